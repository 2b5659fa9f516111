"""Model of a Dataspeed DBW1 controller's response to commands: enabling, timeouts, overrides, watchdog, shifting.

It turns command frames and the driver's inputs into requests to the actuators, and knows neither dynamics nor reports.
Behaviour as published in Dataspeed's `dbw_mkz_can` and `dbw_ford_can` sources, WatchdogCounter.msg and its FAQ.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from vve_sumo.values import Frame
from vve_sumo.vehicle.dataspeed import codec, layout
from vve_sumo.vehicle.dataspeed.messages import (
    BrakeCommand,
    BrakeKind,
    GearCommand,
    GearReject,
    SteeringCommand,
    ThrottleCommand,
    ThrottleKind,
    WatchdogSource,
)
from vve_sumo.vehicle.dataspeed.pedals import PEDALS, TORQUES, pedal_to_throttle, pedal_to_torque
from vve_sumo.vehicle.interface import HANDS_OFF, DriverInputs, Gear, Malformed, Request

# Time without a usable command after which a module drops out [s]; a stuck counter trips the watchdog after the same
# time, which is an assumption: that time is not public.
TIMEOUT: Final = 0.100
OVERRIDE_TIME: Final = 0.100  # input beyond the threshold for this long is the driver taking over [s]
ACTIVITY_TIME: Final = 0.020  # [s]
BRAKE_OVERRIDE, THROTTLE_OVERRIDE = 0.22, 0.30  # pedal sensor
PEDAL_ACTIVITY: Final = 0.18  # pedal sensor
STEERING_OVERRIDE, STEERING_ACTIVITY = 3.0, 1.5  # driver's torque on the wheel [N m]; not public, assumptions
REST_SPEED: Final = 0.05  # slower counts as standing [m/s]
SHIFT_BRAKE: Final = 200.0  # torque that the shifter takes for a pressed pedal [N m]; an assumption

# The DBW controller moves the pedal at most 0.4 in 20 ms; as torque, by the table's mean slope [N m/s].
BRAKE_RAMP: Final = 0.4 / 0.020 * TORQUES[-1] / (PEDALS[-1] - PEDALS[0])

# In Python 3.11 naming a member of an enumeration is a call; code that runs with every command names these instead.
_NO_BRAKE, _BRAKE_PEDAL, _BRAKE_PERCENT = BrakeKind.NONE, BrakeKind.PEDAL, BrakeKind.PERCENT
_DECELERATION = BrakeKind.DECELERATION
_NO_THROTTLE, _THROTTLE_PERCENT = ThrottleKind.NONE, ThrottleKind.PERCENT
_NO_GEAR, _ACCEPTED = Gear.NONE, GearReject.NONE


def _throttle(command: ThrottleCommand) -> float:
    """Throttle opening that a command asks for, 0 to 1."""
    if command.kind is _NO_THROTTLE:
        return 0.0
    return min(command.value, 1.0) if command.kind is _THROTTLE_PERCENT else pedal_to_throttle(command.value)


@dataclass(frozen=True, slots=True)
class DbwControllerParameters:
    """How one DBW controller is configured."""

    variant: layout.Variant = layout.Variant.DBW1_2024
    watchdog: bool = True  #: the optional watchdog is fitted; commands whose counter changes arm it
    watchdog_torque: float = 1500.0  #: its braking [N m]; the real strength is not public, this one is an assumption
    brake_torque_limit: float = 3250.0  #: most that a command gets [N m]
    wheel_angle_limit: float = math.radians(470.0)  #: of the steering wheel [rad]
    wheel_rate_limit: float = 8.7  #: of the steering wheel [rad/s]
    shift_time: float = 0.5  #: from command to engaged gear [s]; cars of this kind take 0.3 to 0.6


@dataclass(slots=True)
class Module:
    """State of one of the three by-wire modules."""

    override_above: float  #: driver's input
    activity_above: float  #: driver's input
    command: BrakeCommand | ThrottleCommand | SteeringCommand | None = None  #: last usable one
    received_step: int = -(1 << 30)  #: step at which it came
    counted: int = 0  #: step at which its counter last changed
    counting: bool = False  #: the watchdog is armed on it
    enabled: bool = False
    timeout: bool = True
    override: bool = False  #: latched
    driver: bool = False  #: active now
    pressed: int = 0  #: steps beyond the override threshold
    touched: int = 0  #: steps beyond the activity threshold
    source: WatchdogSource = WatchdogSource.NONE
    enable_commanded: bool = False  #: the last usable command asks to enable it
    broken: bool = False  #: cannot be enabled, whatever is commanded

    def receive(self, command: BrakeCommand | ThrottleCommand | SteeringCommand, step: int) -> None:
        """Take in a usable command."""
        if command.clear and not self.pressed:
            self.override = False
        if command.counter is None:
            return
        last = self.command
        if last is None or last.counter != command.counter:
            self.counted = step
            self.counting |= last is not None and last.enable and command.enable
        self.command, self.received_step, self.enable_commanded = command, step, command.enable

    def feel(self, value: float, override_steps: int, activity_steps: int) -> None:
        """Update the driver's activity and override from an input `value`."""
        self.pressed = self.pressed + 1 if value > self.override_above else 0
        self.touched = self.touched + 1 if value > self.activity_above else 0
        self.driver = self.touched >= activity_steps
        self.override |= self.pressed >= override_steps


class DbwController:
    """The DBW controller's modules, stepped together every `duration` seconds."""

    def __init__(self, parameters: DbwControllerParameters, duration: float) -> None:
        self.parameters = parameters
        self.brake = Module(BRAKE_OVERRIDE, PEDAL_ACTIVITY)
        self.throttle = Module(THROTTLE_OVERRIDE, PEDAL_ACTIVITY)
        self.steering = Module(STEERING_OVERRIDE, STEERING_ACTIVITY)
        self.modules = (self.brake, self.throttle, self.steering)
        self.gear = Gear.PARK
        self.gear_command = Gear.NONE
        self.gear_reject = GearReject.NONE
        self.gear_override = False  #: the driver moved the lever; latched until a clear
        self.fault = False  #: the watchdog has latched
        self.watchdog_braking = False
        self.misuses = 0  #: command frames that asked to ignore the driver
        self.request = Request(0.0, 0.0, math.nan)
        #: what the last commands ask for, enabled or not: brake torque [N m], throttle opening, wheel angle [rad]
        self.commanded_torque = self.commanded_throttle = self.commanded_wheel_angle = 0.0
        self._wheel_target = self._wheel_change = 0.0  # within the limit, and largest change in a step [rad]
        self._take(HANDS_OFF)
        self._step = self._due = 0
        self._shift_ends: int | None = None
        self._timeout_steps = round(TIMEOUT / duration)
        self._override_steps = round(OVERRIDE_TIME / duration)
        self._activity_steps = round(ACTIVITY_TIME / duration)
        self._shift_steps = round(parameters.shift_time / duration)
        self._brake_change = BRAKE_RAMP * duration
        self._duration = duration

    def receive(self, frames: Sequence[Frame], speed: float, brake_torque: float) -> None:
        """Take in frames from the bus; a frame with a wrong length or value is ignored."""
        self._due = 0
        for frame in frames:
            if frame.id not in layout.COMMAND_IDS:
                continue
            command = codec.decode(frame, self.parameters.variant)
            if isinstance(command, BrakeCommand):
                if command.kind is not _DECELERATION:  # a Fusion's brake module doesn't know it
                    self.brake.receive(command, self._step)
                    if command is self.brake.command:
                        self.commanded_torque = self._torque(command)
            elif isinstance(command, ThrottleCommand):
                self.throttle.receive(command, self._step)
                if command is self.throttle.command:
                    self.commanded_throttle = _throttle(command)
            elif isinstance(command, SteeringCommand):
                self.steering.receive(command, self._step)
                if command is self.steering.command:
                    self._aim(command)
            elif isinstance(command, GearCommand):
                if command.clear and self.driver.gear is _NO_GEAR:
                    self.gear_override = False
                self._shift(command.gear, speed, brake_torque)
            elif isinstance(command, Malformed):
                self.misuses += command.reason == "ignore_bit"

    def step(self, driver: DriverInputs, speed: float, wheel_angle: float) -> Request:
        """Advance by one step; `speed` [m/s] and steering `wheel_angle` [rad] are the car's own measurements."""
        if driver is not HANDS_OFF or self.driver is not HANDS_OFF:  # without a driver there is nothing to update
            self._take(driver)
            self._feel(driver)
            self._move_lever(driver.gear, speed)
            self._due = 0
        if self._step >= self._due:
            self._update(speed)
        self._step += 1
        throttle = max(self.commanded_throttle if self.throttle.enabled else 0.0, self._foot_throttle)
        self.request = Request(self._brake(), throttle, self._steer(wheel_angle))
        return self.request

    def drop_out(self, subsystem: int | None) -> None:
        """Make one module fail: 1 brake, 2 throttle, 3 steering; None restores all."""
        for number, module in enumerate(self.modules, start=1):
            module.broken = number == subsystem
        self._due = 0

    def _update(self, speed: float) -> None:
        """Update modules, watchdog and gear, and find the step before which only a command or a driver changes them."""
        oldest = self._step - self._timeout_steps
        for module in self.modules:
            module.timeout = module.received_step <= oldest
        if self.parameters.watchdog:
            self._watch(speed, oldest)
        fault = self.fault
        for module in self.modules:
            module.enabled = module.enable_commanded and not (
                module.broken or module.timeout or module.override or fault
            )
        if self._shift_ends is not None and self._step >= self._shift_ends:
            self.gear, self._shift_ends = self.gear_command, None
        # A counter never changes after the last command, so no time-out comes before it is found to be stuck.
        stuck = min(module.counted for module in self.modules) + self._timeout_steps
        self._due = stuck if self._shift_ends is None else 0

    def _take(self, driver: DriverInputs) -> None:
        """Take the driver's inputs, and what the pedals ask for of themselves."""
        self.driver = driver
        self._foot_torque = pedal_to_torque(driver.brake_pedal)
        self._foot_throttle = pedal_to_throttle(driver.throttle_pedal)

    def _feel(self, driver: DriverInputs) -> None:
        self.brake.feel(driver.brake_pedal, self._override_steps, self._activity_steps)
        self.throttle.feel(driver.throttle_pedal, self._override_steps, self._activity_steps)
        self.steering.feel(abs(driver.steering_torque), self._override_steps, self._activity_steps)

    def _watch(self, speed: float, oldest: int) -> None:
        """Latch the watchdog where an armed module has heard nothing usable since the step `oldest`."""
        if self.fault:
            self._watch_fault()
        elif not (self.brake.override or self.throttle.override or self.steering.override):
            for index, module in enumerate(self.modules):
                if module.counting and (module.timeout or not module.enable_commanded or module.counted <= oldest):
                    cause = self._cause(module, speed)
                    if cause is not None:
                        self._latch(index, cause)
                        return

    def _cause(self, module: Module, speed: float) -> int | None:
        """Why the watchdog trips on an armed module: an offset from its first code in `WatchdogSource`, or None."""
        if module.timeout:
            return 2
        if not module.enable_commanded:
            parked = self.gear is Gear.PARK and abs(speed) < REST_SPEED
            module.counting = not parked
            return None if parked else 1
        return 0

    def _latch(self, index: int, cause: int) -> None:
        self.fault = self.watchdog_braking = True
        for position, module in enumerate(self.modules):
            module.source = WatchdogSource(4 * (index + 1) + cause if position == index else index + 1)

    def _watch_fault(self) -> None:
        if any(module.driver for module in self.modules):
            self.watchdog_braking = False
        if self.driver.acknowledge:
            self.fault = self.watchdog_braking = False
            for module in self.modules:
                module.source = WatchdogSource.NONE
                module.counting = False

    def _torque(self, command: BrakeCommand) -> float:
        """Brake torque that a command asks for [N m]."""
        if command.kind is _NO_BRAKE:
            return 0.0
        limit, value = self.parameters.brake_torque_limit, command.value
        if command.kind is _BRAKE_PEDAL:
            value = pedal_to_torque(value)
        elif command.kind is _BRAKE_PERCENT:
            value *= limit
        return min(value, limit)

    def _aim(self, command: SteeringCommand) -> None:
        """Take the angle and the rate of a steering command."""
        limit, rate = self.parameters.wheel_angle_limit, self.parameters.wheel_rate_limit
        self.commanded_wheel_angle = command.wheel_angle
        self._wheel_target = min(max(command.wheel_angle, -limit), limit)
        self._wheel_change = (min(command.wheel_rate, rate) if command.wheel_rate else rate) * self._duration

    def _brake(self) -> float:
        wanted = self.commanded_torque if self.brake.enabled else 0.0
        if self.watchdog_braking:
            wanted = self.parameters.watchdog_torque
        last, largest = self.request.brake_torque, self._brake_change
        change = max(wanted, self._foot_torque) - last
        return last + (-largest if change < -largest else largest if change > largest else change)

    def _steer(self, wheel_angle: float) -> float:
        """Next angle towards the commanded one [rad], starting at the measured `wheel_angle`; NaN if not enabled."""
        if not self.steering.enabled:
            return math.nan
        last, largest = self.request.wheel_angle, self._wheel_change
        here = wheel_angle if last != last else last
        change = self._wheel_target - here
        return here + (-largest if change < -largest else largest if change > largest else change)

    def _shift(self, gear: Gear, speed: float, brake_torque: float) -> None:
        if gear is _NO_GEAR or (gear is self.gear_command and self._shift_ends is not None):
            return
        self.gear_reject = self._refusal(gear, speed, brake_torque)
        if self.gear_reject is _ACCEPTED:
            self.gear_command = gear
            if gear is not self.gear:
                self._shift_ends = self._step + self._shift_steps

    def _move_lever(self, gear: Gear, speed: float) -> None:
        """Follow the driver's lever where a car's own shifter does, and report an override.

        Neutral is taken at any speed, drive from neutral while the car rolls forward; what else the driver wants, the
        car takes at rest. It leaves park only with a foot on the brake.
        """
        if gear is _NO_GEAR:
            return
        self.gear_override = True
        if gear is self.gear or self._shift_ends is not None:
            return
        if self.gear is Gear.PARK:
            follows = self._foot_torque >= SHIFT_BRAKE
        else:
            rolls_on = self.gear is Gear.NEUTRAL and gear is Gear.DRIVE and speed > 0.0
            follows = gear is Gear.NEUTRAL or rolls_on or abs(speed) < REST_SPEED
        if follows:
            self.gear_command, self._shift_ends = gear, self._step + self._shift_steps

    def _refusal(self, gear: Gear, speed: float, brake_torque: float) -> GearReject:
        if self.gear_override:
            return GearReject.OVERRIDE
        if gear is self.gear:
            return _ACCEPTED
        if gear is Gear.LOW:
            return GearReject.UNSUPPORTED
        if self._shift_ends is not None:
            return GearReject.SHIFT_IN_PROGRESS
        return GearReject.NONE if abs(speed) < REST_SPEED and brake_torque >= SHIFT_BRAKE else GearReject.VEHICLE
