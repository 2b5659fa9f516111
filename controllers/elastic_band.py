"""`follow_and_stop` that steers around what is in its way, by an elastic band; the keys are those of `steer_around`.

The way ahead is a band of nodes beside the path. Forces act on it: the path attracts it, it resists bending and change
of bending, and bodies and the road's edges push it off. Where all forces balance, the band is the way. Elastic bands
are of Quinlan and Khatib (*IEEE International Conference on Robotics and Automation*, 802, 1993).

The forces act on the cubic spline through the nodes, which is the curve that the car follows. The unknowns are its
coefficients of uniform B-splines; an offset, a slope, a curvature and a change of curvature are sums of three or four
neighbours (C. de Boor, *A Practical Guide to Splines*, 1978).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np

from vve_sumo.controller import Tuning
from vve_sumo.values import Vehicle

from .follow_and_stop import FollowAndStop
from .free_space import Room
from .lateral_plan import SLOWEST, LateralPlan, Task, times_at, within_limits
from .steer_around import TUNING, controller

#: with which the band leaves its path and returns to it, where nothing pushes it [s]
TIME: Final = 0.75
#: Against lateral speed [s2], acceleration [s4] and jerk [s6], the attraction of the path being 1 for each metre: the
#: square of (1 + T s)^3, so that the band dies out with three equal time constants and swings over nowhere.
TENSION, BENDING, CHANGE = 3.0 * TIME**2, 3.0 * TIME**4, TIME**6
END: Final = 100.0  #: of what keeps the end of the band parallel to the path, as TENSION
PUSH: Final = 3e4  #: of a body for each metre that the band is too near to it
STIFF: Final = 3e3  #: of what resists acceleration and jerk beyond their limits, as for those within
TRIALS: Final = 24  #: places of the band that are looked at, at most
LEAST_STEP: Final = 0.02  #: share of a step that is not halved any more
HELD: Final = 1e10  #: of what holds the offsets that are not to be changed, and the curvature of the end pieces
WIDTH: Final = 4  #: of the band matrix: a coefficient feels three on either side

# Of the coefficients around a node, or from the one before a piece on: its offset, the piece's mean slope times the
# spacing, the second derivative times its square, and the piece's third derivative times its cube.
_OFFSET: Final = (1.0 / 6.0, 4.0 / 6.0, 1.0 / 6.0)
_SLOPE: Final = (-1.0 / 6.0, -0.5, 0.5, 1.0 / 6.0)
_SECOND: Final = (1.0, -2.0, 1.0)
_THIRD: Final = (-1.0, 3.0, -3.0, 1.0)


class Springs:
    """Springs between the coefficients of a band, as linear equations in them: a matrix of few diagonals."""

    __slots__ = ("diagonals", "right")

    def __init__(self, count: int) -> None:
        """Begin without any, on so many coefficients."""
        self.diagonals = [np.zeros(count) for _ in range(WIDTH)]
        self.right = np.zeros(count)

    def add(self, first: int, stencil: Sequence[float], weight: np.ndarray, aim: np.ndarray) -> None:
        """Add one spring each from the coefficients from `first` on, that draws a stencil's sum over them to an aim."""
        count = len(weight)
        for place, factor in enumerate(stencil):
            own = slice(first + place, first + place + count)
            pull = weight * factor
            self.right[own] += pull * aim
            for other in range(place, len(stencil)):
                self.diagonals[other - place][own] += pull * stencil[other]

    def balance(self) -> list[float]:
        """Return the coefficients at which all forces balance (Cholesky's decomposition, no roots)."""
        main, one, two, three = (diagonal.tolist() for diagonal in self.diagonals)
        right = self.right.tolist()
        count = len(main)
        for row in range(count):
            pivot = main[row]
            a, b, c = one[row], two[row], three[row]
            if row + 1 < count:
                factor = a / pivot
                main[row + 1] -= factor * a
                one[row + 1] -= factor * b
                two[row + 1] -= factor * c
                right[row + 1] -= factor * right[row]
            if row + 2 < count:
                factor = b / pivot
                main[row + 2] -= factor * b
                one[row + 2] -= factor * c
                right[row + 2] -= factor * right[row]
            if row + 3 < count:
                factor = c / pivot
                main[row + 3] -= factor * c
                right[row + 3] -= factor * right[row]
        right += [0.0] * (WIDTH - 1)
        for row in range(count - 1, -1, -1):
            rest = right[row] - one[row] * right[row + 1] - two[row] * right[row + 2] - three[row] * right[row + 3]
            right[row] = rest / main[row]
        coefficients: list[float] = right[:count]
        return coefficients


class ElasticBand:
    """Lets the band come to rest: the forces of bodies and limits act only where the band is beyond them."""

    setting_out_share = 0.8

    def plan(self, task: Task) -> LateralPlan | None:
        """Return the band at rest, None where it is not within the limits."""
        speeds, free = tuple(task.speeds), slice(len(task.head), None)
        room = task.room(times_at(speeds, task.spacing))
        if any(low > high for low, high in zip(room.low[free], room.high[free], strict=True)):
            return None
        plan = LateralPlan((*task.head, *_at_rest(_Band(task, room))[free]), speeds)
        return plan if within_limits(task, plan, room) else None


class _Pulled(NamedTuple):
    """The springs on a band where it is."""

    springs: Springs
    acting: np.ndarray  #: on which side those act that act on one side only; 0 for not at all
    energy: float


class _Band:
    """What acts on a band, wherever it is."""

    def __init__(self, task: Task, room: Room) -> None:
        self.head, self.count, spacing = np.array(task.head), len(task.speeds), task.spacing
        fixed = len(task.head)
        self.fixed = fixed
        v = np.maximum(np.array(task.speeds), SLOWEST)
        bends = np.array([task.limits.bend(speed) for speed in v.tolist()])
        changes = np.array([task.limits.change(speed) for speed in v.tolist()])
        self._low, self._high = np.array(room.low[fixed:]), np.array(room.high[fixed:])
        v, bends, changes = v[fixed - 1 : -1], bends[fixed - 1 : -1], changes[fixed - 1 : -1]
        self._slope = TENSION * (v / spacing) ** 2
        self._slope[-4:] *= END
        self._second = v * v / spacing**2
        self._acceleration = v * v * bends
        self._own = v * v * np.array(task.curvature[fixed - 1 : -1])
        self._third = v * v * v / spacing**3
        self._jerk = v * v * v * changes
        self._held = np.full(fixed, HELD)

    def pulled(self, coefficients: np.ndarray) -> _Pulled:
        """Return the springs on the band that has these coefficients, from the one before its first node on [m]."""
        fixed, springs, one = self.fixed, Springs(self.count + 2), np.ones(1)
        offsets = _sums(coefficients, _OFFSET)
        springs.add(0, _OFFSET, self._held, self.head)
        energy = HELD * float(((offsets[:fixed] - self.head) ** 2).sum())
        for end in (0, self.count - 2):
            springs.add(end, _THIRD, HELD * one, 0.0 * one)
            energy += HELD * float(_sums(coefficients[end : end + 4], _THIRD)[0] ** 2)
        free = offsets[fixed:]
        edge = np.minimum(np.maximum(free, self._low), self._high)
        pushed = np.sign(edge - free)
        push = PUSH * np.abs(pushed)
        springs.add(fixed, _OFFSET, 1.0 + push, push * edge / (1.0 + push))
        energy += float((free * free).sum() + (push * (free - edge) ** 2).sum())
        springs.add(fixed - 1, _SLOPE, self._slope, np.zeros(len(self._slope)))
        energy += float((self._slope * np.diff(offsets[fixed - 1 :]) ** 2).sum())
        second = self._second * _sums(coefficients[fixed - 1 : -1], _SECOND)
        third = self._third * _sums(coefficients[fixed - 2 : -1], _THIRD)
        bent, more = _resist(
            springs, fixed - 1, _SECOND, self._second, second, BENDING, self._acceleration, self._own
        )  # fmt: skip
        turned, most = _resist(
            springs, fixed - 2, _THIRD, self._third, third, CHANGE, self._jerk, np.zeros(len(third))
        )  # fmt: skip
        return _Pulled(springs, np.concatenate((pushed, bent, turned)), energy + more + most)


def _sums(coefficients: np.ndarray, stencil: Sequence[float]) -> np.ndarray:
    """Return a stencil's sums from every coefficient on."""
    many = len(coefficients) - len(stencil) + 1
    total = np.zeros(many)
    for place, factor in enumerate(stencil):
        total += factor * coefficients[place : place + many]
    return total


def _resist(
    springs: Springs, first: int, stencil: Sequence[float], scale: np.ndarray, has: np.ndarray, weight: float,
    limit: np.ndarray, own: np.ndarray,
) -> tuple[np.ndarray, float]:  # fmt: skip
    """Add what resists lateral acceleration or jerk at nodes, and much more of it beyond the limit.

    `scale` makes the stencil's sum one of these, which the band `has`; `own` is what the path has without the band.
    Return the sides on which it is beyond the limit, 0 for neither, and the energy.
    """
    side = np.where(own + has > limit, 1.0, np.where(own + has < -limit, -1.0, 0.0))
    aim = side * limit - own
    stiff = STIFF * weight * np.abs(side)
    total = weight + stiff
    springs.add(first, stencil, total * scale * scale, stiff * aim / (total * scale))
    return side, float((weight * has * has).sum() + (stiff * (has - aim) ** 2).sum())


def _at_rest(band: _Band) -> tuple[float, ...]:
    """Return the offsets at rest: Newton's method on the energy of the springs, which is convex and smooth.

    A step that would raise the energy is halved: else the band could jump to and fro for ever.
    """
    coefficients = np.full(band.count + 2, band.head[-1])
    here, share = band.pulled(coefficients), 1.0
    aim = np.array(here.springs.balance())
    for _ in range(TRIALS):
        moved = coefficients + share * (aim - coefficients)
        found = band.pulled(moved)
        if found.energy > here.energy and share >= LEAST_STEP:
            share *= 0.5
            continue
        settled = share == 1.0 and bool((found.acting == here.acting).all())
        coefficients, here, share = moved, found, 1.0
        if settled:
            break
        aim = np.array(here.springs.balance())
    return tuple(_sums(coefficients, _OFFSET).tolist())


def make(vehicle: Vehicle, tuning: Tuning) -> FollowAndStop:
    """Make the controller; raises ConfigError on a tuning key or value that it cannot take."""
    return controller(vehicle, tuning, ElasticBand(), TUNING)
