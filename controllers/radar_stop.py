"""Stops for what the radar sees in the way, a chosen gap before it; follows it at a time headway while it moves.

It must not know how the way is steered; braking harder than comfort is the emergency layer's business.
"""

from __future__ import annotations

from .approach import NOWHERE, Goal
from .tracks import Target


class RadarStop:
    """Turns the nearest target into a goal for the approach."""

    def __init__(self, gap: float, time_headway: float) -> None:
        """`gap` to stand at [m], bumper to nearest point; `time_headway` [s] adds to it in motion."""
        self._gap, self._headway = gap, time_headway

    def goal(self, target: Target | None) -> Goal:
        """Where the front bumper shall not pass; an oncoming target counts as standing."""
        if target is None:
            return NOWHERE
        speed = max(target.speed, 0.0)
        return Goal(target.gap - self._gap - self._headway * speed, speed)
