"""The worst setpoints that the limiter lets through, in closed loop: the true body never leaves the lot.

At the last moment that the geofence allows, setpoints end, and the last good one is acted on until it expires.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from controllers import follow_and_stop
from tests import vehicles
from tests.exhaustive import with_slow
from tests.vehicle.closed_loop import ClosedLoop, straight
from vve_sumo.drive.pipeline import Pipeline
from vve_sumo.drive.resolved_scenario import PERIOD
from vve_sumo.frames import Alignment
from vve_sumo.lot.geofence import Geofence, StopModel, no_drift
from vve_sumo.lot.polygon import Lot
from vve_sumo.lot.swept_area import Body
from vve_sumo.lot.turning import Turning
from vve_sumo.values import ArmingState, ControlCommand, Observation
from vve_sumo.vehicle.drift import unseen_drift
from vve_sumo.vehicle.gateway import Gateway
from vve_sumo.vehicle.limits import COMFORT, Limits

VEHICLE = vehicles.FUSION.vehicle
LAG = vehicles.FUSION.calibration.drive_lag
GATEWAY = StopModel(2.4, 0.13 + VEHICLE.brake_delay + VEHICLE.brake_lag, 0.48, LAG)
WATCHDOG = StopModel(2.5, 0.22, 0.0, LAG)
CORNERS = Body.of(VEHICLE).corners
FULL = 0.55  #: wheels turned as far as they go [rad]

Play = Callable[[float], tuple[float, float]]  # from time [s] to acceleration [m/s2] and road-wheel angle [rad]


class LegalBrain:
    """Follows the path for 30 m, then asks for whatever `play` says."""

    def __init__(self, play: Play) -> None:
        self._follower, self._play, self._since = follow_and_stop.make(VEHICLE, {}), play, math.inf

    def step(self, observation: Observation) -> ControlCommand:
        if observation.pose.x < 30.0:
            return self._follower.step(observation)
        self._since = min(self._since, observation.time)
        acceleration, steering = self._play(observation.time - self._since)
        return ControlCommand(steering, acceleration if observation.pose.speed < 12.0 else min(acceleration, 0.0))


def room(
    play: Play,
    speed: float,
    lot: Lot,
    silent_from: float = math.inf,
    jerk: float = COMFORT.jerk,
    drift: Callable[[float], float] = unseen_drift,
) -> tuple[float, float]:
    """Least distance of the true body from the lot's edge [m], margin kept, and when the gateway began to stop [s]."""
    fence = Geofence(
        lot,
        VEHICLE,
        Alignment(),
        gateway=replace(GATEWAY, jerk=jerk),
        watchdog=replace(WATCHDOG, jerk=jerk),
        turning=Turning.of(VEHICLE, 5.0, 0.13, COMFORT.acceleration),
        drift=drift,
    )
    loop = ClosedLoop(straight(500.0), speed, controller=LegalBrain(play), pipeline=partial(Pipeline, geofence=fence))  # type: ignore[arg-type]
    limits = Limits(comfort=replace(COMFORT, jerk=jerk))
    loop.gateway = Gateway(VEHICLE, vehicles.FUSION.calibration, limits, PERIOD)
    loop.silent_from = silent_from
    least, stopped = math.inf, math.inf
    for ticked in loop.ticks():
        truth = ticked.truth
        places = truth.x + 1j * truth.y + np.exp(1j * truth.heading) * CORNERS
        least = min(least, lot.clearance(np.stack((places.real, places.imag), axis=-1)[None]))
        if ticked.status.state is ArmingState.STOPPING:
            stopped = min(stopped, ticked.now)
        if (stopped < math.inf and truth.speed == 0.0) or ticked.now > 60.0:
            return least, stopped
    raise AssertionError("ticks never end by themselves")


def assert_inside(play: Play, speed: float, lot: Lot) -> None:
    least, stopped = room(play, speed, lot)
    assert least >= 0.0
    assert stopped < math.inf, "the geofence never stopped this brain"
    least, _ = room(play, speed, lot, silent_from=stopped - 0.5 * PERIOD)
    assert least >= 0.0


def beside(offset: float, slant: float = 0.0) -> Lot:
    """A lot whose left edge is `offset` [m] beside the path and turned towards it by `slant` [rad]."""
    far = offset - 200.0 * math.tan(slant)
    return Lot([(-20.0, -60.0), (180.0, -60.0), (180.0, max(far, -50.0)), (-20.0, offset)], margin=1.0)


@pytest.mark.thorough
@pytest.mark.parametrize("speed", with_slow([2.0, 5.0, 8.0], lambda speed: speed == 5.0))
@pytest.mark.parametrize(
    "play",
    [
        lambda t: (2.0, FULL),
        lambda t: (0.0, FULL if t % 0.8 < 0.4 else -FULL),
    ],
    ids=["towards the edge", "bang-bang"],
)
def test_the_worst_legal_brain_beside_an_edge_stays_inside(play: Play, speed: float) -> None:
    assert_inside(play, speed, beside(2.8))


@pytest.mark.thorough
def test_full_throttle_towards_a_wall_stays_inside() -> None:
    assert_inside(lambda t: (2.0, 0.0), 5.0, Lot([(-20.0, -30.0), (110.0, -30.0), (110.0, 30.0), (-20.0, 30.0)]))


@pytest.mark.parametrize("onset", with_slow([0.0, 0.04, 0.08, 0.12, 0.16, 0.2], lambda onset: onset == 0.08))
def test_a_throttle_that_a_rig_lets_jump_keeps_its_room_before_a_wall(onset: float) -> None:
    """Full throttle within 0.1 s, again and again at other moments; the receiver does not drift."""
    wall = Lot([(-20.0, -30.0), (60.0, -30.0), (60.0, 30.0), (-20.0, 30.0)])

    def play(t: float) -> tuple[float, float]:
        return (2.0 if (t + onset) % 0.5 < 0.25 else -0.5), 0.0

    least, stopped = room(play, 5.0, wall, jerk=20.0, drift=no_drift)
    assert least >= 0.0
    assert stopped < math.inf, "the geofence never stopped this brain"


@pytest.mark.thorough
@pytest.mark.parametrize("seed", with_slow(range(3), lambda seed: seed == 0))
def test_random_brains_towards_a_slanting_edge_stay_inside(seed: int) -> None:
    random = np.random.default_rng(seed)
    steering, acceleration = random.uniform(-FULL, FULL, 200), random.uniform(-1.0, 4.0, 200)

    def play(t: float) -> tuple[float, float]:
        part = min(int(t / 0.3), 199)
        return float(acceleration[part]), float(steering[part])

    assert_inside(play, float(random.uniform(3.0, 9.0)), beside(16.0, math.radians(float(random.uniform(5.0, 12.0)))))
