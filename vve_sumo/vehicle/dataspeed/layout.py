"""Layout of a Dataspeed DBW1 controller's frames: identifiers, scales and ranges, and numbers as counts.

It knows neither the messages nor their bytes. `dbw1.dbc` states the same layout.
"""

from __future__ import annotations

import enum
import math
from typing import Final

# Layout and scales: Dataspeed's BSD-3 sources `dbw_mkz_can` (2018; repository yinzixuan126/dbw_mkz_ros, dispatch.h,
# DbwNode.cpp) and `dbw_ford_can` 2.1.16 (2024; repository revyos-ros/dbw_ros-release, dispatch.hpp, DbwNode.cpp).
BRAKE_COMMAND: Final = 0x060
BRAKE_REPORT: Final = 0x061
THROTTLE_COMMAND: Final = 0x062
THROTTLE_REPORT: Final = 0x063
STEERING_COMMAND: Final = 0x064
STEERING_REPORT: Final = 0x065
GEAR_COMMAND: Final = 0x066
GEAR_REPORT: Final = 0x067
MISC_COMMAND: Final = 0x068
WHEEL_SPEEDS: Final = 0x06A
ACCELERATIONS: Final = 0x06B
YAW_RATE: Final = 0x06C
BRAKE_INFO: Final = 0x074

#: Identifiers that only one node may send; hearing one of them from another node is a fault.
COMMAND_IDS: Final = frozenset({BRAKE_COMMAND, THROTTLE_COMMAND, STEERING_COMMAND, GEAR_COMMAND, MISC_COMMAND})

FULL_TRAVEL = 65535.0  # counts of a pedal's whole travel, and of 100 percent
TENTH_DEGREE = math.radians(0.1)  # step of steering-wheel angles
SPEED_STEP = 0.01 / 3.6  # of the vehicle speed in the steering report [m/s]
DRIVER_TORQUE_STEP = 1.0 / 16.0  # [N m]
TORQUE_MODE_STEP = 1.0 / 128.0  # steering command in torque mode [N m]
WHEEL_SPEED_STEP = 0.01  # [rad/s]
ACCELERATION_STEP = 0.01  # [m/s2]
GYRO_STEP = 2e-4  # [rad/s]
BRAKE_TORQUE_STEP = 4.0  # in the brake info [N m]
OVER_GROUND_STEP = 0.035  # acceleration over ground in the brake info [m/s2]


class Variant(enum.IntEnum):  # whole numbers are hashed quickly, and each command looks up its variant's limits
    """Generation of the firmware; the two disagree on a few fields, so a rig must verify which one it has."""

    DBW1_2018 = enum.auto()
    #: The default: if it is wrong for the car, the steering moves at half the commanded rate, not at twice the rate.
    DBW1_2024 = enum.auto()


# Largest values that the two generations state (BrakeCmd.msg, SteeringCmd.msg): [N m], [rad], [rad/s].
TORQUE_LIMIT: Final = {Variant.DBW1_2018: 3250.0, Variant.DBW1_2024: 3412.0}
WHEEL_ANGLE_LIMIT: Final = {Variant.DBW1_2018: 8.2, Variant.DBW1_2024: 9.6}
WHEEL_RATE_LIMIT: Final = {Variant.DBW1_2018: 8.7, Variant.DBW1_2024: 17.5}
WHEEL_RATE_STEP: Final = {Variant.DBW1_2018: math.radians(2.0), Variant.DBW1_2024: math.radians(4.0)}


def counts(value: float, low: float, high: float, scale: float, what: str) -> int:
    """Counts of an unsigned field; raises ValueError for NaN and outside the range."""
    if not low <= value <= high:
        raise ValueError(f"{what} must be {low:g} to {high:g}, got {value:g}")
    return round(value * scale)


def signed(value: float, step: float, what: str, limit: float = 32767.5) -> int:
    """Counts of a signed report field whose lowest pattern means "invalid"; raises ValueError for what does not fit.

    The `limit` is half a count more than the largest: it would be rounded to one that the field cannot hold.
    """
    count = value / step
    if -limit < count < limit:
        return round(count)
    if value != value:
        return -round(limit + 0.5)
    raise ValueError(f"{what} must be within +-{(limit - 0.5) * step:g}, got {value:g}")


def value_of(count: int, step: float, invalid: int = -32768) -> float:
    """Value of a signed report field, NaN for "invalid"."""
    return math.nan if count == invalid else count * step
