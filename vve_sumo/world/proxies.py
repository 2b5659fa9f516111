"""Makes the traffic of every lane that the ego's body lies on see it.

SUMO shows an external car only to the lane its front bumper is mapped to, and takes its body to lie along that lane.
A car across a lane line, across the road, or with its nose off the road is driven through. So wherever the body
leaves its own line of lanes, each lane that it cuts gets a ghost: an unseen vehicle covering the part that is cut.
Must not know poses over time or why the ego is where it is.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Mapping

import libsumo

from vve_sumo.geometry import Box, Corners
from vve_sumo.world.lanes import Cut, Lane, Lanes, holds, in_line

EGO_PROXY_TYPE = "ego_ghost"

#: A lane gets its ghost when it is cut deeper than this [m], and loses it when it is not cut at all: centimetres of
#: GNSS noise beside a lane line shall not make a ghost come and go.
CUT_DEPTH = 0.05

#: SUMO wants vehicles to have a length [m].
MIN_LENGTH = 0.1

#: Smallest change of length that is passed on [m].
LENGTH_STEP = 0.01

#: Lanes behind the one that holds the front bumper which may still hold the tail: a short junction has two pieces.
LANES_BEHIND = 4

#: moveToXY: exact place, any edge, permissions ignored (a ghost or an obstacle may stand on a bus or bicycle lane).
KEEP_ROUTE_GHOST = 6
MATCH_THRESHOLD = 5.0


class ProxyVehicles:
    """The ghosts of one body; empty while an ego lies within its own line of lanes."""

    def __init__(self, lanes: Lanes, name: str = EGO_PROXY_TYPE) -> None:
        """Ghosts are named after `name`, unlike any other body's."""
        self._lanes, self._name = lanes, name
        self._line: deque[Lane] = deque(maxlen=LANES_BEHIND)
        self._by_lane: dict[str, str] = {}
        self._lengths: dict[str, float] = {}
        self._born = 0

    @property
    def ids(self) -> frozenset[str]:
        """Names of the vehicles that stand for the body and are no actors."""
        return frozenset(self._by_lane.values())

    @property
    def lanes(self) -> tuple[str, ...]:
        """Lanes that have a ghost now."""
        return tuple(self._by_lane)

    def place(self, body: Box, speed: float, lane: str) -> None:
        """Put a ghost on each lane that the ego cuts, for the coming step.

        `body` and `speed` [m/s] are the ego's at the coming step, `lane` the one SUMO last mapped it to ("" is
        none). Raises SUMO's errors.
        """
        self._remember(lane)
        corners = body.corners()
        if self._line and in_line(self._line, corners) and not self._in_junction(corners):
            if self._by_lane:
                self._keep({})
            return
        self.cover(body, speed, self._lanes.cut)

    def cover(self, body: Box, speed: float, cut: Callable[[Box], dict[str, Cut]]) -> None:
        """Put a ghost on each lane that a body cuts, for the coming step, whether it lies within one or not.

        `speed` [m/s] is the body's at the coming step, `cut` tells what a box cuts. Raises SUMO's errors.
        """
        cuts = cut(body)
        if cuts.keys() - self._by_lane.keys():
            firm = cut(body.grown(-CUT_DEPTH))
            cuts = {name: part for name, part in cuts.items() if name in self._by_lane or name in firm}
        self._keep(cuts)
        for part in cuts.values():
            self._show(part, body.heading, speed)

    def leave(self) -> None:
        """Take every ghost off the street; raises SUMO's errors."""
        self._keep({})

    def _remember(self, name: str) -> None:
        """Keep the lanes that the ego came along, newest first."""
        if self._line and self._line[0].id == name:
            return
        if self._line and not self._lanes.follows(self._line[0].id, name):
            self._line.clear()
        if name in self._lanes.by_id:
            self._line.appendleft(self._lanes.by_id[name])

    def _in_junction(self, corners: Corners) -> bool:
        """Whether a part of the body that lies in its own line of lanes lies where other lanes cross those."""
        inside = [lane.bands for lane in self._line if lane.id.startswith(":")]
        return any(holds(bands, x, y) for bands in inside for x, y in corners)

    def _keep(self, cuts: Mapping[str, Cut]) -> None:
        for name in [name for name in self._by_lane if name not in cuts]:
            ghost = self._by_lane.pop(name)
            self._lengths.pop(ghost, None)
            libsumo.vehicle.remove(ghost)

    def _show(self, cut: Cut, heading: float, speed: float) -> None:
        lane = cut.lane
        x, y, along = lane.at(cut.end)
        seen_speed = max(0.0, speed * math.cos(heading - along))
        ghost = self._by_lane.get(lane.id) or self._add(lane, seen_speed)
        length = max(cut.end - cut.start, MIN_LENGTH)
        if abs(length - self._lengths[ghost]) > LENGTH_STEP:
            libsumo.vehicle.setLength(ghost, length)
            self._lengths[ghost] = length
        angle = math.degrees(0.5 * math.pi - along) % 360.0
        libsumo.vehicle.moveToXY(ghost, lane.edge, lane.index, x, y, angle, KEEP_ROUTE_GHOST, MATCH_THRESHOLD)
        libsumo.vehicle.setSpeed(ghost, seen_speed)

    def _add(self, lane: Lane, speed: float) -> str:
        ghost = f"{self._name}.{self._born}"
        self._born += 1
        libsumo.vehicle.add(ghost, self._lanes.route(lane.id), EGO_PROXY_TYPE, departSpeed=f"{speed}")
        libsumo.vehicle.setSpeedMode(ghost, 32)
        libsumo.vehicle.setLaneChangeMode(ghost, 0)
        self._by_lane[lane.id], self._lengths[ghost] = ghost, 0.0
        return ghost
