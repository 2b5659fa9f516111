"""Each injected fault does what its words say, as the real decoder, trust gate and codec see it."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests import vehicles
from tests.plant.test_car import EPOCH, LOT, START, commands
from vve_sumo.errors import ConfigError
from vve_sumo.frames import Alignment, Placement
from vve_sumo.plant.car import STEP, Car
from vve_sumo.plant.fault_injected_car import FaultInjectedCar
from vve_sumo.plant.fault_injector import FaultInjector
from vve_sumo.plant.injected_faults import (
    DRIVER_ACTIONS,
    KINDS,
    NEUTRAL,
    START_SPEED,
    VALUES,
    Due,
    FaultClock,
    InjectedFault,
    Shape,
)
from vve_sumo.pose.ncom import LENGTH, Decoder, Outcome, checksums_hold
from vve_sumo.pose.trust import DRIVE, TrustGate
from vve_sumo.values import Fix, FixQuality, Frame, Pose
from vve_sumo.vehicle.dataspeed import codec, layout
from vve_sumo.vehicle.dataspeed.messages import BrakeInfo, BrakeReport, GearReport, SteeringReport, ThrottleReport
from vve_sumo.vehicle.interface import DEFAULT, PEDAL_REST, Gear, InterfaceConfig, WheelSpeeds, YawRate

AT, DURATION = 1.0, 0.5  # of the fault, from the first motion
PARAMETERS = vehicles.parameters(noise=0.0)
Packets = list[tuple[float, bytes]]


Course = Callable[[float], tuple[float, float, float]]  # of time: brake torque, throttle, angle of the steering wheel


def straight(now: float) -> tuple[float, float, float]:
    """Stand on the brakes, then pull away."""
    return (1500.0, 0.0, 0.0) if now < 1.0 else (0.0, 0.3, 0.0)


def lively(now: float) -> tuple[float, float, float]:
    """The same, then brake with a foot on the throttle, and turn the wheel to and fro."""
    swing = math.sin(3.0 * now)
    torque, throttle, _ = (400.0 + 100.0 * swing, 0.05 + 0.04 * swing, 0.0) if now > 2.4 else straight(now)
    return torque, throttle, 0.5 * swing


class Ride:
    """A car with injected faults that shifts to drive and pulls away straight, for some seconds."""

    def __init__(
        self,
        *faults: InjectedFault,
        seconds: float = 5.0,
        seed: int = 3,
        variant: codec.Variant = codec.Variant.DBW1_2024,
        course: Course = straight,
    ) -> None:
        self._course = course
        parameters = replace(PARAMETERS, interface=InterfaceConfig("dataspeed_dbw1", {"variant": variant.name.lower()}))
        seeds, others = np.random.SeedSequence(1), np.random.SeedSequence(seed)
        self._whole = FaultInjectedCar(parameters, START, LOT, EPOCH, seeds, faults, others)
        self.car = self._whole.car
        self.variant = variant
        self.began = math.inf  # when the car first moved
        self.packets: Packets = []
        self.frames: list[tuple[float, Frame]] = []
        self.enabled: list[tuple[float, tuple[bool, ...]]] = []
        self.truths: dict[float, Pose] = {}
        for step in range(round(seconds / STEP)):
            self._step(step)
        self.decoder = Decoder()
        self.fixes = [fix for time, data in self.packets for fix in self.decoder.feed(data, time)]

    def _step(self, step: int) -> None:
        now, until = step * STEP, (step + 1) / 200
        sent = commands(step // 4, self._course(now)) if step % 4 == 0 else []
        output = self._whole.step(until, sent)
        truth = self.car.truth()
        if truth.speed > START_SPEED:
            self.began = min(self.began, until)
        self.truths[round(until, 3)] = truth
        self.packets += output.packets
        self.frames += output.reports
        self.enabled.append((until, tuple(module.enabled for module in self.car.interface.controller.modules)))

    def during(self, time: float) -> bool:
        """Whether the fault is on."""
        return self.began + AT <= time < self.began + AT + DURATION

    def touched(self, time: float) -> bool:
        """Whether the fault, or what hangs over from it, may show; a little generous at both ends."""
        return self.began + AT - 0.02 <= time < self.began + AT + DURATION + 0.03

    def said(self, kind: type) -> list[tuple[float, object]]:
        """What the reports of one kind say."""
        said = [(time, codec.decode(frame, self.variant)) for time, frame in self.frames]
        return [(time, message) for time, message in said if isinstance(message, kind)]

    def untrusted(self) -> set[str]:
        """Reasons of the trust gate during the fault."""
        gate, reasons = TrustGate(DRIVE, EPOCH), set()
        for fix in self.fixes:
            reason = gate.step(fix.time_received, fix).reasons
            if self.touched(fix.time - EPOCH):
                reasons |= set(reason)
        return reasons


def fault(kind: str, value: float = math.nan) -> InjectedFault:
    return InjectedFault(kind, AT, DURATION, value)


@pytest.fixture(scope="module")
def plain() -> Ride:
    return Ride()


def same_outside(ride: Ride, plain: Ride) -> None:
    """Before the fault, what the car says is untouched."""
    before = ride.began + AT - 0.02
    for name in ("packets", "frames"):
        ours, theirs = ([item for item in getattr(each, name) if item[0] < before] for each in (ride, plain))
        assert ours == theirs
        assert ours


def test_a_ride_without_faults_moves_and_is_trusted(plain):
    assert 1.0 < plain.began < 2.0
    assert plain.car.truth().speed > 3.0
    assert not [time for time, _ in plain.packets if not 0.01 < time <= 5.0]
    assert plain.untrusted() == set()


@pytest.fixture(scope="module")
def livelier() -> Ride:
    return Ride(course=lively)


#: What must happen besides, so that a kind shows.
NEEDED = {
    "brake_driver_bits_zero": (fault("driver_touch"),),
    "throttle_driver_bits_zero": (InjectedFault("throttle_override", AT, 0.05),),
}


@pytest.mark.parametrize("kind", sorted(KINDS))
def test_before_its_time_a_fault_does_nothing_and_a_ride_is_repeatable(kind, livelier):
    needed = NEEDED.get(kind, ())
    plain = Ride(*needed, course=lively) if needed else livelier
    ride, again = (Ride(fault(kind), *needed, course=lively) for _ in range(2))
    same_outside(ride, plain)
    assert (ride.packets, ride.frames) == (again.packets, again.frames)
    changed = (ride.packets, ride.frames, ride.enabled) != (plain.packets, plain.frames, plain.enabled)
    assert changed, "every kind does something"


@pytest.mark.parametrize("kind", sorted(KINDS))
def test_a_car_that_never_moves_has_no_faults(kind):
    faults = [InjectedFault(kind, 0.0, 1e9)]
    seeds = np.random.SeedSequence
    car = FaultInjectedCar(PARAMETERS, START, LOT, EPOCH, seeds(1), faults, seeds(0))
    same = Car(PARAMETERS, START, LOT, EPOCH, seeds(1))
    for step in range(100):
        until = (step + 1) / 200
        assert car.step(until, []) == same.step(until, [])


# Fixes.


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


def off(ride: Ride, pose: Pose) -> tuple[float, float]:
    """How far a pose lies from the truth of its time: ahead and to the left [m]."""
    truth = ride.truths[round(pose.time, 3)]
    cos, sin = math.cos(truth.heading), math.sin(truth.heading)
    x, y = pose.x - truth.x, pose.y - truth.y
    return cos * x + sin * y, cos * y - sin * x


def poses(ride: Ride) -> list[Pose]:
    """The fixes as poses of the rear axle in the lot."""
    placement = Placement(LOT, Alignment(), PARAMETERS.receiver.mounting, EPOCH)
    return [placement.place(fix) for fix in ride.fixes]


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


# Packets.


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


# CAN.


def between(ride: Ride, kind: type) -> list[object]:
    return [message for time, message in ride.said(kind) if ride.during(time)]


def test_a_silent_bus_says_nothing_and_carries_no_commands():
    ride = Ride(fault("bus_silent"))
    assert not [time for time, _ in ride.frames if ride.during(time)]
    assert ride.car.interface.controller.fault, "without commands the kit's watchdog latches"
    assert ride.car.interface.controller.watchdog_braking


def test_stale_reports_stop_while_commands_work(plain):
    ride = Ride(fault("reports_stale"))
    assert not [time for time, _ in ride.frames if ride.during(time)]
    assert not ride.car.interface.controller.fault
    assert ride.car.truth() == plain.car.truth()


@pytest.mark.parametrize("variant", list(codec.Variant))
def test_another_writer_uses_our_identifiers_and_is_obeyed(variant, plain):
    ride = Ride(fault("another_writer"), variant=variant)
    foreign = [(time, frame) for time, frame in ride.frames if frame.id in layout.COMMAND_IDS]
    assert [frame.id for _, frame in foreign] == [codec.BRAKE_COMMAND, codec.STEERING_COMMAND] * (len(foreign) // 2)
    assert len(foreign) == pytest.approx(50, abs=2)
    assert all(ride.during(time) for time, _ in foreign)
    command = codec.decode(foreign[0][1], variant)
    assert (command.value, command.enable) == (1000.0, True)
    assert ride.car.truth().speed < plain.car.truth().speed - 0.1


@pytest.mark.parametrize(
    ("kind", "module"), [("brake_override", 0), ("throttle_override", 1), ("steering_override", 2)]
)
def test_an_override_latches_in_its_module_alone(kind, module):
    ride = Ride(InjectedFault(kind, AT, 0.3))
    overrides = [each.override for each in ride.car.interface.controller.modules]
    assert overrides == [number == module for number in range(3)]
    since = next(time for time, enabled in ride.enabled if time > ride.began + AT and not enabled[module])
    assert since == pytest.approx(ride.began + AT + 0.1, abs=0.011), "100 ms beyond the threshold"


def test_a_touch_is_the_drivers_activity_and_no_override():
    ride = Ride(fault("driver_touch"))
    assert not any(module.override for module in ride.car.interface.controller.modules)
    assert any(report.driver for report in between(ride, BrakeReport))
    assert not any(report.driver for time, report in ride.said(BrakeReport) if time < ride.began + AT)


@pytest.mark.parametrize("variant", list(codec.Variant))
@pytest.mark.parametrize(
    ("kind", "report", "field"),
    [
        ("brake_fault", BrakeReport, "fault_channel_1"),
        ("throttle_fault", ThrottleReport, "fault_channel_1"),
        ("steering_fault", SteeringReport, "fault_bus_1"),
    ],
)
def test_a_fault_bit_is_set_for_its_time_and_nothing_else_changes(kind, report, field, variant):
    ride, plain = Ride(fault(kind), variant=variant), Ride(variant=variant)
    for (time, said), (_, usual) in zip(ride.said(report), plain.said(report), strict=True):
        assert getattr(said, field) == ride.during(time)
        assert said._replace(**{field: False}) == usual
    assert ride.car.truth() == plain.car.truth()


def test_malformed_steering_reports_are_a_byte_short():
    ride = Ride(fault("report_malformed"))
    for time, frame in ride.frames:
        if frame.id == layout.STEERING_REPORT:
            assert len(frame.data) == (7 if ride.during(time) else 8)
            assert isinstance(codec.decode(frame), codec.Malformed) == ride.during(time)


def test_an_invalid_wheel_speed_is_the_rear_left_one():
    ride = Ride(fault("wheel_speed_invalid"))
    for time, wheels in ride.said(WheelSpeeds):
        assert math.isnan(wheels.rear_left) == ride.during(time)
        assert math.isfinite(wheels.rear_right + wheels.front_left + wheels.front_right)


@pytest.mark.parametrize("number", [1, 2, 3])
def test_a_module_that_drops_out_is_disabled_and_comes_back(number):
    ride = Ride(fault("dbw_dropout", number))
    for time, enabled in ride.enabled:
        if time > 0.5 and abs(time - ride.began - AT) > 0.01 and abs(time - ride.began - AT - DURATION) > 0.01:
            assert enabled == tuple(ride.during(time) is False or each != number for each in (1, 2, 3))


def test_a_car_that_says_that_it_stands_says_so_everywhere():
    ride = Ride(fault("wheel_speeds_zero"), course=lively)
    for time, wheels in ride.said(WheelSpeeds):
        assert (max(map(abs, wheels)) == 0.0) == ride.during(time) or time < ride.began
    for time, report in ride.said(SteeringReport):
        assert (report.speed == 0.0) == ride.during(time) or time < ride.began
    for time, info in ride.said(BrakeInfo):
        assert info.stationary == ride.during(time) or time < ride.began
    assert ride.car.truth() == Ride(course=lively).car.truth()


def test_wheel_speeds_are_three_quarters_of_the_true_ones():
    ride, plain = Ride(fault("wheel_speeds_scaled"), course=lively), Ride(course=lively)
    for kind in (WheelSpeeds, SteeringReport):
        for (time, said), (_, usual) in zip(ride.said(kind), plain.said(kind), strict=True):
            factor = 0.75 if ride.during(time) else 1.0
            ours, theirs = (each if kind is WheelSpeeds else (each.speed,) for each in (said, usual))
            # Both are rounded to the wire's hundredths.
            assert ours == pytest.approx([factor * speed for speed in theirs], abs=0.0088)
    assert [info for _, info in ride.said(BrakeInfo)] == [info for _, info in plain.said(BrakeInfo)]


FROZEN = {
    "wheel_speeds_frozen": layout.WHEEL_SPEEDS,
    "steering_report_frozen": layout.STEERING_REPORT,
    "yaw_rate_frozen": layout.YAW_RATE,
    "brake_report_frozen": layout.BRAKE_REPORT,
    "throttle_report_frozen": layout.THROTTLE_REPORT,
}


@pytest.mark.parametrize("kind", FROZEN)
def test_a_frozen_report_goes_on_coming_and_says_one_thing(kind):
    ride, plain = Ride(fault(kind), course=lively), Ride(course=lively)
    assert [time for time, _ in ride.frames] == [time for time, _ in plain.frames]
    during = [frame for time, frame in ride.frames if frame.id == FROZEN[kind] and ride.during(time)]
    usual = [frame for time, frame in plain.frames if frame.id == FROZEN[kind] and ride.during(time)]
    assert len({frame.data for frame in during}) == 1 < len({frame.data for frame in usual})
    rest = [(time, frame) for time, frame in ride.frames if frame.id != FROZEN[kind] or not ride.during(time)]
    assert rest == [(time, frame) for time, frame in plain.frames if frame.id != FROZEN[kind] or not ride.during(time)]
    assert ride.car.truth() == plain.car.truth()


# What the car does.


def braking(now: float) -> tuple[float, float, float]:
    """Pull away, then hold the brakes at 600 N m."""
    return straight(now) if now < 2.4 else (600.0, 0.0, 0.0)


@pytest.mark.parametrize("share", [0.0, 0.5, 1.0])
def test_weak_brakes_slow_the_car_by_their_share_and_believe_more(share):
    """Against the closed form: rolling drag and share times torque times gain."""
    ride = Ride(InjectedFault("brakes_weak", 0.2, 9.0, share), course=braking, seconds=4.0)
    speeds = {time: truth.speed for time, truth in ride.truths.items()}
    calibration = PARAMETERS.calibration
    drag = calibration.drag(speeds[3.55]) / calibration.mass
    expected = share * calibration.brake_force(600.0) / calibration.mass + drag
    # Whatever the idling engine still pushes is told by the one with no brakes at all.
    creep = calibration.creep(speeds[3.55]) / calibration.mass
    assert (speeds[3.5] - speeds[3.6]) / 0.1 == pytest.approx(expected - creep, abs=0.03)
    (believed,) = {info.torque_actual for time, info in ride.said(BrakeInfo) if 3.5 < time < 3.6}
    assert believed == pytest.approx(600.0, abs=4.0)


def test_the_drivers_foot_gets_all_of_the_brakes():
    weak, foot = InjectedFault("brakes_weak", 0.2, 9.0, 0.0), InjectedFault("brake_override", 0.4, 9.0)
    both, alone = Ride(weak, foot), Ride(foot)
    assert both.car.truth().speed == pytest.approx(alone.car.truth().speed, abs=0.02)
    assert both.car.truth().speed < Ride(weak).car.truth().speed - 2.0


def test_an_open_throttle_pushes_with_its_share_and_the_report_knows_nothing_of_it():
    def coasting(now: float) -> tuple[float, float, float]:
        return straight(now) if now < 2.4 else (0.0, 0.0, 0.0)

    ride, plain = (Ride(*faults, course=coasting) for faults in ([InjectedFault("drive_unasked", AT, 9.0, 0.2)], []))
    speeds, usual = ({time: truth.speed for time, truth in each.truths.items()} for each in (ride, plain))
    calibration = PARAMETERS.calibration
    gained = ((speeds[4.4] - speeds[4.3]) - (usual[4.4] - usual[4.3])) / 0.1
    creep = (calibration.creep(speeds[4.35]) - calibration.creep(usual[4.35])) / calibration.mass
    drive = calibration.drive_force(0.2, speeds[4.35]) / calibration.mass
    assert gained == pytest.approx(drive + creep, abs=0.03)
    assert ride.said(ThrottleReport) == plain.said(ThrottleReport)


def speeds_of(ride: Ride) -> dict[float, float]:
    return {time: truth.speed for time, truth in ride.truths.items()}


def test_a_weak_engine_pushes_with_its_share():
    ride, plain = Ride(InjectedFault("throttle_weak", AT, 9.0, 0.25)), Ride()
    weak, usual = speeds_of(ride), speeds_of(plain)
    calibration, at = PARAMETERS.calibration, round(plain.began + AT, 2)
    lost = ((usual[at + 0.1] - usual[at]) - (weak[at + 0.1] - weak[at])) / 0.1
    assert lost == pytest.approx(0.75 * calibration.drive_force(0.3, usual[at]) / calibration.mass, rel=0.05)
    assert ride.said(ThrottleReport) == plain.said(ThrottleReport)


def test_binding_brakes_slow_the_car_by_their_torque_and_no_report_shows_it():
    ride, plain = Ride(InjectedFault("brakes_drag", AT, 9.0, 400.0)), Ride()
    bound, usual = speeds_of(ride), speeds_of(plain)
    calibration, at = PARAMETERS.calibration, round(plain.began + AT, 2)
    lost = ((usual[at + 0.1] - usual[at]) - (bound[at + 0.1] - bound[at])) / 0.1
    assert lost == pytest.approx(calibration.brake_force(400.0) / calibration.mass, rel=0.05)
    for kind in (BrakeReport, ThrottleReport):
        assert ride.said(kind) == plain.said(kind)
    torques = [[info.torque_actual for _, info in each.said(BrakeInfo)] for each in (ride, plain)]
    assert torques[0] == torques[1]


@pytest.mark.parametrize(("kind", "value"), [("steering_stuck", math.nan), ("steering_weak", 0.0)])
def test_a_steering_wheel_that_is_stuck_stays_and_its_report_says_so(kind, value):
    ride = Ride(fault(kind, value), course=lively)
    during = {report.wheel_angle for time, report in ride.said(SteeringReport) if ride.during(time)}
    commands = {report.command for time, report in ride.said(SteeringReport) if ride.during(time)}
    assert len(during) == 1 < len(commands)
    assert ride.said(SteeringReport)[-1][1].wheel_angle not in during


def test_a_weak_steering_follows_slower():
    angles = {
        share: [
            report.wheel_angle
            for _, report in Ride(InjectedFault("steering_weak", 0.2, 9.0, share), course=lively).said(SteeringReport)
        ]
        for share in (1.0, 0.02)
    }
    assert max(angles[0.02][150:]) - min(angles[0.02][150:]) < 0.7 * (max(angles[1.0][150:]) - min(angles[1.0][150:]))


@pytest.mark.parametrize("variant", list(codec.Variant))
def test_driver_bits_that_are_stuck_hide_the_foot_and_nothing_else(variant):
    foot = InjectedFault("brake_override", AT, DURATION)
    ride, plain = Ride(fault("brake_driver_bits_zero"), foot, variant=variant), Ride(foot, variant=variant)
    assert {report.override for report in between(plain, BrakeReport)} == {False, True}
    for (time, said), (_, usual) in zip(ride.said(BrakeReport), plain.said(BrakeReport), strict=True):
        hidden = usual._replace(override=False, driver=False) if ride.during(time) else usual
        assert said == hidden
    assert ride.car.truth() == plain.car.truth(), "the module itself knows its driver"


@pytest.mark.parametrize("variant", list(codec.Variant))
@pytest.mark.parametrize(
    ("module", "report"), [(1, BrakeReport), (2, ThrottleReport), (3, SteeringReport), (4, GearReport)]
)
def test_a_false_override_is_reported_by_one_module_that_goes_on_working(module, report, variant):
    ride, plain = Ride(fault("override_false", module), variant=variant), Ride(variant=variant)
    for kind in (BrakeReport, ThrottleReport, SteeringReport, GearReport):
        for (time, said), (_, usual) in zip(ride.said(kind), plain.said(kind), strict=True):
            assert said == usual._replace(override=kind is report and ride.during(time))
    assert ride.car.truth() == plain.car.truth()


def test_the_reported_brake_torque_is_frozen_or_scaled_and_the_true_one_is_not():
    plain = Ride(course=lively)
    for kind, factor in (("brake_torque_frozen", math.nan), ("brake_torque_scaled", 0.5)):
        ride = Ride(InjectedFault(kind, AT, 1.5), course=lively)
        first = math.nan
        for (time, said), (_, usual) in zip(ride.said(BrakeInfo), plain.said(BrakeInfo), strict=True):
            on = ride.began + AT <= time < ride.began + AT + 1.5
            first = said.torque_actual if on and math.isnan(first) else first
            expected = usual.torque_actual if not on else factor * usual.torque_actual
            assert said.torque_actual == pytest.approx(first if on and math.isnan(factor) else expected, abs=4.0)
            assert said._replace(torque_actual=0.0) == usual._replace(torque_actual=0.0)
        assert len({info.torque_actual for _, info in plain.said(BrakeInfo)}) > 10
        assert ride.car.truth() == plain.car.truth()


def test_a_yaw_rate_is_biased_and_wheel_speeds_are_noisy_while_the_fault_lasts():
    ride, plain = Ride(fault("yaw_rate_biased", 0.2)), Ride()
    for (time, said), (_, usual) in zip(ride.said(YawRate), plain.said(YawRate), strict=True):
        assert said.yaw - usual.yaw == pytest.approx(0.2 if ride.during(time) else 0.0, abs=3e-4)
    ride = Ride(InjectedFault("wheel_speeds_noisy", AT, 3.0, 2.0))
    off = np.array([
        np.subtract(said, usual)
        for (time, said), (_, usual) in zip(ride.said(WheelSpeeds), plain.said(WheelSpeeds), strict=True)
        if ride.began + AT <= time < ride.began + AT + 3.0
    ])  # fmt: skip
    assert off.std() == pytest.approx(2.0, rel=0.1)
    assert off.mean() == pytest.approx(0.0, abs=0.3)


def test_old_reports_follow_every_second_fresh_one(plain):
    ride = Ride(fault("reports_old", 0.2))
    extra = len(ride.frames) - len(plain.frames)
    assert extra == pytest.approx(len([1 for time, _ in plain.frames if ride.during(time)]) / 2, abs=4)
    for number in {frame.id for _, frame in plain.frames}:
        usual = [(time, frame) for time, frame in plain.frames if frame.id == number]
        said = [(time, frame) for time, frame in ride.frames if frame.id == number]
        at = dict(usual)
        for (time, frame), (after, _) in pairwise([*said, (math.inf, said[0][1])]):
            if time == after:
                assert frame == at[time], "the fresh one comes first"
            elif frame != at[time]:
                old = [sent for when, sent in usual if when <= time - 0.2 + 1e-6]
                assert frame == old[-1]
                assert ride.during(time)


def test_commands_that_the_controller_does_not_receive_stand_on_a_bus_that_lives(plain):
    ride = Ride(fault("commands_lost"))
    assert [time for time, _ in ride.frames] == [time for time, _ in plain.frames]
    assert ride.car.interface.controller.watchdog_braking


@pytest.mark.parametrize(
    ("lever", "engaged"), [(Gear.NEUTRAL, Gear.NEUTRAL), (Gear.REVERSE, Gear.DRIVE), (Gear.PARK, Gear.DRIVE)]
)
def test_the_drivers_lever_is_followed_where_a_rolling_car_allows_it_and_is_an_override(lever, engaged):
    ride = Ride(InjectedFault("gear_lever", AT, 9.0, lever))
    reports = ride.said(GearReport)
    assert {report.override for time, report in reports if time < ride.began + AT} == {False}
    late = [report for time, report in reports if time > ride.began + AT + 1.0]
    assert {report.override for report in late} == {True}
    assert {report.gear for report in late} == {engaged}
    assert ride.car.truth().speed < Ride().car.truth().speed - 1.0 or engaged is Gear.DRIVE


def test_a_driver_leaves_park_at_rest_with_a_foot_on_the_brake_only():
    lever = InjectedFault("gear_lever", 0.5, 0.7, Gear.REVERSE, clock=FaultClock.DRIVE)
    foot = InjectedFault("brake_override", 0.2, 1.5, 0.25, clock=FaultClock.DRIVE)
    for faults, gear in ((lever,), Gear.PARK), ((lever, foot), Gear.REVERSE):
        car = FaultInjectedCar(
            PARAMETERS, START, LOT, EPOCH, np.random.SeedSequence(1), faults, np.random.SeedSequence(2)
        )
        car.step(1.5, [])
        assert car.car.interface.gear is gear
        assert car.driver_inputs.gear is Gear.NONE


def test_what_the_driver_truly_does_is_known_whatever_the_reports_say():
    foot = InjectedFault("brake_override", 1.0, 1.0, 0.3, clock=FaultClock.DRIVE)
    silent = InjectedFault("bus_silent", 0.0, 9.0, clock=FaultClock.DRIVE)
    seeds = np.random.SeedSequence
    car = FaultInjectedCar(PARAMETERS, START, LOT, EPOCH, seeds(1), [foot, silent], seeds(2))
    for step in range(1, 500):
        assert car.step(step / 200, []).reports == []
        assert car.driver_inputs.brake_pedal == (0.3 if 200 < step <= 400 else PEDAL_REST), step
    assert {"brake_override", "gear_lever"} <= DRIVER_ACTIONS <= KINDS.keys()


# How the strength of a fault goes over time.


@given(st.sampled_from(sorted(NEUTRAL)), st.floats(0.0, 1.0), st.floats(0.1, 20.0), st.floats(0.0, 5.0))
def test_a_ramp_grows_evenly_from_what_does_nothing_to_its_value(kind, share, duration, at):
    _usual, least, most = VALUES[kind]
    value = least + share * (most - least)
    due = Due([InjectedFault(kind, at, duration, value, Shape.RAMP, clock=FaultClock.DRIVE)])
    began, half = due.share(kind, at), due.share(kind, at + duration / 2.0)
    assert began is not None
    assert half is not None
    assert began.value == pytest.approx(NEUTRAL[kind])
    assert half.value == pytest.approx((NEUTRAL[kind] + value) / 2.0, rel=1e-6, abs=1e-9)
    assert half.total == pytest.approx((0.75 * NEUTRAL[kind] + 0.25 * value) * duration / 2.0, rel=1e-6, abs=1e-6)
    assert due.share(kind, at + duration + 1e-6) is None


@given(st.floats(0.02, 2.0), st.floats(0.0, 10.0), st.floats(0.1, 20.0))
def test_a_flapping_fault_is_on_and_off_in_turn_and_begins_on(period, since, duration):
    due = Due(
        [InjectedFault("pose_rtk_lost", 1.0, duration, shape=Shape.FLAPPING, period=period, clock=FaultClock.DRIVE)]
    )
    turn = since / period
    if abs(turn - round(turn)) < 1e-6 or abs(since - duration) < 1e-6:
        return
    share = due.share("pose_rtk_lost", 1.0 + since)
    assert (share is not None) == (since < duration and math.floor(turn) % 2 == 0)
    if share is not None:
        assert share.since == pytest.approx(since - math.floor(turn) * period, abs=1e-6)


def test_times_count_from_the_start_of_the_drive_or_from_the_first_motion():
    faults = [InjectedFault("pose_lost", 1.0, 1.0, clock=FaultClock.DRIVE), InjectedFault("bus_silent", 1.0, 1.0)]
    due = Due(faults)
    assert [due.value(kind, 1.5) is None for kind in ("pose_lost", "bus_silent")] == [False, True]
    due.moves(3.0, 2.0)
    assert [due.value(kind, 4.5) is None for kind in ("pose_lost", "bus_silent")] == [True, False]


@given(st.sampled_from(sorted(KINDS)), st.sampled_from(list(Shape)), st.sampled_from(list(FaultClock)))
def test_a_fault_goes_through_json_and_comes_back(kind, shape, clock):
    if shape is Shape.RAMP and kind not in NEUTRAL:
        return
    period = 0.5 if shape is Shape.FLAPPING else math.nan
    fault = InjectedFault(kind, 1.0, 2.0, VALUES[kind][0] if kind in VALUES else math.nan, shape, period, clock)
    again = InjectedFault.from_dict(json.loads(json.dumps(fault.to_dict(), allow_nan=False)))
    assert repr(again) == repr(fault)
    assert again.shape is shape
    assert again.clock is clock


# What cannot be injected.


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (("earthquake", 1.0, 1.0), r"fault: kind must be one of another_writer, .*; got 'earthquake'"),
        (("pose_lost", -1.0, 1.0), r"fault pose_lost: at must be 0 s or more"),
        (("pose_lost", math.nan, 1.0), r"fault pose_lost: at must be"),
        (("pose_lost", 1.0, 0.0), r"fault pose_lost: .* duration positive"),
        (("pose_lost", 1.0, math.nan), r"fault pose_lost: .* duration positive"),
        (("pose_lost", 1.0, 1.0, 3.0), r"fault pose_lost: takes no value, got 3"),
        (("brakes_weak", 1.0, 1.0, 1.5), r"fault brakes_weak: value must be 0 to 1, got 1.5"),
        (("brake_override", 1.0, 1.0, 7.0), r"fault brake_override: value must be 0\.15 to 0\.5, got 7"),
        (("dbw_dropout", 1.0, 1.0, 1.5), r"fault dbw_dropout: value must be a whole number, got 1.5"),
        (("pose_lost", 1.0, 1.0, math.nan, Shape.RAMP), r"fault pose_lost: its strength does not grow: no ramp"),
        (("brakes_weak", 1.0, math.inf, 0.5, Shape.RAMP), r"fault brakes_weak: shape ramp needs a duration"),
        (("pose_lost", 1.0, 1.0, math.nan, Shape.FLAPPING), r"flapping needs a positive period, got nan"),
        (("pose_lost", 1.0, 1.0, math.nan, Shape.STEP, 1.0), r"only shape flapping takes a period, got 1"),
    ],
)
def test_a_fault_that_cannot_be_is_one_line(arguments: tuple, text: str):
    with pytest.raises(ConfigError, match=text) as caught:
        InjectedFault(*arguments)
    assert "\n" not in str(caught.value)


def test_a_fix_passes_unchanged_where_nothing_is_due(plain):
    untouched: Callable[[Fix], Fix | None] = FaultInjector([], np.random.SeedSequence(0), DEFAULT).on_fix
    assert all(untouched(fix) is fix for fix in plain.fixes)
