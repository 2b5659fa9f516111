"""What a planner is asked for, and what it answers: a row of lateral offsets d from the path that the car can drive.

It knows the limits of a car that is steered, and no bodies.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Sequence
from itertools import pairwise
from typing import Final, NamedTuple, Protocol

import numpy as np

from vve_sumo.path import second_derivatives
from vve_sumo.values import Vehicle

from .free_space import Room

#: what a way may exceed its limits by, and come nearer to a body by [m], to be taken for one within them
EXCESS, INTRUSION = 1.15, 0.1
#: the same of a change of curvature from one node to the next, which lasts for a fraction of a second
CHANGE_EXCESS: Final = 1.5
SLOWEST: Final = 2.0  #: limits in time become limits in space at this speed at least [m/s]
CURVATURE_SHARE: Final = 0.8  #: of the car's tightest curvature that a way may have
TURNING_SHARE: Final = 0.8  #: of the rate at which the wheel can be turned that a way may take


class LateralLimits(NamedTuple):
    """What a way may ask of the car."""

    acceleration: float  #: lateral, the path's own bends included [m/s2]
    jerk: float  #: lateral [m/s3]
    tightest: float  #: curvature of the car's tightest circle [1/m]
    turning: float  #: change of curvature by which the steering wheel can follow, at 1 m/s [1/(m s)]

    @classmethod
    def of(cls, vehicle: Vehicle, acceleration: float, jerk: float) -> LateralLimits:
        """Return the limits of a car with a lateral acceleration [m/s2] and jerk [m/s3]."""
        return cls(acceleration, jerk, vehicle.tightest_curvature, vehicle.steering_rate_limit / vehicle.wheelbase)

    def share(self, of: float) -> LateralLimits:
        """Return the limits of which a way asks for a share only."""
        return LateralLimits(of * self.acceleration, of * self.jerk, of * self.tightest, of * self.turning)

    def bend(self, speed: float) -> float:
        """Return the greatest curvature at a speed [1/m]."""
        v = max(speed, SLOWEST)
        return min(self.acceleration / (v * v), CURVATURE_SHARE * self.tightest)

    def change(self, speed: float) -> float:
        """Return the greatest change of curvature along the way at a speed [1/m2]."""
        v = max(speed, SLOWEST)
        return min(self.jerk / (v * v * v), TURNING_SHARE * self.turning / v)

    def bends(self, speeds: np.ndarray) -> np.ndarray:
        """Return the greatest curvatures at speeds [1/m]."""
        v = np.maximum(speeds, SLOWEST)
        greatest: np.ndarray = np.minimum(self.acceleration / (v * v), CURVATURE_SHARE * self.tightest)
        return greatest

    def changes(self, speeds: np.ndarray) -> np.ndarray:
        """Return the greatest changes of curvature along the way at speeds [1/m2]."""
        v = np.maximum(speeds, SLOWEST)
        greatest: np.ndarray = np.minimum(self.jerk / (v * v * v), TURNING_SHARE * self.turning / v)
        return greatest


class Task(NamedTuple):
    """What a planner plans."""

    head: tuple[float, ...]  #: d of the first nodes, three or more, which are not to be changed [m]
    spacing: float  #: from node to node [m]
    curvature: Sequence[float]  #: of the path at the nodes [1/m]
    speeds: Sequence[float]  #: that the car is expected to have at the nodes [m/s]
    room: Callable[[Sequence[float]], Room]  #: at the nodes, by the times at which the car is there [s]
    limits: LateralLimits
    before: tuple[float, ...] = ()  #: d at all nodes of the way that the car is on [m]; empty for none


class LateralPlan(NamedTuple):
    """A planner's answer."""

    d: tuple[float, ...]  #: of the rear axle from the path at every node [m], left positive
    speeds: tuple[float, ...]  #: at every node [m/s]
    out_until: float = -math.inf  #: s up to which it leads out near full lock, as no planner lays a way [m]


#: a plan in the making: it yields after each portion of work, and returns the way, None where none is within the limits
Planning = Generator[None, None, LateralPlan | None]


class Planner(Protocol):
    """Whatever lays a way through the nodes."""

    setting_out_share: float
    """Of the limits, before the car has left its path. The rest is for what is seen better from nearer."""
    pulls_out: bool
    """Whether a car that begins near full lock is back on its path soon by the rest of the way, which it lays."""

    def planning(self, task: Task) -> Planning:
        """Lay the way, in portions of about a millisecond.

        There are eight of them at most: a planning that takes longer than from one turn of the lidar to the next would
        never come to its end.
        """
        ...


def planned(planning: Planning) -> LateralPlan | None:
    """Return the way that a planning leads to, without a pause."""
    while True:
        try:
            next(planning)
        except StopIteration as end:
            plan: LateralPlan | None = end.value
            return plan


def times_at(speeds: Sequence[float], spacing: float, start: float = 0.0) -> list[float]:
    """Return when the car is at each node [s], the first of them at `start`, by its speeds there [m/s]."""
    times = [start]
    for here, there in pairwise(speeds):
        times.append(times[-1] + spacing / max(0.5 * (here + there), 0.5))
    return times


def within_limits(task: Task, plan: LateralPlan, room: Room) -> bool:
    """Tell whether a way keeps to the room and to the limits, from the head on.

    Limits are those of the curve that the car follows, a cubic spline through the nodes: where the d of neighbours
    go to and fro, its curvature is up to three times what their differences are.
    """
    d = np.array(plan.d)
    second = second_derivatives(d, np.full(len(d) - 1, task.spacing))
    return bool(_keeps(task, d[:, None], second[:, None], plan.speeds, room)[0])


def all_within_limits(task: Task, ways: np.ndarray, speeds: Sequence[float], room: Room) -> np.ndarray:
    """Tell which of many ways keep to the room and to the limits, as `within_limits` does; shape (ways,).

    `ways` are d at the nodes [m], shape (nodes, ways); `speeds` at the nodes hold for all of them [m/s].
    """
    return _keeps(task, ways, _second_derivatives(ways, task.spacing), speeds, room)


def _keeps(task: Task, ways: np.ndarray, second: np.ndarray, speeds: Sequence[float], room: Room) -> np.ndarray:
    first, limits = len(task.head), task.limits
    at, before = slice(first - 1, -1), slice(first - 2, -2)
    low, high = np.array(room.low[first:]) - INTRUSION, np.array(room.high[first:]) + INTRUSION
    v, own = np.array(speeds[at]), np.array(task.curvature[at])
    bends = EXCESS * np.maximum(limits.bends(v), np.abs(own))
    changes = CHANGE_EXCESS * task.spacing * limits.changes(v)
    keeps: np.ndarray = np.all((ways[first:] >= low[:, None]) & (ways[first:] <= high[:, None]), axis=0)
    keeps &= (np.abs(second[at] + own[:, None]) <= bends[:, None]).all(axis=0)
    change = np.abs(second[at] - second[before])[1:]
    keeps &= (change <= changes[1:, None]).all(axis=0)
    return keeps


def _second_derivatives(ways: np.ndarray, spacing: float) -> np.ndarray:
    """Return the second derivatives of many splines at their points, as `second_derivatives` does of one.

    `ways` are values at points that are equally far from each other, shape (points, splines).
    """
    right = (ways[2:] - 2.0 * ways[1:-1] + ways[:-2]) * (6.0 / spacing**2)
    count = len(right)
    diagonal = [5.0] + [4.0] * (count - 2) + [5.0]
    for row in range(1, count):
        factor = 1.0 / diagonal[row - 1]
        diagonal[row] -= factor
        right[row] -= factor * right[row - 1]
    right[-1] /= diagonal[-1]
    for row in range(count - 2, -1, -1):
        right[row] = (right[row] - right[row + 1]) / diagonal[row]
    return np.concatenate((right[:1], right, right[-1:]))
