"""Monitors how the car answers its pedals: brakes, drive, hold, the modules' repeated commands, and a driver's foot.

One place for the monitors that compare a commanded car with its reports. The gateway decides what follows from them.
"""

from __future__ import annotations

import math

from vve_sumo.timing import MAX_REPORT_AGE
from vve_sumo.values import Vehicle
from vve_sumo.vehicle.actuation import Pedals
from vve_sumo.vehicle.brake_monitor import BrakeMonitor, HoldMonitor
from vve_sumo.vehicle.calibration import Calibration
from vve_sumo.vehicle.command_echo import OPENING_CHANGE, TORQUE_CHANGE, CommandEcho
from vve_sumo.vehicle.driver_braking import DriverBrakingDetector
from vve_sumo.vehicle.interface import BrakeState, ThrottleState
from vve_sumo.vehicle.reports import TOLERANCE, CarReports
from vve_sumo.vehicle.slowing_monitor import SlowingMonitor
from vve_sumo.vehicle.standstill import Standstill


class ResponseMonitor:
    """Watches a commanded car; `holding_torque` is the brake torque that holds it where it stands [N m].

    With `own_brakes` the car decides by itself how hard it brakes for the acceleration that it is commanded: the torque
    that it reports is then compared with none, and its motion alone shows a foot that no module reports.
    """

    def __init__(
        self, vehicle: Vehicle, calibration: Calibration, holding_torque: float, *, own_brakes: bool = False
    ) -> None:
        self._holding_torque, self._own_brakes = holding_torque, own_brakes
        self._brakes = BrakeMonitor(vehicle, calibration)
        self._hold = HoldMonitor()
        self._slowing = SlowingMonitor(vehicle, calibration)
        self._signs = DriverBrakingDetector(vehicle)
        self._brake_echo, self._throttle_echo = CommandEcho(TORQUE_CHANGE), CommandEcho(OPENING_CHANGE)
        self.driver_inferred = False  #: the car brakes or slows down as under a driver's foot
        #: it does, and not by a report alone that may be frozen: that confirms what a module says of an override
        self.confirms_override = False
        #: a foot has been strong enough, for long enough, to take the brakes until the next engagement
        self.brakes_latched = False

    def engage(self) -> None:
        """Begin a drive: what latched in the one before is being cleared."""
        self.reset()
        self._signs.reset()
        self.brakes_latched = False

    def reset(self) -> None:
        """Forget how the car answered: it is not commanded."""
        for monitor in (self._brakes, self._hold, self._slowing, self._brake_echo, self._throttle_echo):
            monitor.reset()
        self.driver_inferred = self.confirms_override = False

    def step(
        self,
        now: float,
        elapsed: float,
        pedals: Pedals,
        reports: CarReports,
        speeds: tuple[float, float],
        grade: float,
        *,
        standstill: Standstill,
        going: bool,
    ) -> list[str]:
        """Return reason codes at `now` [s], `elapsed` after the last step; `pedals` are those commanded in that step.

        `speeds` are those of wheels and receiver [m/s], NaN where unknown; `grade` [rad], uphill positive. What is
        known of its `standstill`; the car may be allowed to move (`going`).
        """
        foot, others_brake, torque = reports.brake.driver_torque, reports.brake.watchdog_braking, pedals.brake_torque
        wheels, gnss = speeds
        # Wheels that say zero by mistake would end what is added up.
        believed = math.nan if standstill.fell_too_fast else wheels
        faults = self._brakes.step(elapsed, pedals, believed, gnss, grade, others_brake)
        held = torque >= self._holding_torque and not others_brake
        mean = math.nan if gnss != gnss else standstill.gnss_mean
        stands = standstill.certain and standstill.at_rest
        if self._hold.step(now, held, stands, reports.fastest_wheel, mean):
            faults.append("brake_not_following")
        faults += self._frozen(now, pedals, reports)
        reported = math.nan if self._own_brakes else reports.brake_torque(now)
        unasked = self._signs.step(now, elapsed, torque, reported, foot)
        self.brakes_latched = self._signs.brakes_latched
        slowed = False
        if going:
            slowed = self._slowing.step(elapsed, pedals, wheels, gnss, grade)
        else:
            self._slowing.reset()
        self.driver_inferred = (unasked or slowed) and not others_brake
        self.confirms_override = self.driver_inferred and (slowed or not self._signs.repeated)
        return faults

    def _frozen(self, now: float, pedals: Pedals, reports: CarReports) -> list[str]:
        """Reason codes of modules whose fresh reports do not repeat their commands."""
        oldest = MAX_REPORT_AGE + TOLERANCE
        torque = reports.brake.command if reports.age(BrakeState, now) <= oldest else math.nan
        opening = reports.throttle.command if reports.age(ThrottleState, now) <= oldest else math.nan
        faults = ["brake_report_frozen"] if self._brake_echo.step(now, pedals.brake_torque, torque) else []
        if self._throttle_echo.step(now, pedals.throttle, opening):
            faults.append("throttle_report_frozen")
        return faults
