"""The limiter: properties over any run of wishes, and the single-track circle in closed form."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.vehicle.car import FUSION, PERIOD
from vve_sumo.errors import ConfigError
from vve_sumo.vehicle.limits import COMFORT, EMERGENCY, Limiter, Limits, move_towards

STEERING_LIMIT = 0.55
WISHES = st.floats(-1e6, 1e6) | st.sampled_from([0.0, -2.4, -9.0, 2.0, 0.3])
SPEEDS = st.floats(0.0, 40.0)


def limiter() -> Limiter:
    return Limiter(FUSION, Limits(), STEERING_LIMIT)


def settled(acceleration: float, steering: float, speed: float, emergency: bool = False):
    """What is granted of a wish that lasts."""
    subject = limiter()
    for _ in range(1000):
        granted = subject.step(acceleration, steering, speed, emergency, PERIOD)
    return granted


@given(st.lists(st.tuples(WISHES, WISHES, SPEEDS, st.booleans(), st.floats(0.0, 0.04)), max_size=40))
def test_nothing_granted_is_outside_the_envelope_or_changes_too_fast(steps):
    subject, last = limiter(), (0.0, 0.0)
    for wish, steering, speed, emergency, elapsed in steps:
        granted = subject.step(wish, steering, speed, emergency, elapsed)
        tiny = 1e-9
        deceleration = 9.0 if emergency else 3.5
        # Coming back from the emergency envelope takes a while: in between the granted value only returns.
        assert min(-deceleration, last[0]) - tiny <= granted.acceleration <= 2.0 + tiny
        change = granted.acceleration - last[0]
        assert -(30.0 if emergency else 10.0) * elapsed - tiny <= change <= 10.0 * elapsed + tiny
        if change < 0.0 and last[0] <= 0.0:
            assert -change <= (30.0 if emergency else 5.0) * elapsed + tiny
        if change > 0.0 and last[0] >= 0.0:
            assert change <= 5.0 * elapsed + tiny, "an emergency does not let the car accelerate faster"
        bound = math.atan2(FUSION.wheelbase * 3.0, speed * speed) + FUSION.understeer_gradient * 3.0
        rate = min(FUSION.steering_rate_limit, 5.0 * FUSION.wheelbase / max(speed, 1e-6) ** 2)
        assert abs(granted.steering - last[1]) <= rate * elapsed + tiny
        assert abs(granted.steering) <= max(min(bound, STEERING_LIMIT), abs(last[1]) - rate * elapsed) + tiny
        assert (granted.limited == ()) == (granted[:2] == (wish, steering))
        last = granted[:2]


@given(st.floats(-3.5, 2.0), SPEEDS, st.booleans())
def test_what_is_inside_is_reached_and_left_alone(wish, speed, emergency):
    granted = settled(wish, 0.0, speed, emergency)
    assert (granted.acceleration, granted.steering, granted.limited) == (wish, 0.0, ())


@given(WISHES, WISHES, SPEEDS, st.booleans())
def test_limiting_twice_is_limiting_once(acceleration, steering, speed, emergency):
    once = settled(acceleration, steering, speed, emergency)
    twice = settled(once.acceleration, once.steering, speed, emergency)
    assert twice[:2] == once[:2]
    assert twice.limited == ()


@given(WISHES, WISHES, WISHES, WISHES, SPEEDS, st.booleans())
def test_a_larger_wish_is_never_granted_less(first, second, left, right, speed, emergency):
    a = limiter().step(first, left, speed, emergency, PERIOD)
    b = limiter().step(second, right, speed, emergency, PERIOD)
    assert (a.acceleration <= b.acceleration) or first > second
    assert (a.steering <= b.steering) or left > right


@given(st.floats(0.0, 40.0), st.floats(0.0, 40.0))
def test_the_faster_the_smaller_the_angle(slow, fast):
    subject = limiter()
    slow, fast = sorted((slow, fast))
    assert subject.steering_bound(fast) <= subject.steering_bound(slow)
    assert subject.steering_rate_bound(fast, 5.0) <= subject.steering_rate_bound(slow, 5.0)


@pytest.mark.parametrize("speed", [8.0, 10.0, 15.0, 25.0])
def test_the_largest_angle_drives_the_circle_of_three_meters_per_square_second(speed):
    """Brute force: the neutral-steer car on the granted angle, with the angle that understeer costs taken off."""
    angle = settled(0.0, 1.0, speed).steering
    kinematic = angle - FUSION.understeer_gradient * 3.0
    x = y = heading = 0.0
    dt = 1e-3
    points = []
    for _ in range(3000):
        heading += speed * math.tan(kinematic) / FUSION.wheelbase * dt
        x, y = x + speed * math.cos(heading) * dt, y + speed * math.sin(heading) * dt
        points.append((x, y))
    (x1, y1), (x2, y2), (x3, y3) = points[0], points[1500], points[2999]
    # Radius of the circle through three points.
    a, b, c = math.dist((x1, y1), (x2, y2)), math.dist((x2, y2), (x3, y3)), math.dist((x1, y1), (x3, y3))
    area = abs((x2 - x1) * (y3 - y1) - (x3 - x1) * (y2 - y1)) / 2
    assert speed**2 / (a * b * c / (4 * area)) == pytest.approx(3.0, rel=1e-3)


@given(st.floats(0.0, 80.0))
def test_a_car_that_oversteers_may_run_out_of_angle_but_never_below_none(speed):
    tail_happy = replace(FUSION, cornering_stiffness_rear=60_000.0)
    assert tail_happy.understeer_gradient < 0.0
    assert 0.0 <= Limiter(tail_happy, Limits(), STEERING_LIMIT).steering_bound(speed) <= STEERING_LIMIT


def test_full_emergency_braking_is_there_in_three_tenths_of_a_second_and_comfort_never_comes_near():
    subject = limiter()
    granted = [subject.step(-9.0, 0.0, 15.0, True, PERIOD).acceleration for _ in range(16)]
    assert granted[-1] == -9.0
    assert granted[13] > -9.0
    assert settled(-9.0, 0.0, 15.0).acceleration == -3.5


@pytest.mark.parametrize("emergency", [False, True])
def test_rates_count_by_the_time_that_has_passed(emergency):
    """A second of setpoints at 100 Hz changes no more than a second of them at 50 Hz."""
    fast, slow = limiter(), limiter()
    for _ in range(10):
        fast.step(2.0, 0.5, 10.0, emergency, 0.005)
        fast.step(2.0, 0.5, 10.0, emergency, 0.015)
        slow.step(2.0, 0.5, 10.0, emergency, 0.02)
    assert (fast.acceleration, fast.steering) == pytest.approx((slow.acceleration, slow.steering), abs=1e-9)
    assert slow.acceleration == pytest.approx(5.0 * 0.2)
    assert slow.steering == pytest.approx(5.0 * FUSION.wheelbase / 10.0**2 * 0.2)


def test_the_way_to_rest_is_steered_with_twice_the_comfort_jerk():
    subject = limiter()
    subject.steer(0.5, 10.0, PERIOD)
    assert subject.steering == pytest.approx(10.0 * FUSION.wheelbase / 10.0**2 * PERIOD)


def test_leaving_the_emergency_envelope_releases_the_brakes_at_the_comfort_rate():
    subject = limiter()
    subject.reset(-9.0, 0.0)
    assert subject.step(0.0, 0.0, 10.0, False, PERIOD).acceleration == pytest.approx(-9.0 + 10.0 * PERIOD)


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_what_is_not_finite_changes_nothing(bad):
    subject = limiter()
    subject.reset(-1.0, 0.1)
    for acceleration, steering, speed, elapsed in (
        (bad, 0.0, 5.0, PERIOD), (0.0, bad, 5.0, PERIOD), (0.0, 0.0, bad, PERIOD), (0.0, 0.0, 5.0, bad)
    ):  # fmt: skip
        assert subject.step(acceleration, steering, speed, True, elapsed) == (-1.0, 0.1, ("not_finite",))
    for steering, speed, elapsed in ((bad, 5.0, PERIOD), (0.0, bad, PERIOD), (0.0, 5.0, bad)):
        assert subject.steer(steering, speed, elapsed) == ("not_finite",)
    assert (subject.acceleration, subject.steering) == (-1.0, 0.1)


@given(st.floats(-10, 10), st.floats(-10, 10), st.floats(0.1, 50), st.floats(0.1, 50), st.floats(0.001, 2.0))
def test_approach_is_the_limit_of_many_small_steps(value, target, away, towards, period):
    fine, steps = value, 4000
    for _ in range(steps):
        # With so small a step the sign can only change on the step that lands on zero.
        rate = towards if fine * target < 0 or abs(target) < abs(fine) else away
        aim = 0.0 if fine * target < 0 else target
        fine += min(max(aim - fine, -rate * period / steps), rate * period / steps)
    assert move_towards(value, target, away, towards, period) == pytest.approx(fine, abs=2 * 50 * 2.0 / steps)


@pytest.mark.parametrize("bad", [0.0, -1.0, math.nan, math.inf])
@pytest.mark.parametrize(
    "name",
    [
        "lateral_acceleration", "stop_deceleration", "stop_jerk", "stop_lateral_jerk", "critical_deceleration",
        "critical_jerk", "speed",
    ],
)  # fmt: skip
def test_limits_that_cannot_be_kept_are_refused_by_name(name, bad):
    with pytest.raises(ConfigError, match=rf"^limits: {name} must be a positive number, got {bad!r}$"):
        Limits(**{name: bad})


@pytest.mark.parametrize("bad", [0.0, -1.0, math.nan, math.inf])
def test_envelopes_that_cannot_be_kept_are_refused_by_name(bad):
    for name in ("deceleration", "acceleration", "jerk", "release_jerk", "lateral_jerk"):
        with pytest.raises(ConfigError, match=rf"^limits: {name} must be a positive number, got {bad!r}$"):
            replace(COMFORT, **{name: bad})
    for name in ("deceleration", "jerk"):
        with pytest.raises(ConfigError, match=rf"^limits: emergency {name} must be a positive number, got {bad!r}$"):
            replace(EMERGENCY, **{name: bad})


def test_emergency_braking_is_the_hardest_or_as_hard():
    """9 m/s2, unless another is said."""
    Limits(critical_deceleration=9.0, comfort=replace(COMFORT, deceleration=9.0))
    for weaker in ({"critical_deceleration": 9.01}, {"comfort": replace(COMFORT, deceleration=9.01)}):
        with pytest.raises(ConfigError, match=r"^limits: emergency deceleration must not be below .*, got 9$"):
            Limits(**weaker)


@pytest.mark.parametrize(
    ("acceleration", "steering", "speed", "limited"),
    [
        (0.09, 0.0, 0.0, ()),
        (0.11, 0.0, 0.0, ("jerk",)),
        (-3.4, 0.0, 0.0, ("jerk",)),
        (2.01, 0.0, 0.0, ("acceleration", "jerk")),
        (-3.51, 0.0, 0.0, ("acceleration", "jerk")),
        (0.0, 0.54, 0.0, ("steering_rate",)),
        (0.0, -0.56, 0.0, ("steering_angle", "steering_rate")),
        (0.0, 0.56, 10.0, ("lateral_acceleration", "steering_rate")),
        (2.01, 0.56, 10.0, ("acceleration", "jerk", "lateral_acceleration", "steering_rate")),
    ],
)
def test_what_limited_a_wish_is_said(acceleration, steering, speed, limited):
    """From rest, in 20 ms: 0.1 m/s2 by the jerk; the wheel's own rate is 0.59 rad/s on the road."""
    assert limiter().step(acceleration, steering, speed, False, PERIOD).limited == limited


def test_what_limits_a_wish_that_lasts_is_its_size():
    assert settled(2.01, 0.56, 10.0).limited == ("acceleration", "lateral_acceleration")
    assert settled(-9.01, -0.56, 1.0, emergency=True).limited == ("acceleration", "steering_angle")


def test_what_limits_the_way_to_rest_is_said():
    assert limiter().steer(0.56, 10.0, PERIOD) == ("lateral_acceleration", "steering_rate")
    assert limiter().steer(0.001, 10.0, PERIOD) == ()


def test_at_a_speed_that_is_not_known_the_wheel_may_go_to_its_end():
    assert limiter().steering_bound(math.nan) == STEERING_LIMIT
