"""`follow_and_stop` that steers around what is in its way, by sampling; the keys are those of `steer_around`.

Many ways are drawn beside the path: out by a quintic polynomial to one of several offsets, along there while a body is
beside, back by another quintic; each at one of several speeds, which quartic polynomials of the distance over time lead
to. The cheapest one within the limits is the way. After Werling and others (*IEEE International Conference on Robotics
and Automation*, 987, 2010). A lane change is the case that goes out and has nothing to come back for.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from typing import Final, NamedTuple

import numpy as np

from vve_sumo.controller import Tuning
from vve_sumo.values import Vehicle

from . import steer_around
from .follow_and_stop import FollowAndStop
from .free_space import Room
from .lateral_plan import SLOWEST, LateralPlan, Task, times_at, within_limits
from .steer_around import controller

TUNING: dict[str, float | str | bool] = {
    **steer_around.TUNING,
    "gap_m": 20.0,  #: out of less a quintic does not lead
}
BEYOND: Final = (0.0, 0.3, 0.8, 1.5)  #: what a way leads over by, more than it must [m]
SHARES: Final = (0.5, 0.7, 0.85, 1.0, 1.2, 1.5, 1.9)  #: of the way to the first body, in which it leads over
BACK_TIMES: Final = (1.2, 1.6, 2.0, 2.4, 2.9, 3.5, 4.5)  #: in which it leads back [s]
SLOWER: Final = (0.75, 0.5)  #: speeds that it leads to, as shares of the expected one
SLOWING_TIME: Final = 4.0  #: in which it does so [s]
CHEAPER: Final = 0.6  #: a way takes the place of the one that the car is on if it costs this share of it, or less
LEAST_LENGTH: Final = 6.0  #: of a quintic [m]
#: costs: of lateral jerk against distance from the path, and of a speed below the expected one
JERK_COST, SPEED_COST = 0.05, 2.0


class Quintic(NamedTuple):
    """A polynomial of fifth degree from a state at 0 to rest at its length; beyond its ends it goes on straight."""

    length: float
    coefficients: tuple[float, float, float, float, float, float]  #: lowest power first

    @classmethod
    def to_rest(cls, start: tuple[float, float, float], end: float, length: float) -> Quintic:
        """Return the polynomial from value, slope and second derivative at 0 to a value with neither, at a length."""
        value, slope, second = start
        c0, c1, c2 = value, slope, 0.5 * second
        # The three conditions at the end, solved for the three highest coefficients.
        far = length * length
        p = end - (c0 + c1 * length + c2 * far)
        q = -(c1 + 2.0 * c2 * length) * length
        r = -2.0 * c2 * far
        cube = far * length
        c3 = (10.0 * p - 4.0 * q + 0.5 * r) / cube
        c4 = (-15.0 * p + 7.0 * q - r) / (cube * length)
        c5 = (6.0 * p - 3.0 * q + 0.5 * r) / (cube * far)
        return cls(length, (c0, c1, c2, c3, c4, c5))

    def at(self, places: np.ndarray) -> np.ndarray:
        """Return the values at places; at the end's beyond it."""
        u = np.minimum(places, self.length)
        c0, c1, c2, c3, c4, c5 = self.coefficients
        values: np.ndarray = c0 + u * (c1 + u * (c2 + u * (c3 + u * (c4 + u * c5))))
        return values


def quartic_speeds(begins: float, ends: float, time: float, places: Sequence[float]) -> list[float]:
    """Return the speeds at places [m] of a car that goes from one speed to another [m/s] within a time [s].

    Its way over time is the quartic with no acceleration at both ends: v = v0 + (v1 - v0) (3 u^2 - 2 u^3), u = t / T.
    """
    step, t, way, speeds = 0.05, 0.0, 0.0, []
    for place in places:
        while way < place and t < time:
            t += step
            u = min(t / time, 1.0)
            way = begins * t + (ends - begins) * time * (u * u * u - 0.5 * u * u * u * u)
        u = min(t / time, 1.0)
        speeds.append(begins + (ends - begins) * u * u * (3.0 - 2.0 * u))
    return speeds


class FrenetSampling:
    """Draws the ways and takes the cheapest within the limits."""

    #: Its ways are far within the limits but for a few places, and a kept one is not laid anew.
    setting_out_share = 1.0

    def plan(self, task: Task) -> LateralPlan | None:
        """Return the way, None where none that is drawn is within the limits."""
        best, least = _kept(task)
        for speeds, slower in _speeds(task):
            room = task.room(times_at(speeds, task.spacing))
            first = len(task.head)
            low, high = np.array(room.low), np.array(room.high)
            drawn = []
            for offsets in _ways(task, room, speeds):
                if (offsets[first:] >= low[first:] - 0.05).all() and (offsets[first:] <= high[first:] + 0.05).all():
                    drawn.append((_cost(offsets, task.spacing, speeds) + slower, offsets))
            for cost, offsets in sorted(drawn, key=lambda one: one[0]):
                if cost >= least:
                    break
                plan = LateralPlan(tuple(offsets.tolist()), tuple(speeds))
                if within_limits(task, plan, room):
                    best, least = plan, cost
                    break
        return best


def _kept(task: Task) -> tuple[LateralPlan | None, float]:
    """Return the way that the car is on, while it is within the limits, and at which cost another one takes its place.

    Drawn anew with every turn, a way that comes back within a time would come back for ever.
    """
    if not task.before:
        return None, math.inf
    plan = LateralPlan(task.before, tuple(task.speeds))
    if not within_limits(task, plan, task.room(times_at(task.speeds, task.spacing))):
        return None, math.inf
    return plan, CHEAPER * _cost(np.array(plan.offsets), task.spacing, plan.speeds)


def _speeds(task: Task) -> Iterator[tuple[Sequence[float], float]]:
    """Return speeds at the nodes, and what they cost."""
    expected = task.speeds
    yield expected, 0.0
    if not expected[-1] >= expected[0] > SLOWEST:
        return
    places = [task.spacing * node for node in range(len(expected))]
    for share in SLOWER:
        speeds = quartic_speeds(expected[0], share * expected[-1], SLOWING_TIME, places)
        yield speeds, SPEED_COST * len(speeds) * (1.0 - share)


def _ways(task: Task, room: Room, speeds: Sequence[float]) -> Iterator[np.ndarray]:
    """Draw ways through the nodes."""
    head, spacing, count = task.head, task.spacing, len(speeds)
    start, first = _state(head, spacing), len(head) - 1
    places = spacing * np.arange(count - first)
    blocked = [node for node in range(first + 1, count) if room.low[node] > 0.0 or room.high[node] < 0.0]
    pace = max(speeds[first], SLOWEST)
    lead = np.array(head[:-1])
    if not blocked:
        for time in BACK_TIMES:
            yield np.concatenate((lead, Quintic.to_rest(start, 0.0, max(pace * time, LEAST_LENGTH)).at(places)))
        return
    over = max(room.low[node] for node in blocked)
    under = min(room.high[node] for node in blocked)
    must, outwards = (over, 1.0) if over > 0.0 else (under, -1.0)
    reach, until = spacing * (blocked[0] - first), spacing * (blocked[-1] - first)
    lengths = {max(share * reach, LEAST_LENGTH) for share in SHARES} | {
        max(pace * time, LEAST_LENGTH) for time in BACK_TIMES
    }
    for beyond, length, back in itertools.product(BEYOND, sorted(lengths), BACK_TIMES):
        aside = must + outwards * beyond
        out = Quintic.to_rest(start, aside, length)
        begins = max(until, length)
        home = Quintic.to_rest((aside, 0.0, 0.0), 0.0, max(pace * back, LEAST_LENGTH))
        way = np.where(places <= begins, out.at(places), home.at(np.maximum(places - begins, 0.0)))
        yield np.concatenate((lead, way))


def _state(head: Sequence[float], spacing: float) -> tuple[float, float, float]:
    """Return value, slope and second derivative at the last node of a head, of the parabola through its last three."""
    before, last, here = head[-3:]
    second = (before - 2.0 * last + here) / spacing**2
    return here, (here - last) / spacing + 0.5 * second * spacing, second


def _cost(offsets: np.ndarray, spacing: float, speeds: Sequence[float]) -> float:
    """Return the cost of a way: squares of lateral jerk and of distance from the path, over all nodes."""
    v = np.maximum(np.array(speeds), SLOWEST)
    third = (offsets[3:] - 3.0 * offsets[2:-1] + 3.0 * offsets[1:-2] - offsets[:-3]) / spacing**3
    jerk = third * (v * v * v)[2:-1]
    return JERK_COST * float((jerk * jerk).sum()) + float((offsets * offsets).sum())


def make(vehicle: Vehicle, tuning: Tuning) -> FollowAndStop:
    """Make the controller; raises ConfigError on a tuning key or value that it cannot take."""
    return controller(vehicle, tuning, FrenetSampling(), TUNING)
