"""Who is braked for on a way around, by the distance between the car's side and a body: plain on a road along x."""

from __future__ import annotations

import math

import numpy as np
import pytest

from controllers.lateral_plan import LateralPlan
from controllers.outlines import Body
from controllers.way_around import NODES, WayAround, speeding_up
from tests.controllers.avoid_bench import CAR
from tests.controllers.bench import ROAD
from vve_sumo.path import ReferencePath

PLACE, ASIDE = 40.0, 1.5  #: of the rear axle along the road [m]; the way runs so far to the left of it [m]
BUMPER = PLACE + CAR.rear_axle_to_bumper


def braked_for(
    begins: float, away: float, *, urgent: bool, along: float = 0.0, braking: bool = True
) -> tuple[bool, bool]:
    """Whether a car on the way at 5 m/s brakes in comfort, and whether at once, for a body of 2 m to the right of it.

    The body begins at an s [m], so far from the car's side [m].
    """
    side = ASIDE - 0.5 * CAR.width - away
    body = Body(np.array([begins, begins + 2.0]), np.array([side, side]), along, 0.0, 0.0)
    plan = LateralPlan((ASIDE,) * NODES, (5.0,) * NODES)
    way = WayAround.of_plan(ROAD, int(PLACE / 1.5), plan, plan.speeds, 2.0, urgent=urgent, braking=urgent and braking)
    nearest, dangers = way.met([body], CAR, ROAD.project(PLACE, ASIDE, PLACE), 5.0)
    return nearest is not None, bool(dangers)


@pytest.mark.parametrize(
    ("away", "urgent", "comfort", "at_once"),
    [
        (0.9, False, False, False),
        (0.4, False, True, False),
        (-0.1, False, True, True),
        (0.9, True, False, False),
        (0.4, True, False, True),  # an urgent way was planned for a car that brakes fully
        (-0.1, True, True, True),
    ],
)
def test_who_is_near_a_way_is_braked_for(away: float, urgent: bool, comfort: bool, at_once: bool) -> None:
    assert braked_for(BUMPER + 6.0, away, urgent=urgent) == (comfort, at_once)


def test_a_swerve_planned_at_speed_goes_on_at_speed() -> None:
    """A car at rest would be met by who comes head-on, past whoever else it swerves."""
    assert braked_for(BUMPER + 6.0, 0.4, urgent=True, braking=False) == (False, False)


def test_who_comes_head_on_is_passed_at_speed() -> None:
    assert braked_for(BUMPER + 20.0, 0.4, urgent=True, along=-5.0) == (False, False)


@pytest.mark.parametrize("urgent", [False, True])
def test_whom_the_bumper_has_passed_is_no_reason_to_brake(urgent: bool) -> None:
    assert braked_for(BUMPER - 2.5, 0.4, urgent=urgent) == (False, False)
    assert braked_for(BUMPER - 1.5, 0.4, urgent=urgent) == (not urgent, urgent)


def test_who_would_be_touched_is_braked_for_though_the_bumper_has_passed_him() -> None:
    assert braked_for(BUMPER - 2.5, -0.1, urgent=False) == (True, True)


def test_the_fastest_that_a_way_can_be_taken() -> None:
    """Straight on as fast as the road allows; on a circle with the lateral acceleration and a tenth more."""
    usual = [min(2.0 + 0.2 * node, 7.0) for node in range(NODES)]
    straight = WayAround.of_plan(ROAD, 0, LateralPlan((0.0,) * NODES, (1.0,) * NODES), usual, 2.0, urgent=False)
    assert straight.fastest(2, usual) == pytest.approx(usual)
    angle = np.arange(0.0, 150.0) / 20.0
    circle = ReferencePath.from_points((20.0 * np.sin(angle)).tolist(), (20.0 * (1.0 - np.cos(angle))).tolist())
    bent = WayAround.of_plan(circle, 0, LateralPlan((0.0,) * NODES, (1.0,) * NODES), usual, 2.0, urgent=False)
    speeds = bent.fastest(20, [9.0] * NODES)[:30]
    assert speeds == pytest.approx([math.sqrt(2.2 * 20.0)] * 30, rel=0.02)


def test_a_car_speeds_up_from_a_bend_no_faster_than_it_can() -> None:
    """v^2 = v0^2 + 2 a s with 1.5 m/s2."""
    found = speeding_up([6.0, 2.0, 9.0, 9.0, 9.0, 3.0])
    assert found == pytest.approx([6.0, 2.0, *(math.sqrt(4.0 + 3.0 * 1.5 * node) for node in (1, 2, 3)), 3.0])
