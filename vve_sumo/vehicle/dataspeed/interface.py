"""A Dataspeed DBW1 drive-by-wire controller as a `VehicleInterface`: four command frames a step, and its reports.

The counter in the frames counts once a step, so the controller's own watchdog, where armed, brakes when encoding stops.
The bit that takes the driver's override away cannot be set.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any, Final

from vve_sumo.errors import ConfigError
from vve_sumo.values import Frame
from vve_sumo.vehicle.dataspeed import codec, layout
from vve_sumo.vehicle.dataspeed.controller import TIMEOUT, DbwController, DbwControllerParameters
from vve_sumo.vehicle.dataspeed.messages import (
    BrakeCommand,
    BrakeKind,
    GearCommand,
    SteeringCommand,
    ThrottleCommand,
    ThrottleKind,
)
from vve_sumo.vehicle.dataspeed.signals import READINGS
from vve_sumo.vehicle.dataspeed.simulated import SimulatedDbw1
from vve_sumo.vehicle.interface import (
    Accelerations,
    ActuationCommand,
    BrakeState,
    BrakeTorque,
    Commanded,
    CommandsStop,
    Gear,
    GearState,
    InterfaceFacts,
    Malformed,
    Report,
    SettingValue,
    SteeringState,
    ThrottleState,
    WheelSpeeds,
    WhenCommandsStop,
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

# How hard the watchdog brakes is not public: each car's own test says it.
WHEN_COMMANDS_STOP: Final = CommandsStop(
    WhenCommandsStop.BRAKES,
    "lets go of pedals and steering; where its watchdog is armed it brakes until the driver takes over",
)


def _encoders(variant: layout.Variant) -> tuple[Callable[[Any], Frame], ...]:
    return (
        codec.encoder(BrakeCommand, variant, BrakeKind.TORQUE.name),
        codec.encoder(ThrottleCommand, variant, ThrottleKind.PERCENT.name),
        codec.encoder(SteeringCommand, variant),
    )


#: Counts and reports of a frame that was not read before.
_NOTHING: Final[tuple[None, tuple[Report, ...]]] = (None, ())

#: What encodes brake torque, throttle opening and steering, as tuples of their fields without the kind.
_ENCODERS: Final = layout.OfVariant(_encoders)


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
            dbc=layout.DBC,
        )
        self._counter = -1
        # A gear command has no counter, so all possible frames are encoded in advance.
        self._gear_frames = {
            (gear, clear): codec.encode(GearCommand(gear, clear), variant) for gear in Gear for clear in (False, True)
        }
        # Identifier to the last counts that were read, and to their reports. Most reports repeat themselves.
        self._understood: dict[int, tuple[tuple[int, ...], tuple[Report, ...]]] = {}

    @property
    def facts(self) -> InterfaceFacts:
        """Return identifiers, wire ranges and time-outs."""
        return self._facts

    def encode(self, command: ActuationCommand) -> tuple[Frame, ...]:
        """Return the brake, throttle, steering and gear frames; the first three have the same counter."""
        torque, throttle, wheel_angle, wheel_rate, gear, enable, clear, _acceleration = command
        counter = self._counter = (self._counter + 1) & 0xFF
        encode_brake, encode_throttle, encode_steering = _ENCODERS[self._variant]
        return (
            encode_brake((torque, enable, counter, clear)),
            encode_throttle((throttle, enable, counter, clear)),
            encode_steering((wheel_angle, wheel_rate, enable, counter, clear)),
            self._gear_frames[gear, clear],
        )

    def decode(self, frame: Frame) -> tuple[Report, ...] | Malformed:
        """Return what a frame reports; repeated signals give the same reports again."""
        number, data = frame
        reading = READINGS[self._variant].get(number)
        if reading is None:
            return ()
        signals, interpret = reading
        if len(data) != signals.size:
            return Malformed(number, "length")
        counts = signals.unpack(data)
        before, reports = self._understood.get(number, _NOTHING)
        if before == counts:
            return reports
        report = interpret(*counts)
        if isinstance(report, Malformed):
            return report
        reports = (report,)
        self._understood[number] = counts, reports
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
    firmware = settings.get("variant")
    if firmware not in names:
        raise ConfigError(
            f"setting 'variant' must be {' or '.join(names)}, to be verified on the car; got {firmware!r}"
        )
    return DataspeedDbw1(names[str(firmware)])
