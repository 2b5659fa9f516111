"""Puts obstacles on the virtual road: what stands for the whole drive exactly where they were declared.

Radar and contact tests see the declared box itself. Traffic sees a proxy vehicle on each lane that the box cuts. The
proxy has a declared stop, the only representation to which SUMO's drivers react early (they change lanes ahead of it
and queue at their usual gap). Must not know the ego.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import libsumo

from vve_sumo.errors import ConfigError
from vve_sumo.geometry import Box
from vve_sumo.world.lanes import Cut, Lanes
from vve_sumo.world.proxies import KEEP_ROUTE_GHOST, MATCH_THRESHOLD

OBSTACLE_PROXY_TYPE = "obstacle_stand_in"

#: A lane is blocked when the box, smaller by this on every side, cuts it [m].
CUT_DEPTH = 0.05

#: An obstacle farther than this from every lane is a mistake in its coordinates [m].
MAX_DISTANCE_FROM_LANES = 50.0

#: A stop that outlasts every drive [s].
FOREVER = 1e9


@dataclass(frozen=True, slots=True)
class MapSpot:
    """A place given in the map."""

    x: float  #: centre of the box, map [m]
    y: float  #: centre of the box, map [m]
    heading: float  #: [rad] counter-clockwise from the map's +x


@dataclass(frozen=True, slots=True)
class LaneSpot:
    """A place given along a lane, facing in the lane's direction."""

    lane: str  #: of SUMO, such as "street_0"
    position: float  #: of the front bumper from the lane's start, along its drawn centre line [m]
    offset: float = 0.0  #: of the box from the centre line [m], left positive


@dataclass(frozen=True, slots=True)
class Obstacle:
    """What stands on the road, declared before the drive."""

    id: str  #: different from any other actor's
    at: MapSpot | LaneSpot  #: where it stands
    length: float = 4.5  #: [m]
    width: float = 1.8  #: [m]
    kind: str = "car"  #: one of BODY_KINDS; decides its height, and how radar and lidar see it


def body(obstacle: Obstacle, lanes: Lanes) -> Box:
    """Return the box of a declared obstacle.

    Raises ConfigError for numbers that are not finite, a size that is not positive, an unknown or too short lane, and
    a place off the network.
    """
    numbers = [getattr(obstacle.at, name) for name in obstacle.at.__slots__ if name != "lane"]
    if not all(map(math.isfinite, [*numbers, obstacle.length, obstacle.width])):
        raise ConfigError(f"obstacle {obstacle.id}: finite numbers expected, got {obstacle}")
    if obstacle.length <= 0.0 or obstacle.width <= 0.0:
        raise ConfigError(f"obstacle {obstacle.id}: positive size expected, got {obstacle.length} x {obstacle.width} m")
    at = obstacle.at
    box = _on_lane(obstacle, at, lanes) if isinstance(at, LaneSpot) else _on_map(obstacle, at)
    lane, distance = lanes.nearest(box.x, box.y)
    if distance > MAX_DISTANCE_FROM_LANES:
        raise ConfigError(
            f"obstacle {obstacle.id}: at ({box.x:.1f}, {box.y:.1f}) it is off the network, "
            f"{distance:.0f} m from the nearest lane {lane.id}"
        )
    return box


def _on_map(obstacle: Obstacle, spot: MapSpot) -> Box:
    return Box(spot.x, spot.y, math.remainder(spot.heading, math.tau), obstacle.length, obstacle.width)


def _on_lane(obstacle: Obstacle, spot: LaneSpot, lanes: Lanes) -> Box:
    if spot.lane not in lanes.by_id:
        raise ConfigError(f"obstacle {obstacle.id}: lane of the network expected, got {spot.lane!r}")
    lane = lanes.by_id[spot.lane]
    if not 0.0 <= spot.position <= lane.drawn_length:
        raise ConfigError(
            f"obstacle {obstacle.id}: position of 0 to {lane.drawn_length:.1f} m on lane {lane.id} expected, "
            f"got {spot.position}"
        )
    x, y, heading = lane.at(spot.position)
    cos, sin, back = math.cos(heading), math.sin(heading), 0.5 * obstacle.length
    return Box(
        x - back * cos - spot.offset * sin, y - back * sin + spot.offset * cos, heading, obstacle.length, obstacle.width
    )


class Obstacles:
    """The obstacles of a drive and their proxy vehicles in SUMO."""

    def __init__(self, obstacles: Sequence[Obstacle], lanes: Lanes) -> None:
        """Compute the obstacles' boxes; raises ConfigError as `body` does, and where two share a name."""
        names = [obstacle.id for obstacle in obstacles]
        if len(set(names)) < len(names):
            twice = next(name for name in names if names.count(name) > 1)
            raise ConfigError(f"obstacle {twice}: every obstacle needs a name of its own")
        self._lanes = lanes
        self.declared = tuple((obstacle, body(obstacle, lanes)) for obstacle in obstacles)
        self.proxies: frozenset[str] = frozenset()

    def enter(self) -> None:
        """Put the proxies on the still empty road; they are effective from the coming step on."""
        names: list[str] = []
        for cut in self._blocked():
            names.append(f"{OBSTACLE_PROXY_TYPE}.{len(names)}")
            self._stand(names[-1], cut)
        self.proxies = frozenset(names)

    def settle(self) -> None:
        """Declare the proxies' stops, one step after `enter`: SUMO accepts a stop only for a vehicle on its lane."""
        for name in self.proxies:
            lane = libsumo.vehicle.getLaneID(name)
            edge, _, index = lane.rpartition("_")
            libsumo.vehicle.setStop(name, edge, libsumo.vehicle.getLanePosition(name), int(index), FOREVER)
            libsumo.vehicle.setSpeed(name, -1.0)

    def _blocked(self) -> Iterable[Cut]:
        """Yield the part of each lane that each box cuts; boxes that share a lane each have their own part."""
        for _, box in self.declared:
            yield from self._lanes.cut(box.grown(-CUT_DEPTH)).values()

    def _stand(self, name: str, cut: Cut) -> None:
        x, y, heading = cut.lane.at(cut.end)
        libsumo.vehicle.add(name, self._lanes.route(cut.lane.id), OBSTACLE_PROXY_TYPE, departSpeed="0")
        libsumo.vehicle.setLength(name, cut.end - cut.start)
        angle = math.degrees(0.5 * math.pi - heading) % 360.0
        libsumo.vehicle.moveToXY(name, cut.lane.edge, cut.lane.index, x, y, angle, KEEP_ROUTE_GHOST, MATCH_THRESHOLD)
        libsumo.vehicle.setSpeed(name, 0.0)
