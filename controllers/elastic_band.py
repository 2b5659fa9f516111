"""`follow_and_stop` that steers around what is in its way, by an elastic band; the keys are those of `steer_around`.

The way ahead is a band of nodes beside the path. Forces act on it: the path attracts it, it resists bending and change
of bending, and bodies and the road's edges push it off. Where all forces balance, the band is the way. After Quinlan and
Khatib (*IEEE International Conference on Robotics and Automation*, 802, 1993), Hilgert and others (*IEEE/ASME
International Conference on Advanced Intelligent Mechatronics*, 1042, 2003), who brought it to cars, and the elastic bands around pedestrians of
Guvenc's group.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

from vve_sumo.controller import Tuning
from vve_sumo.values import Vehicle

from .follow_and_stop import FollowAndStop
from .free_space import Room
from .lateral_plan import SLOWEST, LateralPlan, Task, times_at, within_limits
from .steer_around import controller

#: with which the band leaves its path and returns to it, where nothing pushes it [s]
TIME: Final = 0.75
#: Against lateral speed [s2], acceleration [s4] and jerk [s6], the attraction of the path being 1 for each metre: the
#: square of (1 + T s)^3, so that the band dies out with three equal time constants and swings over nowhere.
TENSION, BENDING, CHANGE = 3.0 * TIME**2, 3.0 * TIME**4, TIME**6
END: Final = 100.0  #: of what keeps the end of the band parallel to the path, as TENSION
PUSH: Final = 3e4  #: of a body for each metre that the band is too near to it
STIFF: Final = 3e3  #: of what resists acceleration and jerk beyond their limits, as for those within
ROUNDS: Final = 30  #: until the forces that act are the ones that should
LEAST_STEP: Final = 0.02  #: share of a step that is not halved any more
WIDTH: Final = 4  #: of the band matrix: a node feels three on either side

Stencil = tuple[float, ...]
_FIRST: Final[Stencil] = (1.0,)
_SLOPE: Final[Stencil] = (-1.0, 1.0)
_SECOND: Final[Stencil] = (1.0, -2.0, 1.0)
_THIRD: Final[Stencil] = (-1.0, 3.0, -3.0, 1.0)


class Forces:
    """Springs on the free nodes of a band, as linear equations in their offsets: a symmetric matrix of few diagonals."""

    __slots__ = ("_fixed", "_head", "diagonals", "right")

    def __init__(self, head: Sequence[float], count: int) -> None:
        """The first nodes are held at `head` [m], the `count` others are free."""
        self._head, self._fixed = head, len(head)
        self.diagonals = [[0.0] * count for _ in range(WIDTH)]
        self.right = [0.0] * count

    def add(self, node: int, stencil: Stencil, weight: float, aim: float) -> None:
        """Add a spring that draws the sum of a stencil over nodes from `node` on to an aim."""
        fixed, right = self._fixed, self.right
        rest = aim
        for place, factor in enumerate(stencil):
            if node + place < fixed:
                rest -= factor * self._head[node + place]
        for place, factor in enumerate(stencil):
            row = node + place - fixed
            if row < 0:
                continue
            pull = weight * factor
            right[row] += pull * rest
            for other in range(place, len(stencil)):
                self.diagonals[other - place][row] += pull * stencil[other]

    def balance(self) -> list[float]:
        """Return the offsets at which all forces balance (Cholesky's decomposition without roots, by plain floats)."""
        main, *others = (list(diagonal) for diagonal in self.diagonals)
        right, count = list(self.right), len(self.right)
        for row in range(count):
            pivot = main[row]
            for away in range(1, min(WIDTH, count - row)):
                factor = others[away - 1][row] / pivot
                if not factor:
                    continue
                main[row + away] -= factor * others[away - 1][row]
                for more in range(away + 1, min(WIDTH, count - row)):
                    others[more - away - 1][row + away] -= factor * others[more - 1][row]
                right[row + away] -= factor * right[row]
        for row in range(count - 1, -1, -1):
            rest = right[row]
            for away in range(1, min(WIDTH, count - row)):
                rest -= others[away - 1][row] * right[row + away]
            right[row] = rest / main[row]
        return right


class ElasticBand:
    """Lets the band come to rest: the forces of bodies and limits act only where the band is beyond them."""

    def plan(self, task: Task) -> LateralPlan | None:
        """Return the band at rest, None where it is not within the limits."""
        speeds = tuple(task.speeds)
        room = task.room(times_at(speeds, task.spacing))
        if any(low > high for low, high in zip(room.low[len(task.head):], room.high[len(task.head):], strict=True)):
            return None
        plan = LateralPlan(self._at_rest(task, room), speeds)
        return plan if within_limits(task, plan, room) else None

    def _at_rest(self, task: Task, room: Room) -> tuple[float, ...]:
        """Return the offsets at rest: Newton's method on the energy of the springs, which is convex and smooth.

        A step that would raise the energy is halved: else the band could jump to and fro for ever.
        """
        offsets = [*task.head, *[task.head[-1]] * (len(task.speeds) - len(task.head))]
        springs = _springs(task, room, offsets)
        for _ in range(ROUNDS):
            aim, share = [*task.head, *springs.forces.balance()], 1.0
            while True:
                moved = [here + share * (there - here) for here, there in zip(offsets, aim, strict=True)]
                found = _springs(task, room, moved)
                if found.energy <= springs.energy or share < LEAST_STEP:
                    break
                share *= 0.5
            settled = share == 1.0 and found.acting == springs.acting
            offsets, springs = moved, found
            if settled:
                break
        return tuple(offsets)


class _Springs(NamedTuple):
    """The springs on a band where it is."""

    forces: Forces
    acting: tuple[int, ...]  #: those that act on one side only: whether they do, and on which side
    energy: float


def _springs(task: Task, room: Room, offsets: Sequence[float]) -> _Springs:
    fixed, count, spacing = len(task.head), len(offsets), task.spacing
    forces, acting, energy = Forces(task.head, count - fixed), [], 0.0
    for node in range(fixed, count):
        here = offsets[node]
        forces.add(node, _FIRST, 1.0, 0.0)
        energy += here * here
        beyond = 1 if here < room.low[node] else 2 if here > room.high[node] else 0
        if beyond:
            edge = room.low[node] if beyond == 1 else room.high[node]
            forces.add(node, _FIRST, PUSH, edge)
            energy += PUSH * (here - edge) ** 2
        acting.append(beyond)
    for node in range(fixed - 1, count - 1):
        v = max(task.speeds[node], SLOWEST)
        weight = TENSION * (END if node > count - 5 else 1.0) * (v / spacing) ** 2
        forces.add(node, _SLOPE, weight, 0.0)
        energy += weight * (offsets[node + 1] - offsets[node]) ** 2
    for node in range(fixed - 2, count - 2):
        v = max(task.speeds[node + 1], SLOWEST)
        limit, own = v * v * task.limits.bend(v), v * v * task.curvature[node + 1]
        side, more = _resist(forces, offsets, node, _SECOND, v * v / spacing**2, BENDING, limit, own)
        acting.append(side)
        energy += more
    for node in range(fixed - 3, count - 3):
        v = max(task.speeds[node + 2], SLOWEST)
        limit = v * v * v * task.limits.change(v)
        side, more = _resist(forces, offsets, node, _THIRD, v * v * v / spacing**3, CHANGE, limit, 0.0)
        acting.append(side)
        energy += more
    return _Springs(forces, tuple(acting), energy)


def _resist(
    forces: Forces, offsets: Sequence[float], node: int, stencil: Stencil, scale: float, weight: float, limit: float,
    own: float,
) -> tuple[int, float]:  # fmt: skip
    """Add what resists lateral acceleration or jerk at a node, and much more of it beyond its limit.

    `scale` makes the stencil's sum one of these; `own` is what the path has of it without the band. Return the side on
    which it is beyond the limit, 0 for neither, and the energy.
    """
    scaled = tuple(scale * factor for factor in stencil)
    forces.add(node, scaled, weight, 0.0)
    has = sum(factor * offsets[node + place] for place, factor in enumerate(scaled))
    energy = weight * has * has
    if -limit <= own + has <= limit:
        return 0, energy
    side = 1 if own + has > limit else -1
    aim = side * limit - own
    forces.add(node, scaled, STIFF * weight, aim)
    return side, energy + STIFF * weight * (has - aim) ** 2


def make(vehicle: Vehicle, tuning: Tuning) -> FollowAndStop:
    """Make the controller; raises ConfigError on a tuning key or value that it cannot take."""
    return controller(vehicle, tuning, ElasticBand())
