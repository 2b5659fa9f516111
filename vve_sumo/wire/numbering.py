"""Gives each object that a radar sees a number that it keeps from scan to scan, as real radars do on their buses.

Knows detections; it must not know whose they are. What is nearest to where a numbered object was to be expected is that
object again, the closest pairs first.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from vve_sumo.values import Detections

#: an object that was not seen for longer loses its number [s]
MAX_UNSEEN: Final = 0.3
#: an object that is farther from where it was expected is another one: a standing part, and one that grows with the
#: time since it was seen, for what moves across [m], [m/s]
GATE, GATE_SPEED = 2.0, 15.0
#: gains of the filter of an object's range rate and its rate of change: the first as a share, the second by Benedict
#: and Bordner's relation (IRE Transactions on Automatic Control, 1962) of least noise beside least lag. At 20 scans a
#: second, errors of 0.12 m/s a scan become 0.13 m/s2, where their plain slope is 3.4 m/s2; two thirds of a change are
#: there after 0.45 s. `tests/wire/test_numbering.py` holds both
RATE_GAIN: Final = 0.25
ACCELERATION_GAIN: Final = RATE_GAIN**2 / (2.0 - RATE_GAIN)


@dataclass(slots=True)
class _Known:
    """A numbered object, where it was last seen."""

    number: int
    range: float  #: [m]
    azimuth: float  #: [rad]
    range_rate: float  #: [m/s]
    seen: float  #: drive time [s]
    filtered_rate: float  #: of range [m/s]
    filtered_acceleration: float = 0.0  #: rate of change of the range rate [m/s2]

    def follow(self, range_rate: float, passed: float) -> float:
        """Take a range rate [m/s] some time later [s]; return its filtered rate of change [m/s2]."""
        expected = self.filtered_rate + self.filtered_acceleration * passed
        off = range_rate - expected
        self.filtered_rate = expected + RATE_GAIN * off
        self.filtered_acceleration += ACCELERATION_GAIN * off / passed
        return self.filtered_acceleration


@dataclass(frozen=True, slots=True)
class Numbered:
    """The number of a detection, and what its past says."""

    number: int
    new: bool  #: the detection is the object's first
    range_acceleration: float  #: rate of change of the range rate [m/s2], filtered; 0 for a new one


class Numbering:
    """Numbers the detections of one radar after another; numbers are 0 to `count` - 1, the lowest free one first."""

    def __init__(self, count: int) -> None:
        self._free = list(range(count - 1, -1, -1))
        self._known: list[_Known] = []
        self._time = -math.inf

    def step(self, scan: Detections, yaw_rate: float) -> list[Numbered | None]:
        """Return the number of each detection of a scan, None where none is free.

        `yaw_rate` is the car's [rad/s], left positive: standing objects turn the other way. A scan that is not newer
        than the last one begins anew.
        """
        if not scan.time > self._time:
            self._forget(math.inf)
        self._time = scan.time
        self._forget(scan.time)
        points = list(zip(scan.range.tolist(), scan.azimuth.tolist(), scan.range_rate.tolist(), strict=True))
        taken = self._paired(scan.time, points, yaw_rate)
        return [self._numbered(scan.time, point, taken.get(row)) for row, point in enumerate(points)]

    def _forget(self, now: float) -> None:
        for known in [each for each in self._known if now - each.seen > MAX_UNSEEN]:
            self._known.remove(known)
            self._free.append(known.number)
        self._free.sort(reverse=True)

    def _paired(self, now: float, points: list[tuple[float, float, float]], yaw_rate: float) -> dict[int, _Known]:
        """Return the known objects that rows of a scan are, the closest pairs first."""
        pairs = []
        for order, known in enumerate(self._known):
            passed = now - known.seen
            far = max(known.range + known.range_rate * passed, 0.0)
            aside = known.azimuth - yaw_rate * passed
            x, y = far * math.cos(aside), far * math.sin(aside)
            for row, (range_, azimuth, _) in enumerate(points):
                off = math.hypot(range_ * math.cos(azimuth) - x, range_ * math.sin(azimuth) - y)
                if off <= GATE + GATE_SPEED * passed:
                    pairs.append((off, order, row))
        taken: dict[int, _Known] = {}
        used: set[int] = set()
        for _, order, row in sorted(pairs):
            if row not in taken and order not in used:
                taken[row] = self._known[order]
                used.add(order)
        return taken

    def _numbered(self, now: float, point: tuple[float, float, float], known: _Known | None) -> Numbered | None:
        range_, azimuth, range_rate = point
        if known is None:
            if not self._free:
                return None
            known = _Known(self._free.pop(), range_, azimuth, range_rate, now, range_rate)
            self._known.append(known)
            return Numbered(known.number, True, 0.0)
        acceleration = known.follow(range_rate, now - known.seen)
        known.range, known.azimuth, known.range_rate, known.seen = range_, azimuth, range_rate, now
        return Numbered(known.number, False, acceleration)
