"""A small car for closing the loop in tests: point mass, first-order pedals, and a drive-by-wire kit that answers.

Written from the kit's described behaviour and from Newton's law, not from the gateway.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from tests import vehicles
from tests.setpoints import setpoint as complete
from vve_sumo.values import ArmingState, Frame, GatewayStatus, Setpoint
from vve_sumo.vehicle.arming_machine import OperatorCommand
from vve_sumo.vehicle.dataspeed import codec, messages
from vve_sumo.vehicle.dataspeed.interface import DataspeedDbw1
from vve_sumo.vehicle.dataspeed.pedals import torque_to_pedal
from vve_sumo.vehicle.gateway import Gateway
from vve_sumo.vehicle.interface import Gear

PERIOD = 0.02
GRAVITY = 9.80665

FUSION, CALIBRATION = vehicles.FUSION.vehicle, vehicles.FUSION.calibration


@dataclass
class Car:
    """A car on a grade [rad, uphill positive] whose mass and brakes may differ from what is believed of them."""

    mass: float = 1690.0
    brake_gain: float = 1.0
    grade: float = 0.0
    drive_lag: float = 0.25
    brake_lag: float = 0.05
    shift_time: float = 0.5
    gear: Gear = Gear.PARK
    variant: codec.Variant = codec.Variant.DBW1_2024
    speed: float = 0.0
    wheel_angle: float = 0.0
    x: float = 0.0
    y: float = 0.0
    heading: float = 0.0
    enabled: bool = False
    override: bool = False  #: latched on the brake by a foot, which the pedal shows for as long
    steering_stuck: bool = False
    driver_brake: bool = False  #: the driver's foot, below what counts as taking over
    foreign_torque: float = 0.0  #: brake torque that another node commands [N m]
    silent: set[int] = field(default_factory=set)
    forged: dict[int, Frame] = field(default_factory=dict)
    _torque: float = 0.0
    _throttle: float = 0.0
    _brake_pipe: list[float] = field(default_factory=lambda: [0.0, 0.0])
    _wanted: Gear = Gear.NONE
    _shifting: float = 0.0
    _angle_wish: float = 0.0
    _throttle_wish: float = 0.0
    _brake_echo: float = 0.0
    _throttle_echo: float = 0.0

    def hear(self, frames: tuple[Frame, ...]) -> None:
        """Obey command frames, as the kit does."""
        brake, throttle, steering, gear = (codec.decode(frame, self.variant) for frame in frames)
        if brake.clear and throttle.clear and steering.clear:
            self.override = False
        self.enabled = brake.enable and throttle.enable and steering.enable and not self.override
        self._brake_echo, self._throttle_echo = brake.value, throttle.value
        self._brake_pipe.append(brake.value if self.enabled else 0.0)
        self._throttle_wish = throttle.value if self.enabled else 0.0
        if self.enabled and not self.steering_stuck:
            self._angle_wish = steering.wheel_angle
        if gear.gear is not self._wanted:
            self._wanted, self._shifting = gear.gear, 0.0

    def advance(self, period: float = PERIOD, steps: int = 10) -> None:
        """Move on by one period."""
        torque_wish = max(self._brake_pipe.pop(0), 400.0 if self.driver_brake else 0.0, self.foreign_torque)
        self._shift(period)
        for _ in range(steps):
            self.heading += self.yaw_rate * period / steps
            self.x += self.speed * math.cos(self.heading) * period / steps
            self.y += self.speed * math.sin(self.heading) * period / steps
            self._advance(period / steps, torque_wish)
        self.wheel_angle += (self._angle_wish - self.wheel_angle) * period / (0.1 + period)

    def reports(self) -> list[Frame]:
        """Frames of one period."""
        wheel = self.speed / FUSION.wheel_radius
        said = [
            codec.BrakeReport(
                messages.BrakeReportKind.PEDAL,
                self.pedal,
                torque_to_pedal(self._brake_echo),
                0.15,
                self.enabled,
                override=self.override,
                driver=self.driver_brake or self.override,
            ),
            codec.ThrottleReport(0.15, 0.15 + 0.65 * self._throttle_echo, 0.15, self.enabled),
            codec.SteeringReport(self.wheel_angle, self._angle_wish, abs(self.speed), 0.0, self.enabled),
            codec.GearReport(self.gear, self._wanted),
            codec.WheelSpeeds(wheel, wheel, wheel, wheel),
            codec.Accelerations(0.0, 0.0, GRAVITY),
            codec.YawRate(0.0, self.yaw_rate),
            codec.BrakeInfo(0.0, max(self._torque, 0.0), self.speed == 0.0),
        ]
        frames = [codec.encode(message, self.variant) for message in said]
        return [self.forged.get(frame.id, frame) for frame in frames if frame.id not in self.silent]

    @property
    def pedal(self) -> float:
        """Brake pedal sensor: an override comes from 0.22 on, a touch from 0.18 on."""
        if self.override:
            return 0.25
        return 0.19 if self.driver_brake else 0.15

    @property
    def yaw_rate(self) -> float:
        return self.speed * math.tan(self.wheel_angle / FUSION.steering_ratio) / FUSION.wheelbase

    def _shift(self, period: float) -> None:
        if self._wanted not in (Gear.NONE, self.gear):
            self._shifting += period
            if self._shifting >= self.shift_time and abs(self.speed) < 0.5:
                self.gear = self._wanted

    def _advance(self, dt: float, torque_wish: float) -> None:
        self._torque += (torque_wish - self._torque) * dt / self.brake_lag
        self._throttle += (self._throttle_wish - self._throttle) * dt / self.drive_lag
        speed = self.speed
        push = -self.mass * GRAVITY * math.sin(self.grade)
        if self.gear is Gear.DRIVE:
            push += self._throttle * min(6500.0, 120_000.0 / max(speed, 1.0))
            push += 600.0 * max(0.0, 1.0 - max(speed, 0.0) / 2.0)
        push -= 0.5 * 1.2 * 0.62 * speed * abs(speed)
        grip = self.brake_gain * self._torque / (550.0 / 1690.0) + 0.012 * self.mass * GRAVITY
        if self.gear is Gear.PARK:
            grip += 20_000.0
        if speed == 0.0:
            push = math.copysign(max(abs(push) - grip, 0.0), push)
            self.speed = push / self.mass * dt
            return
        after = speed + (push - math.copysign(grip, speed)) / self.mass * dt
        # Friction stops a car, it doesn't turn it round.
        self.speed = 0.0 if after * speed < 0.0 else after


@dataclass
class Rig:
    """A gateway and a car, run together tick by tick."""

    car: Car = field(default_factory=Car)
    gateway: Gateway | None = None
    tick: int = -1
    sequence: int = 0
    frames: tuple[Frame, ...] = ()

    def __post_init__(self) -> None:
        if self.gateway is None:
            self.gateway = Gateway(FUSION, CALIBRATION, period=PERIOD, interface=DataspeedDbw1(self.car.variant))

    @property
    def now(self) -> float:
        return self.tick * PERIOD

    def setpoint(self, acceleration: float = 0.0, steering: float = 0.0, **changes: object) -> Setpoint:
        """The setpoint that an honest drive would send now."""
        self.sequence += 1
        values = {
            "sequence": self.sequence,
            "time": self.now,
            "expires": self.now + 0.1,
            "x": self.car.x,
            "y": self.car.y,
            "heading": self.car.heading,
            "speed": self.car.speed,
            "yaw_rate": self.car.yaw_rate,
            "grade": self.car.grade,
        }
        return complete(steering, acceleration, **(values | changes))

    def step(
        self,
        acceleration: float | None = 0.0,
        steering: float = 0.0,
        command: OperatorCommand | None = None,
        extra: tuple[Frame, ...] = (),
        process_faults: tuple[str, ...] = (),
        **changes: object,
    ) -> GatewayStatus:
        """One tick; acceleration None sends no setpoint."""
        self.tick += 1
        setpoint = None if acceleration is None else self.setpoint(acceleration, steering, **changes)
        output = self.gateway.step(self.now, setpoint, [*self.car.reports(), *extra], command, process_faults)
        self.frames = output.frames
        self.car.hear(output.frames)
        self.car.advance()
        return output.status

    def run(self, duration: float, acceleration: float | None = 0.0, **arguments: object) -> list[GatewayStatus]:
        """Ticks for `duration` seconds."""
        return [self.step(acceleration, **arguments) for _ in range(round(duration / PERIOD))]

    def stand_by(self) -> None:
        """Bring the car to "engaged, in drive, held", or to where that fails."""
        self.step(command=OperatorCommand.ENGAGE)
        for _ in range(200):
            if self.step().reasons == ("waiting_for_go",):
                return

    def engage(self) -> None:
        """Bring the car to "engaged, in drive, standing, free to go"."""
        self.stand_by()
        self.step(command=OperatorCommand.GO)

    def cruise(self, speed: float = 10.0) -> None:
        """Engage, and accelerate to about `speed`."""
        self.engage()
        while self.car.speed < speed:
            assert self.step(1.5).state is ArmingState.ENGAGED
        self.run(1.0)

    def commands(self) -> list[codec.Message]:
        """What the frames of the last tick say."""
        return [codec.decode(frame, self.car.variant) for frame in self.frames]


def enabled(rig: Rig) -> set[bool]:
    """What the commands of brake, throttle and steering say of being enabled."""
    return {command.enable for command in rig.commands()[:3]}
