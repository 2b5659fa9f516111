"""Relates positions of the pedal sensors to brake torque and throttle opening.

By Dataspeed's `pedal_lut.h` and the ranges of its messages; knows no frames.
"""

from __future__ import annotations

from bisect import bisect_right
from typing import Final

from vve_sumo.laws import clamp
from vve_sumo.vehicle.interface import PEDAL_REST

THROTTLE_TRAVEL_END: Final = 0.80  # pedal sensor of a floored pedal, fraction of its range

_THROTTLE_TRAVEL: Final = THROTTLE_TRAVEL_END - PEDAL_REST

# Brake pedal sensor and the torque it asks for [N m] (pedal_lut.h).
PEDALS: Final = (0.175, 0.246, 0.283, 0.323, 0.330)
TORQUES: Final = (0.0, 816.0, 1832.0, 3316.0, 3412.0)


def _interpolate(value: float, points: tuple[float, ...], results: tuple[float, ...]) -> float:
    """Piecewise linear, flat beyond the ends."""
    if value <= points[0]:
        return results[0]
    if value >= points[-1]:
        return results[-1]
    index = bisect_right(points, value)
    share = (value - points[index - 1]) / (points[index] - points[index - 1])
    return results[index - 1] + share * (results[index] - results[index - 1])


def pedal_to_torque(pedal: float) -> float:
    """Brake torque [N m] that a brake pedal sensor at `pedal` asks for."""
    return _interpolate(pedal, PEDALS, TORQUES)


def torque_to_pedal(torque: float) -> float:
    """Brake pedal sensor that asks for `torque` [N m]; at rest for none."""
    return _interpolate(torque, TORQUES, PEDALS) if torque > 0.0 else PEDAL_REST


def pedal_to_throttle(pedal: float) -> float:
    """Throttle opening, 0 to 1, of an accelerator pedal sensor at `pedal`."""
    return clamp((pedal - PEDAL_REST) / _THROTTLE_TRAVEL, 0.0, 1.0)
