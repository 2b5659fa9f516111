"""Finds a module's report that stays the same although the command that it should repeat has changed.

Brake and throttle reports repeat the command that the module has understood. A frozen report hides a driver's foot and
a module that has dropped out, so it is a reason to stop. Knows no frames and commands nothing.
"""

from __future__ import annotations

import math
from typing import Final

from vve_sumo.vehicle.setpoint_validation import Debounce

# From a command to the report that repeats it: a step, the frame, the module's 20 ms, and as much again [s].
ECHO_TIME: Final = 0.1
# Change of the command that a report must show. A quarter of a light braking, larger than the rounding of any wire and
# than what a module cuts off at its own limit.
TORQUE_CHANGE: Final = 250.0  # [N m]
OPENING_CHANGE: Final = 0.04  # of the throttle, 0 to 1


class CommandEcho:
    """Compares the command of a module with the one that it reports; `change` is that of the command, in its unit."""

    def __init__(self, change: float) -> None:
        self._change = change
        self._differs_long = Debounce(ECHO_TIME)
        self.reset()

    def reset(self) -> None:
        """Forget the past: nothing is commanded."""
        self._echo = math.nan  # so that the next report counts as changed, and the time from then on
        self._reference = math.nan  # the command when the report last changed

    def step(self, now: float, commanded: float, echo: float) -> bool:
        """Return whether the report is frozen; `echo` is NaN where there is none, or none that is fresh."""
        if echo != self._echo:
            self._echo, self._reference = echo, commanded
        return self._differs_long.step(now, abs(commanded - self._reference) > self._change)
