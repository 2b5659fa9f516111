"""A drive's safety measures tick by tick, and what they add up to.

Reads a run and applies the measures of the rooms beside it; it must not know what anybody draws or writes of them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vve_sumo.analysis.run import Run
from vve_sumo.analysis.units import described, unit_of
from vve_sumo.errors import ConfigError
from vve_sumo.metrics import drive_metrics, following
from vve_sumo.metrics.boxes import Boxes, time_to_collision_of_boxes
from vve_sumo.metrics.crossing import Encroachment, encroachment, time_to_collision_zone
from vve_sumo.metrics.drive_metrics import HORIZON, locate
from vve_sumo.metrics.stopping import AT_REST
from vve_sumo.metrics.tracking import WINDOW, Tracking, track
from vve_sumo.values import Floats

if TYPE_CHECKING:
    import pandas as pd

Indices = NDArray[np.int64]

#: a rate of change is the slope of the straight line that fits best from this long before to this long after [s]
SLOPE_REACH = 0.1

MEANINGS = {
    "time_s": "drive time of the tick",
    "speed_mps": "ego's rear axle along its heading, forward positive: the truth where there is one, else the estimate",
    "acceleration_mps2": "rate of change of speed_mps",
    "jerk_mps3": f"rate of change of acceleration_mps2: slope of the line that fits best within ±{SLOPE_REACH} s",
    "gap_m": "front bumper to the nearest box in the ego's strip, along the path; negative is overlap",
    "closing_speed_mps": "ego's speed minus the leader's along the path, closing positive",
    "leader": "actor that the gap is to; empty where there is none",
    "headway_s": "gap over ego's speed",
    "headway_front_s": "gap and leader's length over ego's speed: front to front",
    "ttc_s": "gap over closing speed",
    "mttc_s": "smallest positive root of gap - dv t - da t²/2",
    "drac_mps2": "closing speed squared over twice the gap, braking positive",
    "required_deceleration_mps2": "the same after the declared dead time of the brakes; inf where that uses up the gap",
    "rss_distance_m": "least safe gap of Responsibility-Sensitive Safety for two cars that go the same way",
    "ttc_2d_s": "least time until the ego's box touches an actor's, both going on steadily; 0 at overlap",
    "ttc_2d_actor": "actor of ttc_2d_s; empty where no box would be touched",
    "lateral_deviation_m": "rear axle from the path, left positive",
    "heading_error_rad": "ego's heading minus the path's, left positive",
    "pose_age_s": "tick minus epoch of the newest trusted fix",
}

EXPOSURE = {
    "tet_s": f"time with ttc_s below {following.TTC_THRESHOLD} s",
    "tit_s2": f"by how much ttc_s lay below {following.TTC_THRESHOLD} s, summed over time",
    "cpi_share": "share of the time with drac_mps2 above the declared deceleration limit",
    "rss_share": "share of the time with gap_m below rss_distance_m",
    "max_jerk_mps3": "greatest size of jerk_mps3",
    "rms_jerk_mps3": "root mean square of jerk_mps3",
    "rms_acceleration_mps2": "root mean square of acceleration_mps2",
}


class _Leader(NamedTuple):
    """What is ahead, tick by tick; NaN where there is nothing."""

    length: Floats  #: [m]
    speed: Floats  #: along the path, away from the ego positive [m/s]
    acceleration: Floats  #: likewise [m/s2]


class _Cast(NamedTuple):
    """The rows of the table of actors that belong to a tick of the record."""

    at: Indices  #: index of the tick
    code: Indices  #: number of the actor, an index of `names`
    names: list[str]
    boxes: Boxes  #: a row each


def over_time(run: Run) -> pd.DataFrame:
    """Return the safety measures of a run, a row a tick; `attrs` hold unit and meaning of every column.

    NaN wherever a measure has nothing to say: nothing ahead, nothing that closes in, no pose. `ttc_s` and `drac_mps2`
    are those of the drive's own figures, so that their extremes are `min_ttc_s` and `max_drac_mps2` of the summary.
    `attrs["deceleration_limit_mps2"]` is what was declared of the car.
    """
    import pandas as pd

    motion, seen, cast = run.motion, run.ahead, _cast(run)
    tracking = _tracking(run)
    touch, touched = _nearest_touch(run, cast)
    columns = {
        "time_s": motion.time,
        "speed_mps": motion.speed,
        "acceleration_mps2": motion.acceleration,
        "jerk_mps3": slope(motion.time, motion.acceleration, run.period),
        "gap_m": seen.gap,
        "closing_speed_mps": seen.closing_speed,
        "leader": seen.actor,
        **_following(run, _leader(run, cast)),
        "ttc_2d_s": touch,
        "ttc_2d_actor": touched,
        "lateral_deviation_m": tracking.lateral_deviation,
        "heading_error_rad": tracking.heading_error,
        "pose_age_s": run.arrow("ticks")["pose_age_s"].to_numpy(),
    }
    index = pd.Index(run.arrow("ticks")["tick"].to_numpy(), name="tick")
    frame = described(pd.DataFrame(columns, index=index), MEANINGS)
    frame.attrs["deceleration_limit_mps2"] = run.vehicle.deceleration_limit
    return frame


def exposure(frame: pd.DataFrame) -> pd.Series:
    """Return what a table of `over_time`, or a stretch of it, adds up to; `attrs` hold units and meanings.

    Each tick holds until the next. A tick at which nothing closes in, or nothing is known, counts as time without
    exposure. A share is NaN where the stretch takes no time. Raises ConfigError for a table that no longer says what
    the car can do.
    """
    import pandas as pd

    limit = frame.attrs.get("deceleration_limit_mps2")
    if limit is None:
        raise ConfigError("exposure: expected a table of over_time with its attrs, this one has lost them")
    time, ttc = frame["time_s"].to_numpy(), frame["ttc_s"].to_numpy()
    shortfall = (frame["rss_distance_m"] - frame["gap_m"]).to_numpy()
    jerk, acceleration = frame["jerk_mps3"], frame["acceleration_mps2"]
    values = {
        "tet_s": following.time_exposed(time, ttc),
        "tit_s2": following.time_integrated(time, ttc),
        "cpi_share": following.crash_potential_index(time, frame["drac_mps2"].to_numpy(), limit),
        "rss_share": following.crash_potential_index(time, shortfall, 0.0),
        "max_jerk_mps3": float(jerk.abs().max()),
        "rms_jerk_mps3": float((jerk**2).mean() ** 0.5),
        "rms_acceleration_mps2": float((acceleration**2).mean() ** 0.5),
    }
    series = pd.Series(values, name="exposure")
    series.attrs.update(units={name: unit_of(name) for name in values}, meanings=dict(EXPOSURE))
    return series


def encroachment_of(run: Run, actor: str) -> Encroachment:
    """Return when the ego (`one`) and an actor were in the area that both of them covered, in drive time [s].

    Meant for ways that cross: of two that follow each other the area is the whole lane. Raises ConfigError for an actor
    that the record does not hold.
    """
    rows, cast = _rows_of(run, actor)
    boxes = cast.boxes.taken(rows)
    return encroachment(run.time, _ego(run), run.time[cast.at[rows]], boxes)


def zone_times(run: Run, actor: str) -> pd.DataFrame:
    """Return the times to the zone where the lanes of ego and actor cross, a row a tick that holds the actor.

    As `time_to_collision_zone` has it, the ego's lane straight along its heading. Raises ConfigError as
    `encroachment_of` does.
    """
    import pandas as pd

    rows, cast = _rows_of(run, actor)
    at = cast.at[rows]
    passages = time_to_collision_zone(_ego(run).taken(at), cast.boxes.taken(rows))
    names = ("ego_reaches_s", "ego_leaves_s", "actor_reaches_s", "actor_leaves_s")
    columns = {"time_s": run.time[at], **dict(zip(names, passages, strict=True)), "difference_s": passages.difference}
    index = pd.Index(run.arrow("ticks")["tick"].to_numpy()[at], name="tick")
    meanings = {name: f"from now until it {name.split('_')[1]} the zone" for name in names}
    meanings |= {"time_s": MEANINGS["time_s"], "difference_s": "ego_reaches_s minus actor_reaches_s"}
    return described(pd.DataFrame(columns, index=index), meanings)


def slope(time: Floats, values: Floats, period: float) -> Floats:
    """Return the rate of change of values [1/s]: slope of the least-squares line over SLOPE_REACH to either side.

    The window is counted in ticks of `period` [s], the slope is of the times as they are. Exact of a parabola on even
    times. NaN where the window reaches beyond the ends or holds a NaN.
    """
    reach = max(1, round(SLOPE_REACH / period))
    answer = np.full(len(values), np.nan)
    if len(values) > 2 * reach:
        times = np.lib.stride_tricks.sliding_window_view(time, 2 * reach + 1)
        windows = np.lib.stride_tricks.sliding_window_view(values, 2 * reach + 1)
        lever = times - times.mean(axis=1, keepdims=True)
        answer[reach:-reach] = (lever * windows).sum(axis=1) / (lever * lever).sum(axis=1)
    return answer


def _following(run: Run, leader: _Leader) -> dict[str, Floats]:
    """Return the columns that tell of the leader; NaN is wherever one has nothing to say."""
    motion, seen = run.motion, run.ahead
    gap, closing = seen.gap, seen.closing_speed
    speed = np.where(np.abs(motion.speed) < AT_REST, 0.0, motion.speed)
    drac = drive_metrics.deceleration_to_avoid(seen)
    modified = following.modified_time_to_collision(gap, closing, motion.acceleration - leader.acceleration)
    needed = following.deceleration_to_avoid(gap, closing, run.vehicle.brake_delay)
    leader_speed = np.where(np.abs(leader.speed) < AT_REST, 0.0, leader.speed)
    return {
        "headway_s": _finite(following.headway(gap, speed)),
        "headway_front_s": _finite(following.headway_front(gap, speed, leader.length)),
        "ttc_s": drive_metrics.time_to_collision(seen),
        "mttc_s": np.where(gap > 0.0, _finite(modified), np.nan),
        "drac_mps2": drac,
        "required_deceleration_mps2": np.where(np.isnan(drac), np.nan, needed),
        "rss_distance_m": following.rss_distance(speed, leader_speed),
    }


def _finite(values: Floats) -> Floats:
    return np.where(np.isfinite(values), values, np.nan)


def _tracking(run: Run) -> Tracking:
    motion = run.motion
    return track(run.path, motion.x, motion.y, motion.heading, run.arrow("ticks")["station_m"].to_numpy())


def _ego(run: Run) -> Boxes:
    """Return the ego's boxes, a row a tick."""
    motion, car = run.motion, run.vehicle
    ahead = car.rear_axle_to_bumper - 0.5 * car.length
    x, y = motion.x + ahead * np.cos(motion.heading), motion.y + ahead * np.sin(motion.heading)
    length, width = np.full_like(x, car.length), np.full_like(x, car.width)
    return Boxes(x, y, motion.heading, length, width, motion.speed)


def _cast(run: Run) -> _Cast:
    table = run.arrow("actors")
    at = drive_metrics.index_of_tick(run.arrow("ticks"), table)
    rows = np.flatnonzero(at >= 0)
    names = table["actor"].combine_chunks().dictionary_encode()
    columns = ("x_m", "y_m", "heading_rad", "length_m", "width_m", "speed_mps")
    boxes = Boxes(*(table[column].to_numpy()[rows] for column in columns))
    code = names.indices.to_numpy()[rows].astype(np.int64)
    return _Cast(at[rows], code, names.dictionary.to_pylist(), boxes)


def _rows_of(run: Run, actor: str) -> tuple[Indices, _Cast]:
    cast = _cast(run)
    if actor not in cast.names:
        raise ConfigError(f"{run.folder}: no actor {actor}: it holds {', '.join(sorted(cast.names)) or 'none'}")
    return np.flatnonzero(cast.code == cast.names.index(actor)), cast


def _leader(run: Run, cast: _Cast) -> _Leader:
    """Return length, speed and acceleration of the actor ahead, tick by tick.

    Its acceleration comes from its own speeds, also from before it was ahead.
    """
    numbers = {name: number for number, name in enumerate(cast.names)}
    wanted = np.array([numbers.get(name, -1) for name in run.ahead.actor], np.int64)
    rows = np.flatnonzero(cast.code == wanted[cast.at])
    acceleration = np.full(len(cast.at), np.nan)
    for code in np.unique(cast.code[rows]):
        own = np.flatnonzero(cast.code == code)
        acceleration[own] = slope(run.time[cast.at[own]], cast.boxes.speed[own], run.period)
    at, boxes = cast.at[rows], cast.boxes.taken(rows)
    along = np.cos(boxes.heading - _path_heading(run, at, boxes))
    leader = _Leader(*(np.full(len(run.time), np.nan) for _ in _Leader._fields))
    leader.length[at] = boxes.length
    leader.speed[at] = boxes.speed * along
    leader.acceleration[at] = acceleration[rows] * along
    return leader


def _path_heading(run: Run, at: Indices, boxes: Boxes) -> Floats:
    """Return the path's heading [rad] beside boxes that stand ahead of the ego at these ticks."""
    own = run.arrow("ticks")["station_m"].to_numpy()[at]
    _, _, heading = locate(run.path, boxes.x, boxes.y, own + 0.5 * HORIZON, 0.5 * HORIZON + 3.0 * WINDOW)
    return heading


def _nearest_touch(run: Run, cast: _Cast) -> tuple[Floats, list[str]]:
    """Return the least time to collision of boxes, tick by tick, and with whom; NaN and empty for none."""
    times = time_to_collision_of_boxes(_ego(run).taken(cast.at), cast.boxes)
    least, names = np.full(len(run.time), np.inf), [""] * len(run.time)
    np.fmin.at(least, cast.at, times)
    rows = np.flatnonzero(np.isfinite(times) & (times == least[cast.at]))
    for at, code in zip(cast.at[rows].tolist(), cast.code[rows].tolist(), strict=True):
        names[at] = cast.names[code]
    return _finite(least), names
