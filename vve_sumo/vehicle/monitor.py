"""Monitors a drive: whether car, receiver and setpoints can be believed, and whether the car stands.

Common part of the gateway, which commands the car, and of the observer, in its place beside an external brain. It keeps
the newest reports and the newest setpoint, and finds what is wrong with them; it decides nothing and commands nothing.
"""

from __future__ import annotations

import math
from typing import Final

from vve_sumo.values import ArmingState, Setpoint, Vehicle
from vve_sumo.vehicle.arming import COMMANDING
from vve_sumo.vehicle.calibration import Calibration
from vve_sumo.vehicle.interface import VehicleInterface
from vve_sumo.vehicle.plausibility import CarMotion, Plausibility
from vve_sumo.vehicle.reports import CarReports
from vve_sumo.vehicle.setpoint_validation import Debounce, SetpointValidator
from vve_sumo.vehicle.standstill import Standstill

#: A drive is over once the car has not been commanded, and nothing has indicated motion, for this long [s].
DRIVER_TIME: Final = 10.0
#: Nonzero wheel speeds that stay the same to the last bit for longer than this are no evidence for or against rest [s].
UNCHANGED_TIME: Final = 5.0

#: The drive's reason code for a pose without a recent trusted fix; the motion in such a setpoint is only a guess.
_GUESSED: Final = "pose_stale"


class Monitor:
    """Knows what the car reports and what the drive asks for, in an arming state that a derived class changes.

    `wheel_bias` is the steering-wheel angle at which the wheels point straight [rad], left positive, as calibrated.
    """

    def __init__(
        self, vehicle: Vehicle, calibration: Calibration, interface: VehicleInterface, wheel_bias: float
    ) -> None:
        self._ratio, self._wheel_bias = vehicle.steering_ratio, wheel_bias
        self._reports = CarReports(vehicle.wheel_radius, interface)
        self._validator = SetpointValidator()
        self._standstill = Standstill()
        self._plausibility = Plausibility(vehicle, calibration)
        self._let_go_long = Debounce(DRIVER_TIME)

        self._state = ArmingState.DISARMED
        # Reason codes of why the car is being stopped or no longer commanded: each once, first cause first.
        self._causes: dict[str, None] = {}
        self._notes: list[str] = []  # what an operator should know of this step only
        self._last_now = math.nan
        self._speed = math.nan  # by the wheels [m/s]; NaN where it is not known
        self._satellite_speed = math.nan  # by the receiver [m/s]; NaN without a valid setpoint from trusted fixes
        self._has_been_engaged = False
        self._let_go = False  # for long nothing was commanded, and nothing said that the car moves
        self._old_overrides: frozenset[str] = frozenset()

    @property
    def measured_steering(self) -> float:
        """Last valid road-wheel angle that the car reported [rad], left positive; NaN before the first."""
        return (self._reports.wheel_angle - self._wheel_bias) / self._ratio

    @property
    def wheel_speed(self) -> float:
        """Speed of the rear axle by the last wheel speeds [m/s], forward positive; NaN without valid ones."""
        return self._reports.speed

    @property
    def gear(self) -> str:
        """Gear that the car last reported, in lower case; "none" before the first report."""
        return self._reports.gear.gear.name.lower()

    @property
    def sequence(self) -> int:
        """Sequence number of the drive's newest accepted setpoint; -1 for none."""
        return -1 if self._validator.setpoint is None else self._validator.setpoint.sequence

    @property
    def last_dbw_report(self) -> float:
        """Drive time at which a report of the DBW controller was last decoded [s]; -inf before the first."""
        return self._reports.last_dbw_report

    @property
    def done(self) -> bool:
        """Whether a drive is over: it was begun and ended, and the car stands, or nothing has moved for DRIVER_TIME."""
        if not self._has_been_engaged or self._state in COMMANDING:
            return False
        return (self._standstill.certain and self._standstill.at_rest) or self._let_go

    def _look(self, now: float, setpoint: Setpoint | None) -> list[str]:
        """Reason codes of faults in what car and drive say, one by one; `setpoint` is None if none arrived."""
        reports = self._reports
        faults = reports.stale(now)
        faults += reports.faults()
        faults += reports.consistency.faults(now)
        if setpoint is not None:
            faults += self._take(now, setpoint)
        faults += self._validator.faults(now)
        return faults

    def _take(self, now: float, setpoint: Setpoint) -> list[str]:
        """Accept or reject a setpoint; of a rejected one, its fault codes and a fatal reason."""
        rejection = self._validator.take(now, setpoint)
        if rejection is None:
            self._accept(now, setpoint)
            return []
        # The setpoint is rejected as a command, but the faults that it carries still count.
        if rejection.fatal:
            return [rejection.reason, *setpoint.faults]
        self._notes.append(rejection.reason)
        return list(setpoint.faults)

    def _accept(self, now: float, setpoint: Setpoint) -> None:
        """Do what is to be done with an accepted setpoint besides keeping it; a monitor does nothing."""

    def _compare(self, now: float, elapsed: float, fresh: bool, braking: float | None, steering: float) -> list[str]:
        """Weigh whether the car stands, and compare receiver and car on its motion; reason codes of what disagrees.

        `fresh` says that the newest setpoint arrived at this step. The car is told to brake with `braking` [m/s2], None
        where nobody tells it, and to steer with the road-wheel angle `steering` [rad], NaN where nobody does.
        """
        reports, standstill, setpoint = self._reports, self._standstill, self._validator.setpoint
        if setpoint is not None and (_GUESSED in setpoint.faults or not self._validator.valid(now)):
            setpoint = None
        known = reports.speed_known(now)
        fastest = reports.fastest_wheel if known and not reports.unchanged(now) > UNCHANGED_TIME else None
        satellite = None if setpoint is None else setpoint.speed
        standstill.step(now, elapsed, fastest, satellite, braking)
        self._speed = speed = reports.speed if known else math.nan
        self._satellite_speed = math.nan if satellite is None else satellite
        car = CarMotion(
            speed, reports.yaw_rate, self.measured_steering, reports.wheels, steering, standstill.certain
        )  # fmt: skip
        return self._plausibility.step(now, elapsed, car, setpoint, fresh)
