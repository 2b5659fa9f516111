"""A brain that steers by pure pursuit and keeps a constant time headway.

    python pursuit_headway.py WAYPOINTS.csv [--gnss PORT] [--radar PORT] [--setpoints PORT] [--key FILE] [--speed M/S]

Steering: R. C. Coulter, "Implementation of the Pure Pursuit Path Tracking Algorithm", CMU-RI-TR-92-01, 1992. Law: the
constant time gap of adaptive cruise control, R. Rajamani, "Vehicle Dynamics and Control", chapter 6: the acceleration
is linear in the error of the gap and in the range rate. It sees by NCOM and radar datagrams.
"""

from __future__ import annotations

import math

from driving import LOOKAHEAD, SHORTEST, WHEELBASE, answer_by_radar, waypoints
from following import Follower, Lead

HEADWAY, BY_GAP, BY_RATE = 1.5, 0.25, 0.8  # [s], [1/s2], [1/s]
BY_SPEED, EASIEST = 0.8, 1.2  # [1/s], [m/s2]


class PursuitHeadway(Follower):
    """Steers towards a place ahead on the way; keeps a gap that grows with the speed."""

    def steering(self, x: float, y: float, heading: float, speed: float) -> float:
        """Return the angle of the circle through a place ahead on the way [rad]."""
        goal = self._goal(x, y, max(SHORTEST, LOOKAHEAD * speed))
        far = math.hypot(goal[0] - x, goal[1] - y)
        aside = math.atan2(goal[1] - y, goal[0] - x) - heading
        return math.atan(2.0 * WHEELBASE * math.sin(aside) / max(far, 1.0))

    def law(self, speed: float, free: float, lead: Lead | None) -> float:
        """Return the lesser of what keeps the speed and what keeps the headway [m/s2]."""
        kept = min(BY_SPEED * (free - speed), EASIEST)
        if lead is None:
            return kept
        return min(kept, BY_GAP * (lead.gap - self.standoff - HEADWAY * speed) - BY_RATE * lead.closing)


if __name__ == "__main__":
    answer_by_radar(lambda given: PursuitHeadway(waypoints(given.waypoints), given.speed), __doc__)
