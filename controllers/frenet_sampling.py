"""`follow_and_stop` that steers around what is in its way, by sampling; the keys are those of `steer_around`.

Many ways are drawn beside the path: out by a quintic polynomial to one of several d, along there while a body is
beside, back by another quintic; each at one of several speeds, which quartic polynomials of the distance over time lead
to. The cheapest one within the limits is the way. After Werling and others (*IEEE International Conference on Robotics
and Automation*, 987, 2010). A lane change is the case that goes out and has nothing to come back for.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Final, NamedTuple

import numpy as np

from vve_sumo.controller import Tuning
from vve_sumo.values import Vehicle

from . import steer_around
from .follow_and_stop import FollowAndStop
from .free_space import Room
from .lateral_plan import SLOWEST, LateralPlan, Planning, Task, all_within_limits, times_at, within_limits
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
NEAR: Final = 0.05  #: a way may come nearer to a body by this than it shall [m]
#: costs: of lateral jerk against distance from the path, and of a speed below the expected one. With half of that,
#: to stay behind a bicyclist at half the speed cost as much as to pass, and noise decided at every turn of the lidar.
JERK_COST, SPEED_COST = 0.05, 4.0


class Quintics(NamedTuple):
    """Polynomials of fifth degree from a state at 0 to rest at their lengths, beyond which they go on straight."""

    length: np.ndarray  #: shape (n,)
    coefficients: tuple[np.ndarray, ...]  #: lowest power first, shape (n,) each

    @classmethod
    def to_rest(
        cls, start: tuple[np.ndarray | float, float, float], end: np.ndarray | float, length: np.ndarray
    ) -> Quintics:
        """Return the polynomials from values, slope and second derivative at 0 to values with neither, at lengths."""
        value, slope, second = start
        zero = 0.0 * length
        c0, c1, c2 = value + zero, slope + zero, 0.5 * second + zero
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
        """Return the values at places, shape (m, n) or (m, 1), as (m, n); that at the end for what is beyond it."""
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
    #: From close behind it takes so long that in the end who came met the car, in 9 of 32 drives.
    pulls_out = False

    def planning(self, task: Task) -> Planning:
        """Draw ways at one speed after the other, and return the cheapest, None where none is within the limits."""
        best, least = _kept(task)
        for speeds, slower in _speeds(task):
            yield
            room = task.room(times_at(speeds, task.spacing))
            first = len(task.head)
            low, high = np.array(room.low[first:]) - NEAR, np.array(room.high[first:]) + NEAR
            if (low > high).any():
                continue
            ways = _ways(task, room, speeds)
            free = ((ways[first:] >= low[:, None]) & (ways[first:] <= high[:, None])).all(axis=0)
            ways = ways[:, free]
            costs = _costs(ways, task.spacing, speeds) + slower
            cheaper = costs < least
            if not cheaper.any():
                continue
            yield
            ways, costs = ways[:, cheaper], costs[cheaper]
            keeps = all_within_limits(task, ways, speeds, room)
            if keeps.any():
                way = int(np.where(keeps, costs, math.inf).argmin())
                best, least = LateralPlan(tuple(ways[:, way].tolist()), tuple(speeds)), float(costs[way])
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
    return plan, CHEAPER * float(_costs(np.array(plan.d)[:, None], task.spacing, plan.speeds)[0])


def _speeds(task: Task) -> Iterator[tuple[Sequence[float], float]]:
    """Return speeds at the nodes, none above the expected one, and what they cost."""
    expected = task.speeds
    yield expected, 0.0
    if not expected[-1] >= expected[0] > SLOWEST:
        return
    places = [task.spacing * node for node in range(len(expected))]
    for share in SLOWER:
        slower = quartic_speeds(expected[0], share * expected[-1], SLOWING_TIME, places)
        speeds = [min(pair) for pair in zip(slower, expected, strict=True)]
        yield speeds, SPEED_COST * len(speeds) * (1.0 - share)


def _ways(task: Task, room: Room, speeds: Sequence[float]) -> np.ndarray:
    """Draw ways through the nodes; return their d [m], shape (nodes, ways)."""
    head, spacing, count = task.head, task.spacing, len(speeds)
    start, first = _state(head, spacing), len(head) - 1
    places = spacing * np.arange(count - first)[:, None]
    blocked = [node for node in range(first + 1, count) if room.low[node] > 0.0 or room.high[node] < 0.0]
    paces = np.maximum(np.array(speeds[first:]), SLOWEST)
    back_times = np.array(BACK_TIMES)
    if not blocked:
        ways = Quintics.to_rest(start, 0.0, np.maximum(paces[0] * back_times, LEAST_LENGTH)).at(places)
    else:
        over = max(room.low[node] for node in blocked)
        under = min(room.high[node] for node in blocked)
        must, outwards = (over, 1.0) if over > 0.0 else (under, -1.0)
        reach, until = spacing * (blocked[0] - first), spacing * (blocked[-1] - first)
        lengths = {max(share * reach, LEAST_LENGTH) for share in SHARES}
        lengths |= {max(float(paces[0]) * time, LEAST_LENGTH) for time in BACK_TIMES}
        aside, length, back = (
            part.ravel()
            for part in np.meshgrid(must + outwards * np.array(BEYOND), sorted(lengths), back_times, indexing="ij")
        )
        begins = np.maximum(length, until)
        # By then the car may be much faster: at the speed that it has here, it would come back in far too short a way.
        pace = paces[np.minimum(np.ceil(begins / spacing).astype(np.intp), len(paces) - 1)]
        out = Quintics.to_rest(start, aside, length).at(places)
        home = Quintics.to_rest((aside, 0.0, 0.0), 0.0, np.maximum(pace * back, LEAST_LENGTH))
        ways = np.where(places <= begins, out, home.at(np.maximum(places - begins, 0.0)))
    return np.concatenate((np.repeat(np.array(head[:-1])[:, None], ways.shape[1], axis=1), ways))


def _state(head: Sequence[float], spacing: float) -> tuple[float, float, float]:
    """Return value, slope and second derivative at the last node of a head, of the parabola through its last three."""
    before, last, here = head[-3:]
    second = (before - 2.0 * last + here) / spacing**2
    return here, (here - last) / spacing + 0.5 * second * spacing, second


def _costs(ways: np.ndarray, spacing: float, speeds: Sequence[float]) -> np.ndarray:
    """Return the costs of ways: squares of lateral jerk and of distance from the path, over all nodes."""
    v = np.maximum(np.array(speeds), SLOWEST)
    third = (ways[3:] - 3.0 * ways[2:-1] + 3.0 * ways[1:-2] - ways[:-3]) / spacing**3
    jerk = third * (v * v * v)[2:-1, None]
    costs: np.ndarray = JERK_COST * (jerk * jerk).sum(axis=0) + (ways * ways).sum(axis=0)
    return costs


def make(vehicle: Vehicle, tuning: Tuning) -> FollowAndStop:
    """Make the controller; raises ConfigError on a tuning key or value that it cannot take."""
    return controller(vehicle, tuning, FrenetSampling(), TUNING)
