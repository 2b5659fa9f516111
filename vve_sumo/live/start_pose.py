"""Whether a car stands where its path begins and faces along it: judged before it is engaged, and by the doctor.

Knows a pose and a path; not who asks, nor what follows.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

from vve_sumo.frames import wrap_angle
from vve_sumo.path import Path
from vve_sumo.values import Pose

#: The rear axle may stand so far from the path's start, in any direction [m]. A driver who parks by a mark on the
#: ground comes nearer than that, and it is a quarter of the deviation at which a car under way is stopped by default:
#: a car that stands farther off stands at another start, or in another lot.
MAX_START_DISTANCE: Final = 1.0
#: The car may be turned so much against its path [rad]. A driver who parks along a line is nearer than that, and over
#: 11 m it takes a car 1 m to the side.
MAX_START_TURN: Final = math.radians(5.0)


class StartPose(NamedTuple):
    """How a car stands to the start of its path; NaN is no number that holds."""

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


def start_pose_of(pose: Pose, path: Path) -> StartPose:
    """Return how a pose of the rear axle stands to the start of a path."""
    begin = path.at(0.0)
    x, y = pose.x - begin.x, pose.y - begin.y
    cosine, sine = math.cos(begin.heading), math.sin(begin.heading)
    return StartPose(x * cosine + y * sine, y * cosine - x * sine, wrap_angle(pose.heading - begin.heading))
