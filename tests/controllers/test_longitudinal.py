"""Speed profile, approach, emergency and tracker against closed forms, and filterpy's where there is one."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from controllers.approach import Approach, Goal, Standstill
from controllers.radar_stop import RadarStop
from controllers.sightings import RANGE_SIGMA, RATE_SIGMA, Sighting
from controllers.speed import SpeedProfile
from controllers.tracks import Target, Track, Tracker
from tests.controllers.street import FUSION
from vve_sumo.path import ReferencePath
from vve_sumo.values import Detections, Observation, Point, Pose

STRAIGHT = ReferencePath.from_points([0.0, 300.0], [0.0, 0.0])


def test_the_profile_brakes_for_a_bend_with_its_deceleration():
    turns = np.linspace(0.0, 1.5, 40)
    x = np.concatenate((np.arange(0.0, 100.0), 100.0 + 25.0 * np.sin(turns)))
    y = np.concatenate((np.zeros(100), 25.0 * (1.0 - np.cos(turns))))
    path = ReferencePath.from_points(x, y)
    profile = SpeedProfile(path, lateral=2.0, slowing=1.5)
    bend = math.sqrt(2.0 * 25.0)
    assert profile.at(120.0)[0] == pytest.approx(bend, rel=0.01)
    before = profile.at(60.0)
    assert before[0] == pytest.approx(math.sqrt(bend**2 + 2.0 * 1.5 * 40.0), rel=0.02)
    assert before[1] == pytest.approx(-1.5)
    for s in np.arange(0.0, path.length - 1.0, 0.7):
        assert profile.at(float(s))[0] ** 2 * abs(path.at(float(s)).curvature) <= 2.0 * 1.05


@given(st.floats(-5.0, 200.0))
def test_the_approach_profile_is_an_integral_of_its_deceleration(distance):
    approach, step = Approach(FUSION, 2.0, 0.02), 1e-4
    (speed, slowing), (nearer, _) = approach.profile(distance), approach.profile(distance - step)
    assert speed * (speed - nearer) / step == pytest.approx(slowing, abs=2e-2)
    assert slowing <= 2.0 + 1e-9


def test_the_approach_profile_has_no_step_and_is_constant_deceleration_far_out():
    approach = Approach(FUSION, 2.0, 0.02)
    speeds = [approach.profile(d / 100.0)[0] for d in range(10_000)]
    assert max(np.diff(speeds)) < 0.01
    far, farther = approach.profile(50.0)[0], approach.profile(60.0)[0]
    assert farther**2 - far**2 == pytest.approx(2.0 * 2.0 * 10.0)


def test_standstill_is_left_only_when_the_goal_has_gone_for_a_second():
    hold = Standstill(0.02)
    assert hold.step(0.2, 0.5, last_bit=False) is None
    assert hold.step(0.2, 0.3, last_bit=True) == -0.5
    assert hold.step(0.1, 0.01, last_bit=True) == -1.0
    assert {hold.step(1.4, 0.07, last_bit=False) for _ in range(500)} == {-1.0}
    assert {hold.step(2.0, 0.0, last_bit=False) for _ in range(49)} == {-1.0}
    assert hold.step(1.4, 0.0, last_bit=False) == -1.0
    answers = [hold.step(2.0, 0.0, last_bit=False) for _ in range(51)]
    assert answers[:49] == [-1.0] * 49
    assert answers[-1] is None


def test_the_goal_is_the_gap_and_the_headway():
    stop = RadarStop(gap=5.0, time_headway=1.5)
    assert stop.goal(None).distance == math.inf
    assert stop.goal(Target(25.0, 8.0)) == Goal(25.0 - 5.0 - 12.0, 8.0)
    assert stop.goal(Target(25.0, -3.0)) == Goal(20.0, 0.0)


def test_a_track_is_a_kalman_filter():
    """Against the matrix form with numpy.linalg, written out from the textbook."""
    random = np.random.default_rng(3)
    track = Track(0.0, Sighting(50.0, 0.3, 0.2, 2.0))
    x, p = np.array([50.0, 2.0]), np.diag([RANGE_SIGMA**2, RATE_SIGMA**2])
    noise = np.diag([RANGE_SIGMA**2, RATE_SIGMA**2])
    for i in range(1, 40):
        dt = 0.04 if i % 2 else 0.06
        time = track.time + dt
        s, v = 50.0 + 2.0 * time + random.normal(0, 0.25), 2.0 + random.normal(0, 0.12)
        f = np.array([[1.0, dt], [0.0, 1.0]])
        x, p = f @ x, f @ p @ f.T + np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]])
        gain = p @ np.linalg.inv(p + noise)
        x, p = x + gain @ (np.array([s, v]) - x), p - gain @ p
        track.predict(time)
        track.update(Sighting(s, 0.0, 0.2, v))
        assert (track.s, track.speed) == pytest.approx(tuple(x))
        assert (track.p_s, track.p_sv, track.p_v) == pytest.approx((p[0, 0], p[0, 1], p[1, 1]))
    assert abs(track.s - (50.0 + 2.0 * track.time)) < 0.2


def look(tracker: Tracker, time: float, scan_time: float, rows: list[tuple[float, float, float]], x: float = 0.0,
         speed: float = 0.0) -> Target | None:  # fmt: skip
    columns = np.array(rows, dtype=float).reshape(-1, 3).T.copy()
    scan = Detections(scan_time, *columns, np.zeros(len(rows), np.int8))
    pose = Pose(time, Point.REAR_AXLE, x, 0.0, 0.0, speed, 0.0, 0.0, 0.0, 0.0)
    now = Observation(round(time / 0.02), time, pose, STRAIGHT, 10.0, {"radar": scan}, math.nan)
    return tracker.step(now, STRAIGHT.project(x, 0.0, x))


def test_a_target_counts_from_the_third_scan_on():
    tracker = Tracker(FUSION)
    found = [look(tracker, t, t, [(30.0, 0.0, 0.0)]) for t in (0.0, 0.04, 0.1, 0.14)]
    assert found[:2] == [None, None]
    assert found[3].gap == pytest.approx(30.0, abs=0.01)
    assert found[3].speed == pytest.approx(0.0, abs=0.01)


def test_the_same_scan_is_not_taken_twice():
    tracker = Tracker(FUSION)
    assert [look(tracker, 0.02 * i, 0.0, [(30.0, 0.0, 0.0)]) for i in range(10)] == [None] * 10


def test_an_old_scan_is_read_from_where_the_car_was():
    """At 10 m/s a scan dated 40 ms ago was made 0.4 m farther back."""
    tracker = Tracker(FUSION)
    for i in range(20):
        time = 0.05 * i
        seen_from = 10.0 * (time - 0.04)
        target = look(tracker, time, time - 0.04, [(60.0 - seen_from, 0.0, -10.0)], x=10.0 * time, speed=10.0)
    assert target.gap == pytest.approx(60.0 - 10.0 * time, abs=0.01)
    assert target.speed == pytest.approx(0.0, abs=0.01)


@pytest.mark.parametrize(("lateral", "in_way"), [(0.0, True), (1.0, True), (-1.0, True), (1.7, False), (-2.2, False)])
def test_only_what_the_body_would_sweep_counts(lateral, in_way):
    tracker = Tracker(FUSION)
    for i in range(20):
        target = look(tracker, 0.05 * i, 0.05 * i, [(math.hypot(20.0, lateral), math.atan2(lateral, 20.0), 0.0)])
    assert (target is not None) is in_way


def test_a_target_at_the_edge_does_not_flicker():
    """In the way from 1.0 m beside the path, it must clear the band's 1.23 m by 0.3 m to be out of it."""
    tracker, seen, time = Tracker(FUSION), [], 0.0
    for lateral in (1.0, 1.4, 1.7, 1.4):
        for _ in range(100):
            time += 0.05
            target = look(tracker, time, time, [(math.hypot(20.0, lateral), math.atan2(lateral, 20.0), 0.0)])
        seen.append(target is not None)
    assert seen == [True, True, False, False]


def test_what_stands_is_seen_to_stand_while_the_car_turns():
    """At the bumper the car moves sideways by yaw rate times lever arm; echoes off the axis show it."""
    tracker, front = Tracker(FUSION), FUSION.rear_axle_to_bumper
    azimuth = math.atan2(1.0, 6.0)
    rate = -(4.0 * math.cos(azimuth) + 0.5 * front * math.sin(azimuth))
    for i in range(4):  # the same instant, as far as places go; scans follow quickly
        time = 1e-4 * i
        echo = np.array([[math.hypot(6.0, 1.0)], [azimuth], [rate]])
        scan = Detections(time, *echo, np.zeros(1, np.int8))
        pose = Pose(time, Point.REAR_AXLE, 0.0, 0.0, 0.0, 4.0, 0.0, 0.5, 0.0, 0.0)
        now = Observation(i, time, pose, STRAIGHT, 10.0, {"radar": scan}, math.nan)
        target = tracker.step(now, STRAIGHT.project(0.0, 0.0, 0.0))
    assert target.speed == pytest.approx(0.0, abs=0.01)
    assert target.gap == pytest.approx(6.0, abs=0.01)


def test_the_nearest_in_the_way_is_the_target_and_it_coasts_through_misses():
    tracker = Tracker(FUSION)
    rows = [(15.0, 0.15, -0.2), (25.0, 0.0, 2.8), (60.0, 0.0, -0.2)]  # the car rolls at 0.2 m/s
    for i in range(10):
        moved = [rows[0], (25.0 + 3.0 * 0.05 * i, 0.0, 2.8), rows[2]]
        target = look(tracker, 0.05 * i, 0.05 * i, moved, speed=0.2)
    assert target.gap == pytest.approx(25.0 + 3.0 * 0.45, abs=0.1)
    assert target.speed == pytest.approx(3.0, abs=0.05)
    for i in range(10, 20):
        coasting = look(tracker, 0.05 * i, 0.05 * i, rows[2:], speed=0.2)
    assert coasting.gap == pytest.approx(25.0 + 3.0 * 0.95, abs=0.2)
    for i in range(20, 40):
        target = look(tracker, 0.05 * i, 0.05 * i, rows[2:], speed=0.2)
    assert target.gap == pytest.approx(60.0, abs=0.1)
