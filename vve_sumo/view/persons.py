"""How real people were on the virtual road along a record: where each was thought to be, and how sure that was.

Knows records; nothing of how people are drawn.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vve_sumo.analysis.run import Run
from vve_sumo.people.presence import Presence
from vve_sumo.record.layout import PEOPLE
from vve_sumo.view.words import presence_in_words

#: numbers of a person, as the page has them: middle of the circle that holds the true place with 95 %, its radius, age
#: of the newest believed position, and the heading and the sides of the box that sensors meet; NaN for none
NUMBERS: Final = ("x", "y", "radius", "age", "heading", "length", "width")
#: of a table without a row
_NOTHING: Final[NDArray[np.float64]] = np.zeros(0)


class PersonRows(NamedTuple):
    """People along a record: rows that are sorted by tick."""

    at: NDArray[np.int64]  #: index of the tick
    names: Sequence[str]  #: of the person of each row
    presences: Sequence[str]
    numbers: Mapping[str, NDArray[np.float64]]  #: NUMBERS


def rows_of(run: Run) -> PersonRows:
    """Return the people of a record, each with the box that the record's actors have at the same tick."""
    if not run.holds(PEOPLE):
        return PersonRows(np.zeros(0, np.int64), [], [], dict.fromkeys(NUMBERS, _NOTHING))
    table = run.arrow(PEOPLE)
    time = table["time_s"].to_numpy()
    at = np.clip(np.searchsorted(run.time, time - 0.5 * run.period), 0, len(run.time) - 1)
    # A step of the virtual road that no tick looked at, such as the last one, is shown by none.
    looked_at = np.flatnonzero(np.abs(run.time[at] - time) < 0.5 * run.period)
    order = looked_at[np.argsort(at[looked_at], kind="stable")]
    names = [table["person"].to_pylist()[row] for row in order.tolist()]
    presences = [table["presence"].to_pylist()[row] for row in order.tolist()]
    columns = {"x": "x_m", "y": "y_m", "radius": "radius_m", "age": "age_s"}
    numbers = {name: table[column].to_numpy()[order] for name, column in columns.items()}
    return PersonRows(at[order], names, presences, numbers | _boxes(run, at[order], names))


def changes_of(rows: PersonRows) -> list[tuple[int, str]]:
    """Return every change of how somebody is there: index of the tick and words, in order; nobody is there at first."""
    found = []
    before: dict[str, str] = {}
    for at, name, presence in zip(rows.at.tolist(), rows.names, rows.presences, strict=True):
        if presence != before.get(name, Presence.GONE.name.lower()):
            found.append((at, presence_in_words(name, presence)))
        before[name] = presence
    return found


def _boxes(run: Run, at: NDArray[np.int64], names: Sequence[str]) -> dict[str, NDArray[np.float64]]:
    """Return heading, length and width of the body that each person has at a tick; NaN without one."""
    rows = run.data.actor_rows
    sides = {"heading": rows.boxes.heading, "length": rows.boxes.length, "width": rows.boxes.width}
    found = {name: np.full(len(at), np.nan) for name in sides}
    codes = {name: code for code, name in enumerate(rows.names)}
    there = {(int(rows.at[row]), int(rows.code[row])): row for row in _rows_of_people(run, set(names))}
    for number, (tick, name) in enumerate(zip(at.tolist(), names, strict=True)):
        row = there.get((tick, codes.get(name, -1)))
        if row is not None:
            for side, values in sides.items():
                found[side][number] = values[row]
    return found


def _rows_of_people(run: Run, names: set[str]) -> list[int]:
    rows = run.data.actor_rows
    codes = [code for code, name in enumerate(rows.names) if name in names]
    found: list[int] = np.flatnonzero(np.isin(rows.code, codes)).tolist()
    return found
