"""Gains of the preview steering from a table over speed, such as `vve-sumo study gains` makes one.

It must not know how the gains were found.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Protocol

from vve_sumo.values import Vehicle

from .preview import Gains


class Schedule(Protocol):
    """Gains over speed."""

    def at(self, vehicle: Vehicle, speed: float) -> Gains:
        """Gains at a speed [m/s]."""
        ...


class GainSchedule:
    """Gains from a table over speed, constant beyond both ends.

    Between two rows the look-ahead is straight, and so are the gains times its square: a law that keeps its damping
    over speed has gains that fall with that square.
    """

    def __init__(self, rows: Sequence[tuple[float, float, float, float]]) -> None:
        """Each row is speed [m/s], look-ahead [m], proportional [rad/m] and derivative gain [rad s/m], speed rising.

        Raises ValueError for no rows, for numbers that are not finite or negative, a look-ahead of 0, and for speeds
        that do not rise.
        """
        self.rows = tuple((speed, Gains(*gains)) for speed, *gains in rows)
        speeds = [speed for speed, _gains in self.rows]
        if not self.rows or not all(low < high for low, high in pairwise(speeds)):
            raise ValueError("a gain schedule needs rows of rising speed")
        if not all(0.0 <= number < math.inf for row in rows for number in row) or any(not row[1] for row in rows):
            raise ValueError("a gain schedule needs finite numbers of 0 or more, and look-aheads above 0")

    def at(self, vehicle: Vehicle, speed: float) -> Gains:
        """Gains at a speed [m/s]; the vehicle is the one that the table was made for."""
        low, gains = self.rows[0]
        if not speed > low:
            return gains
        for high, faster in self.rows[1:]:
            if speed < high:
                return _between(gains, faster, (speed - low) / (high - low))
            low, gains = high, faster
        return gains


def _between(slower: Gains, faster: Gains, share: float) -> Gains:
    near, far = slower.look_ahead, faster.look_ahead
    look_ahead = near + share * (far - near)
    slow, fast = (1.0 - share) * near * near, share * far * far
    square = look_ahead * look_ahead
    return Gains(
        look_ahead,
        (slow * slower.proportional + fast * faster.proportional) / square,
        (slow * slower.derivative + fast * faster.derivative) / square,
    )
