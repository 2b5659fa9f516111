"""What a node needs of the path at a tick: its next stretch as the car sees it, and how fast to drive there."""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np

from vve_sumo.laws import squared_speed_limits
from vve_sumo.path import ReferencePath
from vve_sumo.values import Pose
from vve_sumo.wire.ros2.messages import BASE, header_of, pose_of, vector_of
from vve_sumo.wire.ros2.types import make

AHEAD: Final = 60.0  #: length of `/path/ahead` [m]: a car of 11 m/s stops within it at 1.1 m/s2
STEP: Final = 2.0  #: between its poses [m]
LATERAL: Final = 1.2  #: acceleration in bends at the speed of `/path/speed` [m/s2]
SLOWING: Final = 1.0  #: deceleration before bends [m/s2]: a node's commands are followed late


class PathAhead:
    """The next stretch of the line that the rear axle shall follow, and how fast it shall be driven there.

    The speed is the scenario's, lower in bends and before them: LATERAL sideways in a bend, SLOWING before it.
    """

    def __init__(self, line: ReferencePath, speed: float) -> None:
        """`speed` is the scenario's [m/s]."""
        s = np.arange(0.0, line.length + STEP, STEP)
        places = [line.at(min(one, line.length)) for one in s.tolist()]
        self._s, self._x, self._y = s, np.array([one.x for one in places]), np.array([one.y for one in places])
        self._heading = np.array([one.heading for one in places])
        self._curvature = [one.curvature for one in places]
        self._squares = squared_speed_limits(self._curvature, speed, LATERAL, SLOWING, STEP)

    def path(self, at: int, pose: Pose, s: float) -> Any:
        """Return nav_msgs/Path in `base_link`: poses every STEP over AHEAD, from the one before `s` [m] on."""
        first = min(int(s / STEP), len(self._s) - 2)
        part = slice(max(first, 0), max(first, 0) + round(AHEAD / STEP) + 1)
        dx, dy = self._x[part] - pose.x, self._y[part] - pose.y
        cos, sin = math.cos(pose.heading), math.sin(pose.heading)
        columns = (cos * dx + sin * dy, cos * dy - sin * dx, self._heading[part] - pose.heading)
        header = header_of(at, BASE)
        poses = [
            make("geometry_msgs/msg/PoseStamped", header, pose_of(x, y, turn))
            for x, y, turn in zip(*(column.tolist() for column in columns), strict=True)
        ]
        return make("nav_msgs/msg/Path", header, poses)

    def reference(self, at: int, s: float) -> Any:
        """Return geometry_msgs/TwistStamped: the speed at `s` [m] along the line, and the line's turn at that speed."""
        row = min(max(int(s / STEP), 0), len(self._s) - 2)
        share = min(max(s / STEP - row, 0.0), 1.0)
        square = self._squares[row] + share * (self._squares[row + 1] - self._squares[row])
        bend = self._curvature[row] + share * (self._curvature[row + 1] - self._curvature[row])
        speed = math.sqrt(square)
        twist = make("geometry_msgs/msg/Twist", vector_of(speed), vector_of(z=speed * bend))
        return make("geometry_msgs/msg/TwistStamped", header_of(at, BASE), twist)
