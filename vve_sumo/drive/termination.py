"""Decides when a drive is over and what its outcome is.

Sees one tick after the other; knows neither SUMO nor the record.
"""

from __future__ import annotations

import enum
from collections.abc import Mapping
from dataclasses import dataclass, field

from vve_sumo.scenario.schema import EndTrigger
from vve_sumo.values import ArmingState

#: below this speed the car counts as at standstill [m/s]
STANDSTILL_SPEED = 0.05
#: a car that was faster than this has driven off [m/s]
MOVING_SPEED = 0.5
#: a stop nearer than this to the end of the path is an arrival [m]
ARRIVAL_DISTANCE = 10.0
#: a drive whose car has not driven off by this drive time ends [s]
START_TIMEOUT = 30.0


class Outcome(enum.StrEnum):
    """How a drive ended."""

    STOPPED = "stopped"  #: at rest before the end of the path
    ARRIVED = "arrived"  #: at rest at the end of the path
    CONTACT = "contact"  #: touched something on the virtual road, then stopped
    DRIVER = "driver_has_control"  #: the driver took over
    FAULT = "fault"  #: the gateway stopped the car for another reason
    TIMEOUT = "timeout"  #: the scenario's time ran out
    COMPLETED = "completed"  #: the scenario's end trigger fired
    PLAYED = "played"  #: a recorded drive ran to its end
    INTERRUPTED = "interrupted"  #: ended from the keyboard
    BROKEN = "broken"  #: the simulation broke


@dataclass(frozen=True, slots=True)
class DriveEnd:
    """How a drive ended, with what is not in its record's tables."""

    outcome: Outcome
    reasons: tuple[str, ...]  #: reason codes: the end trigger's first, if it fired, then the gateway's at the end
    cleared: tuple[str, ...] = ()  #: vehicles taken off the virtual road where the ego or a scenario's actor entered it
    warnings: tuple[str, ...] = ()  #: SUMO's
    text: str = ""  #: message of an exception that ended the drive, or of the last failure on the way
    standoffs: tuple[str, ...] = ()  #: vehicles taken off the road because they and the ego waited for each other
    extra: Mapping[str, float] = field(default_factory=dict)  #: figures of this shell alone, by summary key


def end_reason(wanted: EndTrigger, contact: bool, bumper: float, deviation: float, ttc: float) -> str:
    """Return the reason code of an end trigger's condition that holds, empty while none holds.

    `bumper` is the front bumper's s [m], `deviation` the lateral deviation [m], `ttc` the time to collision [s]; NaN
    meets no condition.
    """
    if wanted.contact and contact:
        return "end_contact"
    if wanted.ego_at_m is not None and bumper >= wanted.ego_at_m:
        return "end_ego_at"
    if wanted.lateral_deviation_m is not None and abs(deviation) > wanted.lateral_deviation_m:
        return "end_deviation"
    return "end_ttc" if wanted.ttc_s is not None and ttc < wanted.ttc_s else ""


@dataclass(slots=True)
class TerminationMonitor:
    """Watches for the end of a closed-loop drive."""

    path_length: float  #: [m]
    rest: float  #: how long the car must be at standstill before the drive is over [s]
    collided: bool = False  #: whether anything was touched so far
    _moved: bool = False
    _standing_since: float | None = None

    def step(self, time: float, speed: float, station: float, state: ArmingState, contact: bool) -> Outcome | None:
        """Return the outcome if the drive has ended at drive time `time` [s], or None while it goes on.

        `speed` [m/s] and `station` (s along the path [m]) are the rear axle's; NaN before there is a pose.
        """
        self.collided |= contact
        self._moved |= speed > MOVING_SPEED
        if not abs(speed) < STANDSTILL_SPEED:
            self._standing_since = None
            return None
        if self._standing_since is None:
            self._standing_since = time
        rested = time - self._standing_since >= self.rest
        if not self._moved:
            return self._never_started(time, state)
        return self._name(station, state) if rested else None

    def _never_started(self, time: float, state: ArmingState) -> Outcome | None:
        """Return the outcome of a car that never drove off: a fault, or STOPPED where it may drive but does not."""
        if state is not ArmingState.FAULT and time <= START_TIMEOUT:
            return None
        return Outcome.STOPPED if state is ArmingState.ENGAGED else Outcome.FAULT

    def _name(self, station: float, state: ArmingState) -> Outcome:
        if self.collided:
            return Outcome.CONTACT
        if state is not ArmingState.ENGAGED:
            return Outcome.FAULT
        return Outcome.ARRIVED if self.path_length - station < ARRIVAL_DISTANCE else Outcome.STOPPED
