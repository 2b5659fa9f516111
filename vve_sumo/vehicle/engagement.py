"""Follows the steps of engaging: the DBW controller's confirmation, then the gear.

It checks the car's reports after the operator has engaged; the gateway decides what follows from a step that fails.
"""

from __future__ import annotations

from typing import Final

from vve_sumo.vehicle.interface import Gear
from vve_sumo.vehicle.reports import TOLERANCE, CarReports
from vve_sumo.vehicle.setpoint_validation import Debounce

HANDSHAKE_TIME: Final = 0.400  # from the act to all modules enabled [s], as Apollo's lincoln_controller waits
SHIFT_TIME: Final = 3.0  # from asking for drive to drive confirmed [s]; a rotary shifter takes about one
# While the steering moves, command and measurement differ by its rate times (delay + lag). A difference larger by more
# than this, for as long as this, is a steering that does not follow.
STEERING_DIFFERENCE: Final = 0.10  # road-wheel angle [rad]
STEERING_DIFFERENCE_TIME: Final = 0.5  # [s]

_DRIVE: Final = Gear.DRIVE  # found once, for every step: looking it up in its class costs a call


class Engagement:
    """Monitors the car from the operator's ENGAGE to following its commands.

    A moving steering may differ from its command by `steering_lag` [rad] more than a steering at rest. In `shadow` mode
    nothing is commanded, so nothing is awaited.
    """

    def __init__(self, steering_lag: float, shadow: bool) -> None:
        self._steering_tolerance = STEERING_DIFFERENCE + steering_lag
        self._shadow = shadow
        self._begun = 0.0
        self._shifting_since = 0.0
        self._steering_differs = Debounce(STEERING_DIFFERENCE_TIME)
        self.enabled = False  #: the DBW controller has confirmed
        self.in_drive = False  #: the gear has been confirmed

    def begin(self, now: float) -> None:
        """Start anew: the operator has engaged."""
        self._begun = now
        self._steering_differs.reset()
        self.enabled = self.in_drive = self._shadow

    def settled(self, now: float) -> bool:
        """Whether the DBW controller has confirmed, and its handshake time is over."""
        return self.enabled and now - self._begun > HANDSHAKE_TIME + TOLERANCE

    def follow(self, now: float, reports: CarReports, steering_error: float) -> list[str]:
        """Reason codes of steps that fail; `steering_error` is commanded minus measured road-wheel angle [rad]."""
        if self._shadow:
            return []
        if not self.enabled:
            self.enabled = reports.all_enabled()
            if not self.enabled:
                return ["handshake_timeout"] if now - self._begun > HANDSHAKE_TIME + TOLERANCE else []
            self._shifting_since = now
        troubles = reports.dropped_out()
        in_drive = reports.gear.gear is _DRIVE
        if self.in_drive and not in_drive:
            troubles.append("gear_lost")
        elif not in_drive and now - self._shifting_since > SHIFT_TIME + TOLERANCE:
            troubles.append("gear_not_confirmed")
        self.in_drive = self.in_drive or in_drive
        if self._steering_differs.step(now, not abs(steering_error) <= self._steering_tolerance):
            troubles.append("steering_not_following")
        return troubles

    def dropped_out(self, reports: CarReports) -> list[str]:
        """Reason codes of modules that dropped out after the DBW controller had confirmed."""
        return reports.dropped_out() if self.enabled and not self._shadow else []

    def may_go(self, driver: list[str]) -> bool:
        """Whether the car may be allowed to move; `driver` names the pedals that the driver touches."""
        return self.enabled and self.in_drive and not driver

    def waits_for(self, driver: list[str]) -> list[str]:
        """Reason codes of what keeps an engaged car standing; `driver` as in `may_go`."""
        if not self.enabled:
            return ["engaging"]
        if not self.in_drive:
            return ["shifting"]
        return driver or ["waiting_for_go"]
