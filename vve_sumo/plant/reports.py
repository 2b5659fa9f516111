"""What the car says over CAN: the kit's reports and the car's own sensors, each at its rate.

Reads the kit's and the car's state and changes neither; the codec does the quantising.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from vve_sumo.plant.dynamics import Dynamics
from vve_sumo.plant.noise import White
from vve_sumo.values import Frame
from vve_sumo.vehicle.calibration import GRAVITY
from vve_sumo.vehicle.dataspeed import codec
from vve_sumo.vehicle.dataspeed.controller import (
    PEDAL_REST,
    REST,
    THROTTLE_TRAVEL_END,
    DbwController,
    pedal_to_torque,
    torque_to_pedal,
)
from vve_sumo.vehicle.dataspeed.messages import (
    Accelerations,
    BrakeInfo,
    BrakeReport,
    BrakeReportKind,
    Gear,
    GearReport,
    SteeringReport,
    ThrottleReport,
    WheelSpeeds,
    YawRate,
)

BRAKE_LIGHTS = 520.0  # torque from which they are lit [N m] (dbw_mkz_can)
TORQUE_SENSOR_LIMIT = 7.9  # of the driver's steering torque [N m]
_DRIVE_SIGNS = {Gear.DRIVE: 1.0, Gear.LOW: 1.0, Gear.REVERSE: -1.0}


class Axles(NamedTuple):
    """What turns the car's motion into that of its wheels."""

    wheelbase: float  #: [m]
    track: float  #: [m]
    wheel_radius: float  #: rolling [m]


def _throttle_pedal(throttle: float) -> float:
    return PEDAL_REST + throttle * (THROTTLE_TRAVEL_END - PEDAL_REST)


class Reports:
    """Makes the frames that are due."""

    def __init__(self, axles: Axles, gyro_noise: float, white: White, gyro_bias: float = 0.0) -> None:
        """`gyro_noise` is the standard deviation of the yaw rate, `gyro_bias` its mean [rad/s], `white` its source."""
        self._axles = axles
        self._gyro_bias = gyro_bias
        self._gyro_noise = gyro_noise
        self._white = white

    def fast(self, motion: Dynamics, road_angle: float, variant: codec.Variant) -> list[Frame]:
        """What is sent at 100 Hz: wheel speeds, accelerometers, gyroscope."""
        felt = motion.acceleration + GRAVITY * math.sin(motion.grade)
        yaw_rate = motion.yaw_rate + self._gyro_bias + self._gyro_noise * self._white.draw()
        return [
            codec.encode(self._wheels(motion, road_angle), variant),
            codec.encode(Accelerations(felt, motion.speed * motion.yaw_rate, GRAVITY), variant),
            codec.encode(YawRate(0.0, yaw_rate), variant),
        ]

    def slow(self, kit: DbwController, motion: Dynamics, wheel_angle: float, brake_torque: float) -> list[Frame]:
        """What is sent at 50 Hz: brake, throttle and steering modules, and the car's brake controller.

        `wheel_angle` is the steering wheel's [rad], `brake_torque` what the brake controller believes to apply [N m].
        """
        variant = kit.parameters.variant
        info = BrakeInfo(
            torque_requested=kit.request.brake_torque,
            torque_actual=brake_torque,
            stationary=abs(motion.speed) < REST,
            acceleration_over_ground=motion.acceleration,
        )
        return [
            codec.encode(self._brake(kit), variant),
            codec.encode(self._throttle(kit), variant),
            codec.encode(self._steering(kit, wheel_angle, motion.speed), variant),
            codec.encode(info, variant),
        ]

    def gear(self, kit: DbwController) -> Frame:
        """What is sent at 20 Hz: the shift module."""
        return codec.encode(GearReport(kit.gear, kit.gear_command, reject=kit.gear_reject), kit.parameters.variant)

    def _wheels(self, motion: Dynamics, road_angle: float) -> WheelSpeeds:
        """Each wheel rolls with the speed of its place on the car along its own plane."""
        wheelbase, track, radius = self._axles
        half = 0.5 * track * motion.yaw_rate
        across = math.sin(road_angle) * (motion.lateral_speed + wheelbase * motion.yaw_rate)
        along = math.cos(road_angle)
        left, right = motion.speed - half, motion.speed + half
        return WheelSpeeds(
            (left * along + across) / radius, (right * along + across) / radius, left / radius, right / radius
        )

    def _brake(self, kit: DbwController) -> BrakeReport:
        module, driver = kit.brake, kit.driver.brake_pedal
        command, output = kit.commanded_torque(), kit.request.brake_torque
        kind = BrakeReportKind.TORQUE
        if kit.parameters.variant is codec.Variant.DBW1_2018:
            kind, command, output = BrakeReportKind.PEDAL, torque_to_pedal(command), torque_to_pedal(output)
        else:
            driver = pedal_to_torque(driver)
        return BrakeReport(
            kind,
            driver,
            command,
            output,
            module.enabled,
            lights=kit.request.brake_torque >= BRAKE_LIGHTS,
            override=module.override,
            driver=module.driver,
            timeout=module.timeout,
            watchdog_braking=kit.watchdog_braking,
            watchdog_source=module.source,
            fault_watchdog=kit.fault,
        )

    def _throttle(self, kit: DbwController) -> ThrottleReport:
        module = kit.throttle
        return ThrottleReport(
            kit.driver.throttle_pedal,
            _throttle_pedal(kit.commanded_throttle()),
            _throttle_pedal(kit.request.throttle),
            module.enabled,
            override=module.override,
            driver=module.driver,
            timeout=module.timeout,
            watchdog_source=module.source,
            fault_watchdog=kit.fault,
        )

    def _steering(self, kit: DbwController, wheel_angle: float, speed: float) -> SteeringReport:
        module = kit.steering
        signless = kit.parameters.variant is codec.Variant.DBW1_2018
        torque = min(max(kit.driver.steering_torque, -TORQUE_SENSOR_LIMIT), TORQUE_SENSOR_LIMIT)
        return SteeringReport(
            wheel_angle,
            kit.commanded_wheel_angle(),
            abs(speed) if signless else speed,
            torque,
            module.enabled,
            override=module.override,
            timeout=module.timeout,
            fault_watchdog=kit.fault,
        )


def drive_sign(gear: Gear) -> float:
    """Which way the engine pushes in `gear`: 1 forward, -1 backward, 0 not at all."""
    return _DRIVE_SIGNS.get(gear, 0.0)
