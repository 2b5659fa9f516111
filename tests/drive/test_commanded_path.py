"""Commands that carry a path of their own: where the car comes to rest, and what the geofence says, by the truth."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest

from tests.drive.swerve import Swerver, over_and_back
from tests.lot.test_geofence import GATEWAY, WATCHDOG
from tests.vehicle.closed_loop import ClosedLoop, Ticked, straight
from tests.vehicles import FUSION
from vve_sumo.drive.pipeline import Pipeline
from vve_sumo.frames import Alignment
from vve_sumo.lot.geofence import Geofence
from vve_sumo.lot.polygon import Lot
from vve_sumo.values import ArmingState

CAR = FUSION.vehicle
SPEED = 7.0  #: [m/s]
#: 3 m aside between 40 m and 70 m, around a car that stands at 80 m, and back
AROUND = over_and_back((40.0, 70.0, 90.0, 120.0), 3.0)
#: of the car from the line that it meant to drive, when the gateway has led it to rest [m]
TOLERANCE = 0.3


def stopped_from(place: float, controller: Swerver, *, raising: bool = False) -> Ticked:
    """Return the tick at rest of a drive whose setpoints, or whose controller, end at a place along x [m]."""
    loop = ClosedLoop(straight(), SPEED, controller=controller)
    for ticked in loop.ticks():
        if ticked.truth.x >= place and loop.silent_from == controller.fails_from == np.inf:
            if raising:
                controller.fails_from = ticked.now
            else:
                loop.silent_from = ticked.now
        if ticked.truth.x >= place and ticked.truth.speed < 0.01:
            assert ticked.status.state in (ArmingState.STOPPING, ArmingState.STOPPED)
            return ticked
        assert ticked.now < 60.0
    raise AssertionError("ticks never end by themselves")


@pytest.mark.thorough
@pytest.mark.parametrize("place", [46.0, 52.0, 58.0])
@pytest.mark.parametrize("raising", [False, True])
def test_in_mid_swerve_the_car_comes_to_rest_on_the_commanded_path(place: float, raising: bool) -> None:
    """Setpoints that end and a controller that fails: the gateway goes on along what the controller meant."""
    truth = stopped_from(place, Swerver(CAR, AROUND, SPEED), raising=raising).truth
    assert truth.x > place + 6.0
    assert abs(AROUND.project(truth.x, truth.y).d) < TOLERANCE
    assert truth.y > AROUND.at(place).y + 0.5


def test_without_a_path_the_car_comes_back_onto_the_scenarios() -> None:
    truth = stopped_from(52.0, Swerver(CAR, AROUND, SPEED, says=False)).truth
    assert abs(AROUND.project(truth.x, truth.y).d) > 1.0


def fenced(controller: Swerver, until: float) -> list[Ticked]:
    """Return the ticks of a drive to a place along x [m], or to rest, in a lot that reaches 5 m to both sides."""
    lot = Lot([(-30.0, -5.0), (500.0, -5.0), (500.0, 5.0), (-30.0, 5.0)])
    fence = Geofence(lot, CAR, Alignment(), gateway=GATEWAY, watchdog=WATCHDOG)
    loop, ticks = ClosedLoop(straight(), SPEED, controller=controller, pipeline=partial(Pipeline, geofence=fence)), []
    for ticked in loop.ticks():
        ticks.append(ticked)
        if ticked.truth.x > until or (ticked.truth.x > 5.0 and ticked.truth.speed < 0.01):
            return ticks
        assert ticked.now < 60.0
    raise AssertionError("ticks never end by themselves")


@pytest.mark.thorough
def test_the_geofence_refuses_a_commanded_path_that_leaves_the_lot() -> None:
    """The car keeps to the scenario's path, which stays inside; only what the controller says that it means leads out.

    The car is stopped, and along the path that stays inside.
    """
    out = over_and_back((60.0, 90.0, 200.0, 230.0), 8.0)
    says, silent = Swerver(CAR, out, SPEED), Swerver(CAR, out, SPEED, says=False)
    says.steered = silent.steered = straight()
    ticks = fenced(silent, 110.0)
    assert ticks[-1].truth.x > 110.0
    assert not any("geofence_breach" in ticked.found for ticked in ticks)
    ticks = fenced(says, 110.0)
    first = next(ticked for ticked in ticks if "geofence_breach" in ticked.found)
    # As soon as the stopping way, 21 m at 7 m/s, leads over the edge, and before the car would begin to go over.
    assert 50.0 < first.truth.x < 60.0
    assert ticks[-1].truth.speed < 0.01
    assert "geofence_breach" in ticks[-1].status.reasons
    assert abs(ticks[-1].truth.y) < TOLERANCE


@pytest.mark.thorough
def test_a_commanded_path_inside_the_lot_is_not_refused() -> None:
    ticks = fenced(Swerver(CAR, over_and_back((40.0, 70.0, 90.0, 120.0), 1.5), SPEED), 130.0)
    assert ticks[-1].truth.x > 130.0
    assert max(ticked.truth.y for ticked in ticks) > 1.3
    assert not any("geofence_breach" in ticked.found for ticked in ticks)
