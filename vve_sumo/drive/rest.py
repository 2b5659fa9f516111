"""Tells what a car at rest stands before: something that stays, traffic that may move on, or nothing.

Reads the actors of one tick and the scenario's lists; knows neither SUMO nor when a drive is over.
"""

from __future__ import annotations

import enum

from vve_sumo.metrics.lead_vehicle import lead_vehicle_now
from vve_sumo.path import ReferencePath
from vve_sumo.scenario.schema import Scenario
from vve_sumo.values import Actors, Pose, Vehicle

#: a car at rest does not stand before what is farther ahead of its front bumper than this [m]
REACH = 30.0
#: an actor that is slower than this stands [m/s]
STANDING = 0.2


class Ahead(enum.Enum):
    """What a car at rest stands before."""

    STAYS = enum.auto()  #: an obstacle, or a standing actor of the scenario
    MOVES_ON = enum.auto()  #: a vehicle or person of the traffic, standing or not, or a moving actor of the scenario
    TRAFFIC = enum.auto()  #: nothing, on a road with traffic, which may have passed ahead a moment ago
    NOTHING = enum.auto()  #: nothing, on a road without traffic


class RestObserver:
    """Looks ahead of the car along its path, in the strip that the car covers."""

    def __init__(self, scenario: Scenario, path: ReferencePath, vehicle: Vehicle) -> None:
        self._path, self._vehicle = path, vehicle
        self._obstacles = frozenset(one.id for one in scenario.obstacles)
        self._actors = frozenset(one.id for one in scenario.actors)
        self._nothing = Ahead.TRAFFIC if scenario.road.demand else Ahead.NOTHING

    def ahead(self, pose: Pose | None, station: float, actors: Actors) -> Ahead:
        """Return what a car at rest with its rear axle at `pose` stands before.

        `station` [m] is the rear axle's s along the path, NaN where it is unknown; `actors` are those of the tick.
        Where the pose is unknown, nothing is ahead.
        """
        if pose is None:
            return self._nothing
        lead = lead_vehicle_now(pose, station, actors, self._path, self._vehicle)
        name = lead.actor[0]
        if not name or not lead.gap[0] <= REACH:
            return self._nothing
        if name in self._obstacles:
            return Ahead.STAYS
        stands = abs(float(actors.speed[actors.ids.index(name)])) < STANDING
        return Ahead.STAYS if name in self._actors and stands else Ahead.MOVES_ON
