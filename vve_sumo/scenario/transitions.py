"""Changes from one value to another by the shapes that OpenSCENARIO names: how far at a time, and the way until then.

ASAM OpenSCENARIO XML 1.3, DynamicsShape. Arithmetic alone.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

#: greatest slope of each shape over its mean slope: of f(p) = p, 3 p^2 - 2 p^3 and (1 - cos(pi p)) / 2
STEEPEST: Final = {"step": 1.0, "linear": 1.0, "cubic": 1.5, "sinusoidal": 0.5 * math.pi}


class Transition(NamedTuple):
    """From one value to another over a length of time, or of way."""

    before: float
    after: float
    shape: str = "step"
    over: float = 0.0  #: time [s] or way [m] that it takes; 0 is at once

    def at(self, gone: float) -> tuple[float, float]:
        """Return value and slope at a time or way since it began."""
        if not gone < self.over:
            return self.after, 0.0
        part, slope = _shape(self.shape, gone / self.over)
        change = self.after - self.before
        return self.before + change * part, change * slope / self.over

    def integral(self, gone: float) -> float:
        """Return the value's integral from its beginning on."""
        p = min(gone / self.over, 1.0) if self.over > 0.0 else 1.0
        mean = self.over * _integral(self.shape, p)
        rest = max(gone - self.over, 0.0)
        return self.before * (gone - rest) + (self.after - self.before) * mean + self.after * rest


def length(shape: str, change: float, steepest: float) -> float:
    """Return the time that a change takes whose greatest rate is `steepest`."""
    return abs(change) * STEEPEST[shape] / steepest


def _shape(shape: str, p: float) -> tuple[float, float]:
    if shape == "linear":
        return p, 1.0
    if shape == "cubic":
        return p * p * (3.0 - 2.0 * p), 6.0 * p * (1.0 - p)
    return 0.5 - 0.5 * math.cos(math.pi * p), 0.5 * math.pi * math.sin(math.pi * p)


def _integral(shape: str, p: float) -> float:
    if shape == "linear":
        return 0.5 * p * p
    if shape == "cubic":
        return p * p * p * (1.0 - 0.5 * p)
    return 0.5 * p - 0.5 * math.sin(math.pi * p) / math.pi if shape == "sinusoidal" else p
