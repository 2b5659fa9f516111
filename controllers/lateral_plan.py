"""What a planner is asked for, and what it answers: a row of offsets beside the path that the car can drive.

It knows the limits of a car that is steered, and no bodies.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
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


class Task(NamedTuple):
    """What a planner plans."""

    head: tuple[float, ...]  #: offsets of the first nodes, three or more, which are not to be changed [m]
    spacing: float  #: from node to node [m]
    curvature: Sequence[float]  #: of the path at the nodes [1/m]
    speeds: Sequence[float]  #: that the car is expected to have at the nodes [m/s]
    room: Callable[[Sequence[float]], Room]  #: at the nodes, by the times at which the car is there [s]
    limits: LateralLimits
    before: tuple[float, ...] = ()  #: offsets at all nodes of the way that the car is on [m]; empty for none


class LateralPlan(NamedTuple):
    """A planner's answer."""

    offsets: tuple[float, ...]  #: of the rear axle from the path at every node [m], left positive
    speeds: tuple[float, ...]  #: at every node [m/s]


class Planner(Protocol):
    """Whatever lays a way through the nodes."""

    setting_out_share: float
    """Of the limits, before the car has left its path. The rest is for what is seen better from nearer."""

    def plan(self, task: Task) -> LateralPlan | None:
        """Return the way, None where there is none within the limits."""
        ...


def times_at(speeds: Sequence[float], spacing: float, start: float = 0.0) -> list[float]:
    """Return when the car is at each node [s], the first of them at `start`, by its speeds there [m/s]."""
    times = [start]
    for here, there in pairwise(speeds):
        times.append(times[-1] + spacing / max(0.5 * (here + there), 0.5))
    return times


def within_limits(task: Task, plan: LateralPlan, room: Room) -> bool:
    """Tell whether a way keeps to the room and to the limits, from the head on.

    Limits are those of the curve that the car follows, a cubic spline through the nodes: where offsets of neighbours
    go to and fro, its curvature is up to three times what their differences are.
    """
    d, spacing, limits = plan.offsets, task.spacing, task.limits
    first = len(task.head)
    for node in range(first, len(d)):
        if not room.low[node] - INTRUSION <= d[node] <= room.high[node] + INTRUSION:
            return False
    second = second_derivatives(np.array(d), np.full(len(d) - 1, spacing)).tolist()
    for node in range(first - 1, len(d) - 1):
        v = plan.speeds[node]
        if abs(second[node] + task.curvature[node]) > EXCESS * max(limits.bend(v), abs(task.curvature[node])):
            return False
        if node >= first and abs(second[node] - second[node - 1]) / spacing > CHANGE_EXCESS * limits.change(v):
            return False
    return all(map(math.isfinite, d))
