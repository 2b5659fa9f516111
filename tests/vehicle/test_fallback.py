"""The fallback path: odometry and curvature against closed forms, and a blind stop in a bend with the whole car."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.vehicle.car import FUSION, PERIOD, Rig
from tests.vehicle.whole_car import VEHICLE, WholeCar
from vve_sumo.values import ArmingState, DeferredFallbackPath, FallbackPath
from vve_sumo.vehicle.arming_machine import OperatorCommand
from vve_sumo.vehicle.dataspeed import codec, layout
from vve_sumo.vehicle.fallback import FallbackTracker, well_formed

S = ArmingState
#: A car that steers at once and neutrally, so that the wheel angle tells the curvature and nothing else.
PLAIN = replace(
    FUSION, steering_delay=0.0, steering_lag=0.0,
    cornering_stiffness_front=FUSION.cornering_stiffness_rear * 1.58 / 1.27, front_axle_to_mass=1.27,
)  # fmt: skip
RAMP = FallbackPath(1.0, tuple(0.005 * i for i in range(64)))  # its curvature tells the distance


def curvature(way: FallbackTracker) -> float:
    angle = way.steering()
    assert angle is not None
    return math.tan(angle) / PLAIN.wheelbase


def test_the_plain_car_is_neutral():
    assert PLAIN.understeer_gradient == pytest.approx(0.0, abs=1e-12)


# What a way is.


@pytest.mark.thorough(witnesses=3)
@pytest.mark.parametrize(
    "fallback_path",
    [
        FallbackPath(0.0, (0.0,)),
        FallbackPath(-1.0, (0.0,)),
        FallbackPath(math.nan, (0.0,)),
        FallbackPath(math.inf, (0.0,)),
        FallbackPath(1.0, ()),
        FallbackPath(1.0, (0.0,) * 65),
        FallbackPath(1.0, (0.0, math.nan)),
        FallbackPath(1.0, (math.inf, 0.0)),
        FallbackPath(1.0, (math.inf, -math.inf)),
    ],
)
def test_what_is_no_way_is_refused_and_stops_the_car(fallback_path):
    assert not well_formed(fallback_path)
    rig = Rig()
    rig.cruise(5.0)
    status = rig.step(1.0, fallback_path=fallback_path)
    assert (status.state, status.reasons[0]) == (S.STOPPING, "profile_invalid")


@pytest.mark.parametrize(
    "fallback_path",
    [FallbackPath(1e-300, (0.1, -0.1)), FallbackPath(2.0, (0.0,) * 64), FallbackPath(2.0, (1e308, 1e308))],
)
def test_what_is_a_way_is_taken(fallback_path):
    assert well_formed(fallback_path)
    rig = Rig()
    rig.cruise(5.0)
    assert rig.step(1.0, fallback_path=fallback_path).state is S.ENGAGED


# Odometry.


@given(
    st.floats(0.1, 5.0),
    st.lists(st.floats(-0.2, 0.2), min_size=1, max_size=64),
    st.floats(0.0, 400.0),
)
def test_curvature_is_linear_between_knots_and_holds_the_last_one(spacing, knots, distance):
    way = FallbackTracker(PLAIN)
    way.move(0.02, distance / 0.05)
    way.take(0.05, FallbackPath(spacing, tuple(knots)))
    expected = np.interp(distance, spacing * np.arange(len(knots)), knots)
    assert curvature(way) == pytest.approx(expected, abs=1e-9 + 1e-6 * 0.4 / spacing)


@given(st.floats(0.5, 12.0), st.floats(0.5, 6.0), st.floats(0.0, 0.1), st.lists(st.floats(0.002, 0.05), max_size=60))
def test_the_distance_is_that_of_even_braking(speed, deceleration, age, steps):
    way = FallbackTracker(PLAIN)
    way.move(0.02, speed)
    way.take(age, RAMP)
    time = 0.0
    for duration in steps:
        part = min(duration, speed / deceleration - time)
        if part <= 0.0:
            break
        time += part
        way.move(part, speed - deceleration * time)
    driven = speed * age + speed * time - 0.5 * deceleration * time * time
    assert curvature(way) == pytest.approx(0.005 * driven, abs=1e-9)


def test_at_speed_the_steady_circle_asks_for_the_understeer_too():
    vehicle = replace(PLAIN, cornering_stiffness_front=90_000.0)
    way = FallbackTracker(vehicle)
    way.move(0.02, 10.0)
    way.take(0.0, FallbackPath(1.0, (0.02,)))
    rear = vehicle.wheelbase - vehicle.front_axle_to_mass
    load = vehicle.mass * 10.0**2 * 0.02 / vehicle.wheelbase
    slip = load * rear / 90_000.0 - load * vehicle.front_axle_to_mass / vehicle.cornering_stiffness_rear
    assert way.steering() == pytest.approx(math.atan(0.02 * vehicle.wheelbase) + slip)


def test_the_angle_is_the_one_that_is_due_when_the_steering_has_answered():
    way = FallbackTracker(replace(PLAIN, steering_delay=0.1, steering_lag=0.2))
    way.move(0.02, 8.0)
    way.take(0.0, RAMP)
    assert curvature(way) == pytest.approx(0.005 * 8.0 * 0.3)


@pytest.mark.parametrize("duration", [0.101, 3.0, 0.0, -0.02, math.nan, math.inf])
def test_a_gap_in_which_the_kit_lets_go_loses_the_way_until_the_next(duration):
    way = FallbackTracker(PLAIN)
    way.move(0.02, 5.0)
    way.take(0.0, RAMP)
    way.move(0.1, 5.0)
    assert curvature(way) == pytest.approx(0.005 * 0.5)
    way.move(duration, 5.0)
    way.move(0.02, 5.0)
    assert way.steering() is None
    way.take(0.02, RAMP)
    assert curvature(way) == pytest.approx(0.005 * 0.1)


def test_without_speed_there_is_no_knowing():
    way = FallbackTracker(PLAIN)
    way.take(0.0, RAMP)
    assert way.steering() is None
    way.move(0.02, 5.0)
    way.take(0.0, RAMP)
    way.move(0.02, math.nan)
    assert way.steering() is None
    way.move(0.02, 5.0)
    assert way.steering() is None


@given(st.floats(), st.floats(), st.floats(1e-9, 1e9), st.lists(st.floats(-1e308, 1e308), min_size=1, max_size=5))
def test_no_number_breaks_it(speed, age, spacing, knots):
    for vehicle in (FUSION, replace(FUSION, cornering_stiffness_rear=50_000.0)):
        way = FallbackTracker(vehicle)
        way.move(0.02, speed)
        way.take(age, FallbackPath(spacing, tuple(knots)))
        way.move(0.02, speed)
        angle = way.steering()
        assert angle is None or not math.isnan(angle)


# In the gateway.


def bend() -> FallbackPath:
    """Straight for 5 m, then a bend to the left."""
    return FallbackPath(1.0, (*(0.0,) * 6, *(0.05,) * 30))


def test_a_stop_follows_the_way_although_nobody_speaks_any_more():
    rig = Rig()
    rig.cruise(6.0)
    rig.step(0.0, fallback_path=bend())
    rig.car.shift_time = math.inf
    statuses = rig.run(6.0, acceleration=None)
    steering = [status.steering for status in statuses]
    assert statuses[-1].state is S.STOPPED
    assert max(steering) == pytest.approx(math.atan(0.05 * FUSION.wheelbase), rel=0.05)
    assert steering[10] == 0.0
    change = FUSION.steering_rate_limit * PERIOD + 1e-12
    assert all(abs(b - a) <= change for a, b in itertools.pairwise(steering) if b != steering[-1])


def test_without_a_way_or_with_one_taken_back_the_measured_angle_is_held():
    for last in ({}, {"fallback_path": None}):
        rig = Rig()
        rig.cruise(6.0)
        if last:
            rig.step(0.0, fallback_path=bend())
        rig.step(0.0, **last)
        assert {status.steering for status in rig.run(6.0, acceleration=None)} == {0.0}


def test_a_drive_in_trouble_that_knows_no_way_does_not_take_back_the_one_before():
    rig = Rig()
    rig.cruise(6.0)
    rig.step(0.0, fallback_path=bend())
    statuses = rig.run(6.0, faults=("pose_stale",))
    assert max(status.steering for status in statuses) > 0.1


def test_a_drive_in_trouble_that_knows_a_way_is_believed():
    rig = Rig()
    rig.cruise(6.0)
    rig.step(0.0, fallback_path=FallbackPath(1.0, (0.0,)))
    rig.step(0.0, fallback_path=bend(), faults=("off_path",))
    assert max(status.steering for status in rig.run(3.0, None)) > 0.1


def test_a_way_that_comes_too_late_to_be_acted_on_is_not_taken():
    rig = Rig()
    rig.cruise(6.0)
    rig.run(0.2, acceleration=None)
    rig.step(0.0, time=rig.now - 0.15, expires=rig.now - 0.05, fallback_path=bend())
    assert {status.steering for status in rig.run(4.0, acceleration=None)} == {0.0}


def test_a_newer_way_counts_on_the_way_to_rest_too():
    rig = Rig()
    rig.cruise(8.0)
    rig.step(0.0, command=OperatorCommand.STOP, fallback_path=FallbackPath(1.0, (0.0,)))
    assert {status.steering for status in rig.run(1.0, fallback_path=FallbackPath(1.0, (0.0,)))} == {0.0}
    assert rig.run(1.0, fallback_path=FallbackPath(1.0, (-0.05,)))[-1].steering < -0.1


def test_a_deferred_path_is_computed_by_the_stop_that_follows_it_and_gives_the_same_stop():
    computed: list[str] = []

    def compute() -> FallbackPath:
        computed.append("now")
        return bend()

    stops = []
    for fallback_path in (bend(), DeferredFallbackPath(compute)):
        rig = Rig()
        rig.cruise(6.0)
        rig.step(0.0, fallback_path=fallback_path)
        assert computed == []
        stops.append([status.steering for status in rig.run(6.0, acceleration=None)])
        assert max(stops[-1]) > 0.1
    assert computed == ["now"]
    assert stops[0] == stops[1]


@pytest.mark.parametrize("path", [None, FallbackPath(1.0, (0.05, math.nan)), FallbackPath(0.0, (0.05,))])
def test_a_deferred_path_that_is_none_or_not_well_formed_is_no_path(path):
    rig = Rig()
    rig.cruise(6.0)
    rig.step(0.0, fallback_path=DeferredFallbackPath(lambda: path))
    assert {status.steering for status in rig.run(6.0, acceleration=None)} == {0.0}


@pytest.mark.thorough
@pytest.mark.parametrize(("path", "followed"), [(None, True), (FallbackPath(1.0, (0.0,)), False)])
def test_a_setpoint_with_faults_takes_back_the_path_before_only_if_its_deferred_path_is_one(path, followed):
    rig = Rig()
    rig.cruise(6.0)
    rig.step(0.0, fallback_path=bend())
    rig.step(0.0, fallback_path=DeferredFallbackPath(lambda: path), faults=("pose_stale",))
    assert (max(status.steering for status in rig.run(6.0, acceleration=None)) > 0.1) is followed


ASTRAY = [
    ("speed_mismatch", {}, {"speed": 3.0}),
    ("yaw_rate_mismatch", {}, {"yaw_rate": 1.0}),
    ("steering_report_stale", {"silent": {layout.STEERING_REPORT}}, {}),
    ("wheel_speeds_stale", {"silent": {layout.WHEEL_SPEEDS}}, {}),
    ("steering_fault", {"forged": codec.SteeringReport(0.4, 0.4, 6.0, 0.0, enabled=True, fault_bus_1=True)}, {}),
    ("steering_disabled", {"forged": codec.SteeringReport(0.4, 0.4, 6.0, 0.0, enabled=False)}, {}),
    ("steering_timeout", {"forged": codec.SteeringReport(0.4, 0.4, 6.0, 0.0, enabled=False, timeout=True)}, {}),
    ("steering_not_following", {"process_faults": ("steering_not_following",)}, {}),
    ("reports_inconsistent", {"process_faults": ("reports_inconsistent",)}, {}),
    ("wheel_speeds_frozen", {"process_faults": ("wheel_speeds_frozen",)}, {}),
]


@pytest.mark.thorough
@pytest.mark.parametrize(("reason", "car", "step"), ASTRAY)
def test_where_the_car_is_not_where_it_is_believed_to_be_the_measured_angle_is_held(reason, car, step):
    rig = Rig()
    rig.cruise(8.0)
    rig.run(1.0, steering=0.05, fallback_path=FallbackPath(1.0, (-0.05,)))
    rig.car.silent = car.get("silent", set())
    if "forged" in car:
        frame = codec.encode(car["forged"])
        rig.car.forged = {frame.id: frame}
    arguments = step | ({"process_faults": car["process_faults"]} if "process_faults" in car else {})
    while reason not in rig.step(0.0, 0.05, fallback_path=FallbackPath(1.0, (-0.05,)), **arguments).reasons:
        pass
    measured = rig.gateway.monitor.measured_steering
    rig.run(0.1, fallback_path=FallbackPath(1.0, (-0.05,)), **arguments)  # the limits hold on the way there
    statuses = rig.run(2.0, fallback_path=FallbackPath(1.0, (-0.05,)), **arguments)
    assert [status.steering for status in statuses] == pytest.approx([measured] * len(statuses), abs=1e-3)
    assert measured > 0.02


def test_at_rest_the_wheels_stay_where_they_are():
    rig = Rig()
    rig.cruise(3.0)
    rig.step(0.0, fallback_path=FallbackPath(1.0, (0.05,)))
    while rig.step(None).state is not S.STOPPED:
        pass
    statuses = rig.run(0.8, fallback_path=FallbackPath(1.0, (-0.05,)))
    measured = rig.gateway.monitor.measured_steering
    assert [status.steering for status in statuses] == pytest.approx([measured] * 40, abs=1e-3)


def test_the_limits_have_the_last_word():
    rig = Rig()
    rig.cruise(10.0)
    rig.step(0.0, fallback_path=FallbackPath(1.0, (0.5,)))
    statuses = rig.run(0.6, acceleration=None)
    assert "lateral_acceleration" in statuses[-1].limited
    lateral = rig.car.speed**2 * math.tan(statuses[-1].steering) / FUSION.wheelbase
    assert lateral < 3.3


# With the whole car: its own dynamics, lags and dead times.

BENDS = {
    "into a bend": lambda s: np.interp(s, [60.0, 65.0], [0.0, 0.04]),
    "s-bend": lambda s: np.interp(s, [60.0, 65.0, 69.0, 77.0], [0.0, 0.04, 0.04, -0.04]),
    "out of a bend": lambda s: np.interp(s, [40.0, 50.0, 60.0, 66.0], [0.0, 0.04, 0.04, 0.0]),
}


def blind_stop(name: str, with_path: bool) -> float:
    """Distance from the declared way at rest [m], after the drive fell silent at 58 m at 8 m/s."""
    road, whole = BENDS[name], WholeCar()
    whole.engage()
    while whole.distance < 58.0:
        speed, here = whole.car.truth().speed, whole.car.truth()
        ahead = float(road(whole.distance + 0.12 * speed))
        steering = math.atan(VEHICLE.wheelbase * ahead) + VEHICLE.understeer_gradient * ahead * speed**2
        way = FallbackPath(1.0, tuple(map(float, road(whole.distance + np.arange(40.0)))))
        begin = whole.distance
        status = whole.step(min(8.0 - speed, 2.0), steering, fallback_path=way if with_path else None)
        assert status.state is S.ENGAGED
    while whole.step(None).state is not S.STOPPED:
        pass
    assert whole.car.interface.controller.fault is False
    step = 0.005
    heading = here.heading + step * np.cumsum(road(np.arange(begin, whole.distance, step)))
    x, y = here.x + step * np.sum(np.cos(heading)), here.y + step * np.sum(np.sin(heading))
    rest = whole.car.truth()
    return float(abs((rest.y - y) * math.cos(heading[-1]) - (rest.x - x) * math.sin(heading[-1])))


@pytest.mark.thorough
@pytest.mark.parametrize("name", BENDS)
def test_a_blind_stop_in_a_bend_ends_beside_the_way_by_centimetres_and_not_by_metres(name):
    assert blind_stop(name, True) < 0.35
    assert blind_stop(name, False) > 1.0
