"""`follow_and_stop` that steers around what is in its way, by an elastic band; the keys are those of `steer_around`.

The way ahead is a band of nodes beside the path. Forces act on it: the path attracts it, it resists bending and change
of bending, and bodies and the road's edges push it off. Where all forces balance, the band is the way. Elastic bands
are of Quinlan and Khatib (*IEEE International Conference on Robotics and Automation*, 802, 1993).
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
WIDTH: Final = 4  #: of the band matrix: a node feels three on either side

_SLOPE: Final = (-1.0, 1.0)
_SECOND: Final = (1.0, -2.0, 1.0)
_THIRD: Final = (-1.0, 3.0, -3.0, 1.0)


class Springs:
    """Springs between the nodes of a band, as linear equations in the offsets: a matrix of few diagonals."""

    __slots__ = ("diagonals", "right")

    def __init__(self, count: int) -> None:
        """Begin without any, on so many nodes."""
        self.diagonals = [np.zeros(count) for _ in range(WIDTH)]
        self.right = np.zeros(count)

    def add(self, first: int, stencil: Sequence[float], weight: np.ndarray, aim: np.ndarray) -> None:
        """Add one spring each at the nodes from `first` on, that draws a stencil's sum over nodes to an aim."""
        count = len(weight)
        for place, factor in enumerate(stencil):
            own = slice(first + place, first + place + count)
            pull = weight * factor
            self.right[own] += pull * aim
            for other in range(place, len(stencil)):
                self.diagonals[other - place][own] += pull * stencil[other]

    def balance(self, head: Sequence[float]) -> list[float]:
        """Return the offsets at which all forces balance, the first ones held (Cholesky's decomposition, no roots)."""
        fixed = len(head)
        main, *others = (diagonal[fixed:].tolist() for diagonal in self.diagonals)
        right = self.right[fixed:].tolist()
        for held, offset in enumerate(head):
            for away in range(fixed - held, WIDTH):
                right[held + away - fixed] -= float(self.diagonals[away][held]) * offset
        one, two, three = others
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
        offsets: list[float] = right[:count]
        return offsets


class ElasticBand:
    """Lets the band come to rest: the forces of bodies and limits act only where the band is beyond them."""

    def plan(self, task: Task) -> LateralPlan | None:
        """Return the band at rest, None where it is not within the limits."""
        speeds, free = tuple(task.speeds), slice(len(task.head), None)
        room = task.room(times_at(speeds, task.spacing))
        if any(low > high for low, high in zip(room.low[free], room.high[free], strict=True)):
            return None
        plan = LateralPlan(_at_rest(_Band(task, room)), speeds)
        return plan if within_limits(task, plan, room) else None


class _Pulled(NamedTuple):
    """The springs on a band where it is."""

    springs: Springs
    acting: np.ndarray  #: on which side those act that act on one side only; 0 for not at all
    energy: float


class _Band:
    """What acts on a band, wherever it is."""

    def __init__(self, task: Task, room: Room) -> None:
        self.head, self.count, spacing = list(task.head), len(task.speeds), task.spacing
        fixed = len(task.head)
        v = np.maximum(np.array(task.speeds), SLOWEST)
        bends = np.array([task.limits.bend(speed) for speed in v.tolist()])
        changes = np.array([task.limits.change(speed) for speed in v.tolist()])
        self._low, self._high = np.array(room.low[fixed:]), np.array(room.high[fixed:])
        self._slope = TENSION * (v[fixed - 1 : -1] / spacing) ** 2
        self._slope[-4:] *= END
        middle = v[fixed - 1 : -1]
        self._second = middle * middle / spacing**2
        self._acceleration = middle * middle * bends[fixed - 1 : -1]
        self._own = middle * middle * np.array(task.curvature[fixed - 1 : -1])
        middle = v[fixed - 1 : -1]
        self._third = middle * middle * middle / spacing**3
        self._jerk = middle * middle * middle * changes[fixed - 1 : -1]

    def pulled(self, offsets: np.ndarray) -> _Pulled:
        """Return the springs on the band at some offsets [m]."""
        fixed, springs = len(self.head), Springs(self.count)
        free = offsets[fixed:]
        edge = np.minimum(np.maximum(free, self._low), self._high)
        pushed = np.sign(edge - free)
        push = PUSH * np.abs(pushed)
        springs.add(fixed, (1.0,), 1.0 + push, push * edge / (1.0 + push))
        energy = float((free * free).sum() + (push * (free - edge) ** 2).sum())
        springs.add(fixed - 1, _SLOPE, self._slope, np.zeros(len(self._slope)))
        energy += float((self._slope * np.diff(offsets[fixed - 1 :]) ** 2).sum())
        second = self._second * np.diff(offsets[fixed - 2 :], 2)
        third = self._third * np.diff(offsets[fixed - 3 :], 3)
        bent, more = _resist(
            springs, fixed - 2, _SECOND, self._second[: len(second)], second, BENDING,
            self._acceleration[: len(second)], self._own[: len(second)],
        )  # fmt: skip
        turned, most = _resist(
            springs, fixed - 3, _THIRD, self._third[: len(third)], third, CHANGE, self._jerk[: len(third)],
            np.zeros(len(third)),
        )  # fmt: skip
        return _Pulled(springs, np.concatenate((pushed, bent, turned)), energy + more + most)


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
    offsets = np.array([*band.head, *[band.head[-1]] * (band.count - len(band.head))])
    here, share = band.pulled(offsets), 1.0
    aim = np.array([*band.head, *here.springs.balance(band.head)])
    for _ in range(TRIALS):
        moved = offsets + share * (aim - offsets)
        found = band.pulled(moved)
        if found.energy > here.energy and share >= LEAST_STEP:
            share *= 0.5
            continue
        settled = share == 1.0 and bool((found.acting == here.acting).all())
        offsets, here, share = moved, found, 1.0
        if settled:
            break
        aim = np.array([*band.head, *here.springs.balance(band.head)])
    return tuple(offsets.tolist())


def make(vehicle: Vehicle, tuning: Tuning) -> FollowAndStop:
    """Make the controller; raises ConfigError on a tuning key or value that it cannot take."""
    return controller(vehicle, tuning, ElasticBand(), TUNING)
