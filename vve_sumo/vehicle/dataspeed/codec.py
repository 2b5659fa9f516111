"""Codec of a Dataspeed DBW1 drive-by-wire controller: values in, CAN frame out, and back.

Both directions: the gateway encodes commands and decodes reports, the simulated vehicle does the reverse.
It knows bits, and nothing about when or why anything is sent. `layout` holds identifiers, scales and ranges.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from typing import Any, Final

from vve_sumo.values import Frame
from vve_sumo.vehicle.dataspeed.layout import (
    ACCELERATION_STEP,
    ACCELERATIONS,
    BRAKE_COMMAND,
    BRAKE_INFO,
    BRAKE_REPORT,
    BRAKE_TORQUE_STEP,
    DRIVER_TORQUE_STEP,
    FULL_TRAVEL,
    GEAR_COMMAND,
    GEAR_REPORT,
    GYRO_STEP,
    OVER_GROUND_STEP,
    SPEED_STEP,
    STEERING_COMMAND,
    STEERING_REPORT,
    TENTH_DEGREE,
    THROTTLE_COMMAND,
    THROTTLE_REPORT,
    TORQUE_LIMIT,
    TORQUE_MODE_STEP,
    WHEEL_ANGLE_LIMIT,
    WHEEL_RATE_LIMIT,
    WHEEL_RATE_STEP,
    WHEEL_SPEED_STEP,
    WHEEL_SPEEDS,
    YAW_RATE,
    Variant,
    counts,
    signed,
    value_of,
)
from vve_sumo.vehicle.dataspeed.messages import (
    BrakeCommand,
    BrakeInfo,
    BrakeKind,
    BrakeReport,
    BrakeReportKind,
    GearCommand,
    GearReject,
    GearReport,
    Message,
    ParkingBrake,
    SteeringCommand,
    SteeringReport,
    ThrottleCommand,
    ThrottleKind,
    ThrottleReport,
    WatchdogSource,
)
from vve_sumo.vehicle.interface import Accelerations, Gear, Malformed, WheelSpeeds, YawRate

_EN, _CLEAR, _IGNORE = 1, 2, 4  # bits of every command's flag byte; _IGNORE is only ever looked for, never set

_PEDAL_COMMAND = struct.Struct("<HBBxxxB")
_PEDAL_REPORT = struct.Struct("<HHHBB")
_STEERING_COMMAND = struct.Struct("<hBBxxxB")
_STEERING_REPORT = struct.Struct("<hHhbB")
_STEERING_REPORT_2018 = struct.Struct("<hhHbB")
_FOUR_WORDS = struct.Struct("<hhhh")
_THREE_WORDS = struct.Struct("<hhh")
_TWO_WORDS = struct.Struct("<hh")
_BRAKE_INFO = struct.Struct("<HHHH")


#: (smallest, largest, counts per unit) of every kind of pedal command; a torque is limited by its variant.
_BRAKE_SCALE = {
    BrakeKind.NONE: (0.0, 0.0, 1.0),
    BrakeKind.PEDAL: (0.15, 0.50, FULL_TRAVEL),
    BrakeKind.PERCENT: (0.0, 1.0, FULL_TRAVEL),
    BrakeKind.TORQUE: (0.0, math.inf, 1.0),
    BrakeKind.TORQUE_CLOSED_LOOP: (0.0, math.inf, 1.0),
    BrakeKind.DECELERATION: (0.0, 10.0, 1000.0),
}
_THROTTLE_SCALE = {
    ThrottleKind.NONE: (0.0, 0.0, 1.0),
    ThrottleKind.PEDAL: (0.15, 0.80, FULL_TRAVEL),
    ThrottleKind.PERCENT: (0.0, 1.0, FULL_TRAVEL),
}
_REPORT_STEPS = {
    BrakeReportKind.PEDAL: (1.0 / FULL_TRAVEL, 1.0 / FULL_TRAVEL),
    BrakeReportKind.DECELERATION: (1.0, 1e-3),
    BrakeReportKind.TORQUE: (1.0, 1.0),
}

_BRAKE_KINDS = {int(kind): kind for kind in BrakeKind}
_THROTTLE_KINDS = {int(kind): kind for kind in ThrottleKind}
# In Python 3.11 naming a member of an enumeration is a call; code that runs with every frame names these instead.
_OLD, _MODERN = Variant.DBW1_2018, Variant.DBW1_2024
_BY_TORQUE, _BY_PERCENT = BrakeKind.TORQUE << 4, ThrottleKind.PERCENT << 4  # second byte of a pedal's command
_REPORT_KINDS = {int(kind): kind for kind in BrakeReportKind}
_GEARS = {int(gear): gear for gear in Gear}
#: Every flag byte as eight booleans, lowest bit first.
_FLAGS = tuple(tuple(bool(byte >> bit & 1) for bit in range(8)) for byte in range(256))
_REJECTS = tuple(GearReject)
_PARKING_BRAKES = tuple(ParkingBrake)
_SOURCES = tuple(WatchdogSource)


def encode(message: Message, variant: Variant = Variant.DBW1_2024) -> Frame:
    """Return the frame of `message`.

    NaN in a report becomes the field's "invalid" pattern. Raises ValueError for NaN in a command, for a value outside
    its field's stated range (nothing is ever wrapped or clipped) and for a watchdog counter outside 0 to 255.
    """
    return _ENCODERS[type(message)](message, variant)


def decode(frame: Frame, variant: Variant = Variant.DBW1_2024) -> Message | Malformed | None:
    """Return the message in `frame`: None for an unknown identifier, `Malformed` for one without usable content."""
    known = _DECODERS.get(frame.id)
    if known is None:
        return None
    length, function = known
    data = frame.data
    if len(data) == length:
        message: Message | Malformed = function(data, variant)
        return message
    if len(data) == 4 and frame.id in _CLEAR_ALONE:
        command: BrakeCommand | ThrottleCommand | SteeringCommand | Malformed = function(data + bytes(4), variant)
        return command if isinstance(command, Malformed) else command._replace(counter=None)
    return Malformed(frame.id, "length")


def encode_commands(
    torque: float,
    throttle: float,
    wheel_angle: float,
    wheel_rate: float,
    enable: bool,
    clear: bool,
    counter: int,
    variant: Variant,
) -> tuple[Frame, Frame, Frame]:
    """Return the frames of a brake torque, a throttle in percent and a steering command, as `encode` gives each.

    In one go and without messages in between, because every step of the gateway sends them.
    """
    flags = (_EN if enable else 0) | (_CLEAR if clear else 0)
    brake = counts(torque, 0.0, TORQUE_LIMIT[variant], 1.0, "brake command")
    opening = counts(throttle, 0.0, 1.0, FULL_TRAVEL, "throttle command")
    angle, rate = _steering_counts(wheel_angle, wheel_rate, variant)
    return (
        Frame(BRAKE_COMMAND, _PEDAL_COMMAND.pack(brake, _BY_TORQUE, flags, counter)),
        Frame(THROTTLE_COMMAND, _PEDAL_COMMAND.pack(opening, _BY_PERCENT, flags, counter)),
        Frame(STEERING_COMMAND, _STEERING_COMMAND.pack(angle, flags, rate, counter)),
    )


def _flags(command: BrakeCommand | ThrottleCommand | SteeringCommand) -> int:
    counter = command.counter
    if counter is None:
        if command.enable or not command.clear:
            raise ValueError("a command without a counter can only be CLEAR alone")
    elif not 0 <= counter <= 255:
        raise ValueError(f"the watchdog counter must be 0 to 255, got {counter}")
    return (_EN if command.enable else 0) | (_CLEAR if command.clear else 0)


def _command_frame(identifier: int, layout: struct.Struct, first: int, a: int, b: int, counter: int | None) -> Frame:
    if counter is None:
        # With all eight bytes the DBW controller would see a counter that does not count, and its watchdog would brake.
        return Frame(identifier, layout.pack(first, a, b, 0)[:4])
    return Frame(identifier, layout.pack(first, a, b, counter))


def _encode_brake_command(command: BrakeCommand, variant: Variant) -> Frame:
    low, high, scale = _BRAKE_SCALE[command.kind]
    value = counts(command.value, low, min(high, TORQUE_LIMIT[variant]), scale, "brake command")
    return _command_frame(BRAKE_COMMAND, _PEDAL_COMMAND, value, command.kind << 4, _flags(command), command.counter)


def _encode_throttle_command(command: ThrottleCommand, _: Variant) -> Frame:
    value = counts(command.value, *_THROTTLE_SCALE[command.kind], "throttle command")
    return _command_frame(THROTTLE_COMMAND, _PEDAL_COMMAND, value, command.kind << 4, _flags(command), command.counter)


def _decode_brake_command(data: bytes, _: Variant) -> BrakeCommand | Malformed:
    value, kind_bits, flags, counter = _PEDAL_COMMAND.unpack(data)
    kind = _BRAKE_KINDS.get(kind_bits >> 4)
    if kind is None or flags & _IGNORE:
        return Malformed(BRAKE_COMMAND, "value" if kind is None else "ignore_bit")
    return BrakeCommand(kind, value / _BRAKE_SCALE[kind][2], bool(flags & _EN), counter, bool(flags & _CLEAR))


def _decode_throttle_command(data: bytes, _: Variant) -> ThrottleCommand | Malformed:
    value, kind_bits, flags, counter = _PEDAL_COMMAND.unpack(data)
    kind = _THROTTLE_KINDS.get(kind_bits >> 4)
    if kind is None or flags & _IGNORE:
        return Malformed(THROTTLE_COMMAND, "value" if kind is None else "ignore_bit")
    return ThrottleCommand(kind, value / _THROTTLE_SCALE[kind][2], bool(flags & _EN), counter, bool(flags & _CLEAR))


def _encode_steering_command(command: SteeringCommand, variant: Variant) -> Frame:
    angle, rate = _steering_counts(command.wheel_angle, command.wheel_rate, variant)
    return _command_frame(STEERING_COMMAND, _STEERING_COMMAND, angle, _flags(command), rate, command.counter)


def _steering_counts(wheel_angle: float, wheel_rate: float, variant: Variant) -> tuple[int, int]:
    limit = WHEEL_ANGLE_LIMIT[variant]
    angle = counts(wheel_angle, -limit, limit, 1.0 / TENTH_DEGREE, "steering-wheel angle")
    if not 0.0 <= wheel_rate <= WHEEL_RATE_LIMIT[variant]:
        raise ValueError(f"steering-wheel rate must be 0 to {WHEEL_RATE_LIMIT[variant]:g}, got {wheel_rate:g}")
    # Rounded down, but never to zero: zero asks for the DBW controller's largest rate.
    rate = int(wheel_rate / WHEEL_RATE_STEP[variant] + 1e-9) or 1 if wheel_rate > 0.0 else 0
    return angle, rate


def _decode_steering_command(data: bytes, variant: Variant) -> SteeringCommand | Malformed:
    angle, flags, rate, counter = _STEERING_COMMAND.unpack(data)
    if flags & _IGNORE or flags & 0x80:
        return Malformed(STEERING_COMMAND, "ignore_bit" if flags & _IGNORE else "torque_mode")
    return SteeringCommand(
        angle * TENTH_DEGREE, rate * WHEEL_RATE_STEP[variant], bool(flags & _EN), counter, bool(flags & _CLEAR)
    )


def _encode_gear_command(command: GearCommand, _: Variant) -> Frame:
    return Frame(GEAR_COMMAND, bytes((command.gear | (0x80 if command.clear else 0),)))


def _decode_gear_command(data: bytes, _: Variant) -> GearCommand | Malformed:
    gear = _GEARS.get(data[0] & 7)
    return Malformed(GEAR_COMMAND, "value") if gear is None else GearCommand(gear, bool(data[0] & 0x80))


def _encode_brake_report(report: BrakeReport, variant: Variant) -> Frame:
    first, second = _REPORT_STEPS[report.kind]
    if variant is _MODERN:
        status = report.kind | report.lights << 2
    elif report.kind is BrakeReportKind.PEDAL:
        status = report.lights << 1
    else:
        raise ValueError("the 2018 variant reports brakes as pedal travel only")
    return Frame(
        BRAKE_REPORT,
        _PEDAL_REPORT.pack(
            counts(report.driver_input, 0.0, FULL_TRAVEL * first, 1.0 / first, "driver's brake"),
            counts(report.command, 0.0, FULL_TRAVEL * second, 1.0 / second, "reported brake command"),
            counts(report.output, 0.0, FULL_TRAVEL * second, 1.0 / second, "reported brake output"),
            status | report.watchdog_braking << 3 | report.watchdog_source << 4,
            _pedal_flags(report),
        ),
    )


def _decode_brake_report(data: bytes, variant: Variant) -> BrakeReport | Malformed:
    driver_input, command, output, status, flags = _PEDAL_REPORT.unpack(data)
    modern = variant is _MODERN
    kind = _REPORT_KINDS.get(status & 3) if modern else BrakeReportKind.PEDAL
    if kind is None:
        return Malformed(BRAKE_REPORT, "value")
    first, second = _REPORT_STEPS[kind]
    enabled, override, driver, fault_watchdog, fault_channel_1, fault_channel_2, fault_power, timeout = _FLAGS[flags]
    return BrakeReport(
        kind,
        driver_input * first,
        command * second,
        output * second,
        enabled,
        bool(status & (4 if modern else 2)),
        override,
        driver,
        timeout,
        bool(status & 8),
        _SOURCES[status >> 4],
        fault_watchdog,
        fault_channel_1,
        fault_channel_2,
        fault_power,
    )


def _pedal_flags(report: BrakeReport | ThrottleReport) -> int:
    return (
        report.enabled
        | report.override << 1
        | report.driver << 2
        | report.fault_watchdog << 3
        | report.fault_channel_1 << 4
        | report.fault_channel_2 << 5
        | report.fault_power << 6
        | report.timeout << 7
    )


def _encode_throttle_report(report: ThrottleReport, _: Variant) -> Frame:
    return Frame(
        THROTTLE_REPORT,
        _PEDAL_REPORT.pack(
            counts(report.driver_input, 0.0, 1.0, FULL_TRAVEL, "driver's throttle"),
            counts(report.command, 0.0, 1.0, FULL_TRAVEL, "reported throttle command"),
            counts(report.output, 0.0, 1.0, FULL_TRAVEL, "reported throttle output"),
            report.watchdog_source << 4,
            _pedal_flags(report),
        ),
    )


def _decode_throttle_report(data: bytes, _: Variant) -> ThrottleReport:
    driver_input, command, output, status, flags = _PEDAL_REPORT.unpack(data)
    enabled, override, driver, fault_watchdog, fault_channel_1, fault_channel_2, fault_power, timeout = _FLAGS[flags]
    return ThrottleReport(
        driver_input / FULL_TRAVEL,
        command / FULL_TRAVEL,
        output / FULL_TRAVEL,
        enabled,
        override,
        driver,
        timeout,
        _SOURCES[status >> 4],
        fault_watchdog,
        fault_channel_1,
        fault_channel_2,
        fault_power,
    )


def _encode_steering_report(report: SteeringReport, variant: Variant) -> Frame:
    angle = signed(report.wheel_angle, TENTH_DEGREE, "reported steering-wheel angle")
    torque = signed(report.torque, DRIVER_TORQUE_STEP, "driver's steering torque", 127.5)
    flags = (
        report.enabled
        | report.override << 1
        | report.fault_power << 2
        | report.fault_watchdog << 3
        | report.fault_bus_1 << 4
        | report.fault_bus_2 << 5
        | report.fault_calibration << 6
        | report.timeout << 7
    )
    if variant is _OLD:
        command = signed(report.command, TENTH_DEGREE, "reported steering command")
        speed = counts(report.speed, 0.0, 65535 * SPEED_STEP, 1.0 / SPEED_STEP, "reported speed")
        return Frame(STEERING_REPORT, _STEERING_REPORT_2018.pack(angle, command, speed, torque, flags))
    step = TORQUE_MODE_STEP if report.torque_mode else TENTH_DEGREE
    command = signed(report.command, step, "reported steering command", 16383.5) & 0x7FFF | report.torque_mode << 15
    speed = signed(report.speed, SPEED_STEP, "reported speed")
    return Frame(STEERING_REPORT, _STEERING_REPORT.pack(angle, command, speed, torque, flags))


def _decode_steering_report(data: bytes, variant: Variant) -> SteeringReport:
    if variant is _OLD:
        angle, command, speed, torque, flags = _STEERING_REPORT_2018.unpack(data)
        command_value, speed_value, torque_mode = value_of(command, TENTH_DEGREE), speed * SPEED_STEP, False
    else:
        angle, word, speed, torque, flags = _STEERING_REPORT.unpack(data)
        torque_mode = bool(word & 0x8000)
        step = TORQUE_MODE_STEP if torque_mode else TENTH_DEGREE
        command_value = value_of(((word & 0x7FFF) ^ 0x4000) - 0x4000, step, -16384)
        speed_value = value_of(speed, SPEED_STEP)
    enabled, override, fault_power, fault_watchdog, fault_bus_1, fault_bus_2, fault_calibration, timeout = _FLAGS[flags]
    return SteeringReport(
        value_of(angle, TENTH_DEGREE),
        command_value,
        speed_value,
        value_of(torque, DRIVER_TORQUE_STEP, -128),
        enabled,
        override,
        timeout,
        torque_mode,
        fault_watchdog,
        fault_bus_1,
        fault_bus_2,
        fault_calibration,
        fault_power,
    )


def _encode_gear_report(report: GearReport, _: Variant) -> Frame:
    first = report.gear | report.override << 3 | report.command << 4 | report.fault_bus << 7
    return Frame(GEAR_REPORT, bytes((first, report.reject)))


def _decode_gear_report(data: bytes, _: Variant) -> GearReport | Malformed:
    gear, command = _GEARS.get(data[0] & 7), _GEARS.get(data[0] >> 4 & 7)
    if gear is None or command is None:
        return Malformed(GEAR_REPORT, "value")
    return GearReport(gear, command, bool(data[0] & 0x08), bool(data[0] & 0x80), _REJECTS[data[1] & 7])


def _encode_wheel_speeds(report: WheelSpeeds, _: Variant) -> Frame:
    front_left, front_right, rear_left, rear_right = report
    return Frame(
        WHEEL_SPEEDS,
        _FOUR_WORDS.pack(
            signed(front_left, WHEEL_SPEED_STEP, "wheel speed"),
            signed(front_right, WHEEL_SPEED_STEP, "wheel speed"),
            signed(rear_left, WHEEL_SPEED_STEP, "wheel speed"),
            signed(rear_right, WHEEL_SPEED_STEP, "wheel speed"),
        ),
    )


def _decode_wheel_speeds(data: bytes, _: Variant) -> WheelSpeeds:
    a, b, c, d = _FOUR_WORDS.unpack(data)
    step = WHEEL_SPEED_STEP
    return WheelSpeeds(value_of(a, step), value_of(b, step), value_of(c, step), value_of(d, step))


def _encode_accelerations(report: Accelerations, _: Variant) -> Frame:
    # On the wire lateral comes first, and lateral and vertical have the opposite sense to ISO 8855.
    return Frame(
        ACCELERATIONS,
        _THREE_WORDS.pack(
            signed(-report.lateral, ACCELERATION_STEP, "lateral acceleration"),
            signed(report.longitudinal, ACCELERATION_STEP, "longitudinal acceleration"),
            signed(-report.vertical, ACCELERATION_STEP, "vertical acceleration"),
        ),
    )


def _decode_accelerations(data: bytes, _: Variant) -> Accelerations:
    lateral, longitudinal, vertical = _THREE_WORDS.unpack(data)
    step = ACCELERATION_STEP
    return Accelerations(value_of(longitudinal, step), value_of(lateral, -step), value_of(vertical, -step))


def _encode_yaw_rate(report: YawRate, _: Variant) -> Frame:
    return Frame(
        YAW_RATE,
        _TWO_WORDS.pack(signed(report.roll, GYRO_STEP, "roll rate"), signed(report.yaw, GYRO_STEP, "yaw rate")),
    )


def _decode_yaw_rate(data: bytes, _: Variant) -> YawRate:
    roll, yaw = _TWO_WORDS.unpack(data)
    return YawRate(value_of(roll, GYRO_STEP), value_of(yaw, GYRO_STEP))


def _torque_counts(torque: float) -> int:
    if torque != torque:
        return 0xFFF
    return counts(torque, 0.0, 0xFFE * BRAKE_TORQUE_STEP, 1.0 / BRAKE_TORQUE_STEP, "reported brake torque")


def _encode_brake_info(report: BrakeInfo, _: Variant) -> Frame:
    over_ground = signed(report.acceleration_over_ground, OVER_GROUND_STEP, "acceleration over ground", 511.5)
    activity = report.abs_active << 10 | report.stability_active << 12 | report.traction_active << 14
    return Frame(
        BRAKE_INFO,
        _BRAKE_INFO.pack(
            _torque_counts(report.torque_requested) | report.stationary << 15,
            _torque_counts(report.torque_actual) | report.parking_brake << 14,
            0,
            over_ground & 0x3FF | activity,
        ),
    )


def _decode_brake_info(data: bytes, _: Variant) -> BrakeInfo:
    requested, actual, _torque, tail = _BRAKE_INFO.unpack(data)
    return BrakeInfo(
        value_of(requested & 0xFFF, BRAKE_TORQUE_STEP, 0xFFF),
        value_of(actual & 0xFFF, BRAKE_TORQUE_STEP, 0xFFF),
        bool(requested & 0x8000),
        _PARKING_BRAKES[actual >> 14],
        value_of(((tail & 0x3FF) ^ 0x200) - 0x200, OVER_GROUND_STEP, -512),
        bool(tail & 0x400),
        bool(tail & 0x1000),
        bool(tail & 0x4000),
    )


_ENCODERS: Final[dict[type, Callable[[Any, Variant], Frame]]] = {
    BrakeCommand: _encode_brake_command,
    ThrottleCommand: _encode_throttle_command,
    SteeringCommand: _encode_steering_command,
    GearCommand: _encode_gear_command,
    BrakeReport: _encode_brake_report,
    ThrottleReport: _encode_throttle_report,
    SteeringReport: _encode_steering_report,
    GearReport: _encode_gear_report,
    WheelSpeeds: _encode_wheel_speeds,
    Accelerations: _encode_accelerations,
    YawRate: _encode_yaw_rate,
    BrakeInfo: _encode_brake_info,
}

#: Identifier to (length of its data, decoder).
_DECODERS: Final[dict[int, tuple[int, Callable[[bytes, Variant], Any]]]] = {
    BRAKE_COMMAND: (8, _decode_brake_command),
    THROTTLE_COMMAND: (8, _decode_throttle_command),
    STEERING_COMMAND: (8, _decode_steering_command),
    GEAR_COMMAND: (1, _decode_gear_command),
    BRAKE_REPORT: (8, _decode_brake_report),
    THROTTLE_REPORT: (8, _decode_throttle_report),
    STEERING_REPORT: (8, _decode_steering_report),
    GEAR_REPORT: (2, _decode_gear_report),
    WHEEL_SPEEDS: (8, _decode_wheel_speeds),
    ACCELERATIONS: (6, _decode_accelerations),
    YAW_RATE: (4, _decode_yaw_rate),
    BRAKE_INFO: (8, _decode_brake_info),
}
_CLEAR_ALONE = frozenset({BRAKE_COMMAND, THROTTLE_COMMAND, STEERING_COMMAND})
