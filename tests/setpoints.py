"""Setpoints for tests: complete, and neutral in what a test does not say."""

from __future__ import annotations

import math
from typing import Any, Final

from vve_sumo.values import Setpoint

_NEUTRAL: Final[dict[str, Any]] = {
    "emergency": False,
    "note": "",
    "sequence": -1,
    "time": math.nan,
    "expires": math.nan,
    "x": math.nan,
    "y": math.nan,
    "heading": math.nan,
    "speed": math.nan,
    "yaw_rate": math.nan,
    "grade": 0.0,
    "faults": (),
    "fallback_path": None,
}


def setpoint(steering: float, acceleration: float, **stamped: Any) -> Setpoint:
    """Return a setpoint that says what is given; what is not stamped is refused by the gateway, as NaN or -1."""
    return Setpoint(steering, acceleration, **(_NEUTRAL | stamped))
