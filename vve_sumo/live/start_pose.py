"""Judges whether a car stands where its path begins and faces along it: before it is engaged, and for the doctor.

Knows a pose and a path only.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

from vve_sumo.frames import wrap_angle
from vve_sumo.path import ReferencePath
from vve_sumo.values import Pose

#: Largest distance of the rear axle from the path's start, in any direction [m]. A driver who parks by a mark on the
#: ground comes nearer. It is a quarter of the lateral deviation at which a moving car is stopped by default. A car that
#: is farther off stands at another start, or in another lot.
MAX_START_DISTANCE: Final = 1.0
#: Largest turn of the car against its path [rad]. A driver who parks along a line does better; a car turned by that
#: much is 1 m to the side after 11 m.
MAX_START_TURN: Final = math.radians(5.0)


class StartPose(NamedTuple):
    """A car's pose relative to the start of its path; a NaN is a fault."""

    along: float  #: past the start, in the path's direction [m]
    left: float  #: of the path [m]
    turned: float  #: against the path's direction, counter-clockwise [rad], -pi to pi

    def faults(self) -> tuple[str, ...]:
        """Return reason codes of what keeps the car from being engaged here."""
        away = () if math.hypot(self.along, self.left) <= MAX_START_DISTANCE else ("start_position",)
        turned = () if abs(self.turned) <= MAX_START_TURN else ("start_heading",)
        return away + turned

    def place_text(self) -> str:
        """Return the place in words."""
        side, end = "left" if self.left >= 0.0 else "right", "past" if self.along >= 0.0 else "before"
        return f"{abs(self.left):.1f} m {side} of the path and {abs(self.along):.1f} m {end} its start"

    def turn_text(self) -> str:
        """Return the turn in words."""
        return f"turned by {math.degrees(abs(self.turned)):.0f} deg to the {'left' if self.turned >= 0.0 else 'right'}"


def start_pose_of(pose: Pose, path: ReferencePath) -> StartPose:
    """Return a pose of the rear axle relative to the start of a path."""
    begin = path.at(0.0)
    x, y = pose.x - begin.x, pose.y - begin.y
    cosine, sine = math.cos(begin.heading), math.sin(begin.heading)
    return StartPose(x * cosine + y * sine, y * cosine - x * sine, wrap_angle(pose.heading - begin.heading))
