"""Reads from a report frame only the signals that the port's reports hold, without those around them.

`codec.decode` reads whole messages; here is what the gateway reads of ten frames a tick, by the same DBC files.
"""

from __future__ import annotations

import math
from typing import Any, Final

from vve_sumo.vehicle.dataspeed.layout import MESSAGES, OfVariant, Variant
from vve_sumo.vehicle.dataspeed.pedals import pedal_to_throttle, pedal_to_torque
from vve_sumo.vehicle.frame_codec import FrameReading, reading
from vve_sumo.vehicle.interface import (
    Accelerations,
    BrakeState,
    BrakeTorque,
    GearState,
    SteeringState,
    ThrottleState,
    WheelSpeeds,
    YawRate,
)


def _not_reported(_: float) -> float:
    return math.nan


# A brake report holds positions of the pedal, torques, or the driver's torque beside commanded decelerations.
_BRAKE: Final = {
    Variant.DBW1_2018: {"driver_torque": pedal_to_torque, "command": pedal_to_torque},
    Variant.DBW1_2024: {
        "driver_torque": (pedal_to_torque, float, float),
        "command": (pedal_to_torque, _not_reported, float),
    },
}
_THROTTLE: Final = {"driver_opening": pedal_to_throttle, "command": pedal_to_throttle}


def _readings(variant: Variant) -> dict[int, FrameReading]:
    def of(name: str, made: type, signals: str, **options: Any) -> tuple[int, FrameReading]:
        message = MESSAGES[variant][name]
        return message.id, reading(message, made, signals, **options)

    flags = "ENABLED OVERRIDE DRIVER TMOUT FLT1|FLT2|FLTPWR FLTWDC"
    steering = "ANGLE ENABLED OVERRIDE TMOUT FLTBUS1|FLTBUS2|FLTCAL|FLTPWR FLTWDC TORQUE"
    return dict(
        (
            of("BrakeReport", BrakeState, f"{flags} WDCBRK PI PC", converters=_BRAKE[variant]),
            of("ThrottleReport", ThrottleState, f"{flags} PI PC", converters=_THROTTLE),
            of("SteeringReport", SteeringState, steering),
            of("GearReport", GearState, "STATE OVERRIDE FLTBUS", named=["CMD"]),
            of("WheelSpeeds", WheelSpeeds, "FRONT_LEFT FRONT_RIGHT REAR_LEFT REAR_RIGHT"),
            of("YawRate", YawRate, "ROLL YAW"),
            of("Accelerations", Accelerations, "LONGITUDINAL LATERAL VERTICAL"),
            of("BrakeInfo", BrakeTorque, "TORQUE_ACTUAL"),
        )
    )


#: How a firmware generation's report frames are read, by identifier.
READINGS: Final = OfVariant(_readings)
