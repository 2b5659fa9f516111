"""The Dataspeed interface against the codec: which frames say an actuation, which bit of a report is which state."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vve_sumo.errors import ConfigError
from vve_sumo.values import Frame
from vve_sumo.vehicle import interface as port
from vve_sumo.vehicle.dataspeed import codec, layout, messages
from vve_sumo.vehicle.dataspeed.interface import REPORTS, DataspeedDbw1, make
from vve_sumo.vehicle.dataspeed.layout import Variant

BRAKE = codec.BrakeReport(messages.BrakeReportKind.PEDAL, 0.15, 0.15, 0.15, enabled=False)
THROTTLE = codec.ThrottleReport(0.15, 0.15, 0.15, enabled=False)
STEERING = codec.SteeringReport(0.0, 0.0, 0.0, 0.0, enabled=False)
GEAR = codec.GearReport(port.Gear.NEUTRAL)
COMMAND = port.ActuationCommand(512.0, 0.25, 0.5, 4.0, port.Gear.DRIVE, enable=True, clear=False)
LENGTHS = dict.fromkeys(REPORTS, 8) | {0x067: 2, 0x06B: 6, 0x06C: 4}  #: of the report frames [bytes]
FAULTS = ("fault_channel_1", "fault_channel_2", "fault_power")


def state(message: codec.Message):
    (report,) = DataspeedDbw1().decode(codec.encode(message))
    return report


@pytest.mark.parametrize("variant", Variant)
@pytest.mark.parametrize(("enable", "clear"), [(True, False), (False, True), (False, False)])
def test_an_actuation_is_four_frames_with_one_counter(variant, enable, clear):
    """And exactly those that the codec makes of the four commands."""
    interface = DataspeedDbw1(variant)
    for counter in (*range(256), 0, 1):
        frames = interface.encode(COMMAND._replace(enable=enable, clear=clear))
        assert frames == (
            codec.encode(codec.BrakeCommand(messages.BrakeKind.TORQUE, 512.0, enable, counter, clear), variant),
            codec.encode(codec.ThrottleCommand(messages.ThrottleKind.PERCENT, 0.25, enable, counter, clear), variant),
            codec.encode(codec.SteeringCommand(0.5, 4.0, enable, counter, clear), variant),
            codec.encode(codec.GearCommand(port.Gear.DRIVE, clear), variant),
        )


@pytest.mark.parametrize("variant", Variant)
@pytest.mark.parametrize("wrong", [-1e-9, 4000.0, math.nan, math.inf])
@pytest.mark.parametrize("field", ["brake_torque", "throttle", "wheel_angle", "wheel_rate"])
def test_what_is_no_command_is_refused(variant, wrong, field):
    value = -4000.0 if field == "wheel_angle" and wrong < 0.0 else wrong
    with pytest.raises(ValueError, match=f"Command.* must be .*, got {value:g}"):
        DataspeedDbw1(variant).encode(COMMAND._replace(**{field: value}))


@pytest.mark.parametrize("gear", port.Gear)
@pytest.mark.parametrize("clear", [False, True])
def test_every_gear_is_asked_for_as_it_is(gear, clear):
    frame = DataspeedDbw1().encode(COMMAND._replace(gear=gear, clear=clear))[-1]
    assert codec.decode(frame) == codec.GearCommand(gear, clear)


@pytest.mark.parametrize("variant", Variant)
def test_its_ranges_are_the_codecs(variant):
    facts = DataspeedDbw1(variant).facts
    limits = facts.brake_torque_limit, facts.wheel_angle_limit, facts.wheel_rate_limit
    assert limits == {Variant.DBW1_2018: (3250.0, 8.2, 8.7), Variant.DBW1_2024: (3412.0, 9.6, 17.5)}[variant]
    assert facts.commands == {0x060, 0x062, 0x064, 0x066, 0x068}
    assert facts.occupied == set(range(0x060, 0x080))
    assert facts.command_timeout == 0.1
    assert facts.dbc is not None
    assert facts.dbc.is_file()
    assert variant.name.lower() in facts.title


def test_without_a_variant_it_is_the_newer_one():
    assert DataspeedDbw1().facts == make({"variant": "dbw1_2024"}).facts
    assert make({"variant": "dbw1_2018"}).facts == DataspeedDbw1(Variant.DBW1_2018).facts


@pytest.mark.parametrize("settings", [{}, {"variant": "dbw2"}, {"variant": 1.0}, {"variant": "dbw1_2024", "x": 1.0}])
def test_other_settings_are_refused(settings):
    with pytest.raises(ConfigError, match=r"^setting 'x' is unknown" if "x" in settings else "to be verified"):
        make(settings)


#: What the three modules report while nothing is pressed, commanded or enabled.
BRAKE_STATE = port.BrakeState(False, driver_torque=0.0, command=0.0)
THROTTLE_STATE = port.ThrottleState(False, driver_opening=0.0, command=0.0)
STEERING_STATE = port.SteeringState(0.0, False, driver_torque=0.0)


@pytest.mark.parametrize(("message", "idle"), [(BRAKE, BRAKE_STATE), (THROTTLE, THROTTLE_STATE)])
def test_each_flag_of_a_pedal_module_is_its_own(message, idle):
    assert state(message) == idle
    for field in ("enabled", "override", "driver", "timeout"):
        assert state(message._replace(**{field: True})) == idle._replace(**{field: True})
    for fault in FAULTS:
        assert state(message._replace(**{fault: True})) == idle._replace(fault=True)
    assert state(message._replace(fault_watchdog=True)) == idle._replace(watchdog=True)


def test_the_watchdogs_braking_is_the_brakes():
    assert state(BRAKE._replace(watchdog_braking=True)) == BRAKE_STATE._replace(watchdog_braking=True)


def test_each_flag_of_the_steering_is_its_own():
    assert state(STEERING) == STEERING_STATE
    for field in ("enabled", "override", "timeout"):
        assert state(STEERING._replace(**{field: True})) == STEERING_STATE._replace(**{field: True})
    for fault in ("fault_bus_1", "fault_bus_2", "fault_calibration", "fault_power"):
        assert state(STEERING._replace(**{fault: True})) == STEERING_STATE._replace(fault=True)
    assert state(STEERING._replace(fault_watchdog=True)) == STEERING_STATE._replace(watchdog=True)
    assert state(STEERING._replace(torque=-3.0)).driver_torque == pytest.approx(-3.0, abs=0.04)


def test_a_pedal_module_reports_the_drivers_pedal_and_the_command_that_it_understood():
    """Torque by dbw_mkz_can's table of pedal positions; the throttle's travel goes from 0.15 to 0.80."""
    brake = state(BRAKE._replace(driver_input=0.246, command=0.283))
    assert (brake.driver_torque, brake.command) == (pytest.approx(816.0, rel=1e-3), pytest.approx(1832.0, rel=1e-3))
    brake = state(codec.BrakeReport(messages.BrakeReportKind.TORQUE, 600.0, 1234.0, 0.0, enabled=True))
    assert (brake.driver_torque, brake.command) == (600.0, 1234.0)
    brake = state(codec.BrakeReport(messages.BrakeReportKind.DECELERATION, 600.0, 2.0, 0.0, enabled=True))
    assert brake.driver_torque == 600.0
    assert math.isnan(brake.command)
    throttle = state(THROTTLE._replace(driver_input=0.475, command=0.80))
    assert (throttle.driver_opening, throttle.command) == (pytest.approx(0.5, abs=1e-4), pytest.approx(1.0, abs=1e-4))
    assert state(STEERING._replace(wheel_angle=-0.5)).wheel_angle == pytest.approx(-0.5, abs=1e-3)


def test_each_flag_of_the_shifter_is_its_own():
    assert state(GEAR) == port.GearState(port.Gear.NEUTRAL)
    assert state(GEAR._replace(override=True)) == port.GearState(port.Gear.NEUTRAL, override=True)
    assert state(GEAR._replace(fault_bus=True)) == port.GearState(port.Gear.NEUTRAL, fault=True)


def torque(pedal):
    """Brake torque of a pedal position [N m], by the table of Dataspeed's pedal_lut.h."""
    return float(np.interp(pedal, (0.175, 0.246, 0.283, 0.323, 0.330), (0.0, 816.0, 1832.0, 3316.0, 3412.0)))


def opening(pedal):
    """Throttle opening of a pedal position, 0 to 1."""
    return min(max((pedal - 0.15) / 0.65, 0.0), 1.0)


def of_a_message(message):
    """The report in a whole message that the codec decoded."""
    match message:
        case codec.BrakeReport() | codec.ThrottleReport():
            fault = message.fault_channel_1 or message.fault_channel_2 or message.fault_power
            shared = message.enabled, message.override, message.driver, message.timeout, fault, message.fault_watchdog
            if isinstance(message, codec.ThrottleReport):
                return port.ThrottleState(*shared, *map(opening, (message.driver_input, message.command)))
            driver, command = message.driver_input, message.command
            if message.kind is messages.BrakeReportKind.PEDAL:
                driver, command = torque(driver), torque(command)
            elif message.kind is messages.BrakeReportKind.DECELERATION:
                command = math.nan
            return port.BrakeState(*shared, message.watchdog_braking, driver, command)
        case codec.SteeringReport():
            buses = message.fault_bus_1 or message.fault_bus_2
            fault = buses or message.fault_calibration or message.fault_power
            watchdog = message.fault_watchdog
            return port.SteeringState(
                message.wheel_angle, message.enabled, message.override, message.timeout, fault, watchdog, message.torque
            )
        case codec.GearReport():
            return port.GearState(message.gear, message.override, message.fault_bus)
        case codec.BrakeInfo():
            return port.BrakeTorque(message.torque_actual)
        case _:
            return message


def same_as_the_codec(interface, variant, frame):
    message, report = codec.decode(frame, variant), interface.decode(frame)
    if isinstance(message, port.Malformed):
        return report == message
    expected = of_a_message(message)
    if isinstance(expected, port.BrakeState | port.ThrottleState):
        # Positions go through a table, so that the last bits may differ.
        return report[0][:-2] == expected[:-2] and report[0][-2:] == pytest.approx(
            expected[-2:], rel=1e-9, abs=1e-9, nan_ok=True
        )
    return repr(report) == repr((expected,))  # to the last bit, and NaN is NaN


@given(
    st.sampled_from(Variant), st.lists(st.tuples(st.sampled_from(sorted(REPORTS)), st.binary(max_size=9)), max_size=6)
)
def test_any_bytes_report_what_the_codec_decodes_of_them(variant, said):
    """Several frames on one interface: what was said before changes nothing."""
    interface = DataspeedDbw1(variant)
    for number, data in said:
        for sized in (data, (data + bytes(8))[: LENGTHS[number]]):
            assert same_as_the_codec(interface, variant, Frame(number, sized))


@pytest.mark.thorough(witnesses=2)
@pytest.mark.parametrize("variant", Variant)
@pytest.mark.parametrize("number", REPORTS)
def test_any_value_of_a_byte_reports_what_the_codec_decodes_of_it(variant, number):
    """Every value of each byte, among bytes of zeros and of ones: kinds, gears, invalid patterns."""
    interface = DataspeedDbw1(variant)
    for rest in (bytes(8), b"\xff" * 8):
        for at in range(LENGTHS[number]):
            for value in range(256):
                for pair in ((value,), (value, 0x0F), (value, 0x80)):
                    data = (rest[:at] + bytes(pair) + rest)[: LENGTHS[number]]
                    assert same_as_the_codec(interface, variant, Frame(number, data)), data


def test_sensors_are_passed_on():
    wheels, rates = port.WheelSpeeds(1.0, 2.0, -3.0, 4.0), port.YawRate(0.1, -0.2)
    assert state(wheels) == pytest.approx(wheels)
    assert state(rates) == pytest.approx(rates)
    accelerations = port.Accelerations(1.0, -2.0, 9.8)
    assert state(accelerations) == pytest.approx(accelerations)
    assert state(codec.BrakeInfo(400.0, 800.0, False)) == port.BrakeTorque(800.0)


@pytest.mark.parametrize("variant", Variant)
@pytest.mark.parametrize("identifier", [layout.BRAKE_REPORT, layout.THROTTLE_REPORT])
def test_a_pedal_report_is_read_anew_whenever_its_state_may_differ(variant, identifier):
    """Every pair of status bytes, one after the other in one interface, against one that never heard anything."""
    interface = DataspeedDbw1(variant)
    for status in range(256):
        for flags in (0, 1 << status % 8, 255):
            frame = Frame(identifier, bytes((flags, status, 1, 2, 3, 4, status, flags)))
            assert interface.decode(frame) == DataspeedDbw1(variant).decode(frame)


def test_what_is_damaged_says_nothing_whatever_was_said_before():
    interface = DataspeedDbw1()
    for message in (BRAKE, THROTTLE, STEERING, GEAR, port.WheelSpeeds(1.0, 1.0, 1.0, 1.0)):
        frame = codec.encode(message)
        good = interface.decode(frame)
        for data in {b"", frame.data[:-1], frame.data[1:], frame.data[6:], frame.data + b"\0"}:
            assert interface.decode(Frame(frame.id, data)) == port.Malformed(frame.id, "length")
        assert interface.decode(frame) == good
    assert interface.decode(Frame(layout.GEAR_REPORT, b"\7\0")) == port.Malformed(layout.GEAR_REPORT, "value")


def test_what_it_does_not_read_reports_nothing():
    interface = DataspeedDbw1()
    for number in (*interface.facts.commands, *(interface.facts.occupied - REPORTS.keys()), 0x123):
        assert interface.decode(Frame(number, bytes(8))) == ()


def test_what_a_command_said_can_be_read_from_a_record():
    interface = DataspeedDbw1()
    brake, throttle, steering, gear = map(interface.commanded, interface.encode(COMMAND))
    assert brake == pytest.approx(port.Commanded(512.0, math.nan, math.nan), nan_ok=True)
    assert throttle == pytest.approx(port.Commanded(math.nan, 0.25, math.nan), nan_ok=True, abs=1e-5)
    assert steering == pytest.approx(port.Commanded(math.nan, math.nan, 0.5), nan_ok=True, abs=1e-3)
    assert gear is None
    percent = codec.BrakeCommand(messages.BrakeKind.PERCENT, 0.5, True, 1)
    assert interface.commanded(codec.encode(percent)) is None
    pedal = codec.ThrottleCommand(messages.ThrottleKind.PEDAL, 0.5, True, 1)
    assert interface.commanded(codec.encode(pedal)) is None
    assert interface.commanded(codec.encode(BRAKE)) is None


def test_its_other_end_is_of_the_same_generation():
    for variant in Variant:
        assert DataspeedDbw1(variant).simulated(0.005).controller.parameters.variant is variant
