"""Each fault of the receiver's packets does what its words say, as the decoder sees it."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.plant.faulty_ride import AT, PARAMETERS, Packets, Ride, fault, off
from tests.plant.test_car import EPOCH, LOT
from vve_sumo.frames import Alignment, Placement
from vve_sumo.plant.car import STEP
from vve_sumo.plant.fault_injector import FaultInjector
from vve_sumo.plant.injected_faults import KINDS, InjectedFault
from vve_sumo.pose.ncom import LENGTH, Decoder, Outcome, checksums_hold
from vve_sumo.values import Pose
from vve_sumo.vehicle.interface import DEFAULT


def test_one_packet_says_a_wrong_minute_with_right_checksums(plain):
    ride = Ride(fault("pose_minute_wrong"))
    changed = [
        (ours, theirs) for (_, ours), (_, theirs) in zip(ride.packets, plain.packets, strict=True) if ours != theirs
    ]
    ((wrong, right),) = changed
    assert checksums_hold(wrong)
    minute = slice(63, 67)
    assert int.from_bytes(wrong[minute], "little") - int.from_bytes(right[minute], "little") == 5
    assert wrong[1:62] == right[1:62]


def forged_of(ride: Ride, plain: Ride) -> list[Pose]:
    """What only the other sender said, as poses in the lot; each packet is decoded by itself."""
    true = [data for _, data in plain.packets]
    kept = [data for _, data in ride.packets if data in set(true)]
    assert kept == true, "the true packets arrive all the same"
    decoder = Decoder()
    others = [(time, data) for time, data in ride.packets if data not in set(true)]
    fixes = [fix for time, data in others for fix in decoder.feed(data, time)]
    assert len(fixes) == pytest.approx(50, abs=3)
    placement = Placement(LOT, Alignment(), PARAMETERS.receiver.mounting, EPOCH)
    return [placement.place(fix) for fix in fixes]


@pytest.mark.parametrize("kind", ["pose_forged", "pose_overtaken"])
def test_another_sender_speaks_between_the_true_packets_and_drifts(kind, plain):
    ride = Ride(fault(kind))
    for pose in forged_of(ride, plain):
        since = pose.time - ride.began - AT + (0.01 if kind == "pose_overtaken" else 0.0)
        ahead, left = off(ride, pose)
        assert left == pytest.approx(0.4 * since, abs=2e-3)
        assert ahead == pytest.approx(0.0, abs=2e-3)
        assert pose.lateral_speed == pytest.approx(0.4, abs=2e-3)


def test_forged_packets_are_one_ahead_of_the_true_ones_and_overtaking_ones_are_of_their_time(plain):
    for kind, first in (("pose_forged", 0.01), ("pose_overtaken", 0.0)):
        ride = Ride(fault(kind))
        true = {data for _, data in plain.packets}
        clocks = [(data in true, int.from_bytes(data[1:3], "little") / 1000.0) for _, data in ride.packets]
        for (ours, time), (theirs, after) in pairwise(clocks):
            if kind == "pose_forged" and ours and not theirs:
                assert (after - time) % 60.0 == pytest.approx(first)
            if kind == "pose_overtaken" and not ours:
                assert theirs
                assert after == time


def test_bursts_keep_every_packet_in_order_and_come_every_48_ms(plain):
    ride = Ride(fault("pose_bursts"))
    assert [data for _, data in ride.packets] == [data for _, data in plain.packets]
    times = sorted({time for time, _ in ride.packets if ride.during(time)})
    assert [b - a for a, b in pairwise(times)] == pytest.approx([0.048] * (len(times) - 1), abs=1e-9)
    held = [burst - (number * 0.01 + 0.01) for number, (burst, _) in enumerate(ride.packets, start=1)]
    assert all(-1e-9 <= wait <= 0.048 + 1e-9 for wait in held)


def test_late_packets_come_the_delay_later_and_in_order(plain):
    ride = Ride(fault("pose_late", 0.03))
    assert [data for _, data in ride.packets] == [data for _, data in plain.packets]
    for (late, _), (usual, _) in zip(ride.packets, plain.packets, strict=True):
        if ride.during(usual) and ride.during(late):
            assert late - usual == pytest.approx(0.03, abs=1e-9)
        else:
            assert -1e-9 <= late - usual <= 0.03 + 1e-9


@pytest.mark.plain
def test_duplicates_double_the_packets_and_change_no_fix(plain):
    ride = Ride(fault("pose_duplicates"))
    assert len(ride.packets) - len(plain.packets) == pytest.approx(50, abs=1)
    assert ride.fixes == plain.fixes


def test_reordered_packets_lose_the_earlier_of_two(plain):
    ride = Ride(fault("pose_reordered"))
    assert sorted(data for _, data in ride.packets) == sorted(data for _, data in plain.packets)
    assert ride.decoder.counts[Outcome.NOT_INCREASING] == pytest.approx(25, abs=1)
    assert [data for _, data in ride.packets] != [data for _, data in plain.packets]


def test_garbage_costs_every_fifth_fix_and_no_other(plain):
    ride = Ride(fault("pose_garbage"))
    assert 100 - 100 / 5 - 2 < len([1 for time, _ in ride.packets if ride.during(time)]) < 100
    missing = {fix.time for fix in plain.fixes} - {fix.time for fix in ride.fixes}
    assert len(missing) == pytest.approx(10, abs=1)
    assert [b - a for a, b in pairwise(sorted(missing))] == pytest.approx([0.05] * (len(missing) - 1), abs=1e-6)
    known = {fix.time: fix.latitude for fix in plain.fixes}
    assert all(known[fix.time] == fix.latitude for fix in ride.fixes), "none is made up"
    # The bytes between are really there, and really random.
    assert ride.decoder.discarded > 10 * LENGTH
    assert Ride(fault("pose_garbage"), seed=4).packets != ride.packets


@given(
    st.lists(st.sampled_from([kind for kind in KINDS if kind.startswith("pose_")]), max_size=4),
    st.lists(st.floats(0.0, 0.3), min_size=4, max_size=4),
)
def test_whatever_is_combined_packets_arrive_in_order_and_never_early(kinds, delays):
    faults = [InjectedFault(kind, at, 0.2) for kind, at in zip(kinds, delays, strict=False)]
    injector = FaultInjector(faults, np.random.SeedSequence(0), DEFAULT)
    injector.moves(0.0, 1.0)
    arrived: Packets = []
    for step in range(1, 200):
        until = step * STEP
        packets = [(until, step.to_bytes(2, "big"))] if step % 2 == 0 else []
        new = injector.on_packets(until, packets)
        assert all(time <= until + 1e-9 for time, _ in new)
        arrived += new
    times = [round(time, 9) for time, _ in arrived]
    assert times == sorted(times)
    for time, data in arrived:
        if len(data) == 2 and "pose_garbage" not in kinds:
            assert time >= int.from_bytes(data, "big") * STEP - 1e-9
    if "pose_garbage" not in kinds:
        assert {int.from_bytes(data, "big") for _, data in arrived} == set(range(2, 200, 2)), "none is lost for good"
