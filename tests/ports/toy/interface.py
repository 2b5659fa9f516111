"""A drive-by-wire interface of an invented wire, as an example of how one is written: one command and two reports.

Big endian: command 0x300, reports 0x310 every 20 ms and 0x311 every 10 ms. Every frame ends with a counter of four bits
and a checksum, the sum of all bytes before it and of the identifier. A report whose checksum is wrong, or whose counter
stands still, is malformed; such a command is not followed. The one setting is `brake_nm`, the torque at full brake.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Mapping, Sequence

from vve_sumo.errors import ConfigError
from vve_sumo.values import Frame
from vve_sumo.vehicle.interface import (
    ActuationCommand,
    BrakeState,
    BrakeTorque,
    Commanded,
    CommandsStop,
    DriverInputs,
    Gear,
    GearState,
    InterfaceFacts,
    Malformed,
    Measured,
    Report,
    Request,
    SettingValue,
    SteeringState,
    ThrottleState,
    WheelSpeeds,
    WhenCommandsStop,
    YawRate,
)

COMMAND, STATUS, MOTION = 0x300, 0x310, 0x311
# Brake, throttle: 8 bits of full scale. Steering: 0.001 rad. Flags: gear, enable, clear.
_COMMAND = struct.Struct(">BBhB")
# Flags of brake, throttle and steering; steering wheel 0.001 rad; gear; brake 8 bits of full scale.
_STATUS = struct.Struct(">BhBB")
# Mean wheel speed of the rear axle 0.01 rad/s, the difference of its wheels 0.01 rad/s, yaw rate 0.001 rad/s.
_MOTION = struct.Struct(">hbh")
ANGLE, WHEEL, YAW = 1e-3, 1e-2, 1e-3
ANGLE_LIMIT, RATE_LIMIT = 9.0, 12.0  # [rad], [rad/s]
TIMEOUT, TAKE_OVER = 0.2, 0.3  # [s], pedal sensor
TAKE_OVER_TORQUE = 3.0  # of the driver on the steering wheel [N m]
INVALID = -32768
_ENABLED, _OVERRIDE, _DRIVER, _TIMEOUT, _FAULT = 1, 2, 4, 8, 16


def _sealed(identifier: int, body: bytes, counter: int) -> Frame:
    body += bytes((counter & 15,))
    return Frame(identifier, body + bytes(((sum(body) + identifier) & 255,)))


def _opened(frame: Frame, layout: struct.Struct) -> bytes | None:
    data = frame.data
    whole = len(data) == layout.size + 2 and data[-1] == (sum(data[:-1]) + frame.id) & 255
    return data[:-1] if whole else None


def _counts(value: float, limit: float, step: float, what: str) -> int:
    if not -limit <= value <= limit:
        raise ValueError(f"{what} must be within +-{limit:g}, got {value:g}")
    return round(value / step)


class Toy:
    """The car's side of the wire as the gateway sees it."""

    def __init__(self, brake: float) -> None:
        self.brake = brake
        self.facts = InterfaceFacts(
            title="toy",
            commands=frozenset({COMMAND}),
            reports={
                STATUS: (BrakeState, ThrottleState, SteeringState, GearState, BrakeTorque),
                MOTION: (WheelSpeeds, YawRate),
            },
            occupied=frozenset({COMMAND, STATUS, MOTION}),
            brake_torque_limit=brake,
            wheel_angle_limit=ANGLE_LIMIT,
            wheel_rate_limit=RATE_LIMIT,
            command_timeout=TIMEOUT,
            when_commands_stop=CommandsStop(WhenCommandsStop.RELEASES, "lets go of pedals and steering"),
        )
        self._counter = -1
        self._heard: dict[int, int] = {}

    def encode(self, command: ActuationCommand) -> tuple[Frame, ...]:
        """One frame; the steering's rate is the toy's own."""
        if not 0.0 <= command.brake_torque <= self.brake or not 0.0 <= command.throttle <= 1.0:
            raise ValueError(f"brakes must be 0 to {self.brake:g}, throttle 0 to 1; got {command}")
        if not 0.0 <= command.wheel_rate <= RATE_LIMIT:
            raise ValueError(f"steering-wheel rate must be 0 to {RATE_LIMIT:g}, got {command.wheel_rate:g}")
        self._counter += 1
        body = _COMMAND.pack(
            round(command.brake_torque / self.brake * 255.0),
            round(command.throttle * 255.0),
            _counts(command.wheel_angle, ANGLE_LIMIT, ANGLE, "steering-wheel angle"),
            command.gear | command.enable << 4 | command.clear << 5,
        )
        return (_sealed(COMMAND, body, self._counter),)

    def decode(self, frame: Frame) -> tuple[Report, ...] | Malformed:
        """All that a status or a motion frame says."""
        layout = {STATUS: _STATUS, MOTION: _MOTION}.get(frame.id)
        if layout is None:
            return ()
        body = _opened(frame, layout)
        if body is None or self._heard.get(frame.id) == body[-1]:
            return Malformed(frame.id, "checksum" if body is None else "counter")
        self._heard[frame.id] = body[-1]
        return self._status(frame.id, body) if frame.id == STATUS else _motion(body)

    def _status(self, identifier: int, body: bytes) -> tuple[Report, ...] | Malformed:
        flags, angle, gear, torque = _STATUS.unpack_from(body)
        if gear > Gear.LOW:
            return Malformed(identifier, "gear")
        enabled, override, driver, timeout, fault = (
            bool(flags & bit) for bit in (_ENABLED, _OVERRIDE, _DRIVER, _TIMEOUT, _FAULT)
        )
        return (
            BrakeState(enabled, override, driver, timeout, fault),
            ThrottleState(enabled, override, False, timeout, fault),
            SteeringState(math.nan if angle == INVALID else angle * ANGLE, enabled, override, timeout, fault),
            GearState(Gear(gear), override),
            BrakeTorque(torque / 255.0 * self.brake),
        )

    def commanded(self, frame: Frame) -> Commanded | None:
        """All that a command says."""
        body = _opened(frame, _COMMAND) if frame.id == COMMAND else None
        if body is None:
            return None
        torque, throttle, angle, _flags = _COMMAND.unpack_from(body)
        return Commanded(torque / 255.0 * self.brake, throttle / 255.0, angle * ANGLE)

    def simulated(self, duration: float) -> SimulatedToy:
        """The other end."""
        return SimulatedToy(self.brake, duration)


def _motion(body: bytes) -> tuple[Report, ...]:
    mean, half, yaw = _MOTION.unpack_from(body)
    left, right = (math.nan, math.nan) if mean == INVALID else ((mean - half) * WHEEL, (mean + half) * WHEEL)
    return WheelSpeeds(left, right, left, right), YawRate(math.nan, yaw * YAW)


class SimulatedToy:
    """The toy's controller in a simulated vehicle: one enable for all, no watchdog of its own."""

    watchdog_braking = False
    #: one flag of fault and one of override for all subsystems: a fault of one alone cannot be said on this wire
    injectable = frozenset({"report_malformed"})

    def __init__(self, brake: float, duration: float) -> None:
        self.gear = Gear.PARK
        self.driver_brake_torque = 0.0
        self._brake, self._duration = brake, duration
        self._command, self._gear, self._enable = Commanded(0.0, 0.0, 0.0), Gear.NONE, False
        self._age = math.inf  # of the last command [s]
        self._counter = -1  # of the last command: one that stands still says nothing new
        self._override = self._driver = False
        self._broken: int | None = None
        self._angle = math.nan
        self._spoken = 0

    @property
    def enabled(self) -> tuple[bool, bool, bool]:
        on = self._enable and not self._override and self._age < TIMEOUT and self._broken is None
        return on, on, on

    def receive(self, frames: Sequence[Frame], speed: float, brake_torque: float) -> None:
        for frame in frames:
            body = _opened(frame, _COMMAND) if frame.id == COMMAND else None
            if body is None or body[-1] == self._counter:
                continue
            self._counter = body[-1]
            torque, throttle, angle, flags = _COMMAND.unpack_from(body)
            self._command = Commanded(torque / 255.0 * self._brake, throttle / 255.0, angle * ANGLE)
            self._gear, self._enable, self._age = Gear(flags & 7), bool(flags & 16), 0.0
            self._override = self._override and not flags & 32
            if self._gear is not Gear.NONE and abs(speed) < 0.05:
                self.gear = self._gear

    def step(self, driver: DriverInputs, speed: float, wheel_angle: float) -> Request:
        self._age += self._duration
        pressed, turned = max(driver.brake_pedal, driver.throttle_pedal), abs(driver.steering_torque)
        self._driver = pressed > 0.18
        self._override = self._override or pressed > TAKE_OVER or turned > TAKE_OVER_TORQUE
        self.driver_brake_torque = max(driver.brake_pedal - 0.18, 0.0) * 2e4
        if not self.enabled[0]:
            self._angle = math.nan
            return Request(self.driver_brake_torque, 0.0, math.nan)
        here = wheel_angle if math.isnan(self._angle) else self._angle
        change = RATE_LIMIT * self._duration
        self._angle = here + min(max(self._command.wheel_angle - here, -change), change)
        return Request(
            max(self._command.brake_torque, self.driver_brake_torque), self._command.throttle, self._angle
        )  # fmt: skip

    def reports(self, measured: Measured) -> list[Frame]:
        self._spoken += 1
        wheels = measured.wheels
        mean, half = INVALID, 0
        if all(map(math.isfinite, wheels)):
            mean = round(0.5 * (wheels.rear_left + wheels.rear_right) / WHEEL)
            half = min(max(round(0.5 * (wheels.rear_right - wheels.rear_left) / WHEEL), -128), 127)
        frames = [_sealed(MOTION, _MOTION.pack(mean, half, round(measured.rates.yaw / YAW)), self._spoken)]
        if self._spoken % 2 == 0:
            flags = (
                self.enabled[0] * _ENABLED
                | self._override * _OVERRIDE
                | self._driver * _DRIVER
                | (self._age >= TIMEOUT) * _TIMEOUT
                | (self._broken is not None) * _FAULT
            )
            torque = min(round(measured.brake_torque / self._brake * 255.0), 255)
            body = _STATUS.pack(flags, round(measured.wheel_angle / ANGLE), self.gear, torque)
            frames.append(_sealed(STATUS, body, self._spoken // 2))
        return frames

    def drop_out(self, subsystem: int | None) -> None:
        self._broken = subsystem

    def alter(self, time: float, frame: Frame, due: Callable[[str, float], float | None]) -> Frame:
        if frame.id == STATUS and due("report_malformed", time) is not None:
            return Frame(frame.id, frame.data[:-1])
        return frame


def make(settings: Mapping[str, SettingValue]) -> Toy:
    """Make the interface."""
    brake = settings.get("brake_nm")
    if set(settings) != {"brake_nm"} or not isinstance(brake, float) or not 0.0 < brake <= 10_000.0:
        raise ConfigError(f"settings must be brake_nm, a torque of at most 10000 N m; got {dict(settings)}")
    return Toy(brake)
