"""Each fault of the fixes does what its words say, as the decoder and the trust gate see it."""

from __future__ import annotations

import math
from itertools import pairwise

import pytest

from tests.plant.faulty_ride import AT, DURATION, PARAMETERS, Ride, fault, lively, off, poses
from tests.plant.test_car import EPOCH, LOT
from vve_sumo.frames import Alignment, Placement
from vve_sumo.plant.injected_faults import InjectedFault
from vve_sumo.pose.ncom import Outcome
from vve_sumo.values import FixQuality


def test_lost_poses_leave_a_gap_of_the_duration():
    ride = Ride(fault("pose_lost"))
    gaps = [after.time - before.time for before, after in pairwise(ride.fixes)]
    assert max(gaps) == pytest.approx(DURATION + 0.01, abs=1e-6)
    assert not [fix for fix in ride.fixes if ride.during(fix.time - EPOCH)]


def test_a_frozen_pose_stays_while_time_goes_on():
    ride = Ride(fault("pose_frozen"))
    frozen = [fix for fix in ride.fixes if ride.during(fix.time - EPOCH)]
    assert len(frozen) == pytest.approx(50, abs=1)
    assert len({(fix.latitude, fix.longitude, fix.velocity_east) for fix in frozen}) == 1
    assert all(after.time - before.time == pytest.approx(0.01, abs=1e-6) for before, after in pairwise(frozen))
    assert "frozen_pose" in ride.untrusted()
    assert ride.fixes[-1].latitude != frozen[-1].latitude


@pytest.mark.parametrize(("value", "metres"), [(math.nan, 5.0), (-2.0, -2.0)])
def test_a_jump_is_to_the_left_by_so_many_metres(value, metres):
    ride = Ride(fault("pose_jump", value))
    placement = Placement(LOT, Alignment(), PARAMETERS.receiver.mounting, EPOCH)
    for fix in ride.fixes:
        pose = placement.place(fix)
        truth = ride.truths[round(pose.time, 3)]
        across = math.cos(truth.heading) * (pose.y - truth.y) - math.sin(truth.heading) * (pose.x - truth.x)
        along = math.cos(truth.heading) * (pose.x - truth.x) + math.sin(truth.heading) * (pose.y - truth.y)
        # A sphere's metres differ from the ellipsoid's by up to 0.3 %.
        assert across == pytest.approx(metres if ride.during(pose.time) else 0.0, rel=4e-3, abs=1e-4)
        assert along == pytest.approx(0.0, abs=0.02)
    assert "pose_jump" in ride.untrusted()


def test_lost_rtk_shows_as_float_with_its_sigma():
    ride = Ride(InjectedFault("pose_rtk_lost", AT, 1.0))
    # The status channels come in turn, six packets a cycle.
    late = [fix for fix in ride.fixes if ride.began + AT + 0.1 < fix.time - EPOCH < ride.began + AT + 0.9]
    assert {(fix.quality, fix.position_sigma) for fix in late} == {(FixQuality.RTK_FLOAT, 0.5)}
    assert {"not_rtk_fixed", "position_sigma"} <= ride.untrusted()
    assert ride.fixes[-1].quality is FixQuality.RTK_FIXED


def test_a_clock_set_back_is_not_taken_for_time_going_on():
    ride = Ride(fault("pose_backwards"))
    assert ride.decoder.counts[Outcome.NOT_INCREASING] == pytest.approx(50, abs=1)
    assert not [fix for fix in ride.fixes if ride.during(fix.time_received - 0.01)]


def test_a_latitude_that_is_no_number_and_a_heading_that_is_invalid():
    ride = Ride(fault("pose_nan"))
    assert ride.decoder.counts[Outcome.NO_POSITION] == pytest.approx(50, abs=1)
    ride = Ride(fault("pose_heading_invalid"))
    invalid = [fix for fix in ride.fixes if math.isnan(fix.heading)]
    assert len(invalid) == pytest.approx(50, abs=1)
    assert all(ride.during(fix.time - EPOCH) for fix in invalid)
    assert "heading_invalid" in ride.untrusted()


@pytest.mark.parametrize(("kind", "ahead", "left"), [("pose_drift_lateral", 0.0, 0.4), ("pose_drift_along", 0.4, 0.0)])
def test_a_drift_goes_on_with_its_speed_and_the_velocity_agrees(kind, ahead, left):
    ride = Ride(fault(kind), course=lively)
    for pose in poses(ride):
        truth, on = ride.truths[round(pose.time, 3)], ride.during(pose.time)
        since = pose.time - ride.began - AT if on else 0.0
        assert off(ride, pose) == pytest.approx((ahead * since, left * since), rel=4e-3, abs=2e-3)
        assert pose.speed - truth.speed == pytest.approx(ahead if on else 0.0, abs=2e-3)
        # What the receiver's own place on the car adds in a bend is a millimetre here.
        assert pose.lateral_speed - truth.lateral_speed == pytest.approx(left if on else 0.0, abs=2e-3)
    assert ride.untrusted() <= {"pose_jump", "pose_drift", "velocity_jump", "settling"}


def test_the_position_steps_each_second_and_the_velocity_says_nothing_of_it():
    ride = Ride(InjectedFault("pose_steps", AT, 2.5))
    for pose in poses(ride):
        truth, since = ride.truths[round(pose.time, 3)], pose.time - ride.began - AT
        steps = math.floor(since + 1e-9) + 1 if 0.0 <= since + 1e-9 < 2.5 else 0
        assert off(ride, pose)[1] == pytest.approx(0.2 * steps, rel=4e-3, abs=1e-4)
        assert pose.lateral_speed == pytest.approx(truth.lateral_speed, abs=1e-3)


@pytest.mark.thorough
def test_a_heading_drifts_with_its_yaw_rate_and_positions_are_true():
    ride, plain = Ride(fault("pose_heading_drift"), course=lively), Ride(course=lively)
    for fix, usual in zip(ride.fixes, plain.fixes, strict=True):
        since = fix.time - EPOCH - ride.began - AT
        on = ride.during(fix.time - EPOCH)
        assert fix.heading - usual.heading == pytest.approx(0.08 * since if on else 0.0, abs=3e-6)
        assert fix.yaw_rate - usual.yaw_rate == pytest.approx(0.08 if on else 0.0, abs=3e-5)
        assert (fix.latitude, fix.velocity_east) == (usual.latitude, usual.velocity_east)
    assert ride.untrusted() == set(), "nothing that one receiver says contradicts itself"


def test_one_fix_is_dated_ahead(plain):
    ride = Ride(fault("pose_ahead_once"))
    milliseconds = slice(1, 3)
    changed = [(ours, theirs) for ours, theirs in zip(ride.packets, plain.packets, strict=True) if ours != theirs]
    (((arrived, ahead), (_, right)),) = changed
    clocks = (int.from_bytes(data[milliseconds], "little") for data in (ahead, right))
    assert int.__sub__(*clocks) % 60_000 == 12_000
    assert ride.during(arrived - 0.01)
