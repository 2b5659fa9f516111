"""Cooperative following: its law against transfer functions, what it does without messages, whose messages it heeds."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from vve_sumo.controllers.cacc import LIFETIME, CooperativeTimeGap
from vve_sumo.controllers.follow_and_stop import PERIOD
from vve_sumo.controllers.lead_message import LeadMessage, LeadMessages

from tests.conftest import REPOSITORY
from tests.controllers.street import FUSION
from vve_sumo import controller
from vve_sumo.controllers import ConstantTimeGap
from vve_sumo.errors import ConfigError
from vve_sumo.path import ReferencePath
from vve_sumo.values import Observation, Point, Pose, Stations

ROAD = ReferencePath.from_points([0.0, 1000.0], [0.0, 0.0])
DESIRED = 30.0


def law(**changes: float) -> CooperativeTimeGap:
    usual = {
        "standstill_gap": 5.0, "gap_gain": 0.2, "speed_gain": 0.8, "with_messages": 0.6, "without": 1.5, "share": 0.7,
        "smoothing": 0.0,
    }  # fmt: skip
    return CooperativeTimeGap(**{**usual, **changes})


def told(gap: float, acceleration: float = 0.0, age: float = 0.1) -> LeadMessage:
    return LeadMessage(gap, acceleration, age)


def settled(one: CooperativeTimeGap, message: LeadMessage | None, gap: float, speed: float = 10.0) -> float:
    """Return the acceleration after so long that nothing changes any more."""
    one.message, found = message, 0.0
    for _ in range(2000):
        found = one.acceleration(speed, DESIRED, gap, speed)
    return found


@pytest.mark.parametrize(
    "message",
    [None, told(20.0, -3.0, LIFETIME + 0.01), told(30.0, -3.0), told(10.0, -3.0)],
    ids=["none", "old", "of a car farther on", "of a car between"],
)
def test_without_the_messages_of_the_car_ahead_it_is_acc(message: LeadMessage | None) -> None:
    acc = ConstantTimeGap(5.0, 1.5, 0.2, 0.8)
    assert settled(law(), message, 20.0) == acc.acceleration(10.0, DESIRED, 20.0, 10.0)


def test_when_messages_are_lost_the_gap_grows_gently() -> None:
    one, gap = law(), 11.0
    assert settled(one, told(gap), gap) == pytest.approx(0.0, abs=1e-6)
    one.message, course = None, []
    for _ in range(250):
        course.append(one.acceleration(10.0, DESIRED, gap, 10.0))
    # Never harder than its share of the time gap that ACC has, at 0.2 s more a second.
    assert course[0] == pytest.approx(-0.2 * 0.2 * PERIOD * 10.0)
    assert np.diff(course).min() == pytest.approx(-0.2 * 0.2 * PERIOD * 10.0)
    assert course[-1] == pytest.approx(-0.2 * (1.5 - 0.6) * 10.0)


@pytest.mark.parametrize("frequency", [0.2, 0.5, 1.0, 2.0])
@pytest.mark.parametrize("share", [0.0, 0.7])
def test_a_swinging_leader_is_followed_as_the_transfer_function_says(frequency: float, share: float) -> None:
    """H of the law's docstring, for a car that answers at once and messages that come at once."""
    one, swing, speed = law(share=share), 0.5, 15.0
    settled(one, told(5.0 + 0.6 * speed), 5.0 + 0.6 * speed, speed)
    gap, own, last = 5.0 + 0.6 * speed, speed, []
    for tick in range(round(120.0 / PERIOD)):
        time = tick * PERIOD
        lead, change = speed + swing * math.sin(frequency * time), swing * frequency * math.cos(frequency * time)
        one.message = told(gap, change)
        acceleration = one.acceleration(own, DESIRED, gap, lead)
        own += acceleration * PERIOD
        middle = speed + swing * math.sin(frequency * (time + 0.5 * PERIOD))
        gap += (middle - own + 0.5 * acceleration * PERIOD) * PERIOD
        last = [*last, own][-round(2.0 * math.tau / frequency / PERIOD) :]
    s = 1j * frequency
    expected = abs((0.2 + 0.8 * s + share * s * s) / (s * s + (0.8 + 0.2 * 0.6) * s + 0.2))
    assert 0.5 * (max(last) - min(last)) / swing == pytest.approx(expected, rel=0.03)


@given(st.floats(0.05, 0.6), st.floats(0.0, 0.4), st.floats(0.3, 3.0))
def test_acc_passes_nothing_on_with_gain_where_the_headway_is_above_twice_delay_and_lag(
    lag: float, delay: float, headway: float
) -> None:
    """Speed gain 1 / h and hardly any gap gain: greatest gain over the frequency against h > 2 (delay + lag)."""
    limit = 2.0 * (delay + lag)
    if abs(headway / limit - 1.0) < 0.1:
        return
    s, k1, k2 = 1j * np.geomspace(1e-2, 30.0, 3000), 0.002 / headway, 1.0 / headway
    late = np.exp(-delay * s)
    gain = np.abs(late * (k1 + k2 * s) / (s * s * (lag * s + 1.0) + late * (k1 + (k2 + k1 * headway) * s)))
    assert (gain.max() <= 1.0 + 1e-3) == (headway > limit)


def observation(rows: list[tuple[float, float, float, int]]) -> Observation:
    """Return what a car knows that drives at 10 m/s at s = 100 m, among senders (ahead, left, heading, message)."""
    count = len(rows)
    ahead, left, heading = (np.array([row[column] for row in rows], np.float64) for column in range(3))
    numbers: Any = np.zeros
    stations = Stations(
        time=5.0,
        number=np.arange(count),
        message=np.array([row[3] for row in rows], np.int8),
        kind=numbers(count, np.int8),
        age=np.full(count, 0.2),
        latitude=numbers(count),
        longitude=numbers(count),
        x=ahead,
        y=left,
        heading=heading,
        true_heading=heading,
        speed=np.full(count, 8.0),
        yaw_rate=numbers(count),
        acceleration=-np.arange(1.0, count + 1.0),
        length=np.full(count, 4.0),
        width=np.full(count, 1.8),
        uncertainty=np.full(count, 1.0),
    )
    pose = Pose(5.0, Point.REAR_AXLE, 100.0, 0.0, 0.0, 10.0, 0.0, 0.0, 0.0, 0.0)
    return Observation(
        tick=250, time=5.0, pose=pose, path=ROAD, desired_speed=DESIRED, sensors={"obu": stations}, steering=0.0
    )


def heard(*rows: tuple[float, float, float, int]) -> LeadMessage | None:
    seen = observation([*rows])
    return LeadMessages(FUSION, "obu").step(seen, ROAD.project(100.0, 0.0))


def test_the_nearest_ahead_that_goes_the_same_way_is_meant() -> None:
    found = heard(
        (60.0, 0.5, 0.0, 2),
        (30.0, -0.5, 0.05, 2),  # the car ahead
        (20.0, 3.5, 0.0, 2),  # in the lane beside
        (15.0, 0.3, math.pi, 2),  # comes towards it
        (12.0, 0.0, 0.0, 16),  # a cyclist: no vehicle's message
        (-8.0, 0.0, 0.0, 2),  # behind
    )
    assert found is not None
    # Its rear is half its length nearer than its middle, and it has driven on since the message.
    assert found.gap == pytest.approx(30.0 - 2.0 + 0.2 * 8.0, abs=0.01)
    assert (found.acceleration, found.age) == (-2.0, pytest.approx(0.2))


def test_nobody_ahead_is_nobody() -> None:
    assert heard() is None
    assert heard((20.0, 3.5, 0.0, 2), (-8.0, 0.0, 0.0, 2), (200.0, 0.0, 0.0, 2)) is None


def test_what_it_cannot_take_is_refused() -> None:
    with pytest.raises(ConfigError, match="feed_forward"):
        controller.load("cacc", FUSION, {"feed_forward": 3.0}, [REPOSITORY / "controllers"])
    made = controller.load("cacc", FUSION, {"sensor": "none"}, [REPOSITORY / "controllers"])
    with pytest.raises(TypeError, match="no sensor 'none' of kind v2x"):
        made.step(observation([]))
