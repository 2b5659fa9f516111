"""Writes and reads what the signals showed over a drive, and what was planned. Knows nothing of what it is used for.

`signals.json` holds the states; the table `signal_plans`, where a sensor sees signals, all that the sensor was handed.
"""

from __future__ import annotations

import json
from bisect import bisect_right
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, Final

from vve_sumo.intersections import SignalPhase
from vve_sumo.record.rows import SignalRow
from vve_sumo.values import SignalChange

SIGNALS: Final = "signals.json"
#: a tick's time in the file and that of a replay differ by less than this [s]
TIME_TOLERANCE: Final = 1e-3

#: of each signal by its name: drive times [s] at which its state changed, rising, and the states from then on
Signals = Mapping[str, tuple[list[float], list[str]]]


def signals_text(changes: Iterable[SignalChange]) -> str:
    """Return the content of the file."""
    found: dict[str, tuple[list[float], list[str]]] = {}
    for time, signal, state, *_ in changes:
        times, states = found.setdefault(signal, ([], []))
        if states[-1:] != [state]:
            times.append(round(time, 3))
            states.append(state)
    return json.dumps(found, indent=1, sort_keys=True) + "\n"


def read_signals(folder: Path) -> Signals:
    """Return what a record's file says; nothing where there is none, or where it is not such a file."""
    try:
        content: Any = json.loads((folder / SIGNALS).read_text(encoding="utf-8"))
        return {
            str(name): ([float(time) for time in times], [str(state) for state in states])
            for name, (times, states) in content.items()
        }
    except (OSError, ValueError, TypeError, AttributeError):
        return {}


def files_of(changes: Iterable[SignalChange]) -> dict[str, str]:
    """Return the content of the files that a drive with these changes has, by their names."""
    kept = tuple(changes)
    if not kept:
        return {}
    return {SIGNALS: signals_text(kept)}


def row_of(change: SignalChange) -> SignalRow:
    """Return a change as a row of the record."""
    return SignalRow(change.time, change.signal, change.state, change.end, json.dumps(change.coming))


def _change_of(row: Mapping[str, Any]) -> SignalChange:
    coming = tuple((str(state), float(duration)) for state, duration in json.loads(row["coming"]))
    return SignalChange(row["time_s"], row["signal"], row["state"], row["end_s"], coming)


class RecordedPlans:
    """What a drive's sensors were handed of the signals, by its record."""

    def __init__(self, changes: Iterable[SignalChange]) -> None:
        self._changes: dict[str, list[SignalChange]] = {}
        for change in changes:
            self._changes.setdefault(change.signal, []).append(change)
        self._times = {name: [change.time for change in own] for name, own in self._changes.items()}

    @classmethod
    def of_rows(cls, rows: Iterable[Mapping[str, Any]]) -> RecordedPlans:
        """Return those of the rows of a record's table."""
        return cls(_change_of(row) for row in rows)

    def phases(self, now: float) -> dict[str, SignalPhase]:
        """Return what the signals showed at drive time `now` [s], and how long at least from then on."""
        newest = {name: bisect_right(times, now + TIME_TOLERANCE) - 1 for name, times in self._times.items()}
        return {name: self._changes[name][row].phase(now) for name, row in newest.items() if row >= 0}
