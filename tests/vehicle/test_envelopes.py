"""Each limit alone: which one bound a wish, and which envelopes are refused."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from tests.vehicle.car import FUSION
from vve_sumo.errors import ConfigError
from vve_sumo.vehicle.limits import COMFORT, EMERGENCY, Envelope, Limiter, Limits, move_towards

STEERING_LIMIT = 0.5
LONG = 10.0  # every rate is done in it [s]


def limiter(acceleration: float = 0.0, steering: float = 0.0) -> Limiter:
    subject = Limiter(FUSION, Limits(), STEERING_LIMIT)
    subject.reset(acceleration, steering)
    return subject


@pytest.mark.parametrize(
    ("wish", "emergency", "granted", "limited"),
    [
        (2.0, False, 2.0, ()),
        (2.1, False, 2.0, ("acceleration",)),
        (2.1, True, 2.0, ("acceleration",)),
        (-3.5, False, -3.5, ()),
        (-3.6, False, -3.5, ("acceleration",)),
        (-9.0, True, -9.0, ()),
        (-9.1, True, -9.0, ("acceleration",)),
    ],
)
def test_an_acceleration_that_is_cut_is_named(wish, emergency, granted, limited):
    got = limiter().step(wish, 0.0, 5.0, emergency, LONG)
    assert (got.acceleration, got.limited) == (granted, limited)


@pytest.mark.parametrize(
    ("before", "wish", "emergency", "granted"),
    [
        (0.0, 2.0, False, 0.5),  # 5 m/s3 away from zero
        (0.0, 2.0, True, 0.5),
        (0.0, -3.0, False, -0.5),
        (2.0, 0.0, False, 1.0),  # 10 m/s3 towards zero
        (-2.0, 0.0, False, -1.0),
        (-2.0, 0.0, True, -1.0),
        (0.0, -9.0, True, -3.0),  # 30 m/s3 in an emergency, and only towards more braking
        (2.0, -9.0, True, -1.0),
        (2.0, 0.5, True, 0.5),
    ],
)
def test_a_tenth_of_a_second_of_each_jerk(before, wish, emergency, granted):
    got = limiter(before).step(wish, 0.0, 5.0, emergency, 0.1)
    assert got.acceleration == pytest.approx(granted)
    assert got.limited == (() if granted == wish else ("jerk",))


@pytest.mark.parametrize("emergency", [False, True])
def test_what_is_granted_already_is_no_limit(emergency):
    assert limiter(-2.0).step(-2.0, 0.0, 5.0, emergency, 0.02) == (-2.0, 0.0, ())


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(
    ("speed", "limit"), [(0.0, "steering_angle"), (2.0, "steering_angle"), (15.0, "lateral_acceleration")]
)
def test_an_angle_that_is_cut_is_named_by_what_cut_it(sign, speed, limit):
    """At 15 m/s 3 m/s2 sideways are a radius of 75 m; below the car's own angle is the smaller one."""
    got = limiter().step(0.0, sign * 0.6, speed, False, LONG)
    assert got.limited == (limit,)
    circle = math.atan(FUSION.wheelbase * 3.0 / max(speed, 1e-9) ** 2) + FUSION.understeer_gradient * 3.0
    assert got.steering == pytest.approx(sign * min(STEERING_LIMIT, circle))


def test_a_steering_that_cannot_follow_is_named():
    """5 m/s3 sideways at 10 m/s turn this car's wheels at 0.1425 rad/s; standing they turn at the car's own rate."""
    got = limiter().step(0.0, 0.05, 10.0, False, 0.1)
    assert (got.steering, got.limited) == (pytest.approx(0.01425), ("steering_rate",))
    got = limiter().step(0.0, 0.4, 0.0, False, 0.1)
    assert (got.steering, got.limited) == (pytest.approx(0.1 * 8.7 / 14.8), ("steering_rate",))


def test_steering_to_rest_names_its_limits_too():
    subject = limiter()
    assert subject.steer(0.05, 10.0, 0.1) == ("steering_rate",)
    assert subject.steering == pytest.approx(0.0285), "10 m/s3: twice the comfort"
    assert subject.steer(0.05, 10.0, LONG) == ()
    assert subject.steer(0.6, 2.0, LONG) == ("steering_angle",)


@pytest.mark.parametrize("bad", [0.0, -1.0, math.nan, math.inf])
@pytest.mark.parametrize(
    "name",
    [
        "lateral_acceleration",
        "stop_deceleration",
        "stop_jerk",
        "stop_lateral_jerk",
        "critical_deceleration",
        "critical_jerk",
    ],
)
def test_every_limit_must_be_a_positive_number(name, bad):
    with pytest.raises(ConfigError, match=rf"^limits: {name} must be a positive number, got "):
        Limits(**{name: bad})


@pytest.mark.parametrize("bad", [0.0, -1.0, math.nan, math.inf])
def test_every_figure_of_an_envelope_must_be_a_positive_number(bad):
    for name in Envelope.__slots__:
        with pytest.raises(ConfigError, match=rf"^limits: {name} must be a positive number, got "):
            replace(COMFORT, **{name: bad})
    for name in EMERGENCY.__slots__:
        with pytest.raises(ConfigError, match=rf"^limits: emergency {name} must be a positive number, got "):
            replace(EMERGENCY, **{name: bad})


def test_a_limit_below_one_is_a_limit():
    assert replace(COMFORT, deceleration=0.5).deceleration == 0.5


def test_an_emergency_brakes_no_less_than_anything_else():
    assert Limits(emergency=replace(EMERGENCY, deceleration=4.0)).emergency.deceleration == 4.0
    assert Limits(comfort=replace(COMFORT, deceleration=9.0)).comfort.deceleration == 9.0
    for softer in (
        {"emergency": replace(EMERGENCY, deceleration=3.9)},
        {"comfort": replace(COMFORT, deceleration=9.1)},
    ):
        with pytest.raises(ConfigError, match="emergency deceleration must not be below the comfort and critical ones"):
            Limits(**softer)


@pytest.mark.parametrize(
    ("value", "target", "period", "reached"),
    [
        (2.0, -2.0, 0.1, 1.0),  # towards zero at 10
        (2.0, -2.0, 0.2, 0.0),  # to zero and no further
        (2.0, -2.0, 0.4, -1.0),  # and away from it at 5
        (2.0, -2.0, 1.0, -2.0),
        (-2.0, 2.0, 0.4, 1.0),
    ],
)
def test_zero_is_where_one_pedal_is_let_go_and_the_other_is_pressed(value, target, period, reached):
    assert move_towards(value, target, 5.0, 10.0, period) == pytest.approx(reached)
