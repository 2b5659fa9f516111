"""The events of a record, in order: what a viewer jumps to."""

from __future__ import annotations

from typing import Any

import numpy as np

from vve_sumo.analysis.run import Run
from vve_sumo.view.persons import changes_of, rows_of
from vve_sumo.view.words import detection_in_words, state_in_words

#: a change of the gateway's reasons is listed no more often than this [s]
MIN_SPACING = 0.2


def events_of(run: Run) -> list[dict[str, Any]]:
    """Return the events of a record: time [s], kind (state, reason, note, contact, detection, person, end)
    and text."""
    found = [*_states(run), *_notes(run), *_contacts(run), *_detections(run), *_persons(run), *_end(run)]
    return sorted(found, key=lambda event: float(event["time"]))


def _event(time: float, kind: str, text: str) -> dict[str, Any]:
    return {"time": round(float(time), 3), "kind": kind, "text": text}


def _states(run: Run) -> list[dict[str, Any]]:
    ticks = run.arrow("ticks")
    found: list[dict[str, Any]] = []
    before: tuple[str, str] | None = None
    listed = -np.inf
    for time, state, reasons in zip(
        run.time.tolist(), ticks["state"].to_pylist(), ticks["reasons"].to_pylist(), strict=True
    ):
        if before is None or state != before[0]:
            found.append(_event(time, "state", state_in_words(state, reasons)))
            listed = time
        elif reasons != before[1] and time - listed >= MIN_SPACING:
            found.append(_event(time, "reason", state_in_words(state, reasons)))
            listed = time
        else:
            continue
        before = (state, reasons)
    return found


def _notes(run: Run) -> list[dict[str, Any]]:
    """What the controller says of itself, where that changes."""
    notes = run.arrow("ticks")["note"].to_pylist()
    changed = [at for at in range(1, len(notes)) if notes[at] and notes[at] != notes[at - 1]]
    return [_event(run.time[at], "note", f"controller: {notes[at]}") for at in changed]


def _contacts(run: Run) -> list[dict[str, Any]]:
    found, before = [], ""
    for time, contacts in zip(run.time.tolist(), run.arrow("ticks")["contacts"].to_pylist(), strict=True):
        if contacts and contacts != before:
            found.append(_event(time, "contact", f"contact with {contacts.replace('+', ', ')}"))
        before = contacts
    return found


def _detections(run: Run) -> list[dict[str, Any]]:
    """Each sensor's first detection of every actor."""
    return [
        _event(first.time, "detection", detection_in_words(name, first.actor, first.range))
        for name, table in run.sensed.items()
        for first in table.first_sights()
    ]


def _persons(run: Run) -> list[dict[str, Any]]:
    """Every change of how somebody real is on the road."""
    return [_event(run.time[at], "person", text) for at, text in changes_of(rows_of(run))]


def _end(run: Run) -> list[dict[str, Any]]:
    if run.summary is None:
        return [_event(run.time[-1], "end", "the record ends here: the drive was killed")]
    return [_event(run.time[-1], "end", f"end: {run.summary['outcome']}")]
