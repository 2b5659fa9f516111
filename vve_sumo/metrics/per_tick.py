"""The metrics of a drive tick by tick: a column each, in the order of the table of `over_time`.

To add one, write its row here with its function. NaN stands wherever a metric has nothing to say: nothing
ahead, nothing that closes in, no pose. Reads a drive's tables; nothing of who asks.
"""

from __future__ import annotations

import numpy as np

from vve_sumo.metrics import following
from vve_sumo.metrics.drive_data import DriveData
from vve_sumo.metrics.metric import MetricTable
from vve_sumo.metrics.port import Metrics
from vve_sumo.metrics.ride_comfort import AVERAGED, MARGIN
from vve_sumo.metrics.slope import SLOPE_REACH, slope
from vve_sumo.metrics.stopping import AT_REST
from vve_sumo.values import Floats

PER_TICK: MetricTable[DriveData] = MetricTable()
metric = PER_TICK.add


metric("time_s", "drive time", "drive time of the tick", lambda drive: drive.motion.time)
metric(
    "speed_mps",
    "speed",
    "ego's rear axle along its heading, forward positive: the truth where there is one, else the estimate",
    lambda drive: drive.motion.speed,
)
metric("acceleration_mps2", "acceleration", "rate of change of speed_mps", lambda drive: drive.motion.acceleration)
metric(
    "jerk_mps3",
    "jerk",
    f"rate of change of acceleration_mps2: slope of the line that fits best within ±{SLOPE_REACH} s",
    lambda drive: slope(drive.motion.time, drive.motion.acceleration, drive.period),
)


def _weighted(drive: DriveData) -> Floats:
    """Return the running root mean square of the weighted acceleration; NaN at ticks outside the ride."""
    felt, time = drive.ride_comfort, drive.motion.time
    nothing = np.full(len(time), np.nan)
    return nothing if felt is None else np.interp(time, felt.time, felt.running, left=np.nan, right=np.nan)


metric(
    "weighted_acceleration_mps2",
    "weighted acceleration",
    f"root mean square of the last {AVERAGED:g} s of the rear axle's horizontal accelerations, along and across its "
    f"heading, weighted with Wd; from {MARGIN:g} s before the first motion to {MARGIN:g} s after the last",
    _weighted,
    worse="higher",
    source="ISO 2631-1",
)
metric(
    "gap_m",
    "gap",
    "front bumper to the nearest point in the ego's strip, along its course, of what is there before the path's end "
    "and stands, goes the ego's way, or is or was in conflict with the ego; 0 at contact, negative is overlap",
    lambda drive: drive.lead.gap,
    worse="lower",
)
metric(
    "strip_gap_m",
    "gap in the strip",
    "front bumper to the nearest part of a box in the ego's strip, wherever that goes, along the ego's course; 0 at "
    "contact, negative is overlap",
    lambda drive: drive.strip_lead.gap,
    worse="lower",
)
metric(
    "closing_speed_mps",
    "closing speed",
    "ego's speed minus the leader's along the ego's course, closing positive",
    lambda drive: drive.lead.closing_speed,
    worse="higher",
)
metric(
    "leader",
    "lead vehicle",
    "actor that the gap is to; empty where there is none",
    lambda drive: drive.lead.actor,
    kind="str",
)
metric(
    "headway_s",
    "time headway",
    "gap over ego's speed",
    lambda drive: _finite(following.headway(drive.lead.gap, _or_rest(drive.motion.speed))),
    worse="lower",
    source="SUMO's safety device, TGAP",
)
metric(
    "headway_front_s",
    "time headway, front to front",
    "gap and leader's length over ego's speed: front to front",
    lambda drive: _finite(
        following.headway_front(drive.lead.gap, _or_rest(drive.motion.speed), drive.lead_motion.length)
    ),
    worse="lower",
    source="Highway Capacity Manual",
)
metric(
    "ttc_s",
    "TTC",
    "time to collision: until the ego's body meets an actor's, the ego on its course and the actor on its lane or way, "
    "both at their present speed; behind a leader gap over closing speed",
    lambda drive: drive.conflict.time,
    worse="lower",
    source="Hayward 1972",
)
metric(
    "ttc_actor",
    "actor of the TTC",
    "actor of ttc_s; empty where the ego would meet nobody",
    lambda drive: drive.conflict.actor,
    kind="str",
)
metric(
    "strip_ttc_s",
    "TTC in the strip",
    "gap over closing speed to the nearest box in the ego's strip, wherever that goes",
    lambda drive: drive.strip_lead.time_to_collision,
    worse="lower",
    source="Hayward 1972",
)


def _mttc(drive: DriveData) -> Floats:
    lead, closing = drive.lead, drive.motion.acceleration - drive.lead_motion.acceleration
    modified = following.modified_time_to_collision(lead.gap, lead.closing_speed, closing)
    return np.where(lead.gap > 0.0, _finite(modified), np.nan)


metric(
    "mttc_s",
    "modified TTC",
    "time to collision at constant accelerations: smallest positive root of gap - dv t - da t²/2",
    _mttc,
    worse="lower",
    source="Ozbay, Yang, Bartin and Mudigonda 2008",
)
metric(
    "drac_mps2",
    "DRAC",
    "deceleration rate to avoid the crash of ttc_s, braking positive: behind a leader closing speed squared over twice "
    "the gap, before one that crosses the least that stops short of the shared zone or comes there when it is left; "
    f"{following.MAX_DECELERATION:g} stands for that and more, which no road car can do",
    lambda drive: drive.conflict.deceleration,
    worse="higher",
    source="Almqvist, Hydén and Risser 1991",
)
metric(
    "strip_drac_mps2",
    "DRAC in the strip",
    f"closing speed squared over twice the gap of strip_ttc_s; {following.MAX_DECELERATION:g} stands for that and more",
    lambda drive: drive.strip_lead.required_deceleration,
    worse="higher",
    source="Almqvist, Hydén and Risser 1991",
)


def _mdrac(drive: DriveData) -> Floats:
    lead = drive.lead
    needed = following.required_deceleration(lead.gap, lead.closing_speed, drive.vehicle.brake_delay)
    return np.where(lead.closes, np.minimum(needed, following.MAX_DECELERATION), np.nan)


metric(
    "required_deceleration_mps2",
    "MDRAC",
    "closing speed squared over twice the gap of the lead vehicle that the declared dead time of the brakes leaves; "
    f"{following.MAX_DECELERATION:g} stands for that and more",
    _mdrac,
    worse="higher",
    source="SUMO's safety device, MDRAC",
)
metric(
    "rss_distance_m",
    "RSS safe distance",
    "least safe gap of Responsibility-Sensitive Safety for two cars that go the same way, with the cautious parameters "
    "that Intel's library proposes",
    lambda drive: following.rss_distance(_or_rest(drive.motion.speed), _or_rest(drive.lead_motion.speed)),
    source="Shalev-Shwartz, Shammah and Shashua 2017",
)
metric(
    "rss_following_distance_m",
    "RSS safe distance, ordinary following",
    "rss_distance_m with the reaction time and braking of UN R157's competent and careful driver: 0.75 s, 0.774 g of "
    "both, no acceleration meanwhile",
    lambda drive: following.rss_distance(
        _or_rest(drive.motion.speed), _or_rest(drive.lead_motion.speed), following.RSS_FOLLOWING
    ),
    source="Shalev-Shwartz, Shammah and Shashua 2017; UN R157",
)
metric(
    "ttc_2d_s",
    "TTC of boxes",
    "least time until the ego's box touches an actor's, both going on steadily; 0 at overlap",
    lambda drive: drive.first_touch[0],
    worse="lower",
)
metric(
    "ttc_2d_actor",
    "actor of the TTC of boxes",
    "actor of ttc_2d_s; empty where no box would be touched",
    lambda drive: drive.first_touch[1],
    kind="str",
)
metric(
    "lateral_deviation_m",
    "lateral deviation",
    "rear axle from the path, left positive",
    lambda drive: drive.tracking.lateral_deviation,
)
metric(
    "heading_error_rad",
    "heading error",
    "ego's heading minus the path's, left positive",
    lambda drive: drive.tracking.heading_error,
)
metric(
    "pose_age_s",
    "pose age",
    "tick minus epoch of the newest trusted fix",
    lambda drive: drive.column("pose_age_s"),
    worse="higher",
)


def make() -> Metrics:
    """Return what this file offers to the port of metrics."""
    return Metrics(per_tick=PER_TICK)


def _or_rest(speed: Floats) -> Floats:
    """Return speeds, 0 where the car is at rest."""
    return np.where(np.abs(speed) < AT_REST, 0.0, speed)


def _finite(values: Floats) -> Floats:
    return np.where(np.isfinite(values), values, np.nan)
