"""The metrics of a whole drive: one value each, as `summary.json` and a sweep's row hold them, in their order.

To add one, write its row here with its function: summary, criteria, sweeps, reports, plots and the docs take
it from the table. Reads a drive's tables; neither SUMO nor how the drive was run. A value is NaN where the drive held
nothing to measure.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from vve_sumo.metrics import following
from vve_sumo.metrics.approach import HUNTING, pressed
from vve_sumo.metrics.braked_for import hardest_braking_for, last_stop_for
from vve_sumo.metrics.conflict import HORIZON
from vve_sumo.metrics.crossing_traffic import min_crossing_pet
from vve_sumo.metrics.drive_data import FOLLOWING_SPEED, MIN_FOLLOWED, DriveData
from vve_sumo.metrics.following import MAX_DECELERATION
from vve_sumo.metrics.frequency_weighting import WD, WF
from vve_sumo.metrics.metric import MetricTable
from vve_sumo.metrics.port import Metrics
from vve_sumo.metrics.ride_comfort import AVERAGED, MARGIN, MAX_GAP, RideComfort
from vve_sumo.metrics.slope import SLOPE_REACH
from vve_sumo.metrics.stopping import AT_REST, MIN_RELEASE_TIME, REGAINED, REVERSED, Stop, commanded_deceleration
from vve_sumo.metrics.stopping_tolerance import tolerance
from vve_sumo.metrics.string_stability import SETTLED_FOR, SETTLED_SPEED
from vve_sumo.values import ArmingState, Floats, Vehicle

PER_DRIVE: MetricTable[DriveData] = MetricTable()
metric = PER_DRIVE.add


metric(
    "collision",
    "collision",
    "whether the ego's rectangle overlapped another's at any tick",
    lambda drive: any(drive.ticks["contacts"].to_pylist()),
    kind="bool",
    worse="higher",
)


def _stop_gap(drive: DriveData) -> float:
    speed = drive.motion.speed
    return float(drive.strip_lead.gap[-1]) if len(speed) and abs(speed[-1]) < AT_REST else math.nan


metric(
    "stop_gap_m",
    "gap at rest",
    "at the last tick, if the car stands: front bumper to the nearest part of a box in the strip of the ego's width "
    "around its course, along that; 0 at contact, negative is overlap, none where nothing is within 150 m",
    _stop_gap,
    worse="lower",
    missing="the car did not end at rest with an object ahead",
    actor="braked_for",
)
metric(
    "min_ttc_s",
    "minimum TTC",
    "time to collision: until the ego's body meets an actor's if both keep their speed, the ego along its course and "
    "the actor along its lane or way; the least at any tick, 0 at contact; none where no contact was ever less than "
    f"{HORIZON:g} s away",
    lambda drive: minimum(drive.conflict.time),
    worse="lower",
    source="Hayward 1972",
    absent=math.inf,
    missing="nothing was ever closed in on",
)


def _min_ttc_actor(drive: DriveData) -> str:
    time = drive.conflict.time
    return drive.conflict.actor[int(np.nanargmin(time))] if np.isfinite(time).any() else ""


metric(
    "min_ttc_actor",
    "actor of the minimum TTC",
    "actor that the ego would have met at min_ttc_s; empty for none",
    _min_ttc_actor,
    kind="str",
    criterion=False,
)
metric(
    "max_drac_mps2",
    "maximum DRAC",
    "deceleration rate to avoid a crash that min_ttc_s sees coming: the least constant one of the ego that avoids it, "
    f"the greatest at any tick; counted up to {MAX_DECELERATION:g} m/s², which no road car can do; none as min_ttc_s",
    lambda drive: maximum(drive.conflict.deceleration),
    worse="higher",
    cap=MAX_DECELERATION,
    source="Almqvist, Hydén and Risser 1991",
    absent=0.0,
    missing="nothing was ever closed in on",
)
metric(
    "min_gap_m",
    "minimum gap",
    "least gap at any tick, along the ego's course, to what was in the ego's strip before the path's end and stood, "
    "went the ego's way, or was or had been in conflict with the ego as min_ttc_s sees one; 0 at contact, negative is "
    "overlap, none where nothing ever was",
    lambda drive: minimum(drive.lead.gap),
    worse="lower",
    absent=math.inf,
    missing="nothing was ever ahead",
)
metric(
    "strip_min_ttc_s",
    "minimum TTC in the strip",
    "gap over closing speed to the nearest box in the strip of the ego's width around its course, wherever that goes; "
    "the least at any tick, none where nothing was ever closed in on",
    lambda drive: minimum(drive.strip_lead.time_to_collision),
    worse="lower",
    source="Hayward 1972",
    absent=math.inf,
)
metric(
    "strip_max_drac_mps2",
    "maximum DRAC in the strip",
    "closing speed squared over twice the gap of strip_min_ttc_s, the greatest at any tick; counted up to "
    f"{MAX_DECELERATION:g} m/s²; none as strip_min_ttc_s",
    lambda drive: maximum(drive.strip_lead.required_deceleration),
    worse="higher",
    cap=MAX_DECELERATION,
    source="Almqvist, Hydén and Risser 1991",
    absent=0.0,
)
metric(
    "strip_min_gap_m",
    "minimum gap in the strip",
    "least gap at any tick to the nearest part of a box in the strip of the ego's width around its course, also beyond "
    "the path's end; 0 at contact, negative is overlap, none where nothing ever was",
    lambda drive: minimum(drive.strip_lead.gap),
    worse="lower",
    absent=math.inf,
)


def _speed_amplification(norm: str, drive: DriveData) -> float:
    return float(getattr(drive.speed_amplification, norm))


for name, label, norm, size in (
    ("speed_amplification_l2", "speed amplification, L2", "l2", "root of the sum of squares"),
    ("speed_amplification_linf", "speed amplification, L∞", "linf", "greatest size"),
):
    metric(
        name,
        label,
        f"string stability: {size} of the ego's speed over that of its leader, both counted from the leader's median "
        "speed, in the longest time behind one moving leader from when the ego is settled behind it, which is for "
        f"{SETTLED_FOR:g} s within {SETTLED_SPEED:g} m/s of its speed; above 1 the ego amplifies; none where it never "
        f"settles, below {MIN_FOLLOWED:g} s, or behind a leader of steady speed",
        partial(_speed_amplification, norm),
        worse="higher",
        source="Ploeg, van de Wouw and Nijmeijer 2014",
    )


def _headway_quantile(share: float, drive: DriveData) -> float:
    rows = np.flatnonzero(drive.behind_leader)
    headways = following.headway(drive.lead.gap[rows], drive.motion.speed[rows])
    return float(np.quantile(headways, share)) if len(rows) else math.nan


metric(
    "headway_median_s",
    "median time headway",
    f"gap over the ego's speed behind a leader while both go faster than {FOLLOWING_SPEED:g} m/s, the median of the "
    "ticks; none where the ego followed nobody",
    partial(_headway_quantile, 0.5),
    worse="lower",
)
metric(
    "headway_p05_s",
    "short time headway",
    "as headway_median_s, the headway that a twentieth of the ticks fall short of",
    partial(_headway_quantile, 0.05),
    worse="lower",
)


def impact_speed(drive: DriveData) -> float:
    """Return |v - w|: v the ego's speed, w the velocity of what it touched, projected on the ego's heading.

    NaN where the record ends before it holds what was touched.
    """
    ticks, actors = drive.ticks, drive.actors
    contacts = ticks["contacts"].to_pylist()
    first = next((row for row, names in enumerate(contacts) if names), -1)
    if first < 0:
        return 0.0
    # A tick's row tells of the step that it ended with; what the virtual road then held stands under the next tick.
    tick = actors["tick"].to_numpy()
    later = tick[tick > ticks["tick"][first].as_py()]
    rows = np.flatnonzero(tick == later.min()) if len(later) else np.zeros(0, np.int64)
    touched = np.isin(actors["actor"].take(rows).to_pylist(), contacts[first].split("+"))
    heading, speed = (actors[name].to_numpy()[rows[touched]] for name in ("heading_rad", "speed_mps"))
    relative = ticks["requested_speed_mps"][first].as_py() - speed * np.cos(
        heading - ticks["requested_heading_rad"][first].as_py()
    )
    return maximum(np.abs(relative))


metric(
    "impact_speed_mps",
    "impact speed",
    "relative, at the first contact: size of the ego's speed minus that part of the other's velocity which lies along "
    "the ego's heading, both as the road had them when it found the contact; of several at once the greatest; 0 "
    "without contact",
    impact_speed,
    worse="higher",
    missing="the record ends before it holds what was touched",
)


def _times_named(drive: DriveData, column: str) -> float:
    """Return in how many ticks a column names something; NaN in records without it."""
    if column not in drive.ticks.column_names:
        return math.nan
    return float(sum(1 for name in drive.ticks[column].to_pylist() if name))


metric(
    "red_lights_run",
    "red lights run",
    "how often the front bumper passed a stop line while its signal showed red for the ego's way, by what SUMO showed "
    "in that step; red with yellow is red, none in records that hold no signals",
    lambda drive: _times_named(drive, "red_light"),
    worse="higher",
    missing="the record is of an earlier layout",
)


metric(
    "stop_signs_run",
    "stop signs run",
    "how often the front bumper passed the line of a stop sign without having stood in the 5 m before it, by SUMO's "
    "network, none in records that hold no stop signs",
    lambda drive: _times_named(drive, "stop_sign"),
    worse="higher",
    missing="the record is of an earlier layout",
)


metric(
    "min_crossing_pet_s",
    "minimum post-encroachment time",
    "from when the first one leaves the ground that the ego and an actor both cover to when the second one enters it, "
    "least of all actors whose way crosses the ego's at more than 30°, whoever was first; negative where both were in "
    "it, none where nobody crosses",
    lambda drive: min_crossing_pet(drive.motion.time, drive.ego_boxes, drive.actor_rows),
    worse="lower",
    source="Allen, Shin and Cooper 1978",
    missing="nobody crossed the ego's way",
    absent=math.inf,
)


def _max_lateral_deviation(drive: DriveData) -> float:
    deviation = drive.column("lateral_deviation_m")
    if not np.isfinite(deviation).any():
        deviation = drive.column("estimated_deviation_m")
    return maximum(np.abs(deviation))


metric(
    "max_lateral_deviation_m",
    "maximum lateral deviation",
    "of the true rear axle from the path; of the estimated one where there is no truth",
    _max_lateral_deviation,
    worse="higher",
    missing="the car's place was never known",
)
metric(
    "max_deceleration_mps2",
    "maximum deceleration",
    "of the rear axle along its heading",
    lambda drive: max(0.0, -minimum(drive.motion.acceleration)),
    worse="higher",
    missing="the car's motion was never known",
    actor="hardest_braking_for",
)
metric(
    "max_speed_mps",
    "maximum speed",
    "of the rear axle along its heading",
    lambda drive: maximum(drive.motion.speed),
    criterion=False,
)


#: metrics of how the ride felt to passengers
OF_RIDE: list[str] = []


def _of_ride(name: str, label: str, meaning: str, value: Callable[[RideComfort], float], **rest: Any) -> None:
    """Enter a metric of the ride's comfort; NaN where the drive holds no ride whose accelerations are known."""
    OF_RIDE.append(name)

    def measured(drive: DriveData) -> float:
        return value(drive.ride_comfort) if drive.ride_comfort else math.nan

    missing = "the car did not drive for long enough, or its acceleration was not known throughout"
    metric(name, label, meaning, measured, worse="higher", missing=missing, **rest)


_of_ride(
    "weighted_rms_x_mps2",
    "weighted longitudinal acceleration",
    f"of the rear axle along its heading, weighted with Wd: root mean square from {MARGIN:g} s before the first motion "
    f"to {MARGIN:g} s after the last; none for less than {1.0 / WD.high_pass:g} s, without motion, and where the "
    f"acceleration was not known for longer than {MAX_GAP:g} s",
    lambda felt: felt.longitudinal,
    source="ISO 2631-1",
)
_of_ride(
    "weighted_rms_y_mps2",
    "weighted lateral acceleration",
    "as weighted_rms_x_mps2, across the heading",
    lambda felt: felt.lateral,
    source="ISO 2631-1",
)
_of_ride(
    "weighted_rms_xy_mps2",
    "vibration total value, horizontal",
    "root of the sum of squares of weighted_rms_x_mps2 and weighted_rms_y_mps2; the vertical axis, which is not "
    "simulated, would add to it",
    lambda felt: felt.total,
    source="ISO 2631-1",
)
_of_ride(
    "mtvv_xy_mps2",
    "MTVV, horizontal",
    f"maximum transient vibration value: greatest root mean square over any {AVERAGED:g} s of both weighted "
    "accelerations together; none as weighted_rms_x_mps2",
    lambda felt: felt.max_transient,
    source="ISO 2631-1",
)
_of_ride(
    "msdv_xy_mps1p5",
    "MSDV, horizontal",
    "motion sickness dose value: root of the time integral of the squares of both horizontal accelerations, weighted "
    "with Wf; the standard defines it of vertical motion alone, and no share of sick passengers follows from this one; "
    f"none as weighted_rms_x_mps2, and for less than {1.0 / WF.high_pass:g} s",
    lambda felt: felt.sickness_dose,
    source="ISO 2631-1, of the vertical axis",
)
_of_ride(
    "max_jerk_xy_mps3",
    "maximum horizontal jerk",
    "greatest size of the rate of change of the rear axle's acceleration along and across its heading as one vector: "
    f"slopes of the lines that fit best within ±{SLOPE_REACH} s; none without motion, and where the acceleration was "
    f"not known for longer than {MAX_GAP:g} s",
    lambda felt: felt.max_jerk,
)


#: metrics of the last stop
OF_STOP: list[str] = []


def _of_stop(name: str, label: str, meaning: str, value: Callable[[Stop, Vehicle], float], **rest: Any) -> None:
    """Enter a metric of the last stop; NaN where the drive holds none."""
    OF_STOP.append(name)

    def measured(drive: DriveData) -> float:
        return value(drive.stop, drive.vehicle) if drive.stop else math.nan

    metric(name, label, meaning, measured, criterion=False, **rest)


_of_stop(
    "stop_onset_speed_mps",
    "speed at brake onset",
    "speed at the onset of the last stop, which is the tick that first commanded the braking that ended at rest; none "
    "where the drive holds no commanded stop",
    lambda stop, _vehicle: stop.onset_speed,
)
_of_stop(
    "stop_distance_m",
    "stopping distance",
    "of the last stop, from its onset to rest; none as stop_onset_speed_mps",
    lambda stop, _vehicle: stop.distance,
    worse="higher",
)
_of_stop(
    "stop_bound_m",
    "stopping-distance bound",
    "distance that the car as declared needs for the last stop at most, by the closed form: after its brake delay, "
    "with its brake lag, at the demand",
    lambda stop, vehicle: stop.bound(vehicle),
)
OF_STOP.append("stop_tolerance_m")
metric(
    "stop_tolerance_m",
    "stopping-distance tolerance",
    "distance by which the last stop may exceed its bound without a fault, from what is not known exactly: strength of "
    "the brakes and mass, grade, speed, the tick of the onset; none where the car gained speed on the way",
    lambda drive: tolerance(drive.stop, drive.vehicle, drive.period).total if drive.stop else math.nan,
    criterion=False,
)
_of_stop(
    "stop_demand_mps2",
    "deceleration demand",
    "constant deceleration that stops in the distance which the course granted in the last stop, up to the car's "
    "declared deceleration, would take from the onset's speed",
    lambda stop, _vehicle: stop.demand,
)
_of_stop(
    "stop_reaction_s",
    "brake reaction time",
    "from the onset of the last stop until the car's deceleration begins to rise",
    lambda stop, _vehicle: stop.reaction.duration,
    worse="higher",
)
_of_stop(
    "stop_build_up_s",
    "brake build-up time",
    "from the end of the reaction until the deceleration of the last stop has risen",
    lambda stop, _vehicle: stop.build_up.duration,
    worse="higher",
)
_of_stop(
    "mfdd_mps2",
    "MFDD",
    "mean fully developed deceleration of the last stop, between 80 % and 10 % of the onset's speed",
    lambda stop, _vehicle: stop.mfdd,
    worse="lower",
    source="UN R13-H",
)


def stop_episodes(drive: DriveData) -> int:
    """Return how many braking episodes ended in a release or at rest; the last stop's counts however gentle it was."""
    course, speed, stop = commanded_deceleration(drive.ticks), drive.motion.speed, drive.stop
    return sum(
        (pressed(course, one) or (stop is not None and one.start <= stop.onset < one.end))
        and (one.end < len(course) or bool(abs(speed[-1]) < AT_REST))
        for one in drive.braking_episodes
    )


metric(
    "stop_episodes",
    "braking episodes",
    "how many the drive held that ended in a release or at rest; brakings are one episode unless between them the car "
    f"gained back {100 * REGAINED:g} % of the speed lost, stood for {MIN_RELEASE_TIME:g} s, or was released for "
    f"{MIN_RELEASE_TIME:g} s",
    stop_episodes,
    kind="int",
    criterion=False,
)
metric(
    "approach_distance_m",
    "approach distance",
    "from the first braking episode from which on what the car stopped for stood ahead, to rest; stop_distance_m where "
    "that is the last stop's own; none as stop_onset_speed_mps",
    lambda drive: drive.approach.distance if drive.approach else math.nan,
    criterion=False,
)
metric(
    "approach_duration_s",
    "approach time",
    "of approach_distance_m",
    lambda drive: drive.approach.duration if drive.approach else math.nan,
    criterion=False,
)
metric(
    "hunting_reversals",
    "hunting reversals",
    f"sign changes of the acceleration on the approach, where it exceeds ±{REVERSED:g} m/s²; 0 without a stop",
    lambda drive: drive.approach.reversals if drive.approach else 0,
    kind="int",
    worse="higher",
)
metric(
    "hunting",
    "hunting",
    f"whether hunting_reversals is {HUNTING} or more: on its way to rest the car gained speed and braked again, twice "
    "or more often",
    lambda drive: drive.approach is not None and drive.approach.hunting,
    kind="bool",
    worse="higher",
)
metric(
    "braked_for",
    "braked for",
    "actor that the last stop was for: the one ahead that called for the most deceleration meanwhile; empty for none",
    last_stop_for,
    kind="str",
    criterion=False,
)
metric(
    "hardest_braking_for",
    "braked hardest for",
    "actor that the hardest braking of the drive was for, as braked_for; empty for none",
    hardest_braking_for,
    kind="str",
    criterion=False,
)


def emergency_used(drive: DriveData) -> bool:
    """Whether it braked the car, not merely asked for that while nobody obeyed."""
    engaged, ticks = ArmingState.ENGAGED.value, drive.ticks
    asked = zip(ticks["emergency"].to_pylist(), ticks["state"].to_pylist(), strict=True)
    return any(wanted and state == engaged for wanted, state in asked)


metric("emergency_used", "emergency layer", "whether the emergency layer braked the car", emergency_used, kind="bool")


def _duration(drive: DriveData) -> float:
    time = drive.ticks["time_s"]
    return float(time[-1].as_py() - time[0].as_py()) if drive.ticks.num_rows else 0.0


metric("duration_s", "drive time", "from the first tick to the last", _duration)
metric(
    "ticks",
    "ticks",
    "steps of the drive that the record holds",
    lambda drive: int(drive.ticks.num_rows),
    kind="int",
    criterion=False,
)


def ego_sync_position_error(drive: DriveData) -> float:
    """Greatest error of the ego's place in SUMO."""
    return float(np.fmax.reduce(drive.column("ego_sync_position_error_m"), initial=np.nan))


metric(
    "ego_sync_position_error_m",
    "position error of SUMO's ego",
    "largest distance of SUMO's ego from what was asked of it",
    ego_sync_position_error,
    worse="higher",
    criterion=False,
)
metric(
    "ego_sync_speed_error_mps",
    "speed error of SUMO's ego",
    "largest difference of SUMO's ego from the speed that was asked of it",
    lambda drive: float(np.fmax.reduce(drive.column("ego_sync_speed_error_mps"), initial=np.nan)),
    worse="higher",
    criterion=False,
)


def make() -> Metrics:
    """Return what this file offers to the port of metrics."""
    return Metrics(per_drive=PER_DRIVE)


def minimum(values: Floats) -> float:
    """Return the least finite value; NaN for none."""
    finite = values[np.isfinite(values)]
    return float(finite.min()) if len(finite) else math.nan


def maximum(values: Floats) -> float:
    """Return the greatest finite value; NaN for none."""
    return -minimum(-values)
