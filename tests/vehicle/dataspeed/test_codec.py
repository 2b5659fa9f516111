"""The codec against cantools over the DBC, field by field and both ways."""

from __future__ import annotations

import math
import struct

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from vve_sumo.values import Frame
from vve_sumo.vehicle.dataspeed import codec, layout
from vve_sumo.vehicle.dataspeed.codec import Gear, GearReject, ParkingBrake, Variant, WatchdogSource
from vve_sumo.vehicle.dataspeed.interface import DataspeedDbw1
from vve_sumo.vehicle.interface import read_dbc

DBC = read_dbc(DataspeedDbw1().facts.dbc)
NAMES = {
    codec.BRAKE_COMMAND: "BrakeCommand",
    codec.BRAKE_REPORT: "BrakeReport",
    codec.THROTTLE_COMMAND: "ThrottleCommand",
    codec.THROTTLE_REPORT: "ThrottleReport",
    codec.STEERING_COMMAND: "SteeringCommand",
    codec.STEERING_REPORT: "SteeringReport",
    codec.GEAR_COMMAND: "GearCommand",
    codec.GEAR_REPORT: "GearReport",
    layout.MISC_COMMAND: "MiscCommand",
    codec.WHEEL_SPEEDS: "WheelSpeeds",
    codec.ACCELERATIONS: "Accelerations",
    codec.YAW_RATE: "YawRate",
    codec.BRAKE_INFO: "BrakeInfo",
}
COUNTERS = st.integers(0, 255)
FLAGS = st.booleans()
MODERN, OLD = Variant.DBW1_2024, Variant.DBW1_2018


def fields(frame: Frame) -> dict:
    """What cantools reads in a frame, by the DBC."""
    return DBC.decode_message(frame.id, frame.data, decode_choices=False)


def within(value: float, step: float):
    """A value that was rounded to a step."""
    return pytest.approx(value, abs=step / 2 * (1 + 1e-9))


def floats(low: float, high: float):
    return st.floats(low, high, allow_nan=False)


def brake_commands(limit=3412.0):
    kinds = {
        codec.BrakeKind.NONE: st.just(0.0),
        codec.BrakeKind.PEDAL: floats(0.15, 0.5),
        codec.BrakeKind.PERCENT: floats(0.0, 1.0),
        codec.BrakeKind.TORQUE: floats(0.0, limit),
        codec.BrakeKind.TORQUE_CLOSED_LOOP: floats(0.0, limit),
        codec.BrakeKind.DECELERATION: floats(0.0, 10.0),
    }
    return st.sampled_from(list(kinds)).flatmap(
        lambda kind: st.builds(codec.BrakeCommand, st.just(kind), kinds[kind], FLAGS, COUNTERS, FLAGS)
    )


def throttle_commands():
    kinds = {
        codec.ThrottleKind.NONE: st.just(0.0),
        codec.ThrottleKind.PEDAL: floats(0.15, 0.8),
        codec.ThrottleKind.PERCENT: floats(0.0, 1.0),
    }
    return st.sampled_from(list(kinds)).flatmap(
        lambda kind: st.builds(codec.ThrottleCommand, st.just(kind), kinds[kind], FLAGS, COUNTERS, FLAGS)
    )


def test_the_dbc_holds_every_identifier_and_strictly_loads():
    assert {message.frame_id: message.name for message in DBC.messages} == NAMES
    assert DBC.get_message_by_name("BrakeReport").get_signal_by_name("WDCSRC").choices == {
        source.value: source.name for source in WatchdogSource
    }
    assert DBC.get_message_by_name("GearReport").get_signal_by_name("REJECT").choices == {
        reject.value: reject.name for reject in GearReject
    }


@given(brake_commands())
def test_brake_command_is_what_the_dbc_says(command):
    wire = fields(codec.encode(command))
    scale = {0: 1, 1: 65535, 2: 65535, 3: 1, 4: 1, 6: 1000}[command.kind]
    assert wire["PCMD"] == within(command.value * scale, 1.0)
    assert (wire["CMD_TYPE"], wire["COUNT"]) == (command.kind, command.counter)
    assert (wire["EN"], wire["CLEAR"], wire["IGNORE"]) == (command.enable, command.clear, 0)


@given(throttle_commands())
def test_throttle_command_is_what_the_dbc_says(command):
    wire = fields(codec.encode(command))
    assert wire["PCMD"] == within(command.value * 65535, 1.0)
    assert (wire["CMD_TYPE"], wire["COUNT"]) == (command.kind, command.counter)
    assert (wire["EN"], wire["CLEAR"], wire["IGNORE"]) == (command.enable, command.clear, 0)


@given(st.builds(codec.SteeringCommand, floats(-9.6, 9.6), floats(0.0, 17.5), FLAGS, COUNTERS, FLAGS))
def test_steering_command_is_what_the_dbc_says(command):
    wire = fields(codec.encode(command))
    assert wire["SCMD"] == within(math.degrees(command.wheel_angle), 0.1)
    assert (wire["EN"], wire["CLEAR"], wire["IGNORE"]) == (command.enable, command.clear, 0)
    assert (wire["QUIET"], wire["ALERT"], wire["CMD_TYPE"], wire["COUNT"]) == (0, 0, 0, command.counter)
    asked = math.degrees(command.wheel_rate)
    if command.wheel_rate == 0.0:
        assert wire["SVEL"] == 0
    elif asked < 4.0:
        assert wire["SVEL"] == 4
    else:
        assert asked - 4.0 < wire["SVEL"] <= asked * (1 + 1e-6)


@given(floats(0.001, 8.7), floats(-8.2, 8.2))
def test_the_older_generation_counts_steering_rate_in_two_degrees(rate, angle):
    frame = codec.encode(codec.SteeringCommand(angle, rate, True, 0), OLD)
    assert frame.data[3] == max(1, math.floor(math.degrees(rate) / 2.0 + 1e-6))
    assert codec.decode(frame, OLD).wheel_rate == pytest.approx(math.radians(2.0) * frame.data[3])


@given(st.sampled_from(Gear), FLAGS)
def test_gear_command_is_what_the_dbc_says(gear, clear):
    wire = fields(codec.encode(codec.GearCommand(gear, clear)))
    assert wire == {"GCMD": gear, "CLEAR": clear}


BRAKE_REPORTS = st.sampled_from(
    [(codec.BrakeReportKind.PEDAL, 1.0, 1.0), (codec.BrakeReportKind.DECELERATION, 3412.0, 10.0),
     (codec.BrakeReportKind.TORQUE, 3412.0, 3412.0)]
).flatmap(
    lambda kind: st.builds(
        codec.BrakeReport, st.just(kind[0]), floats(0, kind[1]), floats(0, kind[2]), floats(0, kind[2]),
        *[FLAGS] * 6, st.sampled_from(WatchdogSource), *[FLAGS] * 4,
    )
)  # fmt: skip


@given(BRAKE_REPORTS)
def test_brake_report_is_what_the_dbc_says(report):
    wire = fields(codec.encode(report))
    driver_scale = {0: 65535, 1: 1, 2: 1}[report.kind]
    scale = {0: 65535, 1: 1000, 2: 1}[report.kind]
    assert wire["PI"] == within(report.driver_input * driver_scale, 1.0)
    assert wire["PC"] == within(report.command * scale, 1.0)
    assert wire["PO"] == within(report.output * scale, 1.0)
    assert (wire["BTYPE"], wire["BC"], wire["WDCBRK"]) == (report.kind, report.lights, report.watchdog_braking)
    check_pedal_flags(wire, report)


THROTTLE_REPORTS = st.builds(
    codec.ThrottleReport, *[floats(0, 1)] * 3, *[FLAGS] * 4, st.sampled_from(WatchdogSource), *[FLAGS] * 4
)


@given(THROTTLE_REPORTS)
def test_throttle_report_is_what_the_dbc_says(report):
    wire = fields(codec.encode(report))
    assert [wire[name] for name in ("PI", "PC", "PO")] == pytest.approx(
        [report.driver_input, report.command, report.output], abs=0.5001 / 65535
    )
    check_pedal_flags(wire, report)


def check_pedal_flags(wire, report):
    assert wire["WDCSRC"] == report.watchdog_source
    assert [wire[name] for name in ("ENABLED", "OVERRIDE", "DRIVER", "FLTWDC", "FLT1", "FLT2", "FLTPWR", "TMOUT")] == [
        report.enabled, report.override, report.driver, report.fault_watchdog, report.fault_channel_1,
        report.fault_channel_2, report.fault_power, report.timeout,
    ]  # fmt: skip


STEERING_REPORTS = FLAGS.flatmap(
    lambda torque_mode: st.builds(
        codec.SteeringReport,
        floats(-50.0, 50.0), floats(-20.0, 20.0), floats(-90.0, 90.0), floats(-7.9, 7.9), *[FLAGS] * 3,
        st.just(torque_mode), *[FLAGS] * 5,
    )
)  # fmt: skip


@given(STEERING_REPORTS)
def test_steering_report_is_what_the_dbc_says(report):
    wire = fields(codec.encode(report))
    assert wire["ANGLE"] == within(math.degrees(report.wheel_angle), 0.1)
    # The DBC scales the command as an angle; in torque mode its count is 1/128 N m.
    command = wire["CMD"] / 0.1 / 128.0 if report.torque_mode else math.radians(wire["CMD"])
    assert command == within(report.command, 1 / 128 if report.torque_mode else math.radians(0.1))
    assert wire["TMODE"] == report.torque_mode
    assert wire["SPEED"] / 3.6 == within(report.speed, 0.01 / 3.6)
    assert wire["TORQUE"] == within(report.torque, 1 / 16)
    names = ("ENABLED", "OVERRIDE", "FLTPWR", "FLTWDC", "FLTBUS1", "FLTBUS2", "FLTCAL", "TMOUT")
    assert [wire[name] for name in names] == [
        report.enabled, report.override, report.fault_power, report.fault_watchdog, report.fault_bus_1,
        report.fault_bus_2, report.fault_calibration, report.timeout,
    ]  # fmt: skip


GEAR_REPORTS = st.builds(
    codec.GearReport, st.sampled_from(Gear), st.sampled_from(Gear), FLAGS, FLAGS, st.sampled_from(GearReject)
)


@given(GEAR_REPORTS)
def test_gear_report_is_what_the_dbc_says(report):
    assert fields(codec.encode(report)) == {
        "STATE": report.gear, "OVERRIDE": report.override, "CMD": report.command, "FLTBUS": report.fault_bus,
        "REJECT": report.reject,
    }  # fmt: skip


@given(st.lists(floats(-327.0, 327.0), min_size=4, max_size=4))
def test_wheel_speeds_and_accelerations_are_what_the_dbc_says(values):
    wheels = fields(codec.encode(codec.WheelSpeeds(*values)))
    assert list(wheels.values()) == [within(value, 0.01) for value in values]
    felt = fields(codec.encode(codec.Accelerations(*values[:3])))
    names = ("LONGITUDINAL", "LATERAL", "VERTICAL")
    assert [felt[name] for name in names] == [within(value, 0.01) for value in values[:3]]


@given(floats(-6.5, 6.5), floats(-6.5, 6.5))
def test_yaw_rate_is_what_the_dbc_says(roll, yaw):
    assert fields(codec.encode(codec.YawRate(roll, yaw))) == {"ROLL": within(roll, 2e-4), "YAW": within(yaw, 2e-4)}


BRAKE_INFOS = st.builds(
    codec.BrakeInfo, floats(0, 16000), floats(0, 16000), FLAGS, st.sampled_from(ParkingBrake), floats(-17.8, 17.8),
    FLAGS, FLAGS, FLAGS,
)  # fmt: skip


@given(BRAKE_INFOS)
def test_brake_info_is_what_the_dbc_says(info):
    wire = fields(codec.encode(info))
    assert wire["TORQUE_REQUESTED"] == within(info.torque_requested, 4.0)
    assert wire["TORQUE_ACTUAL"] == within(info.torque_actual, 4.0)
    assert wire["OVER_GROUND"] == within(info.acceleration_over_ground, 0.035)
    assert (wire["STATIONARY"], wire["PARKING_BRAKE"]) == (info.stationary, info.parking_brake)
    names = ("ABS_ACTIVE", "STAB_ACTIVE", "TRAC_ACTIVE")
    assert [wire[name] for name in names] == [info.abs_active, info.stability_active, info.traction_active]


ALL = st.one_of(
    brake_commands(), throttle_commands(), BRAKE_REPORTS, THROTTLE_REPORTS, STEERING_REPORTS, GEAR_REPORTS, BRAKE_INFOS,
    st.builds(codec.SteeringCommand, floats(-9.6, 9.6), floats(0.0, 17.5), FLAGS, COUNTERS, FLAGS),
    st.builds(codec.GearCommand, st.sampled_from(Gear), FLAGS),
    st.builds(codec.WheelSpeeds, *[floats(-327, 327)] * 4),
    st.builds(codec.Accelerations, *[floats(-327, 327)] * 3),
    st.builds(codec.YawRate, *[floats(-6.5, 6.5)] * 2),
)  # fmt: skip


def within_bounds(message):
    """A pedal command whose count, the nearest to a bound, stands for a little more than it: said as the bound."""
    if not isinstance(message, codec.BrakeCommand | codec.ThrottleCommand) or message.kind.name != "PEDAL":
        return message
    low, high = (0.15, 0.5) if isinstance(message, codec.BrakeCommand) else (0.15, 0.8)
    return message._replace(value=min(max(message.value, low), high))


@example(codec.BrakeCommand(codec.BrakeKind.PEDAL, 0.5, False, 0))
@example(codec.ThrottleCommand(codec.ThrottleKind.PEDAL, 0.15, False, 0))
@given(ALL)
def test_what_was_said_is_understood(message):
    frame = codec.encode(message)
    understood = codec.decode(frame)
    assert type(understood) is type(message)
    assert codec.encode(within_bounds(understood)) == frame
    for name, said, heard in zip(message._fields, message, understood, strict=True):
        if type(said) is float:
            assert heard == pytest.approx(said, abs=2.01 if name.startswith("torque_") else 0.51), name
        else:
            assert heard == said, name


@given(st.sampled_from(sorted(NAMES)).flatmap(lambda i: st.tuples(st.just(i), st.binary(max_size=8))))
def test_any_bytes_are_understood_or_refused_but_never_break(row):
    frame = Frame(*row)
    for variant in Variant:
        message = codec.decode(frame, variant)
        if frame.id == layout.MISC_COMMAND:
            assert message is None
        elif len(frame.data) not in (DBC.get_message_by_frame_id(frame.id).length, 4):
            assert message == codec.Malformed(frame.id, "length")


COMMANDS = st.sampled_from([codec.BRAKE_COMMAND, codec.THROTTLE_COMMAND, codec.STEERING_COMMAND])


@given(COMMANDS, st.binary(min_size=8, max_size=8))
def test_a_command_that_ignores_the_driver_is_refused(identifier, data):
    place = 2 if identifier == codec.STEERING_COMMAND else 3
    bad = bytearray(data)
    bad[place] |= 4
    assert isinstance(codec.decode(Frame(identifier, bytes(bad))), codec.Malformed)


def test_clear_alone_goes_out_with_four_bytes():
    for command in (
        codec.BrakeCommand(codec.BrakeKind.NONE, 0.0, False, None, clear=True),
        codec.ThrottleCommand(codec.ThrottleKind.NONE, 0.0, False, None, clear=True),
        codec.SteeringCommand(0.0, 0.0, False, None, clear=True),
    ):
        frame = codec.encode(command)
        assert len(frame.data) == 4
        assert codec.decode(frame) == command
        with pytest.raises(ValueError, match="CLEAR alone"):
            codec.encode(command._replace(enable=True))
        with pytest.raises(ValueError, match="CLEAR alone"):
            codec.encode(command._replace(clear=False))


BRAKE = codec.BrakeCommand(codec.BrakeKind.TORQUE, 100.0, True, 0)
STEER = codec.SteeringCommand(0.0, 1.0, True, 0)


@pytest.mark.parametrize(
    ("message", "variant"),
    [
        (BRAKE._replace(value=3413.0), MODERN),
        (BRAKE._replace(value=3251.0), OLD),
        (BRAKE._replace(value=-1.0), MODERN),
        (BRAKE._replace(value=math.nan), MODERN),
        (BRAKE._replace(value=math.inf), MODERN),
        (BRAKE._replace(kind=codec.BrakeKind.PERCENT, value=1.01), MODERN),
        (BRAKE._replace(kind=codec.BrakeKind.PEDAL, value=0.51), MODERN),
        (BRAKE._replace(kind=codec.BrakeKind.DECELERATION, value=10.1), MODERN),
        (BRAKE._replace(counter=256), MODERN),
        (BRAKE._replace(counter=-1), MODERN),
        (codec.ThrottleCommand(codec.ThrottleKind.PERCENT, 1.01, True, 0), MODERN),
        (codec.ThrottleCommand(codec.ThrottleKind.PERCENT, math.nan, True, 0), MODERN),
        (STEER._replace(wheel_angle=9.61), MODERN),
        (STEER._replace(wheel_angle=-8.21), OLD),
        (STEER._replace(wheel_angle=math.nan), MODERN),
        (STEER._replace(wheel_rate=17.6), MODERN),
        (STEER._replace(wheel_rate=8.8), OLD),
        (STEER._replace(wheel_rate=math.nan), MODERN),
        (codec.WheelSpeeds(0.0, 0.0, 0.0, 328.0), MODERN),
        (codec.WheelSpeeds(0.0, 0.0, 0.0, math.inf), MODERN),
        (codec.YawRate(0.0, -6.56), MODERN),
        (codec.BrakeInfo(16_380.0, 0.0, False), MODERN),
        (codec.BrakeReport(codec.BrakeReportKind.TORQUE, 0.0, 0.0, 0.0, True), OLD),
        (codec.SteeringReport(0.0, 0.0, -1.0, 0.0, True), OLD),
    ],
)
def test_what_does_not_fit_is_refused_and_never_wrapped(message, variant):
    with pytest.raises(ValueError, match=r"got|reports"):
        codec.encode(message, variant)


def test_invalid_patterns_and_nan_are_the_same_thing():
    assert all(map(math.isnan, codec.decode(Frame(codec.WHEEL_SPEEDS, struct.pack("<4h", *[-32768] * 4)))))
    assert all(map(math.isnan, codec.decode(Frame(codec.ACCELERATIONS, struct.pack("<3h", *[-32768] * 3)))))
    assert all(map(math.isnan, codec.decode(Frame(codec.YAW_RATE, struct.pack("<2h", *[-32768] * 2)))))
    steering = codec.decode(Frame(codec.STEERING_REPORT, bytes.fromhex("0080004000808000")))
    assert all(map(math.isnan, steering[:4]))
    info = codec.decode(Frame(codec.BRAKE_INFO, bytes.fromhex("ff0fff0f00000002")))
    assert all(map(math.isnan, (info.torque_requested, info.torque_actual, info.acceleration_over_ground)))
    for message in (codec.WheelSpeeds(*[math.nan] * 4), codec.YawRate(math.nan, math.nan), steering, info):
        again = codec.decode(codec.encode(message))
        assert [str(value) for value in again] == [str(value) for value in message]


def test_the_older_generation_reports_pedal_travel_and_speed_without_sign():
    brake = codec.BrakeReport(codec.BrakeReportKind.PEDAL, 0.25, 0.5, 0.75, True, lights=True)
    frame = codec.encode(brake, OLD)
    assert fields(frame)["BTYPE"] == 2, "BC of the older generation lies in the high bit of BTYPE"
    assert codec.decode(frame, OLD) == pytest.approx(brake, abs=1e-5)
    steering = codec.SteeringReport(-1.0, 2.0, 100.0, 0.5, True)
    frame = codec.encode(steering, OLD)
    assert struct.unpack_from("<hhH", frame.data) == (-573, 1146, 36000)
    assert codec.decode(frame, OLD) == pytest.approx(steering, abs=1e-3)


def test_nothing_public_can_ask_to_ignore_the_driver():
    for kind in (codec.BrakeCommand, codec.ThrottleCommand, codec.SteeringCommand, codec.GearCommand):
        assert not any("ignore" in name for name in kind._fields)
