"""The emergency layer alone, before a driver who does nothing: closed forms, tables of standards, bystanders."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from controllers.crossing import comes_over, will_be_in, will_have_left
from controllers.emergency import EARLIER, FULL, JERK, MARGIN, PARTIAL, Emergency
from controllers.follow_and_stop import FollowAndStop, make
from controllers.tracks import Target
from controllers.trend import Trend
from tests.controllers.bench import (
    CAR,
    KMH,
    Body,
    G,
    braking_lead,
    changes_lane,
    from_kerb,
    ride,
    steady,
    walker,
    weaves,
)
from tests.controllers.street import FUSION
from vve_sumo.laws import impact_speed, stopping_distance

NOSE = CAR.rear_axle_to_bumper
WALK = 5.0 * KMH
PERSON = {"length": 0.5, "width": 0.6, "cross_section": 0.5}


def alone() -> FollowAndStop:
    """The shipped controller with nobody who brakes in time."""
    return make(CAR, {"comfort": False})


def course(vehicle, step=1e-3):
    """Deceleration over time that the declared brakes make of a full demand, integrated step by step."""
    deceleration = 0.0
    for i in range(20_000):
        asked = min(max(JERK * (step * i - 0.02 - vehicle.brake_delay), 0.0), vehicle.deceleration_limit)
        deceleration += (asked - deceleration) / vehicle.brake_lag * step
        yield deceleration


def time_to_brake(speed):
    """Time to a standing target at which the layer must begin [s]."""
    return (Emergency(CAR, 0.02).way(speed, Target(0.0, 0.0)) + MARGIN) / speed


def gap_used(vehicle, speed, lead, braking, step=1e-3):
    """How much nearer the two come, at most [m]."""
    near = worst = 0.0
    for deceleration in course(vehicle, step):
        near += (speed - lead) * step
        worst = max(worst, near)
        speed, lead = speed - deceleration * step, max(lead - braking * step, 0.0)
        if speed <= 0.0:
            break
    return worst


@pytest.mark.parametrize("vehicle", [CAR, FUSION])
@pytest.mark.parametrize(
    ("speed", "lead", "braking"),
    [(5.0, 0.0, 0.0), (20.1, 0.0, 0.0), (20.0, 12.0, 0.0), (22.0, 21.0, 4.9), (22.0, 20.0, 3.0), (14.0, 10.0, 8.0)],
)
def test_the_way_is_that_of_the_declared_brakes(vehicle, speed, lead, braking):
    way = Emergency(vehicle, 0.02).way(speed, Target(0.0, lead, braking))
    assert way == pytest.approx(gap_used(vehicle, speed, lead, braking), abs=0.15)


@given(st.floats(0.5, 25.0), st.floats(0.1, 80.0), st.floats(-5.0, 25.0), st.sampled_from([0.0, 3.0, 8.0]))
def test_it_fires_when_the_way_reaches_the_gap(speed, gap, lead, braking):
    emergency, target = Emergency(FUSION, 0.02), Target(gap, lead, braking)
    wanted = speed > lead and emergency.way(speed, target) + MARGIN >= gap
    assert emergency.step([Target(500.0, 0.0), target], speed) is wanted
    assert emergency.step([], 0.3) is wanted  # latched, whatever is seen
    assert emergency.step([], 0.0) is False


@given(st.floats(0.5, 25.0), st.floats(0.1, 80.0), st.floats(-15.0, 0.0), st.floats(0.0, 80.0))
def test_for_who_crosses_obliquely_it_fires_when_its_own_stop_reaches_where_he_will_be_too(speed, gap, other, nearer):
    """He comes, but will not be nearer than a place: the car has to stop there, whatever the two close by."""
    emergency, target = Emergency(CAR, 0.02), Target(gap, other, keeps_beyond=gap - nearer)
    stops = gap_used(CAR, speed, 0.0, 0.0)
    reaches = stops + min(0.5 + 0.1 * stops, 2.0)
    assume(abs(reaches - target.keeps_beyond) > 0.2)
    late = emergency.way(speed, target) + MARGIN >= gap
    assert emergency.step([target], speed) is (late and reaches >= target.keeps_beyond)


def test_a_place_that_is_no_number_keeps_nobody_from_being_braked_for():
    assert Emergency(CAR, 0.02).step([Target(8.0, -6.0, keeps_beyond=math.nan)], 5.0)


def test_nothing_in_the_way_is_no_emergency():
    emergency = Emergency(FUSION, 0.02)
    assert not emergency.step([], 20.0)
    assert not emergency.step([Target(0.5, 0.0)], 0.0)


def test_a_trend_is_a_kalman_filter():
    """Against the matrix form with numpy, written out from the textbook."""
    random, trend, see = np.random.default_rng(4), Trend(3.0, 0.2, 16.0, 0.05), np.array([[1.0, 0.0]])
    x, p = np.array([3.0, 0.0]), np.diag([0.2, 16.0])
    for i in range(40):
        dt, value, variance = 0.04 if i % 2 else 0.06, 3.0 - 0.07 * i + random.normal(0.0, 0.3), 0.1 + 0.002 * i
        f, noise = np.array([[1.0, dt], [0.0, 1.0]]), np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]])
        x, p = f @ x, f @ p @ f.T + 0.05 * noise
        assert trend.ahead(dt) == pytest.approx((x[0], p[0, 0]))
        gain = p @ see.T / (see @ p @ see.T + variance)
        x, p = x + gain @ (value - see @ x), p - gain @ see @ p
        trend.predict(dt)
        trend.update(value, variance)
        assert (trend.value, trend.rate) == pytest.approx(tuple(x))
        assert (trend.variance, trend.covariance, trend.rate_variance) == pytest.approx((p[0, 0], p[0, 1], p[1, 1]))


@given(st.floats(-8.0, 8.0), st.floats(0.2, 2.5), st.floats(0.0, 3.0), st.sampled_from([-1.0, 1.0]))
def test_a_forecast_without_doubt_is_geometry(place, pace, arrival, side):
    """A walker's first edge at `place` before the path, in the way it goes; the band reaches 1.2 m and 0.9 m."""
    across = Trend(side * place, 1e-9, 1e-9, 0.0)
    across.rate = side * pace
    ahead = place + pace * arrival
    enters, leaves = (-0.9, 1.2) if side > 0.0 else (-1.2, 0.9)
    assume(min(abs(ahead - edge) for edge in (enters, leaves, leaves + 0.5)) > 1e-2)
    assert will_be_in(across, 1.2, 0.9, arrival) is (enters < ahead < leaves + (0.5 if place <= 0.0 else 0.0))
    assert will_have_left(across, 1.2, 0.9, arrival) is (place > 0.0 and ahead > leaves)


@pytest.mark.parametrize("speed", [20.0, 40.0, 60.0, 80.0])
@pytest.mark.parametrize("share", [0.7, 0.97, 1.03])
def test_it_avoids_what_physics_lets_it(speed, share):
    """A car that is there all at once: three scans to be sure, then the closed form."""
    v, sure = speed * KMH, 0.1
    delay = sure + 0.02 + CAR.brake_delay + CAR.brake_lag
    room = stopping_distance(v, CAR.deceleration_limit, delay, CAR.deceleration_limit / JERK)
    done = ride(alone(), v, [steady(NOSE + share * room + 2.25, 0.0)], 8.0, ideal=True)
    assert (done.impact == 0.0) is (share > 1.0)
    foretold = impact_speed(v, share * room, CAR.deceleration_limit, delay + 0.5 * CAR.deceleration_limit / JERK)
    assert done.impact == pytest.approx(foretold, abs=0.6)


@pytest.mark.thorough(witnesses=3)
@pytest.mark.parametrize(
    ("speed", "lead", "mass", "allowed"),
    [(10, 0, 1.15, 0), (40, 0, 1.15, 0), (42, 0, 1.0, 0), (60, 0, 1.15, 35), (30, 20, 1.15, 0), (60, 20, 1.15, 0),
     (80, 0, 1.0, 0), (80, 20, 1.0, 0)],
)  # fmt: skip
@pytest.mark.parametrize("seed", range(2))
def test_cars_ahead(speed, lead, mass, allowed, seed):
    """UN R152, M1 (impact speeds allowed in km/h), and FMVSS 127 (80 km/h; no contact)."""
    v, u = speed * KMH, lead * KMH
    done = ride(alone(), v, [steady(NOSE + 4.0 * (v - u) + 2.25, 0.0, u)], 8.0, seed=seed, mass_factor=mass)
    assert done.impact <= allowed * KMH
    assert done.least_gap < MARGIN + 1.0  # and no earlier than it must


@pytest.mark.thorough(witnesses=3)
@pytest.mark.parametrize("speed", [50, 80])
@pytest.mark.parametrize(("headway", "g"), [(12, 0.5), (12, 0.3), (40, 0.5), (40, 0.3)])
@pytest.mark.parametrize("build_up", [0.0, 1.5])
def test_a_lead_that_brakes(speed, headway, g, build_up):
    """FMVSS 127: equally fast, and the lead reaches its deceleration within 1.5 s; no contact."""
    done = ride(alone(), speed * KMH, [braking_lead(headway, speed * KMH, g * G, build_up, 1.0)], 12.0, seed=headway)
    assert done.impact == 0.0
    assert done.speed == 0.0


@pytest.mark.parametrize(("speed", "allowed"), [(20, 0), (30, 0), (40, 25), (50, 35), (60, 45)])
@pytest.mark.parametrize("seed", range(2))
def test_a_child_that_crosses(speed, allowed, seed):
    """UN R152, M1: 5 km/h from the right, met by the middle of the bumper; impact speeds allowed in km/h."""
    child = walker(speed * KMH, 4.0, 0.0, WALK, size=(0.3, 0.4))
    done = ride(alone(), speed * KMH, [child], 7.0, seed=seed)
    assert done.impact <= allowed * KMH
    early = 4.0 - time_to_brake(speed * KMH) - done.began  # than full braking: partly it may so long before
    assert -0.1 < early < EARLIER + 0.1


@pytest.mark.thorough(witnesses=5)
@pytest.mark.parametrize(
    ("speed", "aside", "at", "pace", "within"),
    [(40, -4.0, -0.25, 5.0, 1.0), (50, -4.0, -0.25, 5.0, 1.0), (60, -4.0, -0.25, 5.0, 1.0), (50, -4.0, 0.0, 5.0, 1.0),
     (60, -4.0, 0.0, 5.0, 1.0), (50, 6.0, 0.0, 8.0, 1.5), (60, 6.0, 0.0, 8.0, 1.5)],
)  # fmt: skip
@pytest.mark.parametrize("seed", range(2))
def test_pedestrians_who_set_out_from_the_kerb(speed, aside, at, pace, within, seed):
    """FMVSS 127: met at an overlap of 25 or 50 %, no contact. Full braking from 60 km/h must begin 1.7 s before."""
    body = from_kerb(speed * KMH, aside, at * CAR.width, pace * KMH, within)
    done = ride(alone(), speed * KMH, [body], 7.0, seed=seed)
    assert done.impact == 0.0
    assert done.began > 4.0 - time_to_brake(speed * KMH) - 0.45  # partly, and no earlier than it may


@pytest.mark.parametrize("speed", [50, 60])
def test_one_who_runs_off_keeps_his_track(speed):
    """With this noise a filter on place and speed is, as he speeds up, farther behind him than its gate is wide."""
    body = from_kerb(speed * KMH, 6.0, 0.0, 8.0 * KMH, 1.5)
    assert ride(alone(), speed * KMH, [body], 7.0, seed=7).impact == 0.0


@pytest.mark.thorough(witnesses=1)
@pytest.mark.parametrize("speed", [30, 50, 60])
@pytest.mark.parametrize("clear", [1.0, 1.5, 2.0])
@pytest.mark.parametrize("seed", range(2))
def test_for_who_stops_at_the_kerb_the_brakes_are_let_go(speed, clear, seed):
    """He walks as if he came on, and stops so far beside the car's side [m] as it must brake, if he came on."""
    stops = 6.0 - (0.5 * CAR.width + clear + 0.3)
    body = from_kerb(speed * KMH, -6.0, 0.0, 5.0 * KMH, 1.0, stops=stops)
    done = ride(alone(), speed * KMH, [body], 7.0, seed=seed)
    assert done.speed > 0.6 * speed * KMH
    assert done.hardest > -4.5 or clear < 1.5


@pytest.mark.thorough(witnesses=1)
@pytest.mark.parametrize("speed", [30, 60])
@pytest.mark.parametrize("clear", [0.5, 1.5])
@pytest.mark.parametrize("pace", [-1.4, 0.0, 1.4])
@pytest.mark.parametrize("seed", range(2))
def test_who_stands_or_walks_beside_the_way_does_not_brake_it(speed, clear, pace, seed):
    body = steady(NOSE + 4.0 * (speed * KMH - pace), -(0.5 * CAR.width + clear + 0.3), pace, 0.0, **PERSON)
    assert ride(alone(), speed * KMH, [body], 6.0, seed=seed).hardest == 0.0


def test_for_one_who_is_foreseen_it_brakes_partly_then_fully_and_lets_go():
    emergency, speed = Emergency(CAR, 0.02), 15.0
    way = emergency.way(speed, Target(0.0, 0.0))
    likely = Target(way + MARGIN + 0.2 * speed, 0.0, probability=0.6, foreseen=True)
    assert not emergency.step([likely._replace(gap=way + MARGIN + 0.4 * speed)], speed)
    slower = likely._replace(speed=10.0, gap=emergency.way(speed, Target(0.0, 10.0)) + MARGIN + 0.4 * (speed - 10.0))
    assert not emergency.step([slower], speed)  # so long before is counted at the speed with which the gap closes
    assert emergency.step([likely], speed)
    assert emergency.demand == PARTIAL
    sure = likely._replace(gap=way, probability=0.8)
    assert emergency.step([sure], speed)
    assert emergency.demand == FULL
    assert emergency.step([sure._replace(probability=0.4)], speed)  # not so sure any more: what is begun goes on
    assert emergency.demand == FULL
    assert not emergency.step([Target(90.0, 0.0)], speed)  # what is far ahead is no reason to
    assert emergency.step([likely], speed)
    assert emergency.step([Target(likely.gap, 0.0)], speed)  # he has come into the way: UN R152 wants 5 m/s2 or more
    assert emergency.demand == FULL
    assert not emergency.step([], speed)
    assert emergency.step([sure], speed)
    assert emergency.step([Target(way + MARGIN + 0.5 * speed, 0.0)], speed)  # he has come into the way
    assert not emergency.step([], speed)  # and has left it again: no standstill
    assert emergency.step([Target(way, 0.0)], speed)
    assert emergency.step([], speed)  # but what was in the way is braked for until standstill


def meets_a_cut_in(slower, seed):
    """UN R157: into the car's lane, 4 m wide, 0.05 s before nobody need avoid it. The whole controller.

    It comes over in 5 s and touches the edge after 1.69 s, 2.33 m from middle to hindmost corner.
    """
    v, u = slower * KMH, 40.0 * KMH
    before = v / (2.0 * 6.0) + 0.35 + 0.05
    other = changes_lane(NOSE + v * (before + 1.5 + 1.69) + 2.33, 4.0, u, 1.5, 5.0)
    return ride(make(CAR, {}), v + u, [other], 6.5, seed=seed, stays=True)


@pytest.mark.thorough(witnesses=1)
@pytest.mark.parametrize("slower", [10, 20, 30, 40, 50, 60])
@pytest.mark.parametrize("seed", range(2))
def test_a_car_that_cuts_in(slower, seed):
    assert meets_a_cut_in(slower, seed).impact == 0.0


def test_a_car_that_comes_out_of_view_beside_the_bumper_is_still_known():
    """Of 10 km/h its rear is at 45 degrees, where the radar's view ends, before it cuts in: then its flank is seen."""
    assert meets_a_cut_in(10, 6).impact == 0.0


@pytest.mark.thorough(witnesses=1)
@pytest.mark.parametrize(
    ("slower", "seed"), [(40, 3), (40, 4), (50, 2), (50, 3), (50, 4), (60, 1), (60, 2), (60, 3), (60, 4), (60, 11)]
)
def test_a_car_that_has_left_its_lane_is_braked_for_before_the_bank_is_sure(slower, seed):
    """Draws of the noise with which the bank is late: impacts of 7 to 27 km/h without where the car kept its lane."""
    assert meets_a_cut_in(slower, seed).impact == 0.0


@pytest.mark.thorough(witnesses=1)
@pytest.mark.parametrize("slower", [20, 40, 60])
@pytest.mark.parametrize("aside", [3.5, 4.0])
@pytest.mark.parametrize("seed", range(3))
def test_a_car_that_keeps_its_lane_is_not_braked_for(slower, aside, seed):
    other = steady(NOSE + 4.0 * slower * KMH + 2.25, aside, 40.0 * KMH)
    assert ride(make(CAR, {}), (40.0 + slower) * KMH, [other], 5.0, seed=seed).hardest == 0.0


@pytest.mark.parametrize("seed", [103, 108, 130, 142])
def test_two_cars_far_ahead_are_not_taken_for_one_between_them(seed):
    """FMVSS 127's pass-through, the whole controller: the azimuth of each is off by a quarter of their distance."""
    bodies = pair(110.0, 4.5)
    done = ride(make(CAR, {}), 80.0 * KMH, bodies, 5.2, seed=seed, begins=0.013 * ((seed - 100) % 4))
    assert done.hardest > -1.0


def test_a_car_that_is_only_beside_it_cuts_in_nowhere():
    """Along the path it is there at once, across it nobody knows yet: the rate must be known first."""
    across = Trend(2.0, 0.04, 16.0, 0.2)
    across.rate = -10.0
    assert not comes_over(across, 1.2, 1.2, 2.0, 0.0)
    across.rate_variance, across.rate = 0.04, -0.3
    assert not comes_over(across, 1.2, 1.2, 2.0, 0.0)  # no more than the noise
    across.rate = -0.45
    assert comes_over(across, 1.2, 1.2, 2.0, 0.0)
    assert not comes_over(across, 1.2, 1.2, 1.7, 0.0)  # it is not there yet
    assert not comes_over(across, 1.2, 1.2, 2.0, 0.4)
    across.rate = 0.45
    assert not comes_over(across, 1.2, 1.2, 2.0, 0.0)  # it goes away


def parked(first, clear, pitch=8.0):
    """Cars at the kerb, so far clear of the ego's side [m]."""
    return [steady(NOSE + first + pitch * i, -(0.5 * CAR.width + clear + 0.9)) for i in range(4)]


def pair(ahead, apart):
    return [steady(NOSE + ahead + 2.25, side * (0.5 * apart + 0.9)) for side in (-1.0, 1.0)]


def crossing(speed, early, pace, **sizes):
    """One who has left the ego's way so long before the ego comes [s]; its back ends there."""
    length = sizes.get("length", 4.5)
    y = 0.5 * (CAR.width + length) + pace * (early - 4.0)
    return [steady(NOSE + 4.0 * speed + 0.9, y, pace, 0.5 * math.pi, **sizes)]


def along_the_kerb(pace):
    return [steady(NOSE + 15.0 + 9.0 * i, -(0.5 * CAR.width + 0.9), pace, 0.0, **PERSON) for i in range(6)]


def beside(speed, aside):
    return [weaves(NOSE + 20.0 + 35.0 * i, aside, speed * KMH, 0.3, 6.0, 1.7 * i) for i in range(4)]


BYSTANDERS = {
    "weaves in the next lane": (50.0, beside(40.0, 3.5)),
    "weaves in the next lane, much slower": (80.0, beside(40.0, 3.5)),
    "FMVSS 127 pass-through": (80.0, pair(100.0, 4.5)),
    "the same, narrower": (80.0, pair(100.0, 4.3)),
    "the same, seen late": (80.0, pair(50.0, 4.3)),
    "parked, seen late, 50": (50.0, parked(28.0, 0.6)),
    "parked, 80": (80.0, parked(60.0, 0.6)),
    "oncoming": (50.0, [steady(NOSE + 60.0 + 60.0 * i, 3.2, 30.0 - 50.0 * KMH, math.pi) for i in range(5)]),
    "a car has crossed": (50.0, crossing(50.0 * KMH, 2.0, 10.0)),
    "somebody has crossed": (30.0, crossing(30.0 * KMH, 1.5, WALK, **PERSON)),
    "somebody crosses behind": (50.0, crossing(50.0 * KMH, -2.8, WALK, **PERSON)),
    "walks ahead of it at the kerb": (50.0, along_the_kerb(WALK)),
    "walks towards it at the kerb": (30.0, along_the_kerb(-WALK)),
}


@pytest.mark.thorough(witnesses=2)
@pytest.mark.parametrize("name", BYSTANDERS)
@pytest.mark.parametrize("seed", range(2))
def test_bystanders_do_not_brake_it(name, seed):
    speed, bodies = BYSTANDERS[name]
    assert ride(alone(), speed * KMH, bodies, 6.0, seed=seed).hardest == 0.0


@pytest.mark.thorough
@settings(max_examples=25, deadline=None)
@given(
    st.floats(15.0, 80.0), st.floats(20.0, 80.0), st.floats(-12.0, 12.0), st.floats(0.0, 15.0),
    st.sampled_from([0.0, 0.5, 1.0, -0.5]).map(lambda turns: turns * math.pi), st.sampled_from([{}, PERSON]),
)  # fmt: skip
def test_who_never_comes_into_the_band_never_brakes_it(speed, ahead, aside, pace, heading, sizes):
    """With a radar that does not err. The band is the car's width and 0.3 m on both sides.

    Along the path or square to it: on a side that is askew the nearest point wanders, which looks like crossing.
    """
    body = steady(NOSE + ahead, aside, pace, heading, **sizes)
    half = 0.5 * (body.length * abs(math.sin(heading)) + body.width * abs(math.cos(heading)))
    beside = [body.place(time)[1] for time in (0.0, 4.0)]
    assume(beside[0] * beside[1] > 0.0)
    assume(min(map(abs, beside)) - half > 0.5 * CAR.width + 0.3)
    assert math.isnan(ride(alone(), speed * KMH, [body], 4.0, ideal=True).began)


def test_after_an_emergency_the_car_is_held():
    """What it stopped for drives off; nobody but the driver may go on."""
    leaves = Body(lambda time: (NOSE + 40.0 + 5.0 * max(time - 6.0, 0.0), 0.0, 0.0, 5.0 if time > 6.0 else 0.0))
    controller, notes = alone(), []

    class Watched:
        def step(self, observation):
            setpoint = controller.step(observation)
            notes.append((observation.pose.speed, setpoint.acceleration, setpoint.note))
            return setpoint

    ride(Watched(), 10.0, [leaves], 12.0, stays=True)
    assert notes[-1] == (0.0, -1.0, "hold")
    assert {note for _, _, note in notes} == {"cruise", "emergency", "hold"}


def test_without_comfort_it_still_stops_where_the_path_ends():
    done = ride(alone(), 15.0, [], 90.0)
    assert done.hardest > -3.0
    assert done.speed < 0.1
