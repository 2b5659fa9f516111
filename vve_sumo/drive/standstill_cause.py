"""Tells what a car at rest stands before: something that stays, traffic that may move on, or nothing.

Reads the actors of one tick and the scenario's lists; knows neither SUMO nor when a drive is over.
"""

from __future__ import annotations

import enum
from typing import NamedTuple

from vve_sumo.metrics.lead_vehicle import lead_vehicle_now
from vve_sumo.path import ReferencePath
from vve_sumo.scenario.schema import Scenario
from vve_sumo.values import Actors, Pose, Vehicle

#: a car at rest does not stand before what is farther ahead of its front bumper than this [m]
REACH = 30.0
#: an actor that is slower than this stands [m/s]
STANDING = 0.2


class StandstillCause(enum.Enum):
    """What a car at rest stands before."""

    PERMANENT = enum.auto()  #: an obstacle, or a standing actor of the scenario
    #: a vehicle or person of the traffic or another ego, standing or not, or a moving actor of the scenario
    TEMPORARY = enum.auto()
    #: nothing, on a road with traffic or other egos, one of which may have passed ahead a moment ago
    CLEAR_WITH_TRAFFIC = enum.auto()
    CLEAR = enum.auto()  #: nothing, on a road without traffic


class DeclaredBodies(NamedTuple):
    """Whom a scenario puts on the virtual road, by their ids."""

    obstacles: tuple[str, ...]
    actors: tuple[str, ...]  #: people among them
    egos: tuple[str, ...]  #: without that of [ego], in order

    @classmethod
    def of(cls, scenario: Scenario) -> DeclaredBodies:
        """Return those of a scenario."""
        actors = tuple(one.id for one in scenario.actors) + tuple(one.id for one in scenario.people)
        egos = tuple(sorted(one.id for one in scenario.egos))
        return cls(tuple(one.id for one in scenario.obstacles), actors, egos)


class StandstillClassifier:
    """Looks ahead of the car along its path, in the strip that the car covers."""

    def __init__(
        self, scenario: Scenario, path: ReferencePath, vehicle: Vehicle, declared: DeclaredBodies | None = None
    ) -> None:
        """`declared` are the bodies of the drive's scenario where `scenario`, a further ego's, does not hold them."""
        self._path, self._vehicle = path, vehicle
        bodies = declared or DeclaredBodies.of(scenario)
        self._obstacles, self._actors = frozenset(bodies.obstacles), frozenset(bodies.actors)
        traffic = scenario.road.demand or bodies.egos
        self._nothing = StandstillCause.CLEAR_WITH_TRAFFIC if traffic else StandstillCause.CLEAR

    def classify(self, pose: Pose | None, s: float, actors: Actors) -> StandstillCause:
        """Return what a car at rest with its rear axle at `pose` stands before.

        `s` [m] is the rear axle's along the path, NaN where it is unknown; `actors` are those of the tick.
        Where the pose is unknown, nothing is ahead.
        """
        if pose is None:
            return self._nothing
        lead = lead_vehicle_now(pose, s, actors, self._path, self._vehicle)
        name = lead.actor[0]
        if not name or not lead.gap[0] <= REACH:
            return self._nothing
        if name in self._obstacles:
            return StandstillCause.PERMANENT
        stands = abs(float(actors.speed[actors.ids.index(name)])) < STANDING
        return StandstillCause.PERMANENT if name in self._actors and stands else StandstillCause.TEMPORARY
