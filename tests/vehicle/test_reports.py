"""What is read of the car's frames, how old it may be, and which flag gives which reason."""

from __future__ import annotations

import math

import pytest

from vve_sumo.values import Frame
from vve_sumo.vehicle.dataspeed import codec, layout, messages
from vve_sumo.vehicle.dataspeed.interface import DataspeedDbw1
from vve_sumo.vehicle.interface import BrakeState, Gear
from vve_sumo.vehicle.reports import CarReports

RADIUS = 0.5  # [m]
BRAKE = codec.BrakeReport(messages.BrakeReportKind.PEDAL, 0.15, 0.15, 0.15, enabled=True)
THROTTLE = codec.ThrottleReport(0.15, 0.15, 0.15, enabled=True)
STEERING = codec.SteeringReport(0.0, 0.0, 0.0, 0.0, enabled=True)
GEAR = codec.GearReport(Gear.PARK)
WHEELS = codec.WheelSpeeds(0.0, 0.0, 0.0, 0.0)
YAW_RATE = codec.YawRate(0.0, 0.0)
ALL = (BRAKE, THROTTLE, STEERING, GEAR, WHEELS, YAW_RATE)
STALE = {
    codec.BrakeReport: "brake_report_stale",
    codec.ThrottleReport: "throttle_report_stale",
    codec.SteeringReport: "steering_report_stale",
    codec.WheelSpeeds: "wheel_speeds_stale",
    codec.YawRate: "yaw_rate_stale",
    codec.GearReport: "gear_report_stale",
}


def heard(*messages: object, now: float = 0.0) -> CarReports:
    """A car that has said all that it should, and then these."""
    reports = CarReports(RADIUS, DataspeedDbw1())
    assert reports.take(now, [codec.encode(message) for message in (*ALL, *messages)]) == []
    return reports


def test_before_the_first_report_nothing_is_known():
    silent = CarReports(RADIUS, DataspeedDbw1())
    assert set(silent.stale(0.0)) == set(STALE.values())
    assert silent.faults() == ["report_invalid"]
    assert not silent.any_enabled()
    assert silent.overrides() == frozenset()
    assert silent.driver() == []
    assert silent.gear.gear is Gear.NONE
    assert math.isnan(silent.speed + silent.fastest_wheel)
    assert math.isnan(silent.yaw_rate)
    assert math.isnan(silent.wheel_angle)
    assert silent.wheels == ()
    assert silent.unchanged(5.0) == 0.0
    assert not silent.speed_known(0.0)
    assert not silent.in_park(0.0)
    assert silent.last_dbw_report == -math.inf
    assert math.isnan(silent.steering.wheel_angle)
    assert not any((*silent.brake[:-2], *silent.throttle[:-2], *silent.steering[1:-1], *silent.gear[1:]))
    unknown = (*silent.brake[-2:], *silent.throttle[-2:], silent.steering[-1], silent.brake_torque(0.0))
    assert all(map(math.isnan, unknown))
    assert silent.age(BrakeState, 0.0) == math.inf


def test_all_is_well_when_all_say_so():
    car = heard()
    assert car.stale(0.0) == car.faults() == car.dropped_out() == []


@pytest.mark.parametrize("late", ALL, ids=lambda message: type(message).__name__)
def test_each_report_counts_for_its_time(late):
    """100 ms, 200 ms for the gear; to half a microsecond. All others are heard again."""
    limit = 0.2 if late is GEAR else 0.1
    car = heard()
    for now, stale in ((limit, []), (limit + 0.5e-6, []), (limit + 2e-6, [STALE[type(late)]])):
        others = [message for message in ALL if message is not late]
        assert car.take(now, [codec.encode(message) for message in others]) == []
        assert car.stale(now) == stale


def test_reports_go_stale_in_their_order():
    assert heard().stale(1.0) == [
        "brake_report_stale",
        "throttle_report_stale",
        "steering_report_stale",
        "wheel_speeds_stale",
        "yaw_rate_stale",
        "gear_report_stale",
    ]


@pytest.mark.parametrize("message", [BRAKE, THROTTLE, STEERING, GEAR])
def test_any_module_of_the_kit_is_the_kit(message):
    car = CarReports(RADIUS, DataspeedDbw1())
    car.take(1.0, [codec.encode(message)])
    assert car.last_dbw_report == 1.0
    car.take(2.0, [codec.encode(WHEELS), codec.encode(YAW_RATE)])
    assert car.last_dbw_report == 1.0, "wheels and gyroscope are the car's own"
    car.take(3.0, [codec.encode(BRAKE)])
    assert car.last_dbw_report == 3.0


def test_repeated_bytes_do_not_hide_those_after_them():
    car = heard()
    assert car.take(0.0, [codec.encode(BRAKE), codec.encode(codec.YawRate(0.0, 0.25))]) == []
    assert car.yaw_rate == pytest.approx(0.25)


def test_the_same_bytes_again_are_a_report_as_good_as_any():
    """Also after one that says nothing; what counts is what was understood last."""
    car = heard()
    frames = [codec.encode(message) for message in ALL]
    assert car.take(0.15, frames) == []
    assert car.stale(0.2) == []
    assert car.take(0.3, [Frame(layout.WHEEL_SPEEDS, b"")]) == ["report_malformed"]
    assert "wheel_speeds_stale" in car.stale(0.3)
    assert car.take(0.3, frames) == []
    assert car.stale(0.3) == []


@pytest.mark.parametrize("identifier", [0x060, 0x062, 0x064, 0x066, 0x068])
def test_a_command_on_the_bus_is_another_writers(identifier):
    assert heard().take(0.0, [Frame(identifier, bytes(8))] * 2) == ["another_writer"] * 2


def test_what_nobody_reads_is_passed_over():
    car = heard()
    assert car.take(0.0, [Frame(0x123, b"x"), Frame(layout.ACCELERATIONS, b"x")]) == []
    assert car.take(0.0, [Frame(layout.ACCELERATIONS, b"x"), codec.encode(codec.YawRate(0.0, 0.25))]) == []
    assert car.yaw_rate == pytest.approx(0.25), "nor does it hide those after it"
    assert car.take(0.0, [Frame(layout.BRAKE_REPORT, bytes(7)), codec.encode(codec.YawRate(0.0, 0.5))]) == [
        "report_malformed"
    ]
    assert car.yaw_rate == pytest.approx(0.5), "one that is damaged does not hide those after it"


def test_a_decoder_that_raises_is_a_reason_with_its_text_and_no_more():
    class Broken(DataspeedDbw1):
        def decode(self, frame):
            if frame.id == layout.BRAKE_REPORT:
                raise IndexError("no such byte")
            return super().decode(frame)

    car = CarReports(RADIUS, Broken())
    assert car.take(0.0, [codec.encode(message) for message in ALL]) == ["interface_raised"]
    assert car.error.startswith("IndexError: no such byte (test_reports.py, line ")
    assert car.stale(0.0) == ["brake_report_stale"]


def test_reports_in_one_frame_are_all_taken():
    class Both(DataspeedDbw1):
        def decode(self, frame):
            return (codec.WheelSpeeds(1.0, 1.0, 1.0, 1.0), YAW_RATE._replace(yaw=0.5))

    car = CarReports(RADIUS, Both())
    assert car.take(0.0, [Frame(layout.WHEEL_SPEEDS, b"")]) == []
    assert (car.speed, car.yaw_rate) == (RADIUS, 0.5)


@pytest.mark.parametrize(
    ("message", "reason"),
    [
        *((report._replace(fault_watchdog=True), "dbw_watchdog") for report in (BRAKE, THROTTLE, STEERING)),
        (BRAKE._replace(watchdog_braking=True), "dbw_braking"),
        *(
            (report._replace(**{flag: True}), f"{name}_fault")
            for name, report, flags in (
                ("brake", BRAKE, ("fault_channel_1", "fault_channel_2", "fault_power")),
                ("throttle", THROTTLE, ("fault_channel_1", "fault_channel_2", "fault_power")),
                ("steering", STEERING, ("fault_bus_1", "fault_bus_2", "fault_calibration", "fault_power")),
            )
            for flag in flags
        ),
        (GEAR._replace(fault_bus=True), "gear_fault"),
        (STEERING._replace(wheel_angle=math.nan), "report_invalid"),
        (YAW_RATE._replace(yaw=math.nan), "report_invalid"),
        *((WHEELS._replace(**{wheel: math.nan}), "report_invalid") for wheel in WHEELS._fields),
    ],
)
def test_each_flag_alone_is_its_fault(message, reason):
    assert heard(message).faults() == [reason]


@pytest.mark.parametrize(
    ("message", "reason"),
    [
        (BRAKE._replace(enabled=False), "brake_disabled"),
        (THROTTLE._replace(enabled=False), "throttle_disabled"),
        (STEERING._replace(enabled=False), "steering_disabled"),
        (BRAKE._replace(timeout=True), "brake_timeout"),
        (THROTTLE._replace(timeout=True), "throttle_timeout"),
        (STEERING._replace(timeout=True), "steering_timeout"),
        (BRAKE._replace(timeout=True, enabled=False), "brake_timeout"),
    ],
)
def test_a_module_that_does_not_work_is_named(message, reason):
    car = heard(message)
    assert car.dropped_out() == [reason]
    assert car.all_enabled() is message.enabled
    assert car.any_enabled()


@pytest.mark.parametrize("on", [BRAKE, THROTTLE, STEERING])
def test_one_enabled_module_is_any(on):
    off = [message._replace(enabled=False) for message in (BRAKE, THROTTLE, STEERING)]
    assert not heard(*off).any_enabled()
    assert heard(*off, on).any_enabled()
    assert not heard(*off, on).all_enabled()


@pytest.mark.parametrize(
    ("message", "name"), [(BRAKE, "brake"), (THROTTLE, "throttle"), (STEERING, "steering"), (GEAR, "gear")]
)
def test_an_override_is_known_by_its_module(message, name):
    assert heard().overrides() == frozenset()
    assert heard(message._replace(override=True)).overrides() == {name}


def test_the_drivers_feet_are_told_apart():
    brake, throttle = BRAKE._replace(driver=True), THROTTLE._replace(driver=True)
    assert heard().driver() == []
    assert heard(brake).driver() == ["driver_on_brake"]
    assert heard(throttle).driver() == ["driver_on_throttle"]
    assert heard(brake, throttle).driver() == ["driver_on_brake", "driver_on_throttle"]


# Motion.


def test_the_rear_axle_moves_with_the_mean_of_its_wheels():
    car = heard(codec.WheelSpeeds(front_left=40.0, front_right=-50.0, rear_left=10.0, rear_right=30.0))
    assert car.speed == pytest.approx(20.0 * RADIUS)
    assert car.fastest_wheel == pytest.approx(50.0 * RADIUS)
    assert car.wheels == pytest.approx((40.0, -50.0, 10.0, 30.0))


@pytest.mark.parametrize("wheel", WHEELS._fields)
@pytest.mark.parametrize("speed", [7.0, -7.0])
def test_the_fastest_wheel_is_any_of_the_four(wheel, speed):
    car = heard(WHEELS._replace(**{wheel: speed}))
    assert car.fastest_wheel == pytest.approx(7.0 * RADIUS)


@pytest.mark.parametrize("wheel", WHEELS._fields)
def test_one_invalid_wheel_leaves_no_speed(wheel):
    car = heard(
        codec.WheelSpeeds(1.0, 1.0, 1.0, 1.0), codec.WheelSpeeds(1.0, 1.0, 1.0, 1.0)._replace(**{wheel: math.nan})
    )
    assert math.isnan(car.speed)
    assert math.isnan(car.fastest_wheel)
    assert not car.speed_known(0.0)


def test_a_speed_is_known_while_it_is_fresh():
    car = heard()
    assert [car.speed_known(now) for now in (0.0, 0.1, 0.1 + 0.5e-6, 0.1 + 2e-6)] == [True, True, True, False]


def test_park_is_what_the_car_has_just_said():
    car = heard()
    assert [car.in_park(now) for now in (0.0, 0.2, 0.2 + 0.5e-6, 0.2 + 2e-6)] == [True, True, True, False]
    assert not heard(codec.GearReport(Gear.NEUTRAL)).in_park(0.0)
    assert not heard(GEAR._replace(fault_bus=True)).in_park(0.0)


def test_an_angle_that_is_valid_outlives_one_that_is_not():
    car = heard(STEERING._replace(wheel_angle=0.5), STEERING._replace(wheel_angle=math.nan))
    assert car.wheel_angle == pytest.approx(0.5, abs=1e-3)
    assert math.isnan(car.steering.wheel_angle)


def test_wheels_that_turn_and_never_change_are_counted():
    car = heard()
    same = codec.encode(codec.WheelSpeeds(1.0, 1.0, 1.0, 1.0))
    for now in (1.0, 2.0, 3.5):
        car.take(now, [same])
    assert car.unchanged(3.5) == 2.5
    car.take(4.0, [codec.encode(codec.WheelSpeeds(1.0, 1.0, 1.0, 1.01))])
    assert car.unchanged(4.25) == 0.25
    car.take(5.0, [codec.encode(WHEELS)])
    assert car.unchanged(9.0) == 0.0, "wheels that stand are still"
    car.take(10.0, [codec.encode(WHEELS._replace(rear_left=1.0))])
    assert car.unchanged(10.0) == 0.0
    assert car.unchanged(10.5) == 0.5


def test_a_first_report_begins_the_count():
    car = CarReports(RADIUS, DataspeedDbw1())
    car.take(7.0, [codec.encode(codec.WheelSpeeds(1.0, 1.0, 1.0, 1.0))])
    assert car.unchanged(8.0) == 1.0


def test_a_decoder_that_forgets_to_return_is_a_malformed_report():
    class Forgetful(DataspeedDbw1):
        def decode(self, frame):
            return None if frame.id == layout.BRAKE_REPORT else super().decode(frame)

    assert CarReports(RADIUS, Forgetful()).take(0.0, [codec.encode(message) for message in ALL]) == ["report_malformed"]
