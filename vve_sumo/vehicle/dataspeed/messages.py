"""Messages between a Dataspeed DBW1 drive-by-wire controller and its host, as values in SI units.

The codec defines bits, scales and identifiers; the gateway decides when and why to send. Wheel speeds, yaw rate,
accelerations and gears are the port's own values.
"""

from __future__ import annotations

import enum
from typing import NamedTuple

from vve_sumo.vehicle.interface import Accelerations, Gear, WheelSpeeds, YawRate


class BrakeKind(enum.IntEnum):
    """Meaning of the value of a brake command."""

    NONE = 0
    PEDAL = 1  #: pedal travel, fraction
    PERCENT = 2  #: of the largest torque, fraction
    TORQUE = 3  #: open loop [N m]
    TORQUE_CLOSED_LOOP = 4  #: [N m]
    DECELERATION = 6  #: [m/s2]; not offered by the pedal module of a Fusion


class ThrottleKind(enum.IntEnum):
    """Meaning of the value of a throttle command."""

    NONE = 0
    PEDAL = 1  #: pedal travel, fraction
    PERCENT = 2  #: of full throttle, fraction


class BrakeReportKind(enum.IntEnum):
    """Meaning of the three values of a brake report."""

    PEDAL = 0  #: fractions of pedal travel
    DECELERATION = 1  #: driver's torque [N m], command and output as deceleration [m/s2]
    TORQUE = 2  #: [N m]


class GearReject(enum.IntEnum):
    """Why the car did not take a gear command."""

    NONE = 0
    SHIFT_IN_PROGRESS = 1
    OVERRIDE = 2
    ROTARY_LOW = 3
    ROTARY_PARK = 4
    VEHICLE = 5
    UNSUPPORTED = 6
    FAULT = 7


class ParkingBrake(enum.IntEnum):
    """State of the parking brake."""

    OFF = 0
    TRANSITION = 1
    ON = 2
    FAULT = 3


class WatchdogSource(enum.IntEnum):
    """What made the DBW controller's watchdog latch."""

    NONE = 0
    OTHER_BRAKE = 1
    OTHER_THROTTLE = 2
    OTHER_STEERING = 3
    BRAKE_COUNTER = 4
    BRAKE_DISABLED = 5
    BRAKE_COMMAND = 6
    BRAKE_REPORT = 7
    THROTTLE_COUNTER = 8
    THROTTLE_DISABLED = 9
    THROTTLE_COMMAND = 10
    THROTTLE_REPORT = 11
    STEERING_COUNTER = 12
    STEERING_DISABLED = 13
    STEERING_COMMAND = 14
    STEERING_REPORT = 15


# Tuples and not dataclasses: making one is several times cheaper, and a dozen are made every tick.
class BrakeCommand(NamedTuple):
    """Command to the brake module."""

    kind: BrakeKind  #: meaning of the value
    value: float  #: fraction, [N m] or [m/s2]
    enable: bool  #: the DBW controller may act on it
    counter: int | None  #: watchdog counter 0 to 255; None only for CLEAR alone, which goes out with four bytes
    clear: bool = False  #: forget a latched override


class ThrottleCommand(NamedTuple):
    """Command to the throttle module."""

    kind: ThrottleKind  #: meaning of the value
    value: float  #: fraction
    enable: bool  #: the DBW controller may act on it
    counter: int | None  #: watchdog counter 0 to 255; None only for CLEAR alone
    clear: bool = False  #: forget a latched override


class SteeringCommand(NamedTuple):
    """Command to the steering module."""

    wheel_angle: float  #: of the steering wheel [rad], left positive
    wheel_rate: float  #: largest rate of the steering wheel [rad/s], rounded down; 0 is the controller's own
    enable: bool  #: the DBW controller may act on it
    counter: int | None  #: watchdog counter 0 to 255; None only for CLEAR alone
    clear: bool = False  #: forget a latched override


class GearCommand(NamedTuple):
    """Command to the shift module."""

    gear: Gear  #: NONE requests nothing
    clear: bool = False  #: forget a latched override


class BrakeReport(NamedTuple):
    """Report of the brake module, 50 Hz."""

    kind: BrakeReportKind  #: meaning of the three values
    driver_input: float  #: the driver's pedal: fraction, or [N m]
    command: float  #: fraction, [N m] or [m/s2]
    output: float  #: fraction, [N m] or [m/s2]
    enabled: bool
    lights: bool = False  #: brake lights asked for
    override: bool = False  #: the driver took over; latched until CLEAR
    driver: bool = False  #: the driver is on the pedal
    timeout: bool = False  #: no command for 100 ms
    watchdog_braking: bool = False  #: the DBW controller brakes because of its watchdog
    watchdog_source: WatchdogSource = WatchdogSource.NONE
    fault_watchdog: bool = False
    fault_channel_1: bool = False
    fault_channel_2: bool = False
    fault_power: bool = False


class ThrottleReport(NamedTuple):
    """Report of the throttle module, 50 Hz."""

    driver_input: float  #: pedal travel, fraction
    command: float  #: pedal travel, fraction
    output: float  #: pedal travel, fraction
    enabled: bool
    override: bool = False  #: the driver took over; latched until CLEAR
    driver: bool = False  #: the driver is on the pedal
    timeout: bool = False  #: no command for 100 ms
    watchdog_source: WatchdogSource = WatchdogSource.NONE
    fault_watchdog: bool = False
    fault_channel_1: bool = False
    fault_channel_2: bool = False
    fault_power: bool = False


class SteeringReport(NamedTuple):
    """Report of the steering module, 50 Hz."""

    wheel_angle: float  #: of the steering wheel [rad], left positive; NaN invalid
    command: float  #: [rad] left positive, or [N m] in torque mode; NaN invalid
    speed: float  #: of the vehicle [m/s]; without a sign in the 2018 variant; NaN invalid
    torque: float  #: of the driver on the wheel [N m]; NaN invalid
    enabled: bool
    override: bool = False  #: the driver took over; latched until CLEAR
    timeout: bool = False  #: no command for 100 ms
    torque_mode: bool = False  #: never in the 2018 variant
    fault_watchdog: bool = False
    fault_bus_1: bool = False
    fault_bus_2: bool = False
    fault_calibration: bool = False
    fault_power: bool = False


class GearReport(NamedTuple):
    """Report of the shift module, 20 Hz."""

    gear: Gear  #: engaged
    command: Gear = Gear.NONE  #: asked for
    override: bool = False  #: the driver took over
    fault_bus: bool = False
    reject: GearReject = GearReject.NONE


class BrakeInfo(NamedTuple):
    """Report of the car's own brake controller, 50 Hz."""

    torque_requested: float  #: all wheels together [N m]; NaN invalid
    torque_actual: float  #: all wheels together [N m]; NaN invalid
    stationary: bool
    parking_brake: ParkingBrake = ParkingBrake.OFF
    acceleration_over_ground: float = 0.0  #: along the road [m/s2]; NaN invalid
    abs_active: bool = False
    stability_active: bool = False
    traction_active: bool = False


Command = BrakeCommand | ThrottleCommand | SteeringCommand | GearCommand
Report = BrakeReport | ThrottleReport | SteeringReport | GearReport | WheelSpeeds | Accelerations | YawRate | BrakeInfo
Message = Command | Report
