"""Port of drive-by-wire interfaces: what the gateway needs of one, and how one is found by its name.

An interface encodes actuation commands as CAN frames and decodes frames into reports, both in SI units. The gateway
decides what a report means for the drive, how old it may be and what is commanded. Only the table of shipped
interfaces names a brand. An interface does no I/O, has no clock and never raises on a received frame.
`tests/ports/vehicle_interface.py` tests any implementation.
"""

from __future__ import annotations

import enum
import importlib.util
import math
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final, NamedTuple, Protocol, runtime_checkable

from vve_sumo import ports
from vve_sumo.errors import ConfigError
from vve_sumo.ports import Port
from vve_sumo.values import Frame, identifier_text

if TYPE_CHECKING:
    from cantools.database import Database

SettingValue = float | str | bool

#: An interface is found by its name in this table, as `file.py:function` or by entry point, and is made from its
#: settings: `make(settings) -> VehicleInterface`.
PORT: Final = Port(
    "drive-by-wire interface",
    "vve_sumo.vehicle_interfaces",
    "(settings)",
    {
        "dataspeed_dbw1": "vve_sumo.vehicle.dataspeed.interface",
        "dataspeed_ulc": "vve_sumo.vehicle.ulc.interface",
        "generic": "vve_sumo.vehicle.mapped.interface",
        "new_eagle_raptor": "vve_sumo.vehicle.raptor.interface",
        "pacmod3": "vve_sumo.vehicle.pacmod.interface",
    },
)


class Gear(enum.IntEnum):
    """Selector position."""

    NONE = 0
    PARK = 1
    REVERSE = 2
    NEUTRAL = 3
    DRIVE = 4
    LOW = 5


# Tuples and not dataclasses, here and below: making one is several times cheaper, and a dozen are made every tick.
class ActuationCommand(NamedTuple):
    """Command to the car in one step of the gateway.

    The acceleration and the pedals say the same in two ways: an interface sends the one that its wire takes.
    """

    brake_torque: float  #: all wheels together [N m]
    throttle: float  #: opening, 0 to 1
    wheel_angle: float  #: of the steering wheel [rad], left positive
    wheel_rate: float  #: largest rate of the steering wheel [rad/s]; 0 is the interface's own largest
    gear: Gear  #: requested gear; NONE requests nothing
    enable: bool  #: the DBW controller may act on the command
    clear: bool  #: latched driver overrides are to be reset
    acceleration: float = 0.0  #: over ground, along the road [m/s2]; the DBW controller sees to grade and drag


class Commanded(NamedTuple):
    """What one frame commands; NaN for what it does not command."""

    brake_torque: float  #: all wheels together [N m]
    throttle: float  #: opening, 0 to 1
    wheel_angle: float  #: of the steering wheel [rad], left positive
    acceleration: float = math.nan  #: over ground, along the road [m/s2]


class BrakeState(NamedTuple):
    """What the brake subsystem reports of itself."""

    enabled: bool  #: it acts on commands
    override: bool = False  #: the driver took over; latched until a clear
    driver: bool = False  #: the driver's foot is on the pedal
    timeout: bool = False  #: it dropped out because no command came in time
    fault: bool = False  #: something in it is broken
    watchdog: bool = False  #: the interface's own watchdog has latched
    watchdog_braking: bool = False  #: the interface brakes because of its watchdog
    driver_torque: float = math.nan  #: that the driver's pedal asks for, all wheels together [N m]; NaN not reported
    command: float = math.nan  #: torque last commanded, as the subsystem understood it [N m]; NaN not reported


class ThrottleState(NamedTuple):
    """What the throttle subsystem reports of itself; fields as of the brakes."""

    enabled: bool
    override: bool = False
    driver: bool = False
    timeout: bool = False
    fault: bool = False
    watchdog: bool = False
    driver_opening: float = math.nan  #: that the driver's pedal asks for, 0 to 1; NaN not reported
    command: float = math.nan  #: opening last commanded, as the subsystem understood it, 0 to 1; NaN not reported


class SteeringState(NamedTuple):
    """What the steering subsystem reports of itself; fields as of the brakes."""

    wheel_angle: float  #: of the steering wheel [rad], left positive; NaN invalid
    enabled: bool
    override: bool = False
    timeout: bool = False
    fault: bool = False
    watchdog: bool = False
    driver_torque: float = math.nan  #: of the driver on the steering wheel [N m], left positive; NaN not reported


class GearState(NamedTuple):
    """What the shifter reports."""

    gear: Gear  #: engaged
    override: bool = False  #: the driver took over
    fault: bool = False


class WheelSpeeds(NamedTuple):
    """Angular speeds of the wheels [rad/s], forward positive; NaN invalid."""

    front_left: float
    front_right: float
    rear_left: float
    rear_right: float


class YawRate(NamedTuple):
    """What the car's gyroscopes measure [rad/s]; NaN invalid or not reported."""

    roll: float
    yaw: float  #: counter-clockwise seen from above


class Accelerations(NamedTuple):
    """What the car's accelerometers measure [m/s2] (specific force), ISO 8855 axes; NaN invalid or not reported."""

    longitudinal: float  #: forward positive
    lateral: float  #: left positive
    vertical: float  #: up positive


class BrakeTorque(NamedTuple):
    """Brake torque that the car reports."""

    actual: float  #: all wheels together [N m]; NaN invalid


class Malformed(NamedTuple):
    """A frame with a known identifier and no usable content."""

    id: int  #: identifier of the frame
    reason: str  #: reason code


Report = (
    BrakeState | ThrottleState | SteeringState | GearState | WheelSpeeds | YawRate | Accelerations | BrakeTorque
)  # fmt: skip

#: Reports without which the gateway commands no car; none may be older than 0.1 s, the gear 0.2 s.
REQUIRED: Final[frozenset[type]] = frozenset(
    {BrakeState, ThrottleState, SteeringState, GearState, WheelSpeeds, YawRate}
)  # fmt: skip


class WhenCommandsStop(enum.Enum):
    """What a DBW controller does by itself when commands stop."""

    RELEASES = "releases"  #: lets go of pedals and steering: the car rolls
    HOLDS = "holds"  #: keeps doing what was commanded last: nothing stops the car
    BRAKES = "brakes"  #: brakes where its watchdog is armed, else lets go


@dataclass(frozen=True, slots=True)
class CommandsStop:
    """What a DBW controller does by itself when commands stop, and how hard it then brakes at most.

    Raises ConfigError for a strength that is not positive, and for one of an interface that does not brake.
    """

    action: WhenCommandsStop
    words: str  #: the same in words
    brake_torque: float = math.inf  #: of its watchdog at most, all wheels together [N m]; inf where nobody states it
    deceleration: float = math.inf  #: of its watchdog at most [m/s2]; inf where nobody states it

    def __post_init__(self) -> None:
        """Raise ConfigError where action and strength contradict each other."""
        for name in ("brake_torque", "deceleration"):
            value = getattr(self, name)
            if not value > 0.0:
                raise ConfigError(f"when_commands_stop: {name} must be a positive number, got {value!r}")
            if math.isfinite(value) and self.action is not WhenCommandsStop.BRAKES:
                raise ConfigError(f"when_commands_stop: an interface that {self.action.value} has no {name}")

    def largest_deceleration(self, brake_gain: float) -> float:
        """Return what its watchdog brakes with at most [m/s2]: inf where nobody states it, 0 where it has none.

        `brake_gain` is the brake torque for each m/s2 of deceleration [kg m].
        """
        if self.action is not WhenCommandsStop.BRAKES:
            return 0.0
        return min(self.deceleration, self.brake_torque / brake_gain)


class AccelerationLimits(NamedTuple):
    """Least and greatest acceleration that a wire takes."""

    minimum: float  #: hardest braking, a negative number [m/s2]
    maximum: float  #: [m/s2]


@dataclass(frozen=True, slots=True)
class InterfaceFacts:
    """Properties that do not change while an interface is in use."""

    title: str  #: the interface in words
    commands: frozenset[int]  #: identifiers that only the gateway may send
    reports: Mapping[int, tuple[type, ...]]  #: identifier of each frame that is read to the kinds of its reports
    occupied: frozenset[int]  #: every identifier that the device sends or receives, read here or not
    brake_torque_limit: float  #: largest that the wire takes, all wheels together [N m]; inf where it takes none
    wheel_angle_limit: float  #: largest that the wire takes, of the steering wheel, both ways [rad]
    wheel_rate_limit: float  #: largest that the wire takes, of the steering wheel [rad/s]
    command_timeout: float  #: without a command for this long a subsystem releases its actuator by itself [s]
    when_commands_stop: CommandsStop  #: what the DBW controller does then by itself
    dbc: Path | None = None  #: file that states the layout of the frames, where there is one
    acceleration_limits: AccelerationLimits | None = None  #: of a wire that takes an acceleration, else it takes pedals
    counts: bool = True  #: its frames hold a counter that runs, so that no two steps' frames are alike
    files: tuple[Path, ...] = ()  #: what it reads besides its code, such as a mapping: a record keeps their hashes

    def largest_brake_torque(self, brake_gain: float) -> float:
        """Return what the wire can ask for at most, all wheels together [N m].

        `brake_gain` is the brake torque for each m/s2 of deceleration [kg m].
        """
        if self.acceleration_limits is None:
            return self.brake_torque_limit
        return -self.acceleration_limits.minimum * brake_gain


@runtime_checkable
class VehicleInterface(Protocol):
    """One drive-by-wire interface, made for one gateway."""

    @property
    def facts(self) -> InterfaceFacts:
        """Return identifiers, wire ranges and time-outs."""
        ...

    def encode(self, command: ActuationCommand) -> tuple[Frame, ...]:
        """Return the frames of `command`, in the order in which they are to be sent; counters count once a call.

        Raises ValueError for NaN and for a value beyond the wire's range; nothing is clipped or wrapped. What the wire
        does not take, pedals or acceleration, is not looked at. No frame ever asks the DBW controller to ignore the
        driver.
        """
        ...

    def decode(self, frame: Frame) -> tuple[Report, ...] | Malformed:
        """Return the reports in a frame; none for an identifier that the interface does not read."""
        ...

    def commanded(self, frame: Frame) -> Commanded | None:
        """Return what a recorded frame commands; None for one that commands neither motion nor steering."""
        ...

    def simulated(self, duration: float) -> SimulatedInterface:
        """Return a simulated DBW controller for the simulated vehicle, which is stepped every `duration` [s].

        Raises ConfigError where there is none.
        """
        ...


# The simulated DBW controller, as the simulated vehicle needs it.

PEDAL_REST: Final = 0.15  # pedal sensor of an untouched pedal, fraction of its range


@dataclass(frozen=True, slots=True)
class DriverInputs:
    """What the driver of a simulated vehicle does."""

    brake_pedal: float = PEDAL_REST  #: pedal sensor, fraction
    throttle_pedal: float = PEDAL_REST  #: pedal sensor, fraction
    steering_torque: float = 0.0  #: on the wheel [N m], left positive
    acknowledge: bool = False  #: resets a latched watchdog fault
    gear: Gear = Gear.NONE  #: to which the driver holds the gear lever; NONE: no hand is on it


HANDS_OFF: Final = DriverInputs()


class Request(NamedTuple):
    """What the DBW controller requests of the actuators."""

    brake_torque: float  #: all wheels together [N m]
    throttle: float  #: 0 to 1
    wheel_angle: float  #: of the steering wheel [rad]; NaN while the steering is not controlled
    #: over ground [m/s2], which the car's own controller gives by its pedals; NaN: the pedals alone are asked for
    acceleration: float = math.nan


class Measured(NamedTuple):
    """What the simulated vehicle's sensors measure."""

    speed: float  #: of the rear axle [m/s], forward positive
    acceleration: float  #: along the road [m/s2]
    wheels: WheelSpeeds
    accelerations: Accelerations
    rates: YawRate
    wheel_angle: float  #: of the steering wheel [rad]
    brake_torque: float  #: applied by the brakes' own estimate, all wheels together [N m]


#: Kinds of injected fault that a simulated DBW controller has to inject itself, because only the interface knows how
#: its frames say it, with what `decode` must give while the fault is due. Nothing else that is reported changes, as far
#: as the wire tells it apart, and the controller does what it would do without the fault.
INTERFACE_KINDS: Final[Mapping[str, str]] = {
    "brake_fault": "`BrakeState.fault` is true",
    "throttle_fault": "`ThrottleState.fault` is true",
    "steering_fault": "`SteeringState.fault` is true",
    "report_malformed": "the frame that holds `SteeringState` is `Malformed`",
    "steering_report_frozen": "`SteeringState` stays what it was when the fault began; counters and checksums go on",
    "brake_report_frozen": "`BrakeState` stays what it was when the fault began; counters and checksums go on",
    "throttle_report_frozen": "`ThrottleState` stays what it was when the fault began; counters and checksums go on",
    "brake_driver_bits_zero": "`BrakeState.override` and `BrakeState.driver` are false, whatever the driver does",
    "throttle_driver_bits_zero": "`ThrottleState.override` and `.driver` are false, whatever the driver does",
    "override_false": "`override` is true in one report: of brakes (value 1), throttle (2), steering (3), shifter (4)",
    "gear_lever": "no report is altered: `step` moves the lever to `DriverInputs.gear` where a car's own shifter does, "
    "and `GearState.override` is true",
}

#: Strength of the injected fault of a kind at a time [s], NaN where the kind has none; None where it is not active.
Due = Callable[[str, float], float | None]


class SimulatedInterface(Protocol):
    """DBW controller of a simulated vehicle: it acts on commands and reports as a real one does."""

    @property
    def gear(self) -> Gear:
        """Return the gear that is engaged."""
        ...

    @property
    def enabled(self) -> tuple[bool, bool, bool]:
        """Return whether brake, throttle and steering act on commands."""
        ...

    @property
    def watchdog_braking(self) -> bool:
        """Return whether its watchdog brakes by itself."""
        ...

    @property
    def injectable(self) -> frozenset[str]:
        """Return those of `INTERFACE_KINDS` that it can inject; a drive with any other of them is refused."""
        ...

    @property
    def driver_brake_torque(self) -> float:
        """Return the brake torque that the driver's foot asks for [N m]."""
        ...

    def receive(self, frames: Sequence[Frame], speed: float, brake_torque: float) -> None:
        """Take in frames from the bus, at a car's `speed` [m/s] and applied `brake_torque` [N m]."""
        ...

    def step(self, driver: DriverInputs, speed: float, wheel_angle: float) -> Request:
        """Advance by one step; `speed` [m/s] and steering `wheel_angle` [rad] are the car's own measurements.

        The driver takes over by either pedal and by torque on the steering wheel.
        """
        ...

    def reports(self, measured: Measured) -> list[Frame]:
        """Return the report frames that are due; called 100 times a second."""
        ...

    def drop_out(self, subsystem: int | None) -> None:
        """Make one subsystem fail: 1 brake, 2 throttle, 3 steering; None restores all."""
        ...

    def alter(self, time: float, frame: Frame, due: Due) -> Frame:
        """Return what is sent at `time` [s] in place of a report.

        `due(kind, time)` says whether a fault of one of the kinds in `injectable` is due, by its value, NaN where the
        kind has none; `INTERFACE_KINDS` says what the report must then hold. With none due the frame is returned as it
        is.
        """
        ...


@dataclass(frozen=True, slots=True)
class InterfaceConfig:
    """A car's interface and its settings: plain data that goes into records and to other processes."""

    name: str  #: shipped name, `file.py:function`, or entry point
    settings: Mapping[str, SettingValue]  #: handed to `make`


#: interface of the paper's car, a Ford Fusion
DEFAULT: Final = InterfaceConfig("dataspeed_dbw1", {"variant": "dbw1_2024"})


def error_text(error: Exception) -> str:
    """Return what the code of an interface raised, in one line, with the innermost place."""
    return ports.error_text(error, __file__)


def read_dbc(file: Path) -> Database:
    """Read a file that states the layout of frames, as a cantools database, checked strictly.

    Raises ConfigError, naming the file, where cantools is not installed or does not take the file.
    """
    try:
        import cantools
    except ImportError:
        raise ConfigError("reading the DBC file needs cantools: pip install 'vve-sumo[dbc]'") from None
    try:
        return cantools.database.load_file(file, strict=True)
    except OSError as error:
        raise ConfigError(f"{file}: {error.strerror}") from None
    except Exception as error:  # the parser below cantools has errors of its own
        raise ConfigError(f"{file}: cantools says: {' '.join(str(error).split())}") from None


def has_cantools() -> bool:
    """Whether DBC files can be read by `read_dbc`."""
    return sys.modules.get("cantools", importlib.util) is not None and importlib.util.find_spec("cantools") is not None


def load(config: InterfaceConfig) -> VehicleInterface:
    """Make the interface of a configuration; raises ConfigError, which names the interface, where that fails."""
    interface = PORT.make(config.name, PORT.find(config.name), dict(config.settings))
    if not isinstance(interface, VehicleInterface):
        made = type(interface).__name__
        raise ConfigError(f"{PORT.kind} {config.name}: make returned a {made}, which is no VehicleInterface")
    facts = interface.facts
    missing = sorted(kind.__name__ for kind in REQUIRED.difference(*facts.reports.values()))
    if missing:
        raise ConfigError(f"{PORT.kind} {config.name}: it reports no {', '.join(missing)}, which the gateway needs")
    if not isinstance(facts.when_commands_stop, CommandsStop):
        raise ConfigError(
            f"{PORT.kind} {config.name}: facts.when_commands_stop: expected a CommandsStop, "
            f"got {facts.when_commands_stop!r}"
        )
    if both := facts.commands & facts.reports.keys():
        raise ConfigError(
            f"{PORT.kind} {config.name}: identifier {identifier_text(min(both))} is both a command and a report"
        )
    return interface
