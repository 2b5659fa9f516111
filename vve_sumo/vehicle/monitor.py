"""Monitors a drive: whether car, receiver and setpoints can be believed, and whether the car stands.

The gateway, which commands the car, has one; so has the observer, in its place where an external controller commands
the car. A monitor keeps the newest reports and the newest setpoint, and finds what is wrong with them; it decides and
commands nothing.
"""

from __future__ import annotations

import math
from typing import Final

from vve_sumo.values import Setpoint, Vehicle
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
    """Knows what the car reports, what the drive asks for, and what of both can be believed.

    `wheel_bias` is the steering-wheel angle at which the wheels point straight [rad], left positive, as calibrated.
    """

    def __init__(
        self, vehicle: Vehicle, calibration: Calibration, interface: VehicleInterface, wheel_bias: float
    ) -> None:
        self._ratio, self._wheel_bias = vehicle.steering_ratio, wheel_bias
        self.reports = CarReports(vehicle.wheel_radius, interface)
        self.validator = SetpointValidator()
        self.standstill = Standstill()
        self._plausibility = Plausibility(vehicle, calibration)
        self._let_go_long = Debounce(DRIVER_TIME)

        self.fresh = False  #: this step's setpoint was accepted
        self.notes: list[str] = []  #: reason codes of why this step's setpoint was refused, where that is no fault
        self.speed = math.nan  #: by the wheels [m/s]; NaN where it is not known
        self.gnss_speed = math.nan  #: by the receiver [m/s]; NaN without a valid setpoint from trusted fixes
        self._let_go = False  # for long nothing was commanded, and nothing said that the car moves

    @property
    def measured_steering(self) -> float:
        """Last valid road-wheel angle that the car reported [rad], left positive; NaN before the first."""
        return (self.reports.wheel_angle - self._wheel_bias) / self._ratio

    @property
    def wheel_speed(self) -> float:
        """Speed of the rear axle by the last wheel speeds [m/s], forward positive; NaN without valid ones."""
        return self.reports.speed

    @property
    def gear(self) -> str:
        """Gear that the car last reported, in lower case; "none" before the first report."""
        return self.reports.gear.gear.name.lower()

    @property
    def sequence(self) -> int:
        """Sequence number of the drive's newest accepted setpoint; -1 for none."""
        return -1 if self.validator.setpoint is None else self.validator.setpoint.sequence

    @property
    def last_dbw_report(self) -> float:
        """Drive time at which a report of the DBW controller was last decoded [s]; -inf before the first."""
        return self.reports.last_dbw_report

    @property
    def supervision_over(self) -> bool:
        """Whether nobody needs to watch a car that is not commanded: it stands, or nothing moved for DRIVER_TIME."""
        return (self.standstill.certain and self.standstill.at_rest) or self._let_go

    def missing(self, now: float) -> list[str]:
        """Reason codes of what every drive needs before it begins, and lacks."""
        missing = []
        if not self.validator.valid(now):
            missing.append("no_setpoint")
        if not self.standstill.certain:
            missing.append("not_standing")
        return missing

    def check_inputs(self, now: float, setpoint: Setpoint | None) -> list[str]:
        """Reason codes of faults in what car and drive say, one by one; `setpoint` is None if none arrived."""
        reports = self.reports
        faults = reports.stale(now)
        faults += reports.faults()
        faults += reports.consistency.faults(now)
        self.fresh, self.notes = False, []
        if setpoint is not None:
            faults += self._take(now, setpoint)
        faults += self.validator.faults(now)
        return faults

    def forget_setpoints(self) -> None:
        """Begin anew: the next drive may have another controller, whose sequence numbers start from zero again."""
        self.validator = SetpointValidator()

    def _take(self, now: float, setpoint: Setpoint) -> list[str]:
        """Accept or reject a setpoint; of a rejected one, its fault codes and a fatal reason."""
        rejection = self.validator.take(now, setpoint)
        if rejection is None:
            self.fresh = True
            return []
        # The setpoint is rejected as a command, but the faults that it carries still count.
        if rejection.fatal:
            return [rejection.reason, *setpoint.faults]
        self.notes.append(rejection.reason)
        return list(setpoint.faults)

    def check_motion(
        self, now: float, elapsed: float, *, idle: bool, braking: float | None, steering: float
    ) -> list[str]:
        """Weigh whether the car stands, and compare receiver and car on its motion; reason codes of what disagrees.

        With `idle` the car's owner does not command it. `braking` is the deceleration that `Standstill.step`
        takes, and `steering` the commanded road-wheel angle [rad], NaN for none.
        """
        reports, standstill, setpoint = self.reports, self.standstill, self.validator.setpoint
        if setpoint is not None and (_GUESSED in setpoint.faults or not self.validator.valid(now)):
            setpoint = None
        known = reports.speed_known(now)
        fastest = reports.fastest_wheel if known and not reports.unchanged(now) > UNCHANGED_TIME else None
        gnss = None if setpoint is None else setpoint.speed
        standstill.step(now, elapsed, fastest, gnss, braking)
        self._let_go = self._let_go_long.step(now, idle and not standstill.moves)
        self.speed = speed = reports.speed if known else math.nan
        self.gnss_speed = math.nan if gnss is None else gnss
        car = CarMotion(
            speed, reports.yaw_rate, self.measured_steering, reports.wheels, steering, standstill.certain
        )  # fmt: skip
        return self._plausibility.step(now, elapsed, car, setpoint, self.fresh)
