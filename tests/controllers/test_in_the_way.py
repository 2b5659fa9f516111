"""Which bodies a way comes too near to, and how a car creeps up beside one: plain on a road along x."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from controllers.free_space import Margins, Nodes
from controllers.in_the_way import Sight, creeping_speeds, leads_free, too_near
from controllers.lateral_plan import LateralPlan
from controllers.outlines import Body
from controllers.way_around import NODES, SPACING
from tests.controllers.bench import CAR, ROAD
from vve_sumo.values import Observation, Point, Pose

KEEPS = Margins(1.1, 0.6, 0.5)
POSE = Pose(0.0, Point.REAR_AXLE, 0.0, 0.0, 0.0, 2.0, 0.0, 0.0, 0.0, 0.0)
PLAN = LateralPlan((0.0,) * NODES, (5.0,) * NODES)


def sight(bodies: list[Body], speed: float = 2.0) -> Sight:
    pose = replace(POSE, speed=speed)
    nodes = Nodes.of(CAR, SPACING * np.arange(NODES), np.zeros(NODES))
    speeds = [min(math.sqrt(speed * speed + 3.0 * SPACING * (node + 1)), 8.0) for node in range(NODES)]
    return Sight(CAR, Observation(0, 0.0, pose, ROAD, 8.0, {}, 0.0), ROAD.project(0.0, 0.0), bodies, nodes, speeds, 0)


def beside(begins: float, away: float, along: float = 0.0) -> Body:
    """One of 2 m whose side is so far to the left of the car's [m]."""
    side = 0.5 * CAR.width + away
    return Body(np.array([begins, begins + 2.0]), np.array([side, side]), along, 0.0, 0.0)


def test_only_who_comes_may_be_passed_more_nearly() -> None:
    person, oncoming = beside(30.0, 0.6), beside(60.0, 0.6, -8.0)
    assert too_near(sight([person, oncoming]), PLAN, KEEPS, 0.7, 0.5) == [person]
    assert too_near(sight([person, oncoming]), PLAN, KEEPS, 0.7, 0.7) == [person, oncoming]
    assert too_near(sight([beside(30.0, 0.8), beside(60.0, 0.8, -8.0)]), PLAN, KEEPS, 0.7, 0.5) == []
    assert leads_free(sight([beside(30.0, 0.8)]), PLAN, KEEPS, 0.7)
    assert not leads_free(sight([person]), PLAN, KEEPS, 0.7)


def test_a_body_that_is_nowhere_known_is_too_near() -> None:
    lost = Body(np.array([30.0, 32.0]), np.array([math.nan, math.nan]), 0.0, 0.0, 0.0)
    assert too_near(sight([lost]), PLAN, KEEPS, 0.7, 0.5) == [lost]


@pytest.mark.parametrize("speed", [0.0, 1.0, 4.0])
def test_it_creeps_until_it_is_beside(speed: float) -> None:
    """To the cap with 1.5 m/s2 from above it, and from its side on up to the road's speed with 1.5 m/s2."""
    begins = 30.0
    speeds = creeping_speeds(sight([], speed), [beside(begins, -1.0)], 2.0)
    until = math.ceil((begins - CAR.rear_axle_to_bumper) / SPACING)
    slowing = [math.sqrt(max(speeds[0] ** 2 - 3.0 * SPACING * node, 4.0)) for node in range(until)]
    assert speeds[:until] == pytest.approx(slowing)
    assert speeds[0] <= max(speed, 2.0)
    rising = [math.sqrt(4.0 + 3.0 * SPACING * (node + 1)) for node in range(10)]
    assert speeds[until : until + 10] == pytest.approx(np.minimum(rising, 8.0).tolist())
    assert creeping_speeds(sight([], speed), [beside(begins, -1.0)], 2.0, 50.0)[until + 5] == pytest.approx(2.0)
