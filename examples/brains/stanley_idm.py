"""A brain that steers as Stanley did and keeps its distance by the Intelligent Driver Model.

    python stanley_idm.py WAYPOINTS.csv [--gnss PORT] [--radar PORT] [--setpoints PORT] [--key FILE] [--speed M/S]

Steering: G. Hoffmann, C. Tomlin, M. Montemerlo, S. Thrun, "Autonomous Automobile Trajectory Tracking for Off-Road
Driving", American Control Conference 2007. Law: M. Treiber, A. Hennecke, D. Helbing, "Congested traffic states in
empirical observations and microscopic simulations", Physical Review E 62, 2000. It sees by NCOM and radar datagrams.
"""

from __future__ import annotations

import math

from driving import WHEELBASE, answer_by_radar, waypoints
from following import Follower, Lead

GAIN, SOFT = 1.2, 1.0  # of the distance aside [1/s], speed added for slow driving [m/s]
ACCELERATION, BRAKING, TIME_GAP = 1.2, 1.8, 1.0  # of the model [m/s2], [m/s2], [s]


class StanleyIdm(Follower):
    """Steers by the front axle; follows by the model."""

    def steering(self, x: float, y: float, heading: float, speed: float) -> float:
        """Return the angle that turns the front wheels along the way and towards it [rad]."""
        front = self.spot(x + WHEELBASE * math.cos(heading), y + WHEELBASE * math.sin(heading))
        off = (front.heading - heading + math.pi) % math.tau - math.pi
        return off + math.atan2(-GAIN * front.aside, SOFT + speed)

    def law(self, speed: float, free: float, lead: Lead | None) -> float:
        """Return the model's acceleration [m/s2]."""
        interaction = 0.0
        if lead is not None:
            approach = speed * lead.closing / (2.0 * math.sqrt(ACCELERATION * BRAKING))
            wanted = self.standoff + max(0.0, speed * TIME_GAP + approach)
            interaction = (wanted / lead.gap) ** 2
        return ACCELERATION * (1.0 - (speed / max(free, 0.1)) ** 4 - interaction)


if __name__ == "__main__":
    answer_by_radar(lambda given: StanleyIdm(waypoints(given.waypoints), given.speed), __doc__)
