"""The way around that a car takes: its nodes, its curve, its speeds, and who is in it.

It must not know why the way was taken, nor what is done about who is in it.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Final, NamedTuple

import numpy as np

from vve_sumo.path import PathProjection, ReferencePath
from vve_sumo.values import CommandedPath, Vehicle

from .free_space import Margins, Nodes, clearances
from .lateral_plan import LateralPlan, times_at
from .outlines import Body
from .speed import SPEEDING_UP, Profile, SpeedProfile
from .tracks import MARGIN, Target

SPACING: Final = 1.5  #: between nodes [m]
NODES: Final = 64  #: of a way: it leads 95 m ahead
#: lateral, of an urgent way: of the gateway's 3.0 m/s2 and 5.0 m/s3 a share is left to the steering law
URGENT_ACCELERATION, URGENT_JERK = 2.8, 4.6
CONTACT: Final = Margins(MARGIN, 0.3, 0.0, 1.0)  #: what comes nearer than this is in the way
NEAR: Final = 0.5  #: who is nearer than this to a way is braked for [m]
CROSSES: Final = 0.5  #: who is faster across the path crosses it: he will be gone [m/s]
ONCOMING: Final = 2.0  #: who comes nearer along the path by more than this comes the other way [m/s]
HORIZON: Final = 3.0  #: what is farther ahead than this is braked for in comfort [s]


class WayAround(NamedTuple):
    """A way around; its nodes lie at whole multiples of SPACING along the scenario's path."""

    first: int  #: number of the first node
    d: tuple[float, ...]  #: at the nodes [m], left positive
    times: tuple[float, ...]  #: at which the car is at the nodes if it takes the planned speeds [s]
    path: ReferencePath
    profile: Profile
    bends: SpeedProfile  #: the speeds that its bends allow
    commanded: CommandedPath
    urgent: bool
    braking: bool  #: whether it was planned for a car that brakes with all there is
    out_until: float  #: s up to which it leads out near full lock [m]

    @classmethod
    def of_plan(
        cls, path: ReferencePath, first: int, plan: LateralPlan, usual: Sequence[float], lateral: float,
        *, urgent: bool, braking: bool = False,
    ) -> WayAround:  # fmt: skip
        """Return the way of a plan from a node of a path on.

        `usual` are the speeds [m/s] at the nodes of a car that has nothing in its way, `lateral` is the acceleration
        [m/s2] that bends allow in comfort.
        """
        x, y = [], []
        for node, d in enumerate(plan.d):
            point = path.at(SPACING * (first + node))
            x.append(point.x - d * math.sin(point.heading))
            y.append(point.y + d * math.cos(point.heading))
        way = ReferencePath.from_points(x, y, rounds=0)
        profile = SpeedProfile(way, max(URGENT_ACCELERATION if urgent else lateral, lateral) * 1.1)
        speeds = [min(v, profile.at(SPACING * node)[0]) for node, v in enumerate(plan.speeds)]
        kept: Profile = profile
        if not urgent and any(planned < open_road - 0.1 for planned, open_road in zip(plan.speeds, usual, strict=True)):
            kept = _Kept(profile, tuple(speed * speed for speed in plan.speeds))
        commanded = CommandedPath(tuple(x), tuple(y), tuple(speeds))
        times = tuple(times_at(plan.speeds, SPACING))
        return cls(first, plan.d, times, way, kept, profile, commanded, urgent, braking, plan.out_until)

    def commanded_from(self, node: int) -> CommandedPath:
        """Return the way from a node on: a command begins at the car, which goes on while the next way is planned."""
        behind = min(max(node - self.first, 0), len(self.d) - 2)
        x, y, speed = self.commanded.x, self.commanded.y, self.commanded.speed
        return CommandedPath(x[behind:], y[behind:], speed[behind:])

    def ahead(self, first: int) -> tuple[list[float], list[float]]:
        """Return the d [m] and the commanded speeds [m/s] at NODES nodes from a number on."""
        last = len(self.d) - 1
        own = [min(max(first + node - self.first, 0), last) for node in range(NODES)]
        return [self.d[node] for node in own], [self.commanded.speed[node] for node in own]

    def fastest(self, first: int, usual: Sequence[float]) -> list[float]:
        """Return the greatest speeds [m/s] at nodes from a number on that its bends leave of the usual ones there."""
        return speeding_up(
            min(open_road, self.bends.at(SPACING * node)[0]) for node, open_road in enumerate(usual, first - self.first)
        )

    def d_at(self, node: int) -> float:
        """Return d at a node by its number [m]; beyond the end that at the end."""
        return self.d[min(max(node - self.first, 0), len(self.d) - 1)]

    def met(
        self, bodies: Iterable[Body], vehicle: Vehicle, here: PathProjection, speed: float
    ) -> tuple[Target | None, list[Target]]:
        """Return the nearest body in the way, and all that a car would meet soon; `here` is its place on the path."""
        s = SPACING * (self.first + np.arange(NODES))
        ahead = s >= here.s - SPACING
        nodes = Nodes.of(vehicle, s[ahead], np.zeros(int(ahead.sum())))
        d = np.array(self.d)[ahead].tolist()
        steady = ((nodes.s - here.s).clip(min=0.0) / max(speed, 0.5)).tolist()
        planned = steady if self.urgent else self._planned(here, ahead)
        bumper, nearest, dangers = here.s + vehicle.rear_axle_to_bumper, None, []
        for body in bodies:
            gap = float(body.s.min()) - bumper
            if float(body.s.max()) < here.s - vehicle.rear_overhang:
                continue
            away = clearances(nodes, steady, d, body, CONTACT)
            # Braking is no use for whom the bumper has passed, and who comes head-on would meet the car at rest.
            near = NEAR if float(body.s.max()) > bumper else 0.0
            node = _first_within(away, near if self.braking and body.along > -ONCOMING else 0.0)
            if node is not None and steady[node] < HORIZON:
                dangers.append(_target(body, gap, steady[node]))
            # At its present speed the car may overtake who goes along too late for this way, or never.
            node = _first_within(away, 0.0) if self.urgent else first_met(nodes, planned, d, body, near)
            if node is not None and (nearest is None or gap < nearest.gap):
                nearest = _target(body, gap, planned[node])
        return nearest, dangers

    def _planned(self, here: PathProjection, ahead: np.ndarray) -> list[float]:
        """Return the times from now on to the nodes ahead at the planned speeds [s], 0 for those that are passed."""
        times = np.array(self.times)
        now = np.interp(here.s, SPACING * (self.first + np.arange(NODES)), times)
        planned: list[float] = (times[ahead] - now).clip(min=0.0).tolist()
        return planned


class _Kept(NamedTuple):
    """The speeds along a way: those that its bends allow, and those that it was planned with."""

    bends: SpeedProfile
    squares: tuple[float, ...]  #: of planned speeds at the nodes [m2/s2]

    def at(self, s: float) -> tuple[float, float]:
        """Return the speed [m/s] and the acceleration along the profile [m/s2] at an s along it [m]."""
        speed, along = self.bends.at(s)
        place = min(max(s / SPACING, 0.0), len(self.squares) - 1.001)
        node = int(place)
        here, there = self.squares[node], self.squares[node + 1]
        square = here + (place - node) * (there - here)
        return (speed, along) if speed * speed <= square else (math.sqrt(square), (there - here) / (2.0 * SPACING))


def speeding_up(limits: Iterable[float]) -> list[float]:
    """Return the greatest speeds at nodes within limits [m/s] to which a car can speed up from node to node."""
    speeds, speed = [], math.inf
    for limit in limits:
        speed = min(limit, math.sqrt(speed * speed + 2.0 * SPEEDING_UP * SPACING))
        speeds.append(speed)
    return speeds


def first_met(nodes: Nodes, times: Sequence[float], d: Sequence[float], body: Body, within: float = 0.0) -> int | None:
    """Return the first node at which the car comes `within` a distance [m] of a body on a way, None for nowhere."""
    return _first_within(clearances(nodes, times, d, body, CONTACT), within)


def _first_within(away: Sequence[float], within: float) -> int | None:
    return next((node for node, clear in enumerate(away) if clear < within), None)


def _target(body: Body, gap: float, time: float) -> Target:
    """Return a body in the way, met after a time [s], as a target."""
    return Target(gap, body.along, foreseen=time > 0.0 and abs(body.across) > CROSSES)
