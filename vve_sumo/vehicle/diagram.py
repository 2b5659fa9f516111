"""Draws the arming table as a diagram for the documents."""

from __future__ import annotations

from vve_sumo.values import ArmingState
from vve_sumo.vehicle.arming import TRANSITIONS


def mermaid() -> str:
    """Return the table as a Mermaid state diagram: one arrow for each pair of different states."""
    lines = ["stateDiagram-v2", f"    [*] --> {ArmingState.DISARMED}"]
    for state, row in TRANSITIONS.items():
        arrows: dict[ArmingState, list[str]] = {}
        for event, after in row.items():
            arrows.setdefault(after, []).append(event)
        lines += [f"    {state} --> {after}: {', '.join(events)}" for after, events in arrows.items() if after != state]
    return "\n".join(lines)
