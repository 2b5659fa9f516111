"""What each sensor showed of each actor, against what there was to be seen.

Knows a record and plane geometry; must not know what a controller makes of a detection.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vve_sumo.analysis.run import Run
from vve_sumo.analysis.sensed import SensedTable
from vve_sumo.analysis.units import described
from vve_sumo.errors import ConfigError
from vve_sumo.metrics.lead_vehicle import CLOSING_FLOOR
from vve_sumo.metrics.metric import Metric
from vve_sumo.metrics.stopping import AT_REST
from vve_sumo.metrics.table import rows
from vve_sumo.record.layout import ACTOR_COLUMNS
from vve_sumo.sensors.drawing import Boxes, Drawing, FieldOfView, Mounting
from vve_sumo.sensors.echo import Mount, antenna_at, echoes
from vve_sumo.sensors.port import STANDARD
from vve_sumo.sensors.visibility import Sector
from vve_sumo.values import Actors, Floats, Point, Pose, Vehicle

if TYPE_CHECKING:
    import pandas as pd

Truths = NDArray[np.bool_]

#: an acceleration asked for that is harder than this counts as braking [m/s2]; lifting the foot is not braking
BRAKING = -1.0

#: what a sensor showed of an actor; its readings are called scans here
STATISTICS = rows(
    Metric("first_tick", "first tick", "tick at which the first detection came out", kind="int"),
    Metric("first_s", "first seen", "drive time of that tick"),
    Metric(
        "first_range_m",
        "first range",
        "range of the first detection as measured, from the sensor's frame",
    ),
    Metric(
        "first_ttc_s",
        "first TTC",
        "true range over true closing range rate when that was measured; NaN where it did not close in",
    ),
    Metric(
        "scans_visible",
        "scans visible",
        "scans in which a part of it that nothing hid lay in the field of view",
        kind="int",
    ),
    Metric("scans_detected", "scans detected", "scans that detected it", kind="int"),
    Metric(
        "detected_share", "share detected", "of the scans in which it was visible those that detected it", worse="lower"
    ),
    Metric(
        "dropouts",
        "drop-outs",
        "stretches of scans between first and last detection that did not detect it",
        worse="higher",
        kind="int",
    ),
    Metric("dropouts_hidden", "drop-outs, hidden", "those of them in which it was never visible", kind="int"),
    Metric(
        "longest_dropout_s",
        "longest drop-out",
        "from the detection before the longest of them to the one after; 0 without any",
        worse="higher",
    ),
    Metric("range_error_mean_m", "range error, mean", "range measured minus range of the nearest point truly visible"),
    Metric("range_error_std_m", "range error, std", "sample standard deviation of the same"),
    Metric(
        "range_rate_error_mean_mps",
        "range rate error, mean",
        "range rate measured minus the true one of that point, opening positive",
    ),
    Metric("range_rate_error_std_mps", "range rate error, std", "sample standard deviation of the same"),
    Metric(
        "ghosts",
        "ghosts",
        "detections of an actor that the virtual road did not have when they were measured; a false alarm has no name",
        worse="higher",
        kind="int",
    ),
)

#: of them those that need a field of view, points, a range rate, which not every sensor declares: a box is measured by
#: its middle, and the truth is of the nearest point
_OF_VIEW = ("first_ttc_s", "scans_visible", "detected_share", "dropouts_hidden")
_OF_POINTS = ("range_error_mean_m", "range_error_std_m")
_OF_RANGE_RATE = ("range_rate_error_mean_mps", "range_rate_error_std_mps")

BRAKED_MEANINGS = {
    "begin_s": "drive time of the first tick of the stretch",
    "duration_s": "of the stretch, its last tick's period included",
    "hardest_mps2": "the least acceleration asked for",
    "emergency": "whether the emergency layer was asked for",
    "notes": "the controller's own words for what it did, joined by +",
    "detected": "what the newest scans held, joined by +",
}


@dataclass(frozen=True, slots=True)
class _Scans:
    """The readings of a sensor, in the order in which they came out."""

    tick: NDArray[np.int64]  #: at which each came out
    time: Floats  #: drive time of that [s]
    measured: NDArray[np.intp]  #: row of the tick at which it was measured


class DropOuts(NamedTuple):
    """Stretches of scans without a detection, between the first detection and the last."""

    number: int
    hidden: int  #: of these, those in which the actor was never visible
    longest: float  #: from the detection before to the one after [s]; 0 without any, NaN without any detection


def sensor_statistics(run: Run, sensor: str = STANDARD) -> pd.DataFrame:
    """Return a row for each actor that ever was in a sensor's field of view or was detected, the first seen first.

    Visible is the nearest point of its box that lies in the field and that no other box hides, from the rear axle's
    true pose (without a truth: the pipeline's estimate) and the recorded actors at the tick at which the scan was
    measured; errors are measured against that point. A detection of an actor that is not visible from there has no
    error. The columns' meanings are in `attrs`. What a sensor does not declare has no column: without a field of view
    nothing is known to be visible. Raises ConfigError for a sensor that does not say whom it saw (`watching`).
    """
    import pandas as pd

    sensors = watching(run)
    if sensor not in sensors:
        raise ConfigError(
            f"sensor {sensor!r} does not say whom it saw, expected {' or '.join(sensors) or 'another drive'}"
        )
    table = sensors[sensor]
    scans, drawing = _scans(run, table), table.drawing
    truth = pd.DataFrame(_truths(run, scans, drawing), columns=["tick", "actor", "true_range", "true_rate"])
    looks = truth.merge(_detections(run, table, scans), on=["tick", "actor"], how="outer")
    looks = looks.sort_values("tick", kind="stable")
    found = {str(actor): _row(looked, scans) for actor, looked in looks.groupby("actor", sort=False)}
    statistics = {name: metric for name, metric in STATISTICS.items() if name not in _unknown(drawing)}
    made = pd.DataFrame.from_dict(found, orient="index", columns=list(STATISTICS))[[*statistics]]
    return described(made.rename_axis("actor"), statistics)


def _unknown(drawing: Drawing) -> tuple[str, ...]:
    """Return the statistics that a sensor cannot have, for what it does not declare."""
    if drawing.view is None:
        return _OF_VIEW + _OF_POINTS + _OF_RANGE_RATE
    return (_OF_POINTS if isinstance(drawing, Boxes) else ()) + (() if drawing.range_rate else _OF_RANGE_RATE)


def watching(run: Run) -> dict[str, SensedTable]:
    """Return the sensors of a drive that say whom they saw, by name."""
    return {name: table for name, table in run.sensed.items() if table.actors is not None}


def _scans(run: Run, table: SensedTable) -> _Scans:
    # Halfway to the next tick: a time that was written is not looked for by its last bit.
    measured = np.searchsorted(run.time, table.measured - 0.5 * run.period)
    return _Scans(run.arrow("ticks")["tick"].to_numpy()[table.at], table.time, measured)


def braked_for_nothing(run: Run) -> pd.DataFrame:
    """Return a row for each stretch in which the controller braked, a sensor showed something, and the way was free.

    Braking is an emergency, or less than BRAKING asked for, of an engaged car that moves; free is a way without an
    actor in the strip that the ego covers (`DriveData.strip_lead`). It is a list to look at and no verdict: a car
    brakes before a bend and before somebody who is about to step into its way, and `notes` say so.
    """
    import pandas as pd

    columns = ("acceleration_setpoint_mps2", "emergency", "note")
    wanted, emergency, notes = (run.arrow("ticks")[name].to_numpy(zero_copy_only=False) for name in columns)
    alone = np.array([actor == "" for actor in run.data.strip_lead.actor], bool)
    names = _newest_readings(run)
    tempted = alone & np.array([bool(seen) for seen in names], bool)
    braked = run.engaged() & (run.motion.speed > AT_REST) & tempted & (emergency.astype(bool) | (wanted < BRAKING))
    found = [
        {
            "begin_s": run.time[begin],
            "duration_s": float(run.time[end - 1] - run.time[begin]) + run.period,
            "hardest_mps2": float(wanted[begin:end].min()),
            "emergency": bool(emergency[begin:end].any()),
            "notes": "+".join(sorted(set(notes[begin:end]))),
            "detected": "+".join(sorted(set().union(*names[begin:end]))),
        }
        for begin, end in stretches(braked)
    ]
    return described(pd.DataFrame(found, columns=list(BRAKED_MEANINGS)), BRAKED_MEANINGS)


def drop_outs(detected: Truths, visible: Truths, time: Floats) -> DropOuts:
    """Return the drop-outs of one actor; an entry a scan each: was it detected, was it visible, drive time [s]."""
    found = np.flatnonzero(detected)
    if not len(found):
        return DropOuts(0, 0, math.nan)
    before, after = found[:-1][np.diff(found) > 1], found[1:][np.diff(found) > 1]
    hidden = sum(not visible[i + 1 : j].any() for i, j in zip(before, after, strict=True))
    return DropOuts(len(before), int(hidden), float((time[after] - time[before]).max(initial=0.0)))


def stretches(flags: Truths) -> Iterator[tuple[int, int]]:
    """Give (begin, end) of each unbroken run of true entries; end is the entry after the last."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], flags, [False])).astype(np.int8)))
    yield from zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True)


def _row(looked: pd.DataFrame, scans: _Scans) -> dict[str, Any]:
    """The figures of one actor, from a row a scan in which it was visible or detected."""
    found = looked[looked["range"].notna()]
    visible = looked[looked["true_range"].notna()]
    detected_at, visible_at = (np.isin(scans.tick, table["tick"]) for table in (found, visible))
    out = drop_outs(detected_at, visible_at, scans.time)
    range_error, rate_error = found["range"] - found["true_range"], found["rate"] - found["true_rate"]
    visible_scans = int(visible_at.sum())
    return {
        **_first(found, scans),
        "scans_visible": visible_scans,
        "scans_detected": int(detected_at.sum()),
        "detected_share": float((detected_at & visible_at).sum() / visible_scans) if visible_scans else math.nan,
        "dropouts": out.number,
        "dropouts_hidden": out.hidden,
        "longest_dropout_s": out.longest,
        "range_error_mean_m": float(range_error.mean()),
        "range_error_std_m": float(range_error.std()),
        "range_rate_error_mean_mps": float(rate_error.mean()),
        "range_rate_error_std_mps": float(rate_error.std()),
        "ghosts": int((~found["there"].astype(bool)).sum()),
    }


def _first(found: pd.DataFrame, scans: _Scans) -> dict[str, Any]:
    """When and where an actor was first detected."""
    if found.empty:
        return {"first_tick": -1, "first_s": math.nan, "first_range_m": math.nan, "first_ttc_s": math.nan}
    first = found.iloc[0]
    closing = -float(first["true_rate"])
    return {
        "first_tick": int(first["tick"]),
        "first_s": float(scans.time[np.searchsorted(scans.tick, first["tick"])]),
        "first_range_m": float(first["range"]),
        "first_ttc_s": float(first["true_range"]) / closing if closing > CLOSING_FLOOR else math.nan,
    }


def _detections(run: Run, table: SensedTable, scans: _Scans) -> pd.DataFrame:
    """Every detection of the scans, and whether the virtual road had an actor of its name when they were measured."""
    import pandas as pd

    rate = table.drawing.range_rate
    rows = np.diff(table.first)
    columns = {
        "tick": np.repeat(scans.tick, rows),
        "actor": table.rows[str(table.drawing.actor)].to_pandas(),
        "range": table.range,
        "rate": np.full(len(table.range), np.nan) if rate is None else table.rows[rate].to_numpy(),
        "looked": np.repeat(run.arrow("ticks")["tick"].to_numpy()[scans.measured], rows),
    }
    there = run.actors[["tick", "actor"]].drop_duplicates().rename(columns={"tick": "looked"}).assign(there=True)
    joined = pd.DataFrame(columns).merge(there, on=["looked", "actor"], how="left")
    return joined.assign(there=joined["there"].notna())


def _truths(run: Run, scans: _Scans, drawing: Drawing) -> Iterator[tuple[int, str, float, float]]:
    """Scan's tick, actor, range from the sensor's frame [m] and range rate [m/s] of every actor that it could see."""
    view = drawing.view
    if view is None:
        return
    mount = _mount(view.frame, run.vehicle)
    sectors = [Sector(sector.range_m, math.tan(sector.half_angle_rad)) for sector in view.sectors]
    looked = run.arrow("ticks")["tick"].to_numpy()[scans.measured]
    looks = zip(scans.tick.tolist(), _poses(run, scans.measured), _snapshots(run, looked), strict=True)
    for tick, pose, actors in looks:
        if not all(math.isfinite(value) for value in (pose.x, pose.y, pose.heading, pose.speed, pose.yaw_rate)):
            continue
        seen, _refused = echoes(antenna_at(pose, mount, run.vehicle), actors, sectors)
        for echo in seen:
            yield tick, actors.ids[echo.row], _from_frame(drawing, view, echo.range, echo.azimuth), echo.range_rate


def _mount(frame: Mounting, vehicle: Vehicle) -> Mount:
    return Mount(frame.x_m - vehicle.rear_axle_to_bumper, frame.y_m, frame.yaw_rad)


def _from_frame(drawing: Drawing, view: FieldOfView, range_: float, azimuth: float) -> float:
    """Return how far from the origin of a drawing's frame a point is [m] that its field of view has at these."""
    seen_from, direction = view.frame, azimuth + view.frame.yaw_rad
    x = seen_from.x_m - drawing.frame.x_m + range_ * math.cos(direction)
    y = seen_from.y_m - drawing.frame.y_m + range_ * math.sin(direction)
    return math.hypot(x, y)


def _poses(run: Run, at: NDArray[np.intp]) -> Iterator[Pose]:
    """The rear axle's pose at each scan; what nobody recorded of it, slip and grade, is 0."""
    motion, turning = run.motion, run.arrow("ticks")["yaw_rate_radps"].to_numpy()
    columns = (run.time, motion.x, motion.y, motion.heading, motion.speed, turning, motion.acceleration)
    for time, x, y, heading, speed, yaw_rate, acceleration in zip(*(c[at].tolist() for c in columns), strict=True):
        yield Pose(time, Point.REAR_AXLE, x, y, heading, speed, 0.0, yaw_rate, acceleration, 0.0)


def _snapshots(run: Run, ticks: NDArray[np.int64]) -> Iterator[Actors]:
    """The virtual road as each tick looked at it; the table holds the ticks in order."""
    table = run.arrow("actors")
    tick = table["tick"].to_numpy()
    begin, end = np.searchsorted(tick, ticks, "left").tolist(), np.searchsorted(tick, ticks, "right").tolist()
    names = table["actor"].to_numpy(zero_copy_only=False)
    values = [table[name].to_numpy() for name in ACTOR_COLUMNS]
    for i, j in zip(begin, end, strict=True):
        yield Actors(0.0, tuple(names[i:j]), *(value[i:j] for value in values))


def _newest_readings(run: Run) -> list[frozenset[str]]:
    """The names in the newest readings of all sensors together, tick by tick."""
    newest: list[frozenset[str]] = [frozenset()] * len(run.time)
    for table in run.sensed.values():
        seen = [frozenset[str](), *table.actors_of_readings()]
        readings = np.searchsorted(table.at, np.arange(len(run.time)), "right").tolist()
        newest = [names | seen[reading] for names, reading in zip(newest, readings, strict=True)]
    return newest
