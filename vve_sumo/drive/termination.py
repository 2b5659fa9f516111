"""Decides when a drive is over and what its outcome is.

Sees one tick after the other; knows neither SUMO nor the record.
"""

from __future__ import annotations

import enum
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

from vve_sumo.drive.standstill_cause import StandstillCause
from vve_sumo.scenario.schema import EndTrigger
from vve_sumo.values import ArmingState, SignalChange
from vve_sumo.vehicle.arming import DRIVER_REASONS

#: below this speed the car counts as at standstill [m/s]
STANDSTILL_SPEED = 0.05
#: a car that was faster than this has driven off [m/s]
MOVING_SPEED = 0.5
#: a stop nearer than this to the end of the path is an arrival [m]
ARRIVAL_DISTANCE = 10.0
#: a drive whose car has not driven off by this drive time ends [s]
START_TIMEOUT = 30.0
#: time that a car on a road with traffic has to drive off once nothing is ahead of it any more [s]: it was at rest for
#: a vehicle that has passed, and a controller lets go of its brakes a second or two after that
DRIVE_OFF_TIME = 5.0
#: a rest that lasts this long is the end, even behind traffic [s]: longer than a cycle of the networks' signals, and
#: than the 60 s after which the virtual road ends a standoff
MAX_REST = 120.0


class Outcome(enum.StrEnum):
    """How a drive ended."""

    STOPPED = "stopped"  #: at rest before the end of the path
    ARRIVED = "arrived"  #: at rest at the end of the path
    CONTACT = "contact"  #: touched something on the virtual road, whatever ended the drive then
    DRIVER = "driver_has_control"  #: the driver stepped in: took over, or touched a pedal under way
    FAULT = "fault"  #: a gateway fault: the gateway stopped the car for another reason
    TIMEOUT = "timeout"  #: the scenario's time ran out
    COMPLETED = "completed"  #: the scenario's end trigger fired, and nothing was touched before
    PLAYED = "played"  #: a recorded drive ran to its end
    INTERRUPTED = "interrupted"  #: ended from the keyboard
    BROKEN = "broken"  #: the simulation broke


@dataclass(frozen=True, slots=True)
class DriveEnd:
    """How a drive ended, with what is not in its record's tables."""

    outcome: Outcome
    reasons: tuple[str, ...]  #: reason codes: the end trigger's first, if it fired, then the gateway's at the end
    #: vehicles taken off the virtual road where the ego or a scenario's actor entered it
    removed_at_entry: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()  #: SUMO's
    text: str = ""  #: message of an exception that ended the drive, or of the last failure on the way
    #: vehicles taken off the road because they and the ego waited for each other
    removed_after_standoff: tuple[str, ...] = ()
    signals: tuple[SignalChange, ...] = ()  #: what the traffic signals showed, change by change
    extra: Mapping[str, Any] = field(default_factory=dict)  #: what this drive alone has, by summary key


#: reason codes of end triggers, of which the first of a drive's reasons is one where a trigger ended it
END_REASONS: Final = frozenset({"end_contact", "end_ego_at", "end_deviation", "end_ttc", "end_story"})


def end_reason(end_trigger: EndTrigger, contact: bool, bumper: float, deviation: float, ttc: float) -> str:
    """Return the reason code of an end trigger's condition that holds, empty while none holds.

    `bumper` is the front bumper's s [m], `deviation` the lateral deviation [m], `ttc` the time to collision [s]; NaN
    meets no condition.
    """
    if end_trigger.contact and contact:
        return "end_contact"
    if end_trigger.ego_at_m is not None and bumper >= end_trigger.ego_at_m:
        return "end_ego_at"
    if end_trigger.lateral_deviation_m is not None and abs(deviation) > end_trigger.lateral_deviation_m:
        return "end_deviation"
    return "end_ttc" if end_trigger.ttc_s is not None and ttc < end_trigger.ttc_s else ""


@dataclass(slots=True)
class TerminationMonitor:
    """Watches for the end of a closed-loop drive.

    A rest counts while the car stands before something that stays, before nothing, or at the end of its path. Behind
    traffic it does not: while the car is engaged, its controller may drive on as soon as the traffic does.
    """

    path_length: float  #: [m]
    rest: float  #: how long the car must be at standstill before the drive is over [s]
    collided: bool = False  #: whether anything was touched so far
    _moved: bool = False
    _standing_since: float | None = None
    _traffic_until: float | None = None  #: when the car last stood behind traffic during this rest [s]

    def step(
        self,
        time: float,
        speed: float,
        s: float,
        state: ArmingState,
        reasons: Sequence[str],
        contact: bool,
        ahead: Callable[[], StandstillCause],
    ) -> Outcome | None:
        """Return the outcome if the drive has ended at drive time `time` [s], or None while it goes on.

        `speed` [m/s] and `s` along the path [m] are the rear axle's; NaN before there is a pose. `reasons`
        are the gateway's in this `state`. `ahead` is called at rest only, and returns what the car stands before.
        """
        self.collided |= contact
        self._moved |= speed > MOVING_SPEED
        if not abs(speed) < STANDSTILL_SPEED:
            self._standing_since = self._traffic_until = None
            return None
        if self._standing_since is None:
            self._standing_since = time
        if not self._moved:
            return self._never_started(time, state)
        outcome = self._name(s, state, reasons)
        lasting = self._lasts(time, ahead()) if outcome is Outcome.STOPPED else time - self._standing_since >= self.rest
        return outcome if lasting else None

    def unless_contact(self, outcome: Outcome) -> Outcome:
        """Return the outcome of a drive that something else than its motion ends now: a contact so far is never hidden.

        Its reasons say what ended the drive.
        """
        return Outcome.CONTACT if self.collided else outcome

    def _lasts(self, time: float, ahead: StandstillCause) -> bool:
        """Return whether the rest of an engaged car on its way has lasted long enough to be the end."""
        assert self._standing_since is not None
        if ahead is StandstillCause.TEMPORARY:
            self._traffic_until = time
        since, needed = self._standing_since, self.rest
        if self._traffic_until is not None or ahead is StandstillCause.CLEAR_WITH_TRAFFIC:
            needed = max(self.rest, DRIVE_OFF_TIME)
        if self._traffic_until is not None:
            since = self._traffic_until
        return time - since >= needed or time - self._standing_since >= max(self.rest, MAX_REST)

    def _never_started(self, time: float, state: ArmingState) -> Outcome | None:
        """Return the outcome of a car that never drove off: a fault, or STOPPED where it may drive but does not."""
        if state is not ArmingState.FAULT and time <= START_TIMEOUT:
            return None
        return self.unless_contact(Outcome.STOPPED if state is ArmingState.ENGAGED else Outcome.FAULT)

    def _name(self, s: float, state: ArmingState, reasons: Sequence[str]) -> Outcome:
        if self.collided:
            return Outcome.CONTACT
        if state is not ArmingState.ENGAGED and not DRIVER_REASONS.isdisjoint(reasons):
            return Outcome.DRIVER
        if state is not ArmingState.ENGAGED:
            return Outcome.FAULT
        return Outcome.ARRIVED if self.path_length - s < ARRIVAL_DISTANCE else Outcome.STOPPED
