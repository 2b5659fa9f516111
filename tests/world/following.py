"""An experiment: how hard a car that follows the ego brakes, for any stream of poses of the ego."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import libsumo

from tests.world.streets import ALONE, PERIOD, demand, street
from vve_sumo.values import EGO, Pose
from vve_sumo.world.world import World

#: It acts in every step, so it sees every twitch of the ego.
FOLLOWER = (
    '<vType id="follower" sigma="0" speedDev="0" actionStepLength="0.02"/>'
    '<vehicle id="follower" type="follower" depart="0" departPos="60" departLane="0" departSpeed="15">'
    '<route edges="east"/></vehicle>'
)


def follower_accelerations(folder: Path, poses: Iterable[Pose]) -> list[float]:
    """Accelerations [m/s2] at every step of a car that starts on lane 0 at x = 60 m with 15 m/s.

    The poses are the front bumper's, one a step, on the one-lane street (y = -1.6, eastward).
    """
    follower = demand(folder, FOLLOWER, "follower")
    seen = []
    with World(street(folder, 1), demand=[follower], seed=1, period=PERIOD, egos=ALONE, warm_up=PERIOD * 2) as world:
        for pose in poses:
            world.step({EGO: pose})
            seen.append(libsumo.vehicle.getAcceleration("follower"))
    return seen
