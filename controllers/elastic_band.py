"""`follow_and_stop` that steers around what is in its way, by an elastic band; the keys are those of `steer_around`.

The way ahead is a band of nodes beside the path. Forces act on it: the path attracts it, it resists bending and change
of bending, and bodies and the road's edges push it off. Where all forces balance, the band is the way. Elastic bands
are of Quinlan and Khatib (*IEEE International Conference on Robotics and Automation*, 802, 1993).

The forces act on the cubic spline through the nodes, which is the curve that the car follows. The unknowns are its
coefficients of uniform B-splines; an offset, a slope, a curvature and a change of curvature are sums of three or four
neighbours (C. de Boor, *A Practical Guide to Splines*, 1978).
"""

from __future__ import annotations

import math
from collections.abc import Generator
from typing import Final

import numpy as np

from vve_sumo.controller import Tuning
from vve_sumo.values import Vehicle

from .follow_and_stop import FollowAndStop
from .free_space import Room
from .lateral_plan import SLOWEST, LateralPlan, Planning, Task, times_at, within_limits
from .steer_around import TUNING, controller

#: with which the band leaves its path and returns to it, where nothing pushes it [s]
TIME: Final = 0.75
#: Against lateral speed [s2], acceleration [s4] and jerk [s6], the attraction of the path being 1 for each metre: the
#: square of (1 + T s)^3, so that the band dies out with three equal time constants and swings over nowhere.
TENSION, BENDING, CHANGE = 3.0 * TIME**2, 3.0 * TIME**4, TIME**6
END: Final = 100.0  #: of what keeps the end of the band parallel to the path, as TENSION
PUSH: Final = 3e4  #: of a body for each metre that the band is too near to it
STIFF: Final = 3e3  #: of what resists acceleration and jerk beyond their limits, as for those within
MAX_STEPS: Final = 24  #: Newton steps of a band, at most
STEPS_IN_A_PORTION: Final = 4  #: Newton steps in one portion of planning
#: of PUSH and STIFF the shares in the first steps; then all of them
SOFTER: Final = (0.0003, 0.001, 0.003, 0.01, 0.03, 0.1, 0.3)
MAX_SEARCHES: Final = 8  #: places along a Newton step that are looked at for the least energy, at most
LEAST_STEP: Final = 1e-3  #: a band whose best step is a smaller share of Newton's goes nowhere any more
HELD: Final = 1e10  #: of what holds the offsets that are not to be changed, and the curvature of the end pieces
WIDTH: Final = 4  #: of the band matrix: a coefficient feels three on either side

# Sums over five neighbouring coefficients. The second to fourth belong to a node: its offset from there on to the one
# after, its second derivative times the square of the spacing; the piece before it and its third derivative times the
# cube; the piece after it and its mean slope times the spacing. The springs of a node's offset are those of the next.
_OFFSET: Final = (1.0 / 6.0, 4.0 / 6.0, 1.0 / 6.0)
_THIRD: Final = (-1.0, 3.0, -3.0, 1.0)
_STENCILS: Final = np.array(
    (
        (0.0, 0.0, *_OFFSET),
        (0.0, 1.0, -2.0, 1.0, 0.0),
        (*_THIRD, 0.0),
        (0.0, -1.0 / 6.0, -0.5, 0.5, 1.0 / 6.0),
    )
)


class Springs:
    """Springs between the coefficients of a band: kinds of them, one of each kind from every coefficient on."""

    __slots__ = ("_place", "_products", "_row", "_rows", "_stencils")

    def __init__(self, stencils: np.ndarray, count: int) -> None:
        """Take the stencils, shape (kinds, reach): a spring draws such a sum of coefficients; `count` of each kind."""
        kinds, reach = stencils.shape
        products = np.zeros((kinds, reach, WIDTH))
        for width in range(min(WIDTH, reach)):
            products[:, : reach - width, width] = stencils[:, : reach - width] * stencils[:, width:]
        self._stencils, self._products = stencils.reshape(-1, 1), products.reshape(-1, WIDTH, 1)
        # Row p of a kind is its numbers moved on by p coefficients: those of the springs which end in a coefficient.
        self._row = np.zeros((kinds, count + 2 * (reach - 1)))
        along, step = self._row.strides
        begin = self._row[:, reach - 1 :]
        self._rows = np.lib.stride_tricks.as_strided(
            begin, (kinds, reach, count + reach - 1), (along, -step, step), writeable=False
        )
        self._place = slice(reach - 1, reach - 1 + count)

    def matrix(self, stiffness: np.ndarray) -> np.ndarray:
        """Return the main diagonal and those below it, shape (WIDTH, count + reach - 1), by each spring's stiffness."""
        self._row[:, self._place] = stiffness
        rows = self._rows.reshape(-1, 1, self._rows.shape[-1])
        diagonals: np.ndarray = (self._products * rows).sum(axis=0)
        return diagonals

    def right(self, pull: np.ndarray) -> np.ndarray:
        """Return the right side by each spring's stiffness times where it draws to, shape (count + reach - 1,)."""
        self._row[:, self._place] = pull
        side: np.ndarray = (self._stencils * self._rows.reshape(-1, self._rows.shape[-1])).sum(axis=0)
        return side


def balance(diagonals: np.ndarray, right: np.ndarray) -> list[float]:
    """Return the coefficients at which all forces balance (Cholesky's decomposition, no roots).

    `diagonals`, shape (WIDTH, n): the main one and those below it of a symmetric matrix; `right`, shape (n,).
    """
    done = []
    main_1 = main_2 = main_3 = one_1 = one_2 = two_1 = right_1 = right_2 = right_3 = 0.0
    for main, one, two, three, side in zip(*diagonals.tolist(), right.tolist(), strict=True):
        pivot, below, second, has = main + main_1, one + one_1, two + two_1, side + right_1
        a, b, c = below / pivot, second / pivot, three / pivot
        main_1, main_2, main_3 = main_2 - a * below, main_3 - b * second, -c * three
        one_1, one_2 = one_2 - a * second, -b * three
        two_1 = -a * three
        right_1, right_2, right_3 = right_2 - a * has, right_3 - b * has, -c * has
        done.append((has / pivot, a, b, c))
    x, next_1, next_2, coefficients = 0.0, 0.0, 0.0, []
    for has, a, b, c in reversed(done):
        x, next_1, next_2 = has - a * x - b * next_1 - c * next_2, x, next_1
        coefficients.append(x)
    coefficients.reverse()
    return coefficients


class ElasticBand:
    """Lets the band come to rest: the forces of bodies and limits act only where the band is beyond them."""

    setting_out_share = 0.8
    pulls_out = True

    def planning(self, task: Task) -> Planning:
        """Let the band come to rest, and return it, None where it is not within the limits."""
        speeds, free = tuple(task.speeds), slice(len(task.head), None)
        room = task.room(times_at(speeds, task.spacing))
        if any(low > high for low, high in zip(room.low[free], room.high[free], strict=True)):
            return None
        d = yield from _Band(task, room).settling()
        plan = LateralPlan((*task.head, *d[free]), speeds)
        return plan if within_limits(task, plan, room) else None


class _Band:
    """What acts on a band, wherever it is: springs of the kinds of _STENCILS, the first three of which have limits."""

    def __init__(self, task: Task, room: Room) -> None:
        head, count, spacing = np.array(task.head), len(task.speeds), task.spacing
        fixed = self._fixed = len(task.head)
        inner = slice(fixed - 1, -1)
        v = np.maximum(np.array(task.speeds[inner]), SLOWEST)
        bends, changes = task.limits.bends(v), task.limits.changes(v)
        many = len(v)
        self._springs = Springs(_STENCILS, many)
        #: what the sums are in metres, m/s2, m/s3 and m/s, and what the path has of that without the band
        self._scale = np.stack((np.ones(many), v * v / spacing**2, v * v * v / spacing**3, v / spacing))
        self._own = np.zeros((4, many))
        self._own[1] = v * v * np.array(task.curvature[inner])
        self._high = np.stack(
            (np.array(room.high[fixed:]), v * v * bends, v * v * v * changes, np.full(many, math.inf))
        )
        self._low = -self._high
        self._low[0] = room.low[fixed:]
        #: of a force for each of these, and beyond the limits
        self._weight = np.repeat(((1.0,), (BENDING,), (CHANGE,), (TENSION,)), many, axis=1)
        self._weight[3, -4:] *= END
        self._stiff = np.array(((PUSH,), (STIFF * BENDING,), (STIFF * CHANGE,), (0.0,)))
        self._held, self._held_right = _held(count + 2, head)

    def settling(self) -> Generator[None, None, tuple[float, ...]]:
        """Return the offsets at rest: Newton's method on the energy of the springs, which is convex and smooth.

        Of each step that share is taken at which the energy along it is least: else the band could jump to and fro.
        The springs beyond limits grow stiff from step to step; from the first step on, they would take twice as many.
        """
        stiffest = self._stiff
        coefficients = self._aim(np.zeros_like(self._own), self._own)
        has = self._has(coefficients)
        for step in range(1, MAX_STEPS):
            if step % STEPS_IN_A_PORTION == 0:
                yield
            soft = SOFTER[step - 1] if step <= len(SOFTER) else 1.0
            self._stiff = soft * stiffest
            edge = np.minimum(np.maximum(has, self._low), self._high)
            acting = np.sign(has - edge)
            aim = self._aim(acting, edge)
            there = self._has(aim)
            beyond = there - np.minimum(np.maximum(there, self._low), self._high)
            settled = bool((np.sign(beyond) == acting).all())
            share = 1.0 if settled else self._best_share(has, there - has)
            coefficients, has = coefficients + share * (aim - coefficients), has + share * (there - has)
            if soft == 1.0 and (settled or share < LEAST_STEP):
                break
        first, middle, last = _OFFSET
        return tuple((first * coefficients[:-2] + middle * coefficients[1:-1] + last * coefficients[2:]).tolist())

    def _has(self, coefficients: np.ndarray) -> np.ndarray:
        """Return what a band has at its nodes: distance [m], acceleration [m/s2], jerk [m/s3] and speed [m/s]."""
        many, first = self._own.shape[1], self._fixed - 2
        sums = _STENCILS[:, :1] * coefficients[first : first + many]
        for place in range(1, _STENCILS.shape[1]):
            sums += _STENCILS[:, place : place + 1] * coefficients[first + place : first + place + many]
        has: np.ndarray = sums * self._scale + self._own
        return has

    def _aim(self, acting: np.ndarray, edge: np.ndarray) -> np.ndarray:
        """Return the band at which the springs balance, those among them that act beyond limits, drawing to these."""
        stiff = self._stiff * np.abs(acting)
        scale, first = self._scale, self._fixed - 2
        diagonals, right = self._held.copy(), self._held_right.copy()
        diagonals[:, first:] += self._springs.matrix((self._weight + stiff) * scale * scale)
        right[first:] += self._springs.right(stiff * scale * (edge - self._own))
        return np.array(balance(diagonals, right))

    def _best_share(self, has: np.ndarray, way: np.ndarray) -> float:
        """Return the share of a step at which the energy is least, its derivative along the step 0; at most 1.

        The derivative rises piece by piece as a straight line: Newton's method, kept between bounds.
        """
        pull, own = self._weight * way, has - self._own
        begins, rises = float((pull * own).sum()), float((pull * way).sum())
        low, high, share = 0.0, 1.0, 1.0
        for _ in range(MAX_SEARCHES):
            at = has + share * way
            beyond = at - np.minimum(np.maximum(at, self._low), self._high)
            pushes = self._stiff * way
            slope = begins + share * rises + float((pushes * beyond).sum())
            if slope > 0.0:
                high = share
            elif share == 1.0:
                return 1.0
            else:
                low = share
            more = slope / (rises + float((pushes * way * np.abs(np.sign(beyond))).sum()))
            moved = share - more
            share = moved if low < moved < high else 0.5 * (low + high)
            if abs(more) < LEAST_STEP:
                break
        return share


def _held(count: int, head: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the springs that hold the first offsets where they are, and the curvature of both end pieces constant."""
    diagonals, right = np.zeros((WIDTH, count)), np.zeros(count)
    springs: list[tuple[int, tuple[float, ...], float]] = [
        (first, _OFFSET, float(aim)) for first, aim in enumerate(head)
    ]
    springs += [(0, _THIRD, 0.0), (count - len(_THIRD), _THIRD, 0.0)]
    for first, stencil, aim in springs:
        for place, factor in enumerate(stencil):
            right[first + place] += HELD * factor * aim
            for other in range(place, len(stencil)):
                diagonals[other - place, first + place] += HELD * factor * stencil[other]
    return diagonals, right


def make(vehicle: Vehicle, tuning: Tuning) -> FollowAndStop:
    """Make the controller; raises ConfigError on a tuning key or value that it cannot take."""
    return controller(vehicle, tuning, ElasticBand(), TUNING)
