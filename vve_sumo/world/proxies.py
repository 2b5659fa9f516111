"""Makes the ego visible to the traffic of every lane on which its body lies, by proxy vehicles.

SUMO shows an external car only to the lane to which its front bumper is mapped, and assumes that its body lies along
that lane. Traffic drives through a car that lies across a lane line, across the road, or with its front off the road.
So where the body leaves its own line of lanes, each lane that it cuts, by more than its edge, gets a proxy vehicle that
covers the part that is cut. Proxies are no actors: sensors do not see them. Must not know poses over time or why the
ego is where it is.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Final

import libsumo

from vve_sumo.geometry import Box, Corners
from vve_sumo.world.coverage import RoadStrip
from vve_sumo.world.lanes import Cut, Lane, Lanes, holds

EGO_PROXY_TYPE: Final = "ego_ghost"

#: A lane gets its proxy when the body, smaller by this on every side, cuts it [m], and loses the proxy when the body
#: does not cut it at all: so centimetres of GNSS noise beside a lane line do not make a proxy come and go.
CUT_DEPTH: Final = 0.05
#: The same of a lane inside a junction. Such lanes lie over each other, and traffic keeps to their middle: a car that
#: waits there to turn left, a corner on the edge of a lane that ends beside it, would hold up those who go straight on.
#: Of a narrow body it is this share of its width.
JUNCTION_CUT_DEPTH, SHARE_OF_WIDTH = 0.25, 0.15

#: Smallest length of a proxy [m]: SUMO needs a length above 0.
MIN_LENGTH: Final = 0.1

#: On lanes that go the other way than the one that the ego is mapped to, a proxy's front is so much behind the ego's
#: front bumper [m]. Where two such lanes know of each other (SUMO's `neigh`), their traffic takes the ego for a leader,
#: too, and what is behind its front bumper along the lane for its body; of the two it heeds the one farther back.
BEHIND_FRONT: Final = 0.05

#: Cosine of the angle between two lanes below which one goes the other way.
AGAINST: Final = -0.7

#: A change of length is passed on to SUMO above this [m].
LENGTH_STEP: Final = 0.01

#: Number of newest lanes, front bumper's included, that may hold the body: a short junction has two pieces.
LANES_BEHIND: Final = 4

#: Flag of moveToXY for an exact place, any edge and no permissions: proxies and obstacles may stand on a bus lane.
KEEP_ROUTE_GHOST: Final = 6
MATCH_THRESHOLD: Final = 5.0


class ProxyVehicles:
    """The proxy vehicles of one body; none while the ego lies within its own line of lanes."""

    def __init__(self, lanes: Lanes, name: str) -> None:
        """The names of the proxies begin with `name`, which must be different for each body."""
        self._lanes, self._name = lanes, name
        self._line: deque[Lane] = deque(maxlen=LANES_BEHIND)
        self._by_lane: dict[str, str] = {}
        self._lengths: dict[str, float] = {}
        self._born = 0
        self._strips: list[tuple[RoadStrip, ...]] = [
            ()
        ] * 4  #: for each corner of the body the piece of the line it lay on

    @property
    def ids(self) -> frozenset[str]:
        """Names of the proxies, which are no actors."""
        return frozenset(self._by_lane.values())

    @property
    def lanes(self) -> tuple[str, ...]:
        """Lanes that have a proxy now."""
        return tuple(self._by_lane)

    def place(self, body: Box, speed: float, lane: str) -> None:
        """Put a proxy on each lane that the ego cuts, for the coming step.

        No proxy is put while the body lies within its own line of lanes and outside junctions. `body` and
        `speed` [m/s] are the ego's at the coming step, `lane` the lane to which SUMO last mapped it ("" is none).
        Raises SUMO's errors.
        """
        self._remember(lane)
        corners = body.corners()
        if self._in_own_lanes(corners):
            if self._by_lane:
                self._keep({})
            return
        self.cover(body, speed, self._cut_behind_front)

    def cover(self, body: Box, speed: float, cut: Callable[[Box], dict[str, Cut]]) -> None:
        """Put a proxy on each lane that a body cuts, for the coming step, even where it lies within one lane.

        `speed` [m/s] is the body's at the coming step; `cut` returns the lanes that a box cuts. Raises SUMO's errors.
        """
        cuts = cut(body)
        if cuts.keys() - self._by_lane.keys():
            deeper = max(CUT_DEPTH, min(JUNCTION_CUT_DEPTH, SHARE_OF_WIDTH * body.width))
            firm, inside = (cut(body.grown(-depth)) for depth in (CUT_DEPTH, deeper))
            cuts = {
                name: part
                for name, part in cuts.items()
                if name in self._by_lane or name in (inside if name.startswith(":") else firm)
            }
        self._keep(cuts)
        for part in cuts.values():
            self._show(part, body.heading, speed)

    def _cut_behind_front(self, box: Box) -> dict[str, Cut]:
        """Return the lanes that a box cuts, on lanes that go against its own up to the front bumper alone."""
        cuts = self._lanes.cut(box)
        if not self._line:
            return cuts
        reach = 0.5 * box.length
        x, y = box.x + reach * math.cos(box.heading), box.y + reach * math.sin(box.heading)
        own = self._line[0]
        along = own.at(own.nearest(x, y))[2]
        return {name: _up_to(part, part.lane.nearest(x, y), along) for name, part in cuts.items()}

    def leave(self) -> None:
        """Remove every proxy; raises SUMO's errors."""
        self._keep({})

    def _remember(self, name: str) -> None:
        """Keep the lanes along which the ego came, newest first."""
        if self._line and self._line[0].id == name:
            return
        self._strips = [()] * 4
        if self._line and not self._lanes.follows(self._line[0].id, name):
            self._line.clear()
        if name in self._lanes.by_id:
            self._line.appendleft(self._lanes.by_id[name])

    def _in_own_lanes(self, corners: Corners) -> bool:
        """Return whether every corner lies within the line of lanes, none on a lane inside a junction.

        Other lanes may cross there.
        """
        inside = [band for lane in self._line if lane.id.startswith(":") for band in lane.bands]
        if inside and any(holds(inside, x, y) for x, y in corners):
            return False
        for number, (x, y) in enumerate(corners):
            # The piece that held this corner at the last tick mostly still does.
            if not holds(self._strips[number], x, y):
                held = next((band for lane in self._line for band in lane.bands if holds((band,), x, y)), None)
                if held is None:
                    return False
                self._strips[number] = (held,)
        return bool(self._line)

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


def _up_to(part: Cut, front: float, along: float) -> Cut:
    """Return what of a cut lies before the front bumper [m], where its lane goes against a direction [rad]."""
    if math.cos(part.lane.at(front)[2] - along) >= AGAINST:
        return part
    end = max(min(part.end, front - BEHIND_FRONT), MIN_LENGTH)
    return replace(part, start=min(part.start, end - MIN_LENGTH), end=end)
