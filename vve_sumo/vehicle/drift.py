"""Finds a receiver that drifts slowly, over the whole way since the comparison began.

A window of some seconds forgets: a drift that is small enough in each window adds up unseen. Here nothing is forgotten.
What honest sensors differ by has four causes that stay the same during a drive: the receiver's heading is misaligned
with the car's, the rear axle slips more or less than the model says, the wheels' radius is off, the receiver is late.
The differences of a whole drive must fit one value of each (set-membership estimation: Milanese and Vicino, Optimal
estimation theory for dynamic systems with set membership uncertainty, Automatica 27, 1991). The module knows no
setpoint, no arming state and no reason codes.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

#: What the differences may be off the values that fit them best: noise of an RTK receiver and what the pose's filter
#: adds [m]. Their sum is assumed to bound it; benchmarks/false_alarms.py raised no alarm in 3.0 h of driving with the
#: noise as declared (seed 1) and in 1.0 h (seed 11).
NOISE: Final = 0.12
RESIDUE: Final = 0.04
#: What misalignment and rolling radius may change by during a drive, as a share of the way: the ground's slope across,
#: a tyre's warmth and slip.
CHANGE: Final = 0.001
MISALIGNMENT: Final = 0.004  # of the receiver's heading, once it is mounted and calibrated: 0.23 deg [rad]
LEVER: Final = 0.1  # by which the receiver sits elsewhere than its mounting says [m]
SLIP_SHARE: Final = 1.0  # of the rear axle's slip angle that the model may be wrong by
# Tolerated age of the receiver's data beyond what their epoch says [s]; it also covers the slip of braking tyres. A
# longer constant delay shows in how the car drives (docs/studies.md): a wider tolerance here would hide false data.
DELAY: Final = 0.30
#: The way on which a receiver is taken to be right: a later drift stands out against what it has taught [m].
LEARNING_DISTANCE: Final = 100.0


def unseen_drift(distance: float) -> float:
    """Return the largest drift [m] that may not have been noticed after a `distance` [m], across or along the way.

    The receiver is taken to be right for the first `LEARNING_DISTANCE` D1. By then each cause is known to
    (NOISE + RESIDUE) / D1 + CHANGE as a share of the way, and what that leaves open is NOISE + RESIDUE and twice CHANGE
    later: (NOISE + RESIDUE) (1 + D / D1) + 2 CHANGE D on a straight way. Each radian of a bend adds up to `LEVER`.
    """
    return (NOISE + RESIDUE) * (1.0 + distance / LEARNING_DISTANCE) + 2.0 * CHANGE * distance


class DriftSample(NamedTuple):
    """Where the receiver and the car's own sensors say that the rear axle is, at the same time."""

    x: float  #: by the receiver [m]
    y: float
    heading: float  #: by the receiver [rad]
    speed: float  #: by the receiver [m/s]
    wheel_speed: float  #: by the wheels [m/s]
    odometer: float  #: driven by the wheels since the start, backwards counts negative [m]


class FeasibleSet:
    """The pairs (a, b) that explain every difference so far: a convex polygon, at first |a| <= `a` and |b| <= `b`."""

    __slots__ = ("_corners",)

    def __init__(self, a: float, b: float) -> None:
        self._corners = [(a, b), (-a, b), (-a, -b), (a, -b)]

    def explain(self, difference: float, p: float, q: float, allowed: float) -> bool:
        """Keep the pairs with |difference - a p - b q| <= `allowed`; False where none is left.

        A value that is not finite cannot be explained.
        """
        if not math.isfinite(difference + p + q):
            return False
        left = self._left(difference, p, q)
        if max(left) > allowed:
            if min(left) > allowed:
                return False
            self._cut([value - allowed for value in left])
            left = self._left(difference, p, q)
        if min(left) < -allowed:
            if max(left) < -allowed:
                return False
            self._cut([-value - allowed for value in left])
        return True

    def _left(self, difference: float, p: float, q: float) -> list[float]:
        """What each corner's pair leaves of the difference, with its sign turned."""
        return [a * p + b * q - difference for a, b in self._corners]

    def _cut(self, values: list[float]) -> None:
        """Keep the part of the polygon where a linear function is not positive, given its `values` at the corners."""
        kept: list[tuple[float, float]] = []
        last, last_value = self._corners[-1], values[-1]
        for corner, value in zip(self._corners, values, strict=True):
            if (value > 0.0) is not (last_value > 0.0):
                share = last_value / (last_value - value)
                kept.append((last[0] + share * (corner[0] - last[0]), last[1] + share * (corner[1] - last[1])))
            if value <= 0.0:
                kept.append(corner)
            last, last_value = corner, value
        self._corners = kept


class DriftCheck:
    """Compares the way by the receiver with the way by the car, sample by sample.

    `slip` is the rear axle's slip angle over its lateral acceleration [rad s2/m], `wheel_speed_tolerance` the share of
    the true speed by which the wheels may be wrong.
    """

    def __init__(self, slip: float, wheel_speed_tolerance: float) -> None:
        self._slip, self._tolerance = slip, wheel_speed_tolerance
        self._last: DriftSample | None = None

    def reset(self) -> None:
        """Begin anew: the way begins with the next sample."""
        self._last = None

    def explain(self, sample: DriftSample) -> bool:
        """Whether one value of each cause explains this sample and all before it; if not, the check begins anew."""
        last, self._last = self._last, sample
        if last is None:
            self._begin(sample)
            return True
        turn = sample.heading - last.heading
        turn = math.remainder(turn, math.tau) if math.isfinite(turn) else math.nan
        middle = last.heading + 0.5 * turn
        cosine, sine = math.cos(middle), math.sin(middle)
        x, y = sample.x - last.x, sample.y - last.y
        ahead, left = x * cosine + y * sine, y * cosine - x * sine
        speed = 0.5 * (last.speed + sample.speed)
        # The rear axle slips outwards in a bend: across the heading, against the lateral acceleration.
        slipped = -self._slip * speed * speed * turn
        self._ahead += ahead
        self._slipped += slipped
        self._left += left - slipped
        self._differs += ahead - (sample.odometer - last.odometer)
        self._driven += abs(ahead)
        self._turned += turn
        # A late receiver is behind by its delay times the mean of the speeds then and now.
        gained = 0.5 * (sample.speed + sample.wheel_speed) - self._first_speed
        allowed = NOISE + CHANGE * self._driven + LEVER * abs(self._turned)
        explained = self._across.explain(self._left, self._ahead, self._slipped, allowed) and self._along.explain(
            self._differs, self._ahead, gained, allowed
        )
        if not explained:
            self._last = None
        return explained

    def _begin(self, sample: DriftSample) -> None:
        self._across = FeasibleSet(MISALIGNMENT, SLIP_SHARE)  # misalignment [rad], share of the slip
        self._along = FeasibleSet(self._tolerance, DELAY)  # share of the way, delay [s]
        self._ahead = self._left = self._slipped = self._differs = self._driven = self._turned = 0.0
        self._first_speed = 0.5 * (sample.speed + sample.wheel_speed)
