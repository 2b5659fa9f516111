"""The invariants of the safety layer, judged from the truth alone, each with the margin by which it holds.

Each judge sees one tick after the other. Knows no search and no simulation.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

from vve_sumo.drive.termination import Outcome
from vve_sumo.hunt.car_invariants import (
    HeldStands,
    InsideLot,
    NoParkWhileMoving,
    SpeedLimit,
    SteeringCommands,
    StopsInBound,
    ToldDriving,
)
from vve_sumo.hunt.driver_invariants import (
    FootClosesThrottle,
    FootOnThrottle,
    HonestVerdict,
    ToldControl,
    UnattendedAlarms,
)
from vve_sumo.hunt.judging import DriverControl, Judge, Tolerances, Violation
from vve_sumo.hunt.truth import TruthSample
from vve_sumo.lot.geofence import StopModel
from vve_sumo.lot.polygon import Lot
from vve_sumo.lot.swept_area import Body
from vve_sumo.physical_constants import GRAVITY
from vve_sumo.plant.car import CarParameters
from vve_sumo.rig import resolve as meaning
from vve_sumo.rig.schema import Rig
from vve_sumo.timing import NOTICED, SETPOINT_LIFETIME
from vve_sumo.vehicle.interface import load
from vve_sumo.vehicle.limits import Limits

#: every invariant
ALL: Final = (
    FootClosesThrottle,
    FootOnThrottle,
    SpeedLimit,
    InsideLot,
    StopsInBound,
    ToldDriving,
    ToldControl,
    UnattendedAlarms,
    NoParkWhileMoving,
    HeldStands,
    SteeringCommands,
    HonestVerdict,
)


class Judges:
    """All invariants of one episode."""

    def __init__(self, rig: Rig, parameters: CarParameters, limits: Limits, tolerances: Tolerances) -> None:
        vehicle = parameters.vehicle
        lot = meaning.lot_of(rig)
        whole = Lot([tuple(c) for c in lot.outline.tolist()], [[tuple(c) for c in h.tolist()] for h in lot.holes], 0.0)
        self._driven = DriverControl()
        self._verdict = HonestVerdict()
        self._foot = FootClosesThrottle(tolerances)
        weakest = weakest_stop(rig, parameters, limits)
        self.judges: tuple[Judge, ...] = (
            self._foot,
            FootOnThrottle(tolerances),
            SpeedLimit(rig.limits.speed_mps, tolerances),
            InsideLot(whole, Body.of(vehicle), self._driven),
            StopsInBound(weakest, max(-math.sin(parameters.grade), 0.0), tolerances, self._driven),
            ToldDriving(tolerances),
            ToldControl(tolerances, self._driven),
            UnattendedAlarms(tolerances),
            NoParkWhileMoving(tolerances),
            HeldStands(tolerances, self._driven),
            SteeringCommands(vehicle, limits, tolerances),
            self._verdict,
        )
        self.violations: list[Violation] = []
        self._broken: set[str] = set()

    def step(self, sample: TruthSample) -> None:
        """Judge a tick; an invariant is broken once."""
        self._driven.step(sample)
        for judge in self.judges:
            if judge.name not in self._broken and (text := judge.step(sample)) is not None:
                self._broken.add(judge.name)
                self.violations.append(Violation(judge.name, sample.time, text))

    def went(self) -> None:
        """The go was given before the first tick that is judged."""
        self._foot.began_driven()

    def end(self, time: float, outcome: Outcome | None, reasons: Sequence[str]) -> None:
        """Judge how the drive ended, by its outcome and the reasons of that moment."""
        if (text := self._verdict.judge(outcome, reasons)) is not None:
            self.violations.append(Violation(self._verdict.name, time, text))

    @property
    def margins(self) -> dict[str, float]:
        """Return the least margin of every invariant."""
        return {judge.name: judge.margin for judge in self.judges}


def weakest_stop(rig: Rig, parameters: CarParameters, limits: Limits) -> StopModel:
    """Return the stop of the weakest layer that may act: the gateway's or the DBW watchdog's, by the true car.

    A car with more mass or less brake than declared brakes less by as much, and none brakes beyond its friction.
    """
    vehicle = parameters.vehicle
    delay = SETPOINT_LIFETIME + NOTICED + vehicle.brake_delay + vehicle.brake_lag
    deceleration, test = limits.stop_deceleration, rig.watchdog_test
    watchdog = meaning.watchdog_deceleration_of(rig, load(meaning.interface_of(rig)).facts)
    if test is not None and watchdog is not None:
        deceleration, delay = min(deceleration, watchdog), max(delay, SETPOINT_LIFETIME + test.delay_s)
    true = deceleration * min(parameters.brake_gain_factor / parameters.mass_factor, 1.0)
    true = min(true, 0.9 * parameters.friction * GRAVITY)
    asked = limits.comfort
    return StopModel(
        true, delay, true / limits.stop_jerk, parameters.calibration.drive_lag, asked.jerk, asked.acceleration
    )
