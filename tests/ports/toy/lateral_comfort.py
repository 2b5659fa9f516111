"""Metrics of an invented lab, in one file: how hard a drive presses its passengers to the side.

In a scenario or a sweep, `metrics = ["lateral_comfort.py:make"]` measures them; `[criteria]` may then judge by them.
"""

from __future__ import annotations

import math

import numpy as np

from vve_sumo.metrics.drive_data import DriveData
from vve_sumo.metrics.port import Metrics
from vve_sumo.values import Floats

LIMIT = 2.0  # that passengers feel as hard [m/s2]


def lateral_acceleration(drive: DriveData) -> Floats:
    """Return the speed times the yaw rate at every tick [m/s2], left positive."""
    turn: Floats = drive.motion.speed * drive.column("yaw_rate_radps")
    return turn


def greatest(drive: DriveData) -> float:
    """Return the greatest size at any tick; NaN where none is known."""
    size = np.abs(lateral_acceleration(drive))
    return float(np.fmax.reduce(size, initial=math.nan))


def is_hard(drive: DriveData) -> bool:
    """Return whether the limit was exceeded at any tick."""
    return bool((np.abs(lateral_acceleration(drive)) > LIMIT).any())


def make() -> Metrics:
    """Return what this file offers."""
    metrics = Metrics()
    metrics.per_tick.add(
        "lateral_acceleration_mps2", "lateral acceleration", "speed times yaw rate, left positive", lateral_acceleration
    )
    metrics.per_drive.add(
        "max_lateral_acceleration_mps2",
        "maximum lateral acceleration",
        "greatest size of lateral_acceleration_mps2 at any tick",
        greatest,
        worse="higher",
        missing="the car's motion was never known",
    )
    metrics.per_drive.add(
        "hard_turn",
        "hard turn",
        f"whether max_lateral_acceleration_mps2 exceeds {LIMIT:g} m/s²",
        is_hard,
        kind="bool",
        worse="higher",
    )
    return metrics
