"""Simulated Dataspeed DBW1 controller: receives command frames and sends its reports, each at its rate.

`controller` defines its response to commands, `codec` the quantisation.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from vve_sumo.values import Frame
from vve_sumo.vehicle.dataspeed import codec, layout
from vve_sumo.vehicle.dataspeed.controller import REST_SPEED, DbwController
from vve_sumo.vehicle.dataspeed.messages import (
    BrakeInfo,
    BrakeReport,
    BrakeReportKind,
    GearReport,
    ParkingBrake,
    SteeringReport,
    ThrottleReport,
)
from vve_sumo.vehicle.dataspeed.pedals import THROTTLE_TRAVEL_END, pedal_to_torque, torque_to_pedal
from vve_sumo.vehicle.dataspeed.report_faults import KINDS, ReportFaults
from vve_sumo.vehicle.interface import PEDAL_REST, DriverInputs, Due, Gear, Measured, Request

BRAKE_LIGHTS: Final = 520.0  # torque from which the brake lights are on [N m] (dbw_mkz_can)
TORQUE_SENSOR_LIMIT: Final = 7.9  # of the driver's steering torque [N m]
MODULE_PERIOD, GEAR_PERIOD = 2, 5  # of reports, in hundredths of a second: 50 and 20 Hz

_INJECTABLE: Final = KINDS | {"gear_lever"}

# In Python 3.11 naming a member of an enumeration is a call; code that runs in every report names these instead.
_RELEASED, _BY_TORQUE = ParkingBrake.OFF, BrakeReportKind.TORQUE


class SimulatedDbw1:
    """A `SimulatedInterface`: the controller, its reports and their faults."""

    def __init__(self, controller: DbwController) -> None:
        self.controller = controller
        self._variant = controller.parameters.variant
        self._faults = ReportFaults(self._variant)
        self._is_old = self._variant is layout.Variant.DBW1_2018
        self._hundredths = 0

    @property
    def gear(self) -> Gear:
        """Return the gear that is engaged."""
        return self.controller.gear

    @property
    def enabled(self) -> tuple[bool, bool, bool]:
        """Return whether brake, throttle and steering act on commands."""
        brake, throttle, steering = self.controller.modules
        return brake.enabled, throttle.enabled, steering.enabled

    @property
    def watchdog_braking(self) -> bool:
        """Return whether the watchdog brakes."""
        return self.controller.watchdog_braking

    @property
    def injectable(self) -> frozenset[str]:
        """Return the kinds of fault that it can inject: of its reports, and the driver's gear lever."""
        return _INJECTABLE

    @property
    def driver_brake_torque(self) -> float:
        """Return the brake torque that the driver's foot asks for [N m]."""
        return pedal_to_torque(self.controller.driver.brake_pedal)

    def receive(self, frames: Sequence[Frame], speed: float, brake_torque: float) -> None:
        """Take in frames from the bus."""
        self.controller.receive(frames, speed, brake_torque)

    def step(self, driver: DriverInputs, speed: float, wheel_angle: float) -> Request:
        """Advance by one step."""
        return self.controller.step(driver, speed, wheel_angle)

    def drop_out(self, subsystem: int | None) -> None:
        """Make one module fail; None restores all."""
        self.controller.drop_out(subsystem)

    def alter(self, time: float, frame: Frame, due: Due) -> Frame:
        """Return what is sent at `time` in place of a report."""
        return self._faults.alter(time, frame, due)

    def reports(self, measured: Measured) -> list[Frame]:
        """Return the frames that are due: the car's sensors at 100 Hz, the modules at 50, the shifter at 20."""
        self._hundredths += 1
        variant = self._variant
        frames = [
            codec.encode(measured.wheels, variant),
            codec.encode(measured.accelerations, variant),
            codec.encode(measured.rates, variant),
        ]
        if self._hundredths % MODULE_PERIOD == 0:
            info = BrakeInfo(
                self.controller.request.brake_torque,
                measured.brake_torque,
                abs(measured.speed) < REST_SPEED,
                _RELEASED,
                measured.acceleration,
            )
            frames += [
                codec.encode(self._brake(), variant),
                codec.encode(self._throttle(), variant),
                codec.encode(self._steering(measured.wheel_angle, measured.speed), variant),
                codec.encode(info, variant),
            ]
        if self._hundredths % GEAR_PERIOD == 0:
            controller = self.controller
            report = GearReport(
                controller.gear, controller.gear_command, controller.gear_override, reject=controller.gear_reject
            )
            frames.append(codec.encode(report, variant))
        return frames

    def _brake(self) -> BrakeReport:
        controller = self.controller
        module, driver = controller.brake, controller.driver.brake_pedal
        command, output = controller.commanded_torque, controller.request.brake_torque
        kind = _BY_TORQUE
        if self._is_old:
            kind, command, output = BrakeReportKind.PEDAL, torque_to_pedal(command), torque_to_pedal(output)
        else:
            driver = pedal_to_torque(driver)
        # In the order of the fields, here and below: naming them takes longer than all the rest.
        return BrakeReport(
            kind,
            driver,
            command,
            output,
            module.enabled,
            controller.request.brake_torque >= BRAKE_LIGHTS,
            module.override,
            module.driver,
            module.timeout,
            controller.watchdog_braking,
            module.source,
            controller.fault,
        )

    def _throttle(self) -> ThrottleReport:
        controller = self.controller
        module = controller.throttle
        return ThrottleReport(
            controller.driver.throttle_pedal,
            _throttle_pedal(controller.commanded_throttle),
            _throttle_pedal(controller.request.throttle),
            module.enabled,
            module.override,
            module.driver,
            module.timeout,
            module.source,
            controller.fault,
        )

    def _steering(self, wheel_angle: float, speed: float) -> SteeringReport:
        controller = self.controller
        module = controller.steering
        torque = min(max(controller.driver.steering_torque, -TORQUE_SENSOR_LIMIT), TORQUE_SENSOR_LIMIT)
        return SteeringReport(
            wheel_angle,
            controller.commanded_wheel_angle,
            abs(speed) if self._is_old else speed,
            torque,
            module.enabled,
            module.override,
            module.timeout,
            False,  # torque mode
            controller.fault,
        )


def _throttle_pedal(throttle: float) -> float:
    return PEDAL_REST + throttle * (THROTTLE_TRAVEL_END - PEDAL_REST)
