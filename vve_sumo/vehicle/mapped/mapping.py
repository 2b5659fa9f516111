"""Schema of a mapping: which signals of a DBC file command a car, which report, and what its controller does by itself.

A signal is named `Message.SIGNAL`. The module does not read the DBC file; `binding` holds a mapping against it.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Final, Literal, Self

from pydantic import Field, ValidationError, model_validator

from vve_sumo.config_file import Finite, Name, Positive, Strength, Table, complaint, numbers_of, read
from vve_sumo.errors import ConfigError
from vve_sumo.vehicle.interface import Gear

#: `Message.SIGNAL`
SignalName = Annotated[str, Field(pattern=r"^\w+\.\w+$")]
#: of a report message; reports are due on whole hundredths of a second
ReportPeriod = Annotated[int, Field(ge=10, le=100, multiple_of=10)]
Byte = Annotated[int, Field(ge=0, le=255)]

STEERING_TORQUE: Final = (
    "a car whose steering takes a torque is refused: the gateway commands an angle, and the loop that turns angles "
    "into torques has to close inside the car, where it goes on when this computer does not"
)

SPEED: Final = (
    "a car that is commanded a speed is refused: the gateway's stops need a deceleration, and a limit on how fast a "
    "commanded speed falls does not make the car brake so hard; expected acceleration, or brake_torque and throttle"
)


class Flag(Table):
    """A yes or no by a signal that is more than one bit: the counts that mean yes, and the one that means no."""

    signal: SignalName
    yes: Annotated[tuple[int, ...], Field(strict=False, min_length=1)]
    no: int = 0


Condition = SignalName | Flag
Conditions = Annotated[tuple[Condition, ...], Field(strict=False)]


class Scaled(Table):
    """A number: its signal, what one unit of it is in SI units, and what says that it is valid.

    Without a scale the DBC file's unit says it; a negative one turns the sign.
    """

    signal: SignalName
    scale: Finite | None = None
    valid: Condition | None = None

    @model_validator(mode="after")
    def _not_zero(self) -> Self:
        if self.scale == 0.0:
            raise ValueError("expected a scale other than 0")
        return self


Quantity = SignalName | Scaled


class Gears(Table):
    """The selector: the count of each position; `none` requests nothing."""

    signal: SignalName
    park: int
    drive: int
    reverse: int | None = None
    neutral: int | None = None
    low: int | None = None
    none: int | None = None

    def counts(self) -> dict[Gear, int]:
        """Return the count of each gear that has one."""
        named = {gear: getattr(self, gear.name.lower()) for gear in Gear}
        return {gear: count for gear, count in named.items() if count is not None}


class CommandTable(Table):
    """What commands the car."""

    steering_wheel_angle: Quantity | None = None
    steering_torque: Any = None
    steering_wheel_rate: Quantity | None = None
    speed: Any = None
    acceleration: Quantity | None = None
    brake_torque: Quantity | None = None
    throttle: Quantity | None = None
    gear: Gears
    enable: Annotated[Conditions, Field(min_length=1)]
    clear: Conditions = ()
    constant: dict[SignalName, int] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _drivable(self) -> Self:
        if self.steering_torque is not None:
            raise ValueError(STEERING_TORQUE)
        if self.speed is not None:
            raise ValueError(SPEED)
        if self.steering_wheel_angle is None:
            raise ValueError("steering_wheel_angle is missing")
        pedals = self.brake_torque is not None, self.throttle is not None
        if self.acceleration is not None and any(pedals):
            raise ValueError("expected acceleration, or brake_torque and throttle, got both")
        if self.acceleration is None and not all(pedals):
            raise ValueError("expected acceleration, or both of brake_torque and throttle")
        return self


class Subsystem(Table):
    """What a subsystem reports of itself; several signals of one condition mean that any of them says so."""

    enabled: Condition
    override: Conditions = ()
    timeout: Conditions = ()
    fault: Conditions = ()
    watchdog: Conditions = ()


class BrakeReport(Subsystem):
    """Of the brakes."""

    driver: Conditions = ()
    watchdog_braking: Conditions = ()
    driver_torque: Quantity | None = None
    command: Quantity | None = None


class ThrottleReport(Subsystem):
    """Of the throttle."""

    driver: Conditions = ()
    driver_opening: Quantity | None = None
    command: Quantity | None = None


class SteeringReport(Subsystem):
    """Of the steering."""

    wheel_angle: Quantity
    driver_torque: Quantity | None = None


class GearReport(Gears):
    """Of the shifter; `between` are the counts of no gear, such as while it shifts."""

    between: Annotated[tuple[int, ...], Field(strict=False)] = ()
    override: Conditions = ()
    fault: Conditions = ()


class WheelReport(Table):
    """Of the wheels."""

    front_left: Quantity
    front_right: Quantity
    rear_left: Quantity
    rear_right: Quantity


class YawReport(Table):
    """Of the gyroscopes."""

    yaw: Quantity
    roll: Quantity | None = None


class AccelerationReport(Table):
    """Of the accelerometers."""

    longitudinal: Quantity
    lateral: Quantity | None = None
    vertical: Quantity | None = None


class TorqueReport(Table):
    """Of the car's own brake controller."""

    actual: Quantity


class ReportTable(Table):
    """What the car reports."""

    brake: BrakeReport
    throttle: ThrottleReport
    steering: SteeringReport
    gear: GearReport
    wheel_speeds: WheelReport
    yaw_rate: YawReport
    accelerations: AccelerationReport | None = None
    brake_torque: TorqueReport | None = None


class Checksum(Table):
    """How one message is protected: its signal, over the other bytes, after the identifier's two low ones if told."""

    signal: SignalName
    kind: Literal["sum", "xor", "crc8", "complement"]
    polynomial: Byte = 0x1D  # of crc8: SAE J1850
    initial: Byte = 0xFF
    final_xor: Byte = 0xFF
    identifier: bool = False
    of: SignalName | None = None  # whose complement it is

    @model_validator(mode="after")
    def _whose(self) -> Self:
        if (self.kind == "complement") != (self.of is not None):
            raise ValueError("expected 'of' with kind 'complement', and with no other")
        return self


class Watchdog(Table):
    """What the controller does by itself when commands stop."""

    command_timeout_s: Annotated[float, Field(ge=0.02, le=1.0)]
    when_commands_stop: Literal["releases", "holds", "brakes"]
    words: Name
    deceleration_mps2: Strength | None = None


class LimitTable(Table):
    """What the wire takes, where the DBC file does not say it."""

    steering_wheel_angle_deg: Positive | None = None
    steering_wheel_rate_degps: Positive | None = None
    acceleration_mps2: Strength | None = None
    deceleration_mps2: Strength | None = None
    brake_torque_nm: Positive | None = None


class Mapping(Table):
    """A whole mapping."""

    title: Name
    dbc: Name
    byte_order: Literal["little", "big", "mixed"]
    watchdog: Watchdog
    command: CommandTable
    report: ReportTable
    limits: LimitTable = Field(default_factory=LimitTable)
    counter: Annotated[tuple[SignalName, ...], Field(strict=False)] = ()
    checksum: Annotated[tuple[Checksum, ...], Field(strict=False)] = ()
    period_ms: dict[str, ReportPeriod] = Field(default_factory=dict)


def load(file: Path) -> Mapping:
    """Return the mapping in a TOML file; raises ConfigError, one line that names file and key, for a wrong one."""
    return parse(read(file, "mapping"), file)


def parse(table: dict[str, Any], file: Path) -> Mapping:
    """Return the mapping that a parsed table holds; `file` is named in the ConfigError of a wrong one."""
    try:
        return Mapping.model_validate(numbers_of(table, file, Mapping))
    except ValidationError as error:
        raise ConfigError(complaint(file, error, Mapping)) from None
