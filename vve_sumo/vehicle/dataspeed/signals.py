"""Reads from a report frame only the signals that the port's reports hold, without those around them.

`codec.decode` reads whole messages; here is what the gateway reads of ten frames a tick. The layout is the same.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Mapping
from typing import Final, NamedTuple

from vve_sumo.vehicle.dataspeed import layout
from vve_sumo.vehicle.dataspeed.layout import FULL_TRAVEL, value_of
from vve_sumo.vehicle.dataspeed.pedals import pedal_to_throttle, pedal_to_torque
from vve_sumo.vehicle.interface import (
    Accelerations,
    BrakeState,
    BrakeTorque,
    Gear,
    GearState,
    Malformed,
    Report,
    SteeringState,
    ThrottleState,
    WheelSpeeds,
    YawRate,
)

# Bits of the last byte of a module's report, and of the byte before it in a brake report.
_ENABLED, _OVERRIDE, _DRIVER, _WATCHDOG, _TIMEOUT = 0x01, 0x02, 0x04, 0x08, 0x80
_PEDAL_FAULTS = 0x70  # either channel of the pedal sensor, the supply
_STEERING_FAULTS = 0x74  # either bus, the calibration, the supply
# Kind of the values in a brake report of the newer generation.
_KIND, _BY_PEDAL, _BY_TORQUE, _NO_KIND = 0x03, 0x00, 0x02, 0x03
_WATCHDOG_BRAKING = 0x08
_INVALID = -32768  # of wheel speeds and yaw rates, which are read as `value_of` reads, without its call

_GEARS: Final = {int(gear): gear for gear in Gear}


class Reading(NamedTuple):
    """How a report frame is read."""

    signals: struct.Struct  #: those that are read, in a frame of this length
    understand: Callable[..., Report | Malformed]  #: from them to the report


def _brake_2018(driver: int, command: int, status: int, flags: int) -> BrakeState:
    return BrakeState(
        flags & _ENABLED != 0,
        flags & _OVERRIDE != 0,
        flags & _DRIVER != 0,
        flags & _TIMEOUT != 0,
        flags & _PEDAL_FAULTS != 0,
        flags & _WATCHDOG != 0,
        status & _WATCHDOG_BRAKING != 0,
        pedal_to_torque(driver / FULL_TRAVEL),
        pedal_to_torque(command / FULL_TRAVEL),
    )


def _brake_2024(driver: int, command: int, status: int, flags: int) -> BrakeState | Malformed:
    kind = status & _KIND
    if kind == _BY_PEDAL:
        return _brake_2018(driver, command, status, flags)
    if kind == _NO_KIND:
        return Malformed(layout.BRAKE_REPORT, "value")
    return BrakeState(
        flags & _ENABLED != 0,
        flags & _OVERRIDE != 0,
        flags & _DRIVER != 0,
        flags & _TIMEOUT != 0,
        flags & _PEDAL_FAULTS != 0,
        flags & _WATCHDOG != 0,
        status & _WATCHDOG_BRAKING != 0,
        float(driver),  # in steps of 1 N m, by torque and by deceleration alike
        float(command) if kind == _BY_TORQUE else math.nan,
    )


def _throttle(driver: int, command: int, flags: int) -> ThrottleState:
    return ThrottleState(
        flags & _ENABLED != 0,
        flags & _OVERRIDE != 0,
        flags & _DRIVER != 0,
        flags & _TIMEOUT != 0,
        flags & _PEDAL_FAULTS != 0,
        flags & _WATCHDOG != 0,
        pedal_to_throttle(driver / FULL_TRAVEL),
        pedal_to_throttle(command / FULL_TRAVEL),
    )


def _steering(angle: int, torque: int, flags: int) -> SteeringState:
    return SteeringState(
        value_of(angle, layout.TENTH_DEGREE),
        flags & _ENABLED != 0,
        flags & _OVERRIDE != 0,
        flags & _TIMEOUT != 0,
        flags & _STEERING_FAULTS != 0,
        flags & _WATCHDOG != 0,
        value_of(torque, layout.DRIVER_TORQUE_STEP, -128),
    )


def _gear(first: int) -> GearState | Malformed:
    gear, command = _GEARS.get(first & 7), _GEARS.get(first >> 4 & 7)
    if gear is None or command is None:
        return Malformed(layout.GEAR_REPORT, "value")
    return GearState(gear, first & 0x08 != 0, first & 0x80 != 0)


def _wheel_speeds(front_left: int, front_right: int, rear_left: int, rear_right: int) -> WheelSpeeds:
    step = layout.WHEEL_SPEED_STEP
    return WheelSpeeds(
        front_left * step if front_left != _INVALID else math.nan,
        front_right * step if front_right != _INVALID else math.nan,
        rear_left * step if rear_left != _INVALID else math.nan,
        rear_right * step if rear_right != _INVALID else math.nan,
    )


def _yaw_rate(roll: int, yaw: int) -> YawRate:
    step = layout.GYRO_STEP
    return YawRate(roll * step if roll != _INVALID else math.nan, yaw * step if yaw != _INVALID else math.nan)


def _accelerations(lateral: int, longitudinal: int, vertical: int) -> Accelerations:
    step = layout.ACCELERATION_STEP
    return Accelerations(value_of(longitudinal, step), value_of(lateral, -step), value_of(vertical, -step))


def _brake_torque(actual: int) -> BrakeTorque:
    return BrakeTorque(value_of(actual & 0xFFF, layout.BRAKE_TORQUE_STEP, 0xFFF))


_SHARED: Final = {
    layout.THROTTLE_REPORT: Reading(struct.Struct("<HH3xB"), _throttle),
    layout.STEERING_REPORT: Reading(struct.Struct("<h4xbB"), _steering),
    layout.GEAR_REPORT: Reading(struct.Struct("<Bx"), _gear),
    layout.WHEEL_SPEEDS: Reading(struct.Struct("<hhhh"), _wheel_speeds),
    layout.YAW_RATE: Reading(struct.Struct("<hh"), _yaw_rate),
    layout.ACCELERATIONS: Reading(struct.Struct("<hhh"), _accelerations),
    layout.BRAKE_INFO: Reading(struct.Struct("<2xH4x"), _brake_torque),
}
_BRAKE: Final = struct.Struct("<HH2xBB")

#: How a firmware generation's report frames are read, by identifier.
READINGS: Final[Mapping[layout.Variant, Mapping[int, Reading]]] = {
    layout.Variant.DBW1_2018: _SHARED | {layout.BRAKE_REPORT: Reading(_BRAKE, _brake_2018)},
    layout.Variant.DBW1_2024: _SHARED | {layout.BRAKE_REPORT: Reading(_BRAKE, _brake_2024)},
}
