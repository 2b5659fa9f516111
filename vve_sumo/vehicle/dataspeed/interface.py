"""A Dataspeed DBW1 drive-by-wire controller as a `VehicleInterface`: four command frames a step, and its reports.

The counter in the frames counts once a step, so the controller's own watchdog, where armed, brakes when encoding stops.
The bit that takes the driver's override away cannot be set.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final

from vve_sumo.errors import ConfigError
from vve_sumo.values import Frame
from vve_sumo.vehicle.dataspeed import codec, layout
from vve_sumo.vehicle.dataspeed.controller import TIMEOUT, DbwController, DbwControllerParameters
from vve_sumo.vehicle.dataspeed.messages import (
    BrakeCommand,
    BrakeInfo,
    BrakeKind,
    BrakeReport,
    GearCommand,
    GearReport,
    SteeringCommand,
    SteeringReport,
    ThrottleCommand,
    ThrottleKind,
    ThrottleReport,
)
from vve_sumo.vehicle.dataspeed.simulated import SimulatedDbw1
from vve_sumo.vehicle.interface import (
    Accelerations,
    ActuationCommand,
    BrakeState,
    BrakeTorque,
    Commanded,
    Gear,
    GearState,
    InterfaceFacts,
    Malformed,
    Report,
    SettingValue,
    SteeringState,
    ThrottleState,
    WheelSpeeds,
    YawRate,
)

REPORTS: Final[dict[int, tuple[type, ...]]] = {
    layout.BRAKE_REPORT: (BrakeState,),
    layout.THROTTLE_REPORT: (ThrottleState,),
    layout.STEERING_REPORT: (SteeringState,),
    layout.GEAR_REPORT: (GearState,),
    layout.WHEEL_SPEEDS: (WheelSpeeds,),
    layout.YAW_RATE: (YawRate,),
    layout.ACCELERATIONS: (Accelerations,),
    layout.BRAKE_INFO: (BrakeTorque,),
}

#: Only the last two bytes of a brake or throttle report hold the state; the others are pedal positions and torques.
_PEDALS: Final = frozenset({layout.BRAKE_REPORT, layout.THROTTLE_REPORT})
PEDAL_REPORT_LENGTH: Final = 8
STATUS_OF_PEDAL: Final = slice(6, 8)

WHEN_COMMANDS_STOP: Final = (
    "lets go of pedals and steering; where its watchdog is armed it brakes until the driver takes over"
)


class DataspeedDbw1:
    """The interface of one firmware generation."""

    def __init__(self, variant: layout.Variant = layout.Variant.DBW1_2024) -> None:
        self._variant = variant
        self._facts = InterfaceFacts(
            title=f"Dataspeed DBW1 ({variant.name.lower()})",
            commands=layout.COMMAND_IDS,
            reports=REPORTS,
            occupied=frozenset(range(0x060, 0x080)),
            brake_torque_limit=layout.TORQUE_LIMIT[variant],
            wheel_angle_limit=layout.WHEEL_ANGLE_LIMIT[variant],
            wheel_rate_limit=layout.WHEEL_RATE_LIMIT[variant],
            command_timeout=TIMEOUT,
            when_commands_stop=WHEN_COMMANDS_STOP,
            dbc=Path(__file__).with_name("dbw1.dbc"),
        )
        self._counter = -1
        # A gear command has no counter, so all possible frames are encoded in advance.
        self._gear_frames = {
            (gear, clear): codec.encode(GearCommand(gear, clear), variant) for gear in Gear for clear in (False, True)
        }
        # Identifier to the last decoded frame, as bytes and as reports. Most reports repeat themselves.
        self._understood: dict[int, tuple[bytes, tuple[Report, ...]]] = {}

    @property
    def facts(self) -> InterfaceFacts:
        """Return identifiers, wire ranges and time-outs."""
        return self._facts

    def encode(self, command: ActuationCommand) -> tuple[Frame, ...]:
        """Return the brake, throttle, steering and gear frames; the first three have the same counter."""
        torque, throttle, wheel_angle, wheel_rate, gear, enable, clear = command
        variant = self._variant
        counter = self._counter = (self._counter + 1) & 0xFF
        return (
            codec.encode(BrakeCommand(BrakeKind.TORQUE, torque, enable, counter, clear), variant),
            codec.encode(ThrottleCommand(ThrottleKind.PERCENT, throttle, enable, counter, clear), variant),
            codec.encode(SteeringCommand(wheel_angle, wheel_rate, enable, counter, clear), variant),
            self._gear_frames[gear, clear],
        )

    def decode(self, frame: Frame) -> tuple[Report, ...] | Malformed:
        """Return what a frame reports; a repeated content gives the same reports without decoding."""
        number, said = frame
        if number in _PEDALS:
            # A report of another length is damaged; empty bytes are equal to no decoded report.
            said = said[STATUS_OF_PEDAL] if len(said) == PEDAL_REPORT_LENGTH else b""
        before = self._understood.get(number)
        if before is not None and before[0] == said:
            return before[1]
        if number not in REPORTS:
            return ()
        message: Any = codec.decode(frame, self._variant)
        if type(message) is Malformed:
            return message
        convert = _NEUTRAL.get(type(message))
        reports = (message if convert is None else convert(message),)
        self._understood[number] = said, reports
        return reports

    def commanded(self, frame: Frame) -> Commanded | None:
        """Return a brake torque, throttle opening or steering command in the gateway's units; None for other frames."""
        match codec.decode(frame, self._variant):
            case BrakeCommand(kind=BrakeKind.TORQUE, value=torque):
                return Commanded(torque, math.nan, math.nan)
            case ThrottleCommand(kind=ThrottleKind.PERCENT, value=throttle):
                return Commanded(math.nan, throttle, math.nan)
            case SteeringCommand(wheel_angle=angle):
                return Commanded(math.nan, math.nan, angle)
            case _:
                return None

    def simulated(self, duration: float) -> SimulatedDbw1:
        """Return a simulated controller of the same generation, with its watchdog."""
        return SimulatedDbw1(DbwController(DbwControllerParameters(variant=self._variant), duration))


def make(settings: Mapping[str, SettingValue]) -> DataspeedDbw1:
    """Make the interface; its one setting is `variant`, the firmware's generation, to be verified on the car."""
    names = {variant.name.lower(): variant for variant in layout.Variant}
    if unknown := sorted(settings.keys() - {"variant"}):
        raise ConfigError(f"setting {unknown[0]!r} is unknown; allowed is 'variant'")
    said = settings.get("variant")
    if said not in names:
        raise ConfigError(f"setting 'variant' must be {' or '.join(names)}, to be verified on the car; got {said!r}")
    return DataspeedDbw1(names[str(said)])


def _throttle(report: BrakeReport | ThrottleReport) -> ThrottleState:
    return ThrottleState(
        report.enabled,
        report.override,
        report.driver,
        report.timeout,
        report.fault_channel_1 or report.fault_channel_2 or report.fault_power,
        report.fault_watchdog,
    )


def _brake(report: BrakeReport) -> BrakeState:
    return BrakeState(*_throttle(report), watchdog_braking=report.watchdog_braking)


def _steering(report: SteeringReport) -> SteeringState:
    return SteeringState(
        report.wheel_angle,
        report.enabled,
        report.override,
        report.timeout,
        report.fault_bus_1 or report.fault_bus_2 or report.fault_calibration or report.fault_power,
        report.fault_watchdog,
    )


def _gear(report: GearReport) -> GearState:
    return GearState(report.gear, report.override, report.fault_bus)


def _brake_torque(report: BrakeInfo) -> BrakeTorque:
    return BrakeTorque(report.torque_actual)


#: How a message becomes a report; wheel speeds, yaw rate and accelerations are reports already.
_NEUTRAL: Final[Mapping[type, Callable[[Any], Report]]] = {
    BrakeReport: _brake,
    ThrottleReport: _throttle,
    SteeringReport: _steering,
    GearReport: _gear,
    BrakeInfo: _brake_torque,
}
