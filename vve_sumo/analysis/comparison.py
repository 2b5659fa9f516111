"""Two records of the same manoeuvre side by side: a real drive and its virtual twin, or any two.

Knows records and signals; must not know which of the two is the truth. Both are measured alike.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from vve_sumo.analysis.run import Run
from vve_sumo.analysis.similarity import pearson, rms, shift_of, theil_u
from vve_sumo.analysis.units import described
from vve_sumo.errors import ConfigError
from vve_sumo.metrics.drive_data import DriveData
from vve_sumo.metrics.metric import Metric, unit_of
from vve_sumo.metrics.per_drive import PER_DRIVE
from vve_sumo.metrics.table import label_of
from vve_sumo.record.alterations import parts_altered_by_hash
from vve_sumo.record.layout import COMMANDED
from vve_sumo.values import Floats

if TYPE_CHECKING:
    import pandas as pd

TIME, PATH_S = "time_s", "s_m"  #: the two axes: time, and s along the path

#: the event that both records are laid together at: the car's speed first reaches this [m/s]
FIRST_MOTION = 0.5
#: what two records must have in common, from first motion on [s]
MIN_OVERLAP = 1.0
#: between two points along the path [m]
S_STEP = 0.2
#: a shift is looked for this far on either side, if the common stretch is long enough [s], [m]
MAX_SHIFT: Final = {TIME: 2.0, PATH_S: 5.0}

#: signals in order, and the axis that each is compared over: what the path causes over the path, the rest over time
AXES: Final = {
    "speed_mps": TIME,
    "acceleration_mps2": TIME,
    "yaw_rate_radps": TIME,
    "steering_rad": TIME,
    "gap_m": TIME,
    "lateral_deviation_m": PATH_S,
}
#: a gap that closes steadily looks the same however it is shifted
UNSHIFTED: Final = frozenset({"gap_m"})

MEANINGS = {
    "unit": "of the signal, and of rmse, max_error and mean_error",
    "axis": "what the two were laid together by",
    "rmse": "root mean square of other minus one",
    "max_error": "greatest size of other minus one",
    "mean_error": "mean of other minus one",
    "pearson_r": "correlation coefficient at no shift; NaN where one of them does not vary",
    "theil_u": "Theil's U1, 0 for two alike to 1; NaN of no points",
    "shift_s": "how much later the other is, over time; NaN where no shift fits best",
    "shift_m": "how much farther along the path the other is; likewise",
    "n": "points that both had",
}
#: sides of a comparison, and which record each is
SIDES: Final = {"one": "first", "other": "second"}
OUTCOME_MEANINGS = {
    "unit": "of the figure; empty for words",
    "one": "what the first record came to",
    "other": "what the second came to",
    "difference": "other minus one; NaN of words and where one of them has none",
}


@dataclass(frozen=True, slots=True)
class Comparison:
    """Two records compared."""

    one: Run
    other: Run
    true: bool  #: whether both were measured by the truth; else both by the pipeline's estimate
    begin: tuple[float, float]  #: drive time of first motion in each [s]: time 0 of `series`
    signals: pd.DataFrame  #: a row a signal, with the columns of MEANINGS
    outcomes: pd.DataFrame  #: a row a figure: unit, one, other, difference
    series: dict[str, pd.DataFrame]  #: by signal: columns one and other over the axis, NaN where one had none
    notes: tuple[str, ...]  #: what makes the two differ beside the drive, a sentence each


class _Side(NamedTuple):
    """One record, ready to be laid beside another."""

    run: Run
    data: DriveData  #: without the truth where the other has none
    time: Floats  #: from first motion [s]
    s: Floats  #: along the path [m]
    signals: dict[str, Floats]
    begin: float  #: drive time of first motion [s]


def compare(
    one: Run, other: Run, altered: Callable[[Path], Sequence[str] | None] = parts_altered_by_hash
) -> Comparison:
    """Compare two records of drives, laid together at first motion.

    Both are measured by the truth if both have it, else both by the pipeline's estimate, so that an estimator's error
    is no difference between the drives. What the path causes is compared over the path. `altered` names the parts of a
    record that are not as its drive left them, which become notes. Raises ConfigError where one never moves, or where
    they have less than MIN_OVERLAP [s] in common.
    """
    true = one.motion.true and other.motion.true
    first, second = _side(one, true), _side(other, true)
    series = _laid_together(first, second)
    return Comparison(
        one=one,
        other=other,
        true=true,
        begin=(first.begin, second.begin),
        signals=_signals(series),
        outcomes=_outcomes(first, second),
        series=series,
        notes=(*_notes(one, other, true), *_changed((one, other), altered)),
    )


def first_motion(time: Floats, speed: Floats) -> float:
    """Return when a speed first reaches FIRST_MOTION, between two ticks by a straight line [s]; NaN if it never does.

    A record that begins in motion has its first motion at the first tick that knows a speed.
    """
    known = np.flatnonzero(np.isfinite(speed))
    fast = np.flatnonzero(speed[known] >= FIRST_MOTION)
    if not len(fast):
        return math.nan
    i = known[fast[0]]
    if fast[0] == 0:
        return float(time[i])
    before = known[fast[0] - 1]
    share = (FIRST_MOTION - speed[before]) / (speed[i] - speed[before])
    return float(time[before] + share * (time[i] - time[before]))


def _side(run: Run, true: bool) -> _Side:
    ticks = run.arrow("ticks")
    if not true:
        place = ticks.schema.get_field_index("true_x_m")
        ticks = ticks.set_column(place, ticks.schema.field(place), pa.array(np.full(ticks.num_rows, np.nan)))
    prefix = "true_" if true else ""
    data = DriveData(
        ticks, run.arrow("actors"), run.path, run.vehicle, run.period, run.arrow("roads"), run.arrow(COMMANDED)
    )
    signals = {
        "speed_mps": ticks[f"{prefix}speed_mps"].to_numpy(),
        "acceleration_mps2": ticks[f"{prefix}acceleration_mps2"].to_numpy(),
        "yaw_rate_radps": ticks["yaw_rate_radps"].to_numpy(),
        "steering_rad": ticks["measured_steering_rad"].to_numpy(),
        "gap_m": data.lead.gap,
        "lateral_deviation_m": ticks["lateral_deviation_m" if true else "estimated_deviation_m"].to_numpy(),
    }
    begin = first_motion(run.time, signals["speed_mps"])
    if not math.isfinite(begin):
        raise ConfigError(f"{run.folder}: the car never reaches {FIRST_MOTION} m/s: no motion to compare")
    return _Side(run, data, run.time - begin, ticks["s_m"].to_numpy(), signals, begin)


def _laid_together(one: _Side, other: _Side) -> dict[str, pd.DataFrame]:
    """Every signal of both over its axis, on points that both reach."""
    step = max(one.run.period, other.run.period)
    end = min(one.time[-1], other.time[-1])
    if not end >= MIN_OVERLAP:
        raise ConfigError(
            f"{one.run.folder} and {other.run.folder}: from first motion on they have {max(end, 0.0):.2f} s in common, "
            f"expected {MIN_OVERLAP:g} s or more"
        )
    grids = {TIME: np.arange(0.0, end + 1e-9, step), PATH_S: _common_s(one, other)}
    return {name: _pair(one, other, name, axis, grids[axis]) for name, axis in AXES.items()}


def _common_s(one: _Side, other: _Side) -> Floats:
    """Points along the path that both drove over; none where the paths are two."""
    if one.run.resolved["path_m"] != other.run.resolved["path_m"]:
        return np.zeros(0)
    reached = [_onward(side) for side in (one, other)]
    reached_s = [side.s[kept] for side, kept in zip((one, other), reached, strict=True)]
    if not all(len(s) for s in reached_s):
        return np.zeros(0)
    begin, end = max(s[0] for s in reached_s), min(s[-1] for s in reached_s)
    return np.arange(begin, end + 1e-9, S_STEP)


def _onward(side: _Side) -> NDArray[np.intp]:
    """Ticks in motion at which the car is farther along the path than ever before: each s once."""
    s = np.where(side.time >= 0.0, side.s, np.nan)
    known = np.flatnonzero(np.isfinite(s))
    farthest = np.concatenate(([-np.inf], np.maximum.accumulate(s[known])[:-1]))
    return known[s[known] > farthest]


def _pair(one: _Side, other: _Side, name: str, axis: str, grid: Floats) -> pd.DataFrame:
    import pandas as pd

    sides = {"one": one, "other": other}
    sampled = {which: _sampled(side, name, axis, grid) for which, side in sides.items()}
    table = pd.DataFrame(sampled, index=pd.Index(grid, name=axis))
    if name == "gap_m" and len(grid):
        # Gaps to two different actors are two different things.
        leaders = [np.array(side.data.lead.actor, object)[_nearest(side.time, grid)] for side in (one, other)]
        table.loc[leaders[0] != leaders[1], :] = np.nan
    described(table, {which: f"{label_of(name)} of the {order} record" for which, order in SIDES.items()})
    table.attrs["units"] = dict.fromkeys(sides, unit_of(name)) | {axis: unit_of(axis)}
    return table


def _sampled(side: _Side, name: str, axis: str, grid: Floats) -> Floats:
    """A signal at the points of the axis, by straight lines between ticks; NaN beside a tick that has none."""
    kept = np.arange(len(side.time)) if axis == TIME else _onward(side)
    if not len(grid):
        return np.zeros(0)
    along = side.time if axis == TIME else side.s
    return np.interp(grid, along[kept], side.signals[name][kept], left=np.nan, right=np.nan)


def _nearest(time: Floats, grid: Floats) -> NDArray[np.intp]:
    """Index of the tick nearest to each moment."""
    after = np.clip(np.searchsorted(time, grid), 1, len(time) - 1)
    return after - (grid - time[after - 1] < time[after] - grid)


def _signals(series: dict[str, pd.DataFrame]) -> pd.DataFrame:
    import pandas as pd

    rows = {name: _likeness(name, table) for name, table in series.items()}
    table = pd.DataFrame.from_dict(rows, orient="index", columns=list(MEANINGS)).rename_axis("signal")
    return described(table, MEANINGS)


def _likeness(name: str, table: pd.DataFrame) -> dict[str, Any]:
    """The figures of one signal."""
    axis = AXES[name]
    whole = (table["one"].to_numpy(), table["other"].to_numpy())
    both = np.isfinite(whole[0]) & np.isfinite(whole[1])
    one, other = whole[0][both], whole[1][both]
    error = other - one
    points = table.index.to_numpy()
    shift = math.nan
    if len(points) > 2 and name not in UNSHIFTED:
        shift = shift_of(*whole, float(points[1] - points[0]), MAX_SHIFT[axis])
    return {
        "unit": unit_of(name),
        "axis": axis,
        "rmse": rms(error) if len(error) else math.nan,
        "max_error": float(np.abs(error).max()) if len(error) else math.nan,
        "mean_error": float(error.mean()) if len(error) else math.nan,
        "pearson_r": pearson(one, other),
        "theil_u": theil_u(one, other),
        "shift_s": shift if axis == TIME else math.nan,
        "shift_m": shift if axis == PATH_S else math.nan,
        "n": len(error),
    }


def _outcomes(one: _Side, other: _Side) -> pd.DataFrame:
    import pandas as pd

    came_to = [_came_to(side) for side in (one, other)]
    rows = {
        name: {"unit": unit_of(name), "one": value, "other": came_to[1][name], "difference": math.nan}
        for name, value in came_to[0].items()
    }
    for row in rows.values():
        if isinstance(row["one"], float) and isinstance(row["other"], float):
            row["difference"] = row["other"] - row["one"]
    table = pd.DataFrame.from_dict(rows, orient="index", columns=list(OUTCOME_MEANINGS)).rename_axis("figure")
    return described(table, OUTCOME_MEANINGS)


def _came_to(side: _Side) -> dict[str, float | str]:
    """What a drive came to, by the same measures as its summary."""
    run = side.run
    return {
        "outcome": str(run.summary["outcome"]) if run.summary else "killed",
        **{name: _in_words(value) for name, value in PER_DRIVE.measure(side.data).items()},
        **{name: _in_words(_recorded(run, row)) for name, row in run.own_metrics.per_drive.items()},
        "first_motion_s": side.begin,
    }


def _recorded(run: Run, row: Metric) -> float | bool | str:
    """Return what a user's metric said of a drive when it was driven; NaN or no text for nothing."""
    value: float | bool | str | None = None if run.summary is None else run.summary[row.name]
    if value is None:
        return math.nan if row.kind == "float" else ""
    return value


def _in_words(value: float | bool | str) -> float | str:
    if isinstance(value, str):
        return value or "none"
    return ("yes" if value else "no") if isinstance(value, bool) else float(value)


def _notes(one: Run, other: Run, true: bool) -> tuple[str, ...]:
    """What was asked differently, and what the comparison leaves out for it."""
    notes = []
    for what, ours, theirs in (
        ("scenarios", one.name, other.name),
        ("seeds", _stated(one, "seed"), _stated(other, "seed")),
        ("controllers", _stated(one, "controller"), _stated(other, "controller")),
        ("kinds of drive", _kind(one), _kind(other)),
    ):
        if ours != theirs:
            notes.append(f"the {what} differ: {ours} and {theirs}")
    if one.resolved["path_m"] != other.resolved["path_m"]:
        notes.append("the paths differ: nothing is compared over the path")
    if one.vehicle != other.vehicle:
        notes.append("the cars differ in what is declared of them")
    if not true:
        blind = " and ".join(str(run.folder) for run in (one, other) if not run.motion.true)
        notes.append(f"{blind}: no truth in it, so both are measured by the pipeline's estimate")
    notes += [
        f"{run.folder}: the drive was broken off, its record ends early" for run in (one, other) if not run.complete
    ]
    return tuple(notes)


def _changed(runs: Iterable[Run], altered: Callable[[Path], Sequence[str] | None]) -> Iterator[str]:
    for run in runs:
        if parts := altered(run.folder):
            yield f"{run.folder}: changed since the drive: {', '.join(parts)}"


def _stated(run: Run, key: str) -> str:
    value = run.resolved["settings"][key]
    return str(value["name"]) if isinstance(value, dict) else str(value)


def _kind(run: Run) -> str:
    return "live" if run.live else "lockstep"
