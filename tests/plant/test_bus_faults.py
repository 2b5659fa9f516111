"""Each fault of what the CAN bus carries does what its words say, as the codec sees it."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest

from tests.plant.faulty_ride import AT, DURATION, Ride, fault, lively
from vve_sumo.plant.injected_faults import InjectedFault
from vve_sumo.vehicle.dataspeed import codec, layout
from vve_sumo.vehicle.dataspeed.messages import BrakeInfo, BrakeReport, GearReport, SteeringReport, ThrottleReport
from vve_sumo.vehicle.interface import WheelSpeeds, YawRate


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


@pytest.mark.thorough(witnesses=1)
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


@pytest.mark.thorough(witnesses=1)
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


@pytest.mark.thorough(witnesses=1)
@pytest.mark.parametrize("variant", list(codec.Variant))
def test_driver_bits_that_are_stuck_hide_the_foot_and_nothing_else(variant):
    foot = InjectedFault("brake_override", AT, DURATION)
    ride, plain = Ride(fault("brake_driver_bits_zero"), foot, variant=variant), Ride(foot, variant=variant)
    assert {report.override for report in between(plain, BrakeReport)} == {False, True}
    for (time, said), (_, usual) in zip(ride.said(BrakeReport), plain.said(BrakeReport), strict=True):
        hidden = usual._replace(override=False, driver=False) if ride.during(time) else usual
        assert said == hidden
    assert ride.car.truth() == plain.car.truth(), "the module itself knows its driver"


@pytest.mark.thorough(witnesses=1)
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
