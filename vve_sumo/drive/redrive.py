"""Compares, tick by tick, another controller's commands on a record's inputs with the recorded controller's.

The comparison is open loop: the car in the record followed the recorded controller's commands. Pure, apart from the
file that `write` writes.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray
from pyarrow import csv

from vve_sumo.drive.pipeline import TickResult
from vve_sumo.drive.replay import reason_codes
from vve_sumo.errors import ConfigError
from vve_sumo.values import ControlCommand, Floats

#: a controller brakes if it asks for more than this deceleration [m/s2]; less is coasting or holding speed
BRAKING_THRESHOLD: Final = 0.5
#: endings of a table's file
TABLE_SUFFIXES: Final = (".parquet", ".csv")

_WHOSE: Final = ("recorded", "other")
_NUMBERS: Final = ("steering_rad", "acceleration_mps2")
_ANSWER: Final = {
    "steering_rad": pa.float64(),
    "acceleration_mps2": pa.float64(),
    "emergency": pa.bool_(),
    "note": pa.string(),
    "failure": pa.string(),
}
_SCHEMA: Final = pa.schema(
    [("tick", pa.int64()), ("time_s", pa.float64())]
    + [(f"{whose}_{name}", kind) for name, kind in _ANSWER.items() for whose in _WHOSE]
)

#: reason codes of a controller that gave no answer
_FAILURES: Final = ("controller_raised", "controller_wrong_type", "controller_not_finite", "controller_path_invalid")


@dataclass(frozen=True, slots=True)
class ControllerResponse:
    """What one controller did over all its ticks; a time is NaN where the event never came."""

    first_braking_time: float  #: drive time of its first braking [s]
    first_emergency_time: float  #: drive time at which it first asked for the emergency envelope [s]
    notes: tuple[str, ...]  #: its different notes, in the order of first appearance
    first_failure: int | None  #: first tick at which the controller gave no valid command; None where it never failed


@dataclass(frozen=True, slots=True)
class ControllerComparison:
    """Two controllers on the same inputs."""

    ticks: int  #: number of ticks at which both controllers gave a command; only these are compared
    first_difference: int | None  #: first tick at which the commands differ in anything; None where they never do
    greatest: dict[str, float]  #: greatest absolute difference, by "steering_rad" and "acceleration_mps2"
    rms: dict[str, float]  #: root mean square difference, by the same keys
    recorded: ControllerResponse
    other: ControllerResponse


def side_by_side(pairs: Iterable[tuple[dict[str, Any], TickResult]]) -> pa.Table:
    """Return a table with both commands, one row per tick, from recorded rows and another controller's tick results.

    Before the first trusted fix no controller is called: NaN, no note. A failed controller has NaN and a reason code.
    """
    return pa.Table.from_pylist([_row(row, result) for row, result in pairs], schema=_SCHEMA)


def _row(row: dict[str, Any], result: TickResult) -> dict[str, Any]:
    command = result.setpoint or ControlCommand(math.nan, math.nan)
    recorded = (row["steering_setpoint_rad"], row["acceleration_setpoint_mps2"], row["emergency"], row["note"])
    other = (command.steering, command.acceleration, command.emergency, command.note)
    answers = (_answer(recorded, reason_codes(row["faults"])), _answer(other, result.faults))
    short_repr = {
        f"{whose}_{name}": answer[name] for whose, answer in zip(_WHOSE, answers, strict=True) for name in _ANSWER
    }
    return {"tick": row["tick"], "time_s": row["time_s"]} | short_repr


def _answer(answer: tuple[float, float, bool, str], faults: Iterable[str]) -> dict[str, Any]:
    failure = next((code for code in faults if code in _FAILURES), "")
    # After a failure the setpoint held a substitute, not the controller's command.
    return dict(zip(_ANSWER, (math.nan, math.nan, False, "", failure) if failure else (*answer, ""), strict=True))


def comparison_of(table: pa.Table) -> ControllerComparison:
    """Return the comparison of the two controllers in a table of `side_by_side`."""
    tick = table["tick"].to_numpy()
    difference = {
        name: numeric_column(table, f"other_{name}") - numeric_column(table, f"recorded_{name}") for name in _NUMBERS
    }
    both = np.logical_and.reduce([np.isfinite(values) for values in difference.values()])
    differs = np.logical_or.reduce([values != 0.0 for values in difference.values()]) & both
    for name in ("emergency", "note"):
        one, two = (table[f"{whose}_{name}"].to_pylist() for whose in _WHOSE)
        differs |= np.array([a != b for a, b in zip(one, two, strict=True)], bool) & both
    known = {name: values[both] for name, values in difference.items()}
    return ControllerComparison(
        ticks=int(both.sum()),
        first_difference=_first(tick, differs),
        greatest={name: float(np.abs(values).max(initial=0.0)) for name, values in known.items()},
        rms={name: math.sqrt(float(values @ values) / max(len(values), 1)) for name, values in known.items()},
        recorded=_answers(table, "recorded"),
        other=_answers(table, "other"),
    )


def _answers(table: pa.Table, whose: str) -> ControllerResponse:
    time, acceleration = numeric_column(table, "time_s"), numeric_column(table, f"{whose}_acceleration_mps2")
    asked = table[f"{whose}_emergency"].to_numpy(zero_copy_only=False)
    brakes, emergency = _first(time, acceleration < -BRAKING_THRESHOLD), _first(time, asked)
    return ControllerResponse(
        first_braking_time=math.nan if brakes is None else float(brakes),
        first_emergency_time=math.nan if emergency is None else float(emergency),
        notes=tuple(note for note in dict.fromkeys(table[f"{whose}_note"].to_pylist()) if note),
        first_failure=_first(table["tick"].to_numpy(), [code != "" for code in table[f"{whose}_failure"].to_pylist()]),
    )


def _first(values: NDArray[Any], where: Any) -> Any:
    """Return the first of the values where a condition holds, None where it never does."""
    at = np.flatnonzero(where)
    return values[at[0]].item() if len(at) else None


def numeric_column(table: pa.Table, name: str) -> Floats:
    """Return a numeric column."""
    values: Floats = table[name].to_numpy()
    return values


def require_writable(file: Path) -> None:
    """Raise ConfigError where `write` could not write a table: wrong file ending, or no such folder."""
    if file.suffix not in TABLE_SUFFIXES:
        raise ConfigError(f"{file}: expected a name that ends in {' or '.join(TABLE_SUFFIXES)}")
    if not file.absolute().parent.is_dir():
        raise ConfigError(f"{file}: its folder does not exist")


def write(table: pa.Table, file: Path) -> None:
    """Write a table of `side_by_side` as Parquet or CSV, as the file's ending says."""
    if file.suffix == ".csv":
        csv.write_csv(table, file)
    else:
        pq.write_table(table, file, compression="zstd")
