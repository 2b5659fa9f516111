"""The simulated vehicle: takes command frames and returns reports and its receiver's bytes, as the real one does.

One object models everything from the bus to the receiver; it knows no street, no gateway and no controller.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import numpy as np

from vve_sumo.frames import MapFrame
from vve_sumo.frozen import fast_frozen
from vve_sumo.plant.acceleration_errors import AccelerationErrors
from vve_sumo.plant.actuators import Lagged, Steering
from vve_sumo.plant.dynamics import Chassis, Dynamics
from vve_sumo.plant.noise import white
from vve_sumo.plant.onboard_sensors import Axles, OnboardSensors, SensorErrors
from vve_sumo.plant.receiver import ReceiverParameters, SimulatedReceiver, unaltered
from vve_sumo.plant.wheel_errors import WheelErrors
from vve_sumo.pose.receivers.port import Receiver, standard
from vve_sumo.values import Fix, Frame, Point, Pose, Vehicle
from vve_sumo.vehicle.calibration import Calibration
from vve_sumo.vehicle.interface import (
    HANDS_OFF,
    DriverInputs,
    Gear,
    InterfaceConfig,
    Measured,
    SimulatedInterface,
    load,
)
from vve_sumo.vehicle.model import IDEAL, Imperfections

STEP: Final = 0.005  # of the integration and of the drive-by-wire controller [s]
STEPS_PER_SECOND = round(1.0 / STEP)
FAST: Final = 2  # steps between measurements: 100 Hz; reports and fixes come with them
# In Python 3.11 naming a member of an enumeration is a call; code that runs in every step names these instead.
_PARK, _REAR_AXLE = Gear.PARK, Point.REAR_AXLE
_DRIVE_SIGNS = {Gear.DRIVE: 1.0, Gear.LOW: 1.0, Gear.REVERSE: -1.0}


@dataclass(frozen=True, slots=True)
class CarParameters:
    """The car as declared, its undeclared parameters, and how the true car differs from its declaration."""

    vehicle: Vehicle  #: as declared
    calibration: Calibration  #: as declared
    interface: InterfaceConfig  #: of the drive-by-wire controller
    receiver: ReceiverParameters
    track: float  #: between the wheels of an axle [m]
    mass_height: float  #: of the centre of mass above ground [m]
    friction: float  #: of tyre on road
    throttle_delay: float  #: dead time from frame to first force [s]
    gyro_noise: float = 1e-3  #: of the car's own gyroscope, 1 sigma [rad/s]
    gyro_bias: float = 0.0  #: what the car's own gyroscope measures at rest [rad/s], counter-clockwise
    mass_factor: float = 1.0  #: true over declared mass, and yaw inertia with it
    brake_gain_factor: float = 1.0  #: true over reported brake torque; the car's own reports don't show it
    grade: float = 0.0  #: slope along the car's path [rad], uphill positive
    steering_wheel_bias: float = 0.0  #: reported wheel angle at which the wheels point straight [rad], left positive
    wheel_radius_factor: float = 1.0  #: true over declared rolling radius
    heading_misalignment: float = 0.0  #: of the receiver beyond its declared mounting [rad], counter-clockwise
    steering_delay: float = 0.0  #: dead time of the steering beyond the declared one [s]
    imperfections: Imperfections = IDEAL  #: of sensors, brakes, tyres and receiver


class ActuatorFaults(NamedTuple):
    """How the true actuators differ from what the car's modules believe of them; the defaults are a healthy car's."""

    brake_share: float = 1.0  #: true share of the torque that the brake actuator is believed to give, not the foot
    brake_drag: float = 0.0  #: torque with which the brakes bind, which is neither asked for nor reported [N m]
    stuck_throttle: float = 0.0  #: smallest opening to which the throttle closes, 0 to 1
    drive_share: float = 1.0  #: true share of the engine's force at its throttle
    steering_share: float = 1.0  #: true share of the steering wheel's movement in each step


HEALTHY = ActuatorFaults()


def as_measured(_time: float, measured: Measured) -> Measured:
    """What the sensors measure, as it is."""
    return measured


@fast_frozen
@dataclass(frozen=True, slots=True)
class CarOutput:
    """What the car sent during a step, in order of time."""

    reports: list[tuple[float, Frame]]  #: drive time [s] and frame
    packets: list[tuple[float, bytes]]  #: of the receiver: drive time of arrival [s] and bytes


def chassis(parameters: CarParameters) -> Chassis:
    """The chassis of the true car."""
    vehicle, calibration = parameters.vehicle, parameters.calibration
    return Chassis(
        mass=vehicle.mass * parameters.mass_factor,
        yaw_inertia=vehicle.yaw_inertia * parameters.mass_factor,
        wheelbase=vehicle.wheelbase,
        front_axle_to_mass=vehicle.front_axle_to_mass,
        cornering_stiffness_front=vehicle.cornering_stiffness_front,
        cornering_stiffness_rear=vehicle.cornering_stiffness_rear,
        mass_height=parameters.mass_height,
        friction=parameters.friction,
        rolling_resistance=calibration.rolling_resistance,
        drag_area=calibration.drag_area,
        combined_slip=parameters.imperfections.combined_slip,
    )


class Car:
    """A car on the lot, from standstill in park at drive time `begin` [s], a multiple of 5 ms.

    `start` is x, y [m] and heading [rad] of the rear axle in the `lot` map; `epoch` the GNSS second of drive time 0;
    `seeds` is spawned from, one child for each source of noise; `alter` injects faults into fixes (see `Receiver`),
    `alter_measured` into what the car's own sensors measured by a time [s]. The car speaks as its `receiver` does, the
    standard one without another.
    """

    def __init__(
        self,
        parameters: CarParameters,
        start: tuple[float, float, float],
        lot: MapFrame,
        epoch: float,
        seeds: np.random.SeedSequence,
        alter: Callable[[Fix], Fix | None] = unaltered,
        alter_measured: Callable[[float, Measured], Measured] = as_measured,
        receiver: Receiver | None = None,
        begin: float = 0.0,
    ) -> None:
        vehicle, calibration = parameters.vehicle, parameters.calibration
        self._parameters = parameters
        self._motion = Dynamics(chassis(parameters), start, grade=parameters.grade)
        self._interface = load(parameters.interface).simulated(STEP)
        self._brakes = Lagged(vehicle.brake_delay, vehicle.brake_lag, STEP)
        self._engine = Lagged(parameters.throttle_delay, calibration.drive_lag, STEP)
        self._steering = Steering(
            vehicle.steering_delay + parameters.steering_delay,
            vehicle.steering_lag,
            vehicle.steering_rate_limit * vehicle.steering_ratio,
            vehicle.steering_limit * vehicle.steering_ratio,
            STEP,
        )
        gyro_seeds, receiver_seeds = seeds.spawn(2)
        gyro_noise = parameters.receiver.noise * parameters.gyro_noise
        radius = vehicle.wheel_radius * parameters.wheel_radius_factor
        axles = Axles(vehicle.wheelbase, parameters.track, radius)
        errors = _sensor_errors(parameters, seeds)
        self._sensors = OnboardSensors(axles, gyro_noise, white(gyro_seeds), parameters.gyro_bias, errors)
        encoder = (standard() if receiver is None else receiver).encoder()
        self._receiver = SimulatedReceiver(_as_mounted(parameters), lot, epoch, receiver_seeds, alter, encoder, begin)
        gain_factor = parameters.brake_gain_factor * parameters.imperfections.brake_gain_factor
        self._brake_force = gain_factor * calibration.brake_force(1.0)
        self._calibration, self._wheel_bias = calibration, parameters.steering_wheel_bias
        self._steering_ratio = vehicle.steering_ratio
        self.actuator_faults = HEALTHY
        self._alter_measured = alter_measured
        self._steps = round(begin * STEPS_PER_SECOND)

    @property
    def interface(self) -> SimulatedInterface:
        """The drive-by-wire controller, to be read only."""
        return self._interface

    @property
    def brake_torque(self) -> float:
        """Applied brake torque by the car's own estimate [N m]."""
        return self._brakes.value

    @property
    def wheel_angle(self) -> float:
        """Angle of the steering wheel [rad], left positive."""
        return self._steering.angle

    def step(self, until: float, frames: Sequence[Frame], driver: DriverInputs = HANDS_OFF) -> CarOutput:
        """Take in `frames`, then advance to drive time `until` [s], a multiple of 5 ms, under the same `driver` inputs.

        Raises ValueError for a time that is no such multiple.
        """
        last = round(until / STEP)
        if abs(last * STEP - until) > 1e-6:
            raise ValueError(f"the car advances in steps of {STEP} s, got until={until!r}")
        self._interface.receive(frames, self._motion.speed, self._brakes.value)
        reports: list[tuple[float, Frame]] = []
        while self._steps < last:
            self._advance(driver)
            if self._steps % FAST == 0:
                self._speak(reports)
        return CarOutput(reports, self._receiver.arrived(until))

    @property
    def speed(self) -> float:
        """True speed of the rear axle [m/s], forward positive."""
        return self._motion.speed

    def truth(self) -> Pose:
        """True pose of the rear axle in the lot map, for analysis only."""
        motion = self._motion
        return Pose(
            self._time,
            _REAR_AXLE,
            motion.x,
            motion.y,
            motion.heading,
            motion.speed,
            motion.lateral_speed,
            motion.yaw_rate,
            motion.acceleration,
            motion.grade,
        )

    @property
    def _time(self) -> float:
        # A quotient of integers, so that a tick's time is bit for bit the number that the drive computes.
        return self._steps / STEPS_PER_SECOND

    def _advance(self, driver: DriverInputs) -> None:
        motion, interface, steering = self._motion, self._interface, self._steering
        brake_torque, opening, wheel_angle, acceleration = interface.step(driver, motion.speed, steering.angle)
        if acceleration == acceleration:
            brake_torque, opening = self._pedals(acceleration, brake_torque, opening)
        torque = self._brakes.step(brake_torque)
        faults = self.actuator_faults
        throttle = self._engine.step(max(opening, faults.stuck_throttle))
        angle = steering.angle
        steering.step(wheel_angle, motion.speed != 0.0)
        if faults.steering_share != 1.0:
            steering.angle = angle + faults.steering_share * (steering.angle - angle)
        gear = interface.gear
        if gear is _PARK:
            held = math.inf
        else:
            held = self._brake_force * (torque if faults is HEALTHY else self._true_torque(torque))
        motion.advance(STEP, self._road_angle(), self._drive_force(gear, throttle), held)
        self._steps += 1

    def _pedals(self, acceleration: float, brake_torque: float, opening: float) -> tuple[float, float]:
        """Brake torque [N m] and throttle opening of a car that gives an `acceleration` [m/s2] by itself.

        Its controller knows the declared car and the grade; a foot that asks for more of either pedal gets it.
        """
        calibration, motion = self._calibration, self._motion
        force = calibration.force(acceleration, math.sin(motion.grade), motion.speed)
        if force > 0.0:
            return brake_torque, max(opening, calibration.throttle(force, max(motion.speed, 0.0)))
        return max(brake_torque, calibration.brake_torque(-force)), opening

    def _true_torque(self, torque: float) -> float:
        """True brake torque for the estimated `torque` [N m]; only the actuator is weak, not the driver's foot."""
        share, drag = self.actuator_faults.brake_share, self.actuator_faults.brake_drag
        return max(share * torque, min(torque, self._interface.driver_brake_torque)) + drag

    def _road_angle(self) -> float:
        return (self._steering.angle - self._wheel_bias) / self._steering_ratio

    def _drive_force(self, gear: Gear, throttle: float) -> float:
        """Force at the wheels [N] by throttle and idle creep, in the direction of the gear."""
        sign = _DRIVE_SIGNS.get(gear, 0.0)
        calibration, speed = self._calibration, sign * self._motion.speed
        force = self.actuator_faults.drive_share * calibration.drive_force(throttle, max(speed, 0.0))
        return sign * (force + calibration.creep(speed))

    def _speak(self, reports: list[tuple[float, Frame]]) -> None:
        motion, time = self._motion, self._time
        measured = self._sensors.measure(motion, self._road_angle(), self._steering.angle, self._brakes.value)
        reports += [(time, frame) for frame in self._interface.reports(self._alter_measured(time, measured))]
        self._receiver.measure(self.truth(), motion.distance * math.tan(motion.grade))


def _sensor_errors(parameters: CarParameters, seeds: np.random.SeedSequence) -> SensorErrors | None:
    """Return the errors of wheels and accelerometers, None for ideal ones; further children are spawned of `seeds`."""
    imperfections, size = parameters.imperfections, parameters.receiver.noise
    if imperfections == IDEAL or size == 0.0:
        return None
    wheels, accelerations = seeds.spawn(2)
    return SensorErrors(
        WheelErrors(imperfections, size, FAST * STEP, wheels),
        AccelerationErrors(imperfections, size, FAST * STEP, accelerations),
    )


def _as_mounted(parameters: CarParameters) -> ReceiverParameters:
    """The receiver with its true mounting on the car, and the car's imperfections."""
    mounting = parameters.receiver.mounting
    turned = mounting.heading_misalignment + parameters.heading_misalignment
    mounted = replace(mounting, heading_misalignment=turned)
    return replace(parameters.receiver, mounting=mounted, imperfections=parameters.imperfections)
