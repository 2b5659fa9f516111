"""One ego on the virtual road: where it is, how SUMO holds it, what traffic sees of it, who waits for it.

Keeps the state of one ego; `world` says when each part of it is due. Must not know other egos.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from vve_sumo.body_kinds import TYPICAL
from vve_sumo.geometry import Box, behind_bumper
from vve_sumo.values import Actors, Pose
from vve_sumo.world.ego_sync import Ego, EgoSync
from vve_sumo.world.lanes import Lanes
from vve_sumo.world.proxies import EGO_PROXY_TYPE, ProxyVehicles
from vve_sumo.world.standoff import Standoff
from vve_sumo.world.surroundings import Row, body_of, row_of, table

#: SUMO vehicle class that decides how well the radar of another ego sees an ego
EGO_CLASS = "passenger"


class PlacedEgo:
    """An ego with all that the virtual road keeps of it."""

    def __init__(self, lanes: Lanes, ego: Ego) -> None:
        """Prepare an ego that has no pose yet."""
        self.id, self._vehicle = ego.id, ego.vehicle
        self.sync = EgoSync(lanes, ego)
        # An actor's id has no colon: its proxies never have the names of an ego's.
        self.proxies = ProxyVehicles(lanes, f"{EGO_PROXY_TYPE}:{ego.id}")
        self.standoff = Standoff()
        self.pose: Pose | None = None  #: of the front bumper, the last that was accepted
        self.body: Box | None = None  #: at that pose
        self.moves = False  #: whether that pose is the coming step's; else the ego stands there
        self.rows: Sequence[Row] = ()  #: of the actors around it
        self.snapshot: Actors = table(0.0, ())  #: the same as a table
        self.route = ego.route
        self.looked_at: Pose | None = None  #: the pose at which it was last looked for passed lines
        self.red_light = ""  #: the signal that it passed on red in the last step; empty for none
        self.stop_sign = ""  #: the lane past whose stop sign it went in that step without a stop; empty for none

    def place(self, pose: Pose) -> bool:
        """Have the front bumper at `pose` when the coming step ends; return whether the pose was accepted."""
        if not self.sync.place(pose):
            return False
        self.pose = pose
        self.body = behind_bumper(pose.x, pose.y, pose.heading, self._vehicle.length, self._vehicle.width)
        return True

    def row(self) -> Row:
        """Return the ego, once it has a pose, as an actor among those around another ego."""
        pose, body = self.pose, self.body
        assert pose is not None and body is not None  # noqa: PT018
        lateral = pose.lateral_speed - 0.5 * body.length * pose.yaw_rate  # of the centre
        speed, lateral = (pose.speed, lateral if math.isfinite(lateral) else 0.0) if self.moves else (0.0, 0.0)
        seen = body_of("", EGO_CLASS, body.length, body.width, TYPICAL["car"].height)
        return row_of(self.id, (body.x, body.y, body.heading), speed, seen, lateral)
