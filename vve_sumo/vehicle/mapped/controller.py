"""Model of a drive-by-wire controller on a mapped wire: enabling, time-outs, overrides, watchdog, shifting.

It turns what commands say and what the driver does into requests to the car; it knows neither frames nor dynamics. Its
thresholds are those of common controllers, an assumption: no DBC file states them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from vve_sumo.laws import clamp
from vve_sumo.vehicle.interface import HANDS_OFF, PEDAL_REST, DriverInputs, Gear, Request, WhenCommandsStop

OVERRIDE_TIME: Final = 0.1  # input beyond a threshold for this long is the driver taking over [s]
ACTIVITY_TIME: Final = 0.02  # [s]
PEDAL_ACTIVITY, BRAKE_OVERRIDE, THROTTLE_OVERRIDE = 0.18, 0.22, 0.30  # pedal sensor
WHEEL_OVERRIDE: Final = 3.0  # driver's torque on the steering wheel [N m]
REST_SPEED: Final = 0.05  # slower counts as standing [m/s]
SHIFT_BRAKE: Final = 200.0  # brake torque that the shifter takes for a pressed pedal [N m]
SHIFT_TIME: Final = 0.5  # [s]
WATCHDOG_DECELERATION: Final = 2.5  # of a watchdog whose strength nobody states [m/s2]
# A foot asks for nothing up to the first position of the brake pedal's sensor, and for all from the second on.
FOOT_RANGE: Final = (0.175, 0.33)
FOOT_TORQUE: Final = 3400.0  # that a whole foot asks for [N m]
THROTTLE_END: Final = 0.80  # sensor of a floored pedal

BRAKE, THROTTLE, STEERING = 0, 1, 2


@dataclass(frozen=True, slots=True)
class DecodedCommands:
    """What the commands of one step say together, in SI units; NaN for what the wire does not take."""

    brake_torque: float
    throttle: float
    acceleration: float
    wheel_angle: float
    wheel_rate: float  #: 0 is the controller's own
    gear: Gear
    enable: bool
    clear: bool


NO_COMMANDS: Final = DecodedCommands(0.0, 0.0, math.nan, 0.0, 0.0, Gear.NONE, enable=False, clear=False)


def foot_torque(pedal: float) -> float:
    """Brake torque that a brake pedal sensor at `pedal` asks for [N m]."""
    begin, end = FOOT_RANGE
    return FOOT_TORQUE * clamp((pedal - begin) / (end - begin), 0.0, 1.0)


def foot_opening(pedal: float) -> float:
    """Throttle opening that an accelerator pedal sensor at `pedal` asks for, 0 to 1."""
    return clamp((pedal - PEDAL_REST) / (THROTTLE_END - PEDAL_REST), 0.0, 1.0)


class Controller:
    """One controller, stepped every `duration` [s].

    `timeout` [s] without a command ends what it does; `stops` is what it then does by itself, with `watchdog` [m/s2]
    where it brakes. Overrides that no command clears are cleared while nothing is enabled (`clears`).
    """

    def __init__(
        self,
        duration: float,
        timeout: float,
        rate_limit: float,
        stops: WhenCommandsStop,
        watchdog: float,
        *,
        clears: bool,
    ) -> None:
        self._duration, self._rate_limit = duration, rate_limit
        self._timeout_steps = round(timeout / duration)
        self._override_steps, self._activity_steps = round(OVERRIDE_TIME / duration), round(ACTIVITY_TIME / duration)
        self._shift_steps = round(SHIFT_TIME / duration)
        self._stops, self._clears = stops, clears
        self._watchdog = watchdog if math.isfinite(watchdog) else WATCHDOG_DECELERATION
        self.commands = NO_COMMANDS
        self.gear = Gear.PARK
        self.gear_override = False  #: the driver moved the lever; latched
        self.overrides = [False, False, False]  #: of brake, throttle and steering; latched
        self.driver = [False, False, False]  #: the driver is at it now
        self.watchdog_braking = False
        self.watchdog_fault = False  #: the watchdog has latched
        self.foot_torque = self.foot_opening = self.hand_torque = 0.0
        self.broken: int | None = None  #: of brake, throttle and steering
        self._beyond, self._touched = [0, 0, 0], [0, 0, 0]  # steps
        self._silent = self._timeout_steps  # steps since the last command
        self._angle = math.nan
        self._shift: tuple[int, Gear] | None = None  # steps that are left, and the gear

    @property
    def timed_out(self) -> bool:
        """Whether no command came for too long."""
        return self._silent >= self._timeout_steps

    @property
    def enabled(self) -> tuple[bool, bool, bool]:
        """Return whether brake, throttle and steering act on commands."""
        goes_on = not self.timed_out or self._stops is WhenCommandsStop.HOLDS
        on = self.commands.enable and goes_on and not any(self.overrides) and not self.watchdog_fault
        return on and self.broken != BRAKE, on and self.broken != THROTTLE, on and self.broken != STEERING

    def receive(self, commands: DecodedCommands, speed: float, brake_torque: float, *, in_time: bool) -> None:
        """Take what the commands say, at the car's `speed` [m/s] and applied `brake_torque` [N m].

        The time-out begins anew only `in_time`: when all of them have come.
        """
        self.commands = commands
        if in_time:
            self._silent = 0
        if commands.clear if self._clears else not commands.enable:
            self.overrides = [self._beyond[number] > 0 for number in range(3)]
            self.gear_override = False
        wanted, held = commands.gear, abs(speed) < REST_SPEED and brake_torque >= SHIFT_BRAKE
        if commands.enable and wanted not in (Gear.NONE, self.gear) and held and not self.gear_override:
            self._shift = self._shift or (self._shift_steps, wanted)

    def step(self, driver: DriverInputs, speed: float, wheel_angle: float) -> Request:
        """Advance by one step; `speed` [m/s] and steering `wheel_angle` [rad] are the car's own measurements."""
        if driver is not HANDS_OFF or any(self._beyond) or any(self.driver):
            self._feel(driver)
        self._move_lever(driver.gear, speed)
        moving_on = self.commands.enable and not self.timed_out
        self._silent += 1
        if moving_on and self.timed_out and self._stops is WhenCommandsStop.BRAKES and not any(self.overrides):
            self.watchdog_fault = self.watchdog_braking = True
        if self.watchdog_fault and any(self.driver):
            self.watchdog_braking = False
        if driver.acknowledge:
            self.watchdog_fault = self.watchdog_braking = False
        if self._shift is not None:
            left, gear = self._shift
            self._shift = (left - 1, gear) if left > 1 else None
            self.gear = gear if left <= 1 else self.gear
        return self._request(wheel_angle)

    def _request(self, wheel_angle: float) -> Request:
        brake, throttle, steering = self.enabled
        commands = self.commands
        torque = max(commands.brake_torque if brake else 0.0, self.foot_torque)
        opening = max(commands.throttle if throttle else 0.0, self.foot_opening)
        acceleration = commands.acceleration
        if not (brake and throttle):
            # What is left of a longitudinal controller of which one half has failed.
            acceleration = min(acceleration, 0.0) if brake else max(acceleration, 0.0) if throttle else math.nan
        if self.watchdog_braking:
            acceleration = -self._watchdog
        if self.foot_torque > 0.0 and acceleration > 0.0:
            acceleration = 0.0
        return Request(torque, opening, self._steer(wheel_angle, steering), acceleration)

    def _steer(self, wheel_angle: float, enabled: bool) -> float:
        if not enabled:
            self._angle = math.nan
            return math.nan
        here = wheel_angle if math.isnan(self._angle) else self._angle
        rate = self.commands.wheel_rate or self._rate_limit
        change = min(rate, self._rate_limit) * self._duration
        self._angle = here + clamp(self.commands.wheel_angle - here, -change, change)
        return self._angle

    def _feel(self, driver: DriverInputs) -> None:
        self.foot_torque, self.foot_opening = foot_torque(driver.brake_pedal), foot_opening(driver.throttle_pedal)
        self.hand_torque = driver.steering_torque
        inputs = (
            (driver.brake_pedal, PEDAL_ACTIVITY, BRAKE_OVERRIDE),
            (driver.throttle_pedal, PEDAL_ACTIVITY, THROTTLE_OVERRIDE),
            (abs(driver.steering_torque), 0.5 * WHEEL_OVERRIDE, WHEEL_OVERRIDE),
        )
        for number, (value, activity, override) in enumerate(inputs):
            self._touched[number] = self._touched[number] + 1 if value > activity else 0
            self._beyond[number] = self._beyond[number] + 1 if value > override else 0
            self.driver[number] = self._touched[number] >= self._activity_steps
            self.overrides[number] |= self._beyond[number] >= self._override_steps

    def _move_lever(self, gear: Gear, speed: float) -> None:
        """Follow the driver's lever: neutral at any speed, the rest at rest; out of park with a foot on the brake."""
        if gear is Gear.NONE:
            return
        self.gear_override = True
        if gear is self.gear or self._shift is not None:
            return
        if self.gear is Gear.PARK:
            follows = self.foot_torque >= SHIFT_BRAKE
        else:
            rolls_on = self.gear is Gear.NEUTRAL and gear is Gear.DRIVE and speed > 0.0
            follows = gear is Gear.NEUTRAL or rolls_on or abs(speed) < REST_SPEED
        if follows:
            self._shift = (self._shift_steps, gear)
