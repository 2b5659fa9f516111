"""Layout of a Dataspeed DBW1 controller's frames: its messages by the DBC files, identifiers, and limits of commands.

`dbw1.dbc` is the one definition of bits, scales, ranges and names; `dbw1_2018.dbc` holds the messages that the older
firmware has otherwise.
"""

from __future__ import annotations

import enum
from collections.abc import Callable
from pathlib import Path
from typing import Final, TypeVar

from vve_sumo import dbc
from vve_sumo.vehicle.frame_codec import maximum_of

T = TypeVar("T")

#: Layout and scales of the newer firmware after Dataspeed's BSD-3 sources `dbw_ford_can` 2.1.16 (2024; repository
#: revyos-ros/dbw_ros-release, dispatch.hpp, DbwNode.cpp), and of the older one after `dbw_mkz_can` (2018; repository
#: yinzixuan126/dbw_mkz_ros, dispatch.h, DbwNode.cpp).
DBC: Final = Path(__file__).with_name("dbw1.dbc")


class Variant(enum.IntEnum):  # whole numbers are hashed quickly, and each command looks up its variant's limits
    """Generation of the firmware; the two disagree on a few fields, so a rig must verify which one it has."""

    DBW1_2018 = enum.auto()
    #: The default: if it is wrong for the car, the steering moves at half the commanded rate, not at twice the rate.
    DBW1_2024 = enum.auto()


class OfVariant(dict[Variant, T]):
    """What belongs to each generation, made when it is first asked for: a car has one of them."""

    def __init__(self, make: Callable[[Variant], T]) -> None:
        self._make = make

    def __missing__(self, variant: Variant) -> T:
        made = self[variant] = self._make(variant)
        return made


_NEWER: Final = dbc.read(DBC)

#: Messages of a generation by name.
MESSAGES: Final = {
    Variant.DBW1_2018: _NEWER | dbc.read(DBC.with_name("dbw1_2018.dbc")),
    Variant.DBW1_2024: _NEWER,
}


def _limits(message: str, signal: str) -> dict[Variant, float]:
    return {variant: maximum_of(messages[message].signals[signal]) for variant, messages in MESSAGES.items()}


BRAKE_COMMAND: Final = _NEWER["BrakeCommand"].id
BRAKE_REPORT: Final = _NEWER["BrakeReport"].id
THROTTLE_COMMAND: Final = _NEWER["ThrottleCommand"].id
THROTTLE_REPORT: Final = _NEWER["ThrottleReport"].id
STEERING_COMMAND: Final = _NEWER["SteeringCommand"].id
STEERING_REPORT: Final = _NEWER["SteeringReport"].id
GEAR_COMMAND: Final = _NEWER["GearCommand"].id
GEAR_REPORT: Final = _NEWER["GearReport"].id
MISC_COMMAND: Final = _NEWER["MiscCommand"].id
WHEEL_SPEEDS: Final = _NEWER["WheelSpeeds"].id
ACCELERATIONS: Final = _NEWER["Accelerations"].id
YAW_RATE: Final = _NEWER["YawRate"].id
BRAKE_INFO: Final = _NEWER["BrakeInfo"].id

#: Identifiers that only one node may send; hearing one of them from another node is a fault.
COMMAND_IDS: Final = frozenset({BRAKE_COMMAND, THROTTLE_COMMAND, STEERING_COMMAND, GEAR_COMMAND, MISC_COMMAND})

# Largest values that the two generations state (BrakeCmd.msg, SteeringCmd.msg): [N m], [rad], [rad/s].
TORQUE_LIMIT: Final = _limits("BrakeCommand", "PCMD_TORQUE")
WHEEL_ANGLE_LIMIT: Final = _limits("SteeringCommand", "SCMD")
WHEEL_RATE_LIMIT: Final = _limits("SteeringCommand", "SVEL")
