"""A brain whose law is the Intelligent Driver Model of the public package cavsandbox (MIT); it steers by pure pursuit.

    pip install cavsandbox
    python cavsandbox_idm.py WAYPOINTS.csv [--gnss PORT] [--radar PORT] [--setpoints PORT] [--key FILE] [--speed M/S]

The package computes the acceleration from the car's speed, the gap and the speed of the vehicle ahead; all else, from
which target is ahead to the hold at rest, is `following.Follower`'s. It sees by NCOM and radar datagrams.
"""

from __future__ import annotations

from cacc_sim.core import VehicleState
from cacc_sim.driving_models import IDMModel
from driving import answer_by_radar, waypoints
from following import Lead
from pursuit_headway import PursuitHeadway

FREE = 1000.0  # gap that stands for a free road [m]
HEADWAY = 1.5  # [s]
SLOWEST = 0.5  # speed that the law is asked to keep, at least: it divides by it [m/s]


class CavsandboxIdm(PursuitHeadway):
    """Keeps the distance that the package's model keeps."""

    def law(self, speed: float, free: float, lead: Lead | None) -> float:
        """Return the model's acceleration [m/s2] behind a lead where there is one, at the way's `free` speed [m/s]."""
        gap, ahead = (FREE, free) if lead is None else (lead.gap, speed - lead.closing)
        model = IDMModel(max(free, SLOWEST), HEADWAY, s0=self.standoff)
        # The model reads speed, gap and lead_speed alone.
        state = VehicleState(speed=speed, acceleration=0.0, time=0.0, position=0.0, gap=gap, lead_speed=ahead)
        return float(model.compute(state).acceleration)


if __name__ == "__main__":
    answer_by_radar(lambda given: CavsandboxIdm(waypoints(given.waypoints), given.speed), __doc__)
