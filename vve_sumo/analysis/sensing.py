"""What the radar showed of each actor, against what there was to be seen.

Knows a record and plane geometry; must not know what a controller makes of a detection.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import pyarrow.compute as pc
from numpy.typing import NDArray

from vve_sumo.analysis.run import Run
from vve_sumo.analysis.units import described
from vve_sumo.metrics.lead_vehicle import CLOSING_FLOOR
from vve_sumo.metrics.metric import Metric
from vve_sumo.metrics.stopping import AT_REST
from vve_sumo.metrics.table import rows
from vve_sumo.record.layout import ACTOR_COLUMNS
from vve_sumo.sensors.echo import antenna_at, echoes
from vve_sumo.sensors.radar import from_bumper
from vve_sumo.sensors.radar_settings import RadarSettings
from vve_sumo.sensors.visibility import Sector
from vve_sumo.values import Actors, Floats, Point, Pose

if TYPE_CHECKING:
    import pandas as pd

Truths = NDArray[np.bool_]

#: an acceleration asked for that is harder than this counts as braking [m/s2]; lifting the foot is not braking
BRAKING = -1.0

#: what the radar showed of an actor
STATISTICS = rows(
    Metric("first_tick", "first tick", "tick at which the first detection came out", kind="int"),
    Metric("first_s", "first seen", "drive time of that tick"),
    Metric(
        "first_range_m", "first range", "range of the first detection as measured, from the middle of the front bumper"
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
        "detections of an actor that the street did not have when they were measured; a false alarm has no name",
        worse="higher",
        kind="int",
    ),
)

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
    """The scans, in the order in which they came out."""

    tick: NDArray[np.int64]  #: at which each came out
    time: Floats  #: drive time of that [s]
    measured: NDArray[np.intp]  #: row of the tick at which it was measured


class DropOuts(NamedTuple):
    """Stretches of scans without a detection, between the first detection and the last."""

    number: int
    hidden: int  #: of these, those in which the actor was never visible
    longest: float  #: from the detection before to the one after [s]; 0 without any, NaN without any detection


def radar_statistics(run: Run) -> pd.DataFrame:
    """Return a row for each actor that ever was in the radar's field of view or was detected, the first seen first.

    Visible is the nearest point of its box that lies in the field and that no other box hides, from the rear axle's
    true pose (without a truth: the pipeline's estimate) and the recorded actors at the tick at which the scan was
    measured; errors are measured against that point. A detection of an actor that is not visible from there has no
    error. The columns' meanings are in `attrs`.
    """
    import pandas as pd

    scans = _scans(run)
    truth = pd.DataFrame(_truths(run, scans), columns=["tick", "actor", "true_range", "true_rate"])
    looks = truth.merge(_detections(run, scans), on=["tick", "actor"], how="outer").sort_values("tick", kind="stable")
    found = {str(actor): _row(looked, scans) for actor, looked in looks.groupby("actor", sort=False)}
    table = pd.DataFrame.from_dict(found, orient="index", columns=list(STATISTICS))
    return described(table.rename_axis("actor"), STATISTICS)


def _scans(run: Run) -> _Scans:
    scans = run.arrow("readings").filter(pc.field("sensor") == "radar")
    at = np.searchsorted(run.arrow("ticks")["tick"].to_numpy(), scans["tick"].to_numpy())
    # Halfway to the next tick: a time that was written is not looked for by its last bit.
    measured = np.searchsorted(run.time, scans["measured_s"].to_numpy() - 0.5 * run.period)
    return _Scans(scans["tick"].to_numpy(), run.time[at], measured)


def braked_for_nothing(run: Run) -> pd.DataFrame:
    """Return a row for each stretch in which the controller braked, the radar showed something, and the way was free.

    Braking is an emergency, or less than BRAKING asked for, of an engaged car that moves; free is a way without an
    actor in the strip that the ego covers (`DriveData.strip_lead`). It is a list to look at and no verdict: a car
    brakes before a bend and before somebody who is about to step into its way, and `notes` say so.
    """
    import pandas as pd

    columns = ("acceleration_setpoint_mps2", "emergency", "note")
    wanted, emergency, notes = (run.arrow("ticks")[name].to_numpy(zero_copy_only=False) for name in columns)
    alone = np.array([actor == "" for actor in run.data.strip_lead.actor], bool)
    names = _newest_scan(run)
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
    found = looked[looked["range_m"].notna()]
    visible = looked[looked["true_range"].notna()]
    detected_at, visible_at = (np.isin(scans.tick, table["tick"]) for table in (found, visible))
    out = drop_outs(detected_at, visible_at, scans.time)
    range_error, rate_error = found["range_m"] - found["true_range"], found["range_rate_mps"] - found["true_rate"]
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
        "first_range_m": float(first["range_m"]),
        "first_ttc_s": float(first["true_range"]) / closing if closing > CLOSING_FLOOR else math.nan,
    }


def _detections(run: Run, scans: _Scans) -> pd.DataFrame:
    """Every detection of the scans, and whether the street had an actor of its name when they were measured."""
    found = run.detections[["tick", "actor", "range_m", "range_rate_mps"]]
    found = found[found["tick"].isin(scans.tick)]
    measured = run.arrow("ticks")["tick"].to_numpy()[scans.measured]
    found = found.assign(looked=measured[np.searchsorted(scans.tick, found["tick"])])
    there = run.actors[["tick", "actor"]].drop_duplicates().rename(columns={"tick": "looked"}).assign(there=True)
    joined = found.merge(there, on=["looked", "actor"], how="left")
    return joined.assign(there=joined["there"].notna())


def _truths(run: Run, scans: _Scans) -> Iterator[tuple[int, str, float, float]]:
    """Scan's tick, actor, range from the bumper [m] and range rate [m/s] of every actor that it could see."""
    radar = RadarSettings.model_validate(run.resolved["settings"]["radar"]).config()
    sectors = [Sector(mode.range_max, math.tan(mode.half_angle)) for mode in radar.modes]
    looked = run.arrow("ticks")["tick"].to_numpy()[scans.measured]
    looks = zip(scans.tick.tolist(), _poses(run, scans.measured), _snapshots(run, looked), strict=True)
    for tick, pose, actors in looks:
        if not all(math.isfinite(value) for value in (pose.x, pose.y, pose.heading, pose.speed, pose.yaw_rate)):
            continue
        seen, _refused = echoes(antenna_at(pose, radar.mount, run.vehicle), actors, sectors)
        for echo in seen:
            range_, _azimuth = from_bumper(echo.range, echo.azimuth, radar.mount)
            yield tick, actors.ids[echo.row], range_, echo.range_rate


def _poses(run: Run, at: NDArray[np.intp]) -> Iterator[Pose]:
    """The rear axle's pose at each scan; what nobody recorded of it, slip and grade, is 0."""
    motion, turning = run.motion, run.arrow("ticks")["yaw_rate_radps"].to_numpy()
    columns = (run.time, motion.x, motion.y, motion.heading, motion.speed, turning, motion.acceleration)
    for time, x, y, heading, speed, yaw_rate, acceleration in zip(*(c[at].tolist() for c in columns), strict=True):
        yield Pose(time, Point.REAR_AXLE, x, y, heading, speed, 0.0, yaw_rate, acceleration, 0.0)


def _snapshots(run: Run, ticks: NDArray[np.int64]) -> Iterator[Actors]:
    """The street as each tick looked at it; the table holds the ticks in order."""
    table = run.arrow("actors")
    tick = table["tick"].to_numpy()
    begin, end = np.searchsorted(tick, ticks, "left").tolist(), np.searchsorted(tick, ticks, "right").tolist()
    names = table["actor"].to_numpy(zero_copy_only=False)
    values = [table[name].to_numpy() for name in ACTOR_COLUMNS]
    for i, j in zip(begin, end, strict=True):
        yield Actors(0.0, tuple(names[i:j]), *(value[i:j] for value in values))


def _newest_scan(run: Run) -> list[frozenset[str]]:
    """The names in the newest scan, tick by tick."""
    found = run.detections.groupby("tick")["actor"].agg(frozenset).to_dict()
    newest, names = frozenset[str](), []
    scanned = set(_scans(run).tick.tolist())
    for tick in run.arrow("ticks")["tick"].to_pylist():
        newest = found.get(tick, frozenset()) if tick in scanned else newest
        names.append(newest)
    return names
