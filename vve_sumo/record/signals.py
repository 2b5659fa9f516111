"""Writes and reads `signals.json`: what the signals showed over a drive. Knows nothing of what it is used for."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, Final

from vve_sumo.values import SignalChange

SIGNALS: Final = "signals.json"

#: of each signal by its name: drive times [s] at which its state changed, rising, and the states from then on
Signals = Mapping[str, tuple[list[float], list[str]]]


def signals_text(changes: Iterable[SignalChange]) -> str:
    """Return the content of the file."""
    found: dict[str, tuple[list[float], list[str]]] = {}
    for time, signal, state in changes:
        times, states = found.setdefault(signal, ([], []))
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
