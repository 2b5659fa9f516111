"""Who will cross the path by their V2X messages, against both moving on in small steps; and who is not waited for."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from controllers.tracks import Target
from controllers.warned import EARLY, SLOWEST, Warned
from tests.controllers.bench import CAR, ROAD
from vve_sumo.values import Observation, Point, Pose, Stations

BUMPER = CAR.rear_axle_to_bumper
#: half of the swept band on a straight road: half of the car's width, and the margin [m]
BAND = 0.5 * CAR.width + 0.3


def stations(
    time: float, ahead: float, left: float, heading: float, speed: float, age: float, length: float, width: float
) -> Stations:
    """One station, whose place is that of `age` ago."""

    def one(value: float) -> np.ndarray:
        return np.array([value])

    return Stations(
        time, np.array([7]), np.array([16], np.int8), np.array([6], np.int8), one(age), one(0.0), one(0.0),
        one(ahead), one(left), one(heading), one(0.0), one(speed), one(0.0), one(0.0), one(length), one(width),
        one(0.0),
    )  # fmt: skip


def seen(heard: Stations | None, time: float, x: float, speed: float) -> Observation:
    pose = Pose(time, Point.REAR_AXLE, x, 0.0, 0.0, speed, 0.0, 0.0, 0.0, 0.0)
    sensors = {} if heard is None else {"obu": heard}
    return Observation(0, time, pose, ROAD, 12.0, sensors, 0.0)


def target(observation: Observation) -> Target | None:
    pose = observation.pose
    return Warned(CAR, "obu").step(observation, ROAD.project(pose.x, pose.y, None))


def nearest_in_time(gap: float, speed: float, d: float, across: float, half: tuple[float, float]) -> float:
    """Time by which car and crosser miss each other, both on the crosser's piece of the road, in steps of 5 ms [s]."""
    times = np.arange(0.0, 120.0, 0.005)
    bumper = max(speed, SLOWEST) * times
    car = times[(bumper >= gap) & (bumper <= gap + 2.0 * half[0] + CAR.length)]
    crosser = times[np.abs(d + across * times) <= BAND + half[1]]
    if not len(crosser):
        return math.inf
    return max(car[0] - crosser[-1], crosser[0] - car[-1], 0.0)


@given(
    ahead=st.floats(3.0, 90.0),
    d=st.floats(-30.0, 30.0),
    speed=st.floats(0.0, 15.0),
    pace=st.floats(0.5, 8.0),
    heading=st.floats(-math.pi, math.pi),
    age=st.floats(0.0, 1.5),
    since=st.floats(0.0, 0.3),
)
def test_it_waits_for_whom_it_would_meet(
    ahead: float, d: float, speed: float, pace: float, heading: float, age: float, since: float
) -> None:
    along, across = pace * math.cos(heading), pace * math.sin(heading)
    assume(abs(across) > 0.35)
    x, time, length, width = 20.0, 5.0, 1.9, 0.6
    # Where it was when its message was made, seen from where the car was when the output was.
    then_x = x - speed * since
    at = (x + BUMPER + ahead - along * (age + since) - then_x - BUMPER, d - across * (age + since))
    warned = Warned(CAR, "obu")
    heard = stations(time - since, *at, heading, pace, age, length, width)
    before = seen(heard, time - since, then_x, speed)
    warned.step(before, ROAD.project(then_x, 0.0, None))
    warned._awaited.clear()  # whoever is awaited is so for longer: tested below
    found = warned.step(seen(heard, time, x, speed), ROAD.project(x, 0.0, None))
    half = (
        0.5 * (length * abs(math.cos(heading)) + width * abs(math.sin(heading))),
        0.5 * (length * abs(math.sin(heading)) + width * abs(math.cos(heading))),
    )
    gap = ahead - half[0]
    assume(gap > 0.2)
    missed = nearest_in_time(gap, speed, d, across, half)
    assume(abs(missed - EARLY) > 0.03)
    assert (found is not None) == (missed < EARLY)
    if found is not None:
        assert found.gap == pytest.approx(gap, abs=0.01)
        assert found.speed == pytest.approx(max(along, 0.0), abs=1e-6)


def test_who_stands_or_walks_along_is_not_waited_for() -> None:
    for heading, pace in ((0.5 * math.pi, 0.0), (0.0, 1.4), (math.pi, 1.4)):
        assert target(seen(stations(1.0, 20.0, 0.0, heading, pace, 0.1, 0.6, 0.5), 1.0, 0.0, 8.0)) is None


def test_one_whose_place_is_vague_is_waited_for_from_farther_beside() -> None:
    """A sigma of the place counts as if the body were so much larger."""
    passed = stations(1.0, 16.0, 3.5, 0.5 * math.pi, 1.5, 0.0, 0.6, 0.5)
    assert target(seen(passed, 1.0, 0.0, 8.0)) is None
    vague = replace(passed, uncertainty=np.array([2.5 * 4.0]))
    assert target(seen(vague, 1.0, 0.0, 8.0)) is not None


def test_one_who_is_awaited_is_so_for_longer() -> None:
    """On the very edge nothing flickers: it takes a second more to be let go."""
    edge = stations(1.0, 40.0, -20.0, 0.5 * math.pi, 2.0, 0.0, 0.6, 0.5)
    fresh, kept = Warned(CAR, "obu"), Warned(CAR, "obu")
    near = seen(edge, 1.0, 0.0, 7.0)
    later = seen(replace(edge, y=np.array([-20.8])), 1.0, 0.0, 7.0)
    projection = ROAD.project(0.0, 0.0, None)
    speeds = [speed for speed in np.arange(4.0, 12.0, 0.05) if Warned(CAR, "obu").step(
        replace(near, pose=replace(near.pose, speed=float(speed))), projection)]  # fmt: skip
    fastest = float(max(speeds))
    at_edge = replace(near, pose=replace(near.pose, speed=fastest))
    beyond = replace(later, pose=replace(later.pose, speed=fastest))
    assert kept.step(at_edge, projection) is not None
    assert kept.step(beyond, projection) is not None
    assert fresh.step(beyond, projection) is None


def test_a_scenario_without_the_receiver_is_said_by_name() -> None:
    with pytest.raises(TypeError, match="no sensor 'obu' of kind v2x"):
        target(seen(None, 1.0, 0.0, 8.0))
