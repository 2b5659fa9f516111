"""The shipped controller in closed loop: rows of scenarios and what must come of them."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.controllers.street import FUSION, Drive, Flaws, Obstacle, drive
from tests.exhaustive import with_slow
from vve_sumo.path import ReferencePath

MPH = 0.44704


def straight(length: float) -> ReferencePath:
    return ReferencePath.from_points(np.arange(0.0, length + 1.0), np.zeros(int(length) + 1))


def bends(speed: float, lateral: float = 2.0) -> ReferencePath:
    """Straight, four bends that take `lateral` m/s2 at the speed, with clothoids, straight."""
    radius, step = max(speed * speed / lateral, 8.0), 0.05
    ramp, run_up = max(1.2 * speed, 6.0), speed * speed / 3.0 + 3.0 * speed + 20.0
    parts = [(run_up, 0.0, 0.0)]
    for side in (1.0, -1.0, 1.0, -1.0):
        bend = side / radius
        parts += [(ramp, 0.0, bend), (0.9 * radius, bend, bend), (ramp, bend, 0.0), (speed, 0.0, 0.0)]
    parts.append((speed * speed / 3.0 + 6.0 * speed + 40.0, 0.0, 0.0))
    curvature = np.concatenate([np.linspace(a, b, int(way / step), endpoint=False) for way, a, b in parts])
    heading = np.cumsum(curvature) * step
    x, y = np.cumsum(np.cos(heading)) * step, np.cumsum(np.sin(heading)) * step
    return ReferencePath.from_points(x[::30], y[::30])


def jerk(done: Drive) -> float:
    """Greatest change of acceleration while the car rolls; the wheels' last grip at standstill is a step."""
    return float(np.abs(np.diff(done.acceleration[done.speed > 0.1])).max() / 0.02)


@pytest.mark.thorough(witnesses=2)
@pytest.mark.parametrize("mph", [5, 10, 15, 20, 25, 30, 35, 40, 45])
def test_it_keeps_the_path_and_stops_five_metres_short(make, mph):
    speed = mph * MPH
    path = bends(speed)
    done = drive(make(), path, speed, [Obstacle(path.length - 15.0)], 150.0, seed=mph)
    assert np.abs(done.d).max() <= 0.07
    assert done.speed.max() == pytest.approx(speed, rel=0.05)
    assert done.speed[-1] == 0.0
    assert done.gap[-1] == pytest.approx(5.0, abs=0.2)
    assert done.acceleration.min() >= -2.6
    assert not done.emergency.any()
    assert jerk(done) < 5.0
    steps = np.diff([setpoint.acceleration for setpoint in done.setpoints]) / 0.02
    assert steps.min() >= -4.0 - 1e-9
    assert steps.max() <= 2.5 + 1e-9


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("flaws", "worst_d", "gap_error"),
    [
        (Flaws(steering_zero=-0.005), 0.15, 0.2),
        (Flaws(misalignment=math.radians(-1.0)), 0.15, 0.2),
        (Flaws(stiffness=0.8), 0.15, 0.2),
        (Flaws(stiffness=1.25), 0.15, 0.2),
        (Flaws(brake_gain=0.85), 0.15, 0.3),
        (Flaws(brake_gain=1.15), 0.15, 0.3),
        (Flaws(pose_sigma=0.03, velocity_sigma=0.05), 0.15, 0.3),
    ],
)
@pytest.mark.parametrize("mph", [10, 45])
def test_it_bears_flaws_it_was_not_told_of(make, mph, flaws, worst_d, gap_error):
    speed = mph * MPH
    path = bends(speed)
    done = drive(make(), path, speed, [Obstacle(path.length - 15.0)], 150.0, seed=mph, flaws=flaws)
    assert np.abs(done.d).max() <= worst_d
    assert done.gap[-1] == pytest.approx(5.0, abs=gap_error)
    assert done.acceleration.min() >= -3.5
    assert not done.emergency.any()


@pytest.mark.thorough
@pytest.mark.parametrize(("law", "worst"), [("pure_pursuit", 0.25), ("stanley", 0.15), ("lqr", 0.15)])
@pytest.mark.parametrize("mph", [5, 25, 45])
def test_the_other_steering_laws_keep_the_path(make, law, worst, mph):
    path = bends(mph * MPH)
    done = drive(make(steering=law), path, mph * MPH, [], 150.0)
    assert np.abs(done.d).max() <= worst
    assert done.final_s == pytest.approx(path.length, abs=0.2)


def test_it_slows_for_a_bend_that_is_too_tight(make):
    path = bends(5.0)
    done = drive(make(), path, 15.0, [], 150.0)
    radius = 12.5
    held = np.array([abs(path.at(float(s)).curvature) for s in np.cumsum(done.speed) * 0.02])
    assert done.speed.max() > 8.0
    assert (done.speed**2 * held).max() < 2.0 * 1.15
    assert done.speed[held > 0.99 / radius].min() > 4.0
    assert done.acceleration.min() > -2.6


@pytest.mark.thorough
def test_it_learns_what_the_throttle_map_forgets(make):
    done = drive(make(), straight(1200.0), 10.0, [], 70.0, flaws=Flaws(drag=0.2))
    late = (done.time > 60.0) & (done.time < 70.0)
    assert np.abs(done.speed[late] - 10.0).max() < 0.1


def test_it_stands_at_the_end_of_the_path(make):
    path = straight(150.0)
    done = drive(make(), path, 10.0, [], 100.0)
    assert done.speed[-1] == 0.0
    assert done.final_s == pytest.approx(150.0, abs=0.2)
    assert {setpoint.acceleration for setpoint in done.setpoints[-50:]} == {-1.0}


@pytest.mark.thorough(witnesses=1)
@pytest.mark.parametrize("seed", range(6))
def test_blinded_until_18_m_it_brakes_fully_and_touches_nothing(make, seed):
    done = drive(make(), straight(400.0), 11.2, [Obstacle(200.0)], 60.0, sight=18.0, start_speed=11.2, seed=seed)
    assert done.emergency.any()
    assert done.acceleration.min() < -3.5
    assert done.speed[-1] == 0.0
    assert done.gap.min() > 0.5
    first = int(np.argmax(done.emergency))
    rest = int(np.argmax(done.speed <= 0.05))
    assert done.emergency[first : rest - 5].all()


def test_without_the_layer_the_same_case_ends_in_contact(make):
    done = drive(make(emergency=False), straight(400.0), 11.2, [Obstacle(200.0)], 60.0, sight=18.0, start_speed=11.2)
    assert done.gap.min() < 0.0


@pytest.mark.thorough(witnesses=1)
@pytest.mark.parametrize("seed", range(3))
def test_it_passes_between_two_parked_cars(make, seed):
    """FMVSS 127: 4.5 m apart, 80 km/h, less than 0.25 g; here hardly a touch of the brakes is granted."""
    side = 4.5 / 2.0 + 0.9
    obstacles = [Obstacle(250.0, d=side), Obstacle(250.0, d=-side)]
    done = drive(make(), straight(500.0), 22.2, obstacles, 15.0, start_speed=22.2, seed=seed)
    passed = done.gap < -10.0
    assert passed.any()
    assert done.acceleration[: int(np.argmax(passed))].min() > -0.3


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("speed", "seed"), with_slow([(8.0, 1), (8.0, 2), (11.2, 0), (11.2, 1), (14.0, 0)], lambda one: one[1] == 0)
)
def test_cars_parked_along_bends_do_not_stop_it(make, speed, seed):
    """As the ego comes round a bend, the nearest point of a parked car's rear slides across like one who walks."""
    path = bends(speed)
    obstacles = [Obstacle(25.0 * i + 30.0, d=3.0 * (-1.0) ** i) for i in range(int(path.length / 25.0) - 3)]
    done, free = (drive(make(), path, speed, boxes, 120.0, seed=seed) for boxes in (obstacles, []))
    assert {setpoint.note for setpoint in done.setpoints} == {"cruise", "path_end", "hold"}
    assert done.time[-1] == pytest.approx(free.time[-1], abs=0.5)


@pytest.mark.thorough
def test_a_car_standing_in_a_bend_is_stopped_for(make):
    path = bends(8.0)
    middle = 20.0 + 24.0 + 64.0 / 3.0 + 9.6 + 14.0
    done = drive(make(), path, 8.0, [Obstacle(middle)], 60.0)
    assert abs(path.at(middle).curvature) > 0.02
    assert done.speed[-1] == 0.0
    assert done.gap[-1] == pytest.approx(5.0, abs=0.6)


@pytest.mark.thorough
def test_it_follows_at_its_headway_and_steadily(make):
    lead = Obstacle(30.0, speed=lambda _time: 8.0)
    done = drive(make(), straight(900.0), 13.0, [lead], 70.0)
    assert done.gap[-1] == pytest.approx(5.0 + 1.5 * 8.0, abs=0.7)
    assert np.ptp(done.speed[-500:]) < 0.2
    assert done.acceleration.min() > -2.6


@pytest.mark.thorough
def test_following_a_slightly_slower_lead_winds_nothing_up(make):
    lead = Obstacle(21.0, speed=lambda time: 7.8 if time < 80.0 else 12.0)
    done = drive(make(), straight(1500.0), 8.0, [lead], 110.0, start_speed=7.8)
    assert done.setpoints[3900].note == "target"
    assert done.speed[done.time > 80.0].max() < 8.15


def test_it_stands_behind_a_stopped_lead_and_goes_when_that_has_gone(make):
    def speed(time: float) -> float:
        return 0.0 if time < 30.0 else min(1.5 * (time - 30.0), 8.0)

    done = drive(make(), straight(500.0), 8.0, [Obstacle(60.0, speed=speed)], 45.0, stay=math.inf)
    standing = (done.time > 20.0) & (done.time < 31.5)
    assert (done.speed[standing] == 0.0).all()
    assert done.gap[standing][0] == pytest.approx(5.0, abs=0.3)
    assert {done.setpoints[i].acceleration for i in np.flatnonzero(standing)} == {-1.0}
    leaving = int(np.argmax((done.time > 30.0) & (done.speed > 0.0)))
    gone_since = int(np.argmax((done.time > 30.0) & (done.gap > done.gap[standing][0] + 1.5)))
    assert done.time[leaving] - done.time[gone_since] > 0.9
    assert done.speed[-1] > 4.0


@pytest.mark.thorough
def test_a_shuffling_lead_does_not_make_it_creep(make):
    def speed(time: float) -> float:
        return 1.0 if 30.0 < time < 31.2 else 0.0  # 1.2 m forward

    done = drive(make(), straight(500.0), 8.0, [Obstacle(60.0, speed=speed)], 45.0, stay=math.inf)
    assert (done.speed[done.time > 20.0] == 0.0).all()


@pytest.mark.thorough
def test_a_braking_lead_is_not_touched(make):
    def speed(time: float) -> float:
        return max(11.0 - 5.0 * max(time - 5.0, 0.0), 0.0)

    done = drive(make(), straight(500.0), 11.0, [Obstacle(20.0, speed=speed)], 30.0, start_speed=11.0)
    assert done.speed[-1] == 0.0
    assert done.gap.min() > 1.0


@pytest.mark.thorough
def test_the_same_drive_gives_the_same_setpoints(make):
    path = bends(9.0)
    once, again = (drive(make(), path, 9.0, [Obstacle(path.length - 15.0)], 30.0, seed=5).setpoints for _ in range(2))
    assert [(s.steering, s.acceleration, s.note) for s in once] == [(s.steering, s.acceleration, s.note) for s in again]


@pytest.mark.thorough
def test_the_delay_margin_of_the_design_is_where_the_loop_breaks(make, part):
    """The margin stands on python-control's linear loop, the drive on this file's non-linear car."""
    row = part("design").margins(FUSION, speeds=(20.1,))[0]
    path = bends(20.1, lateral=1.0)

    def wobble(share: float) -> float:
        # The virtual road itself spends a tick and a half on its way.
        late = replace(FUSION, steering_delay=FUSION.steering_delay + share * row.delay_margin - 0.03)
        done = drive(make(), path, 20.1, [], 60.0, vehicle=late)
        return float(np.abs(done.d).max())

    assert wobble(0.6) < 0.3
    assert wobble(1.3) > 1.0
