"""Invariants of the driver: a foot closes the throttle, and what is said of who has control is true."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

from vve_sumo.drive.termination import Outcome
from vve_sumo.hunt.judging import (
    BLINDING,
    CLOSED,
    HIDE_PEDAL,
    HIDE_TORQUE,
    REST,
    SHOWN_PEDAL,
    UNATTENDED_SPEED,
    UNTROUBLED,
    DriverControl,
    Tolerances,
    alarmed,
    foot_on_brake,
    foot_on_throttle,
    hiding,
    steps_in,
)
from vve_sumo.hunt.truth import TruthSample
from vve_sumo.live.wording import CONTROL
from vve_sumo.timing import PERIOD
from vve_sumo.values import ArmingState
from vve_sumo.vehicle.arming import COMMANDING, DRIVER_REASONS
from vve_sumo.vehicle.gateway import UNATTENDED_TIME


@dataclass(slots=True)
class FootClosesThrottle:
    """Throttle is closed soon after a foot on the brake, and stays so until a new go; a car that it stopped stands."""

    tolerances: Tolerances
    name: ClassVar[str] = "foot_closes_throttle"
    margin: float = 1.0
    _since: float | None = None  # of the foot
    _hiding: frozenset[str] = frozenset()  # kinds of faults that were due since the foot began
    _latched: bool = False
    _went: bool = False
    _rested: bool = False
    _rolled: float = 0.0

    def began_driven(self) -> None:
        """Take note that the go was given before the first tick."""
        self._went = True

    def step(self, sample: TruthSample) -> str | None:
        """Take a tick."""
        if sample.state not in COMMANDING:
            self._since, self._latched, self._rested, self._went = None, False, False, False
            return None
        if sample.went and not self._went:
            self._latched = self._rested = False
            self._since = None  # a foot that is already there counts from the go on
        self._went = sample.went
        foot, now = foot_on_brake(sample.driver), sample.time
        self._hiding = self._hiding | hiding(sample) if foot else frozenset()
        allowed = self._allowed(sample.driver.brake_pedal)
        if not foot or allowed == math.inf or _under_the_commands(sample):
            self._since = None
        elif self._since is None:
            self._since = now
        opened = sample.command.throttle > CLOSED
        if self._since is not None and self._went:
            pressed = now - self._since
            if opened:
                self.margin = min(self.margin, 1.0 - pressed / allowed)
            self._latched |= pressed > allowed + PERIOD / 2
        if self._latched and opened:
            self.margin = min(self.margin, 0.0)
            pressing = "under the driver's foot" if foot else "after the driver's foot, without a new go"
            return f"throttle {100.0 * sample.command.throttle:.0f} % {pressing}"
        return self._roll(sample, foot)

    def _allowed(self, pedal: float) -> float:
        """Longest time from a foot with the brake pedal at `pedal` to a closed throttle [s]; inf for none."""
        tolerances = self.tolerances
        if not (HIDE_PEDAL.isdisjoint(self._hiding) or HIDE_TORQUE.isdisjoint(self._hiding)):
            return tolerances.motion_foot_time if pedal >= tolerances.motion_pedal - 1e-9 else math.inf
        bits_hidden = "brake_driver_bits_zero" in self._hiding or not HIDE_PEDAL.isdisjoint(self._hiding)
        if bits_hidden and pedal < SHOWN_PEDAL - 1e-9:
            return math.inf
        gentle = not BLINDING.isdisjoint(self._hiding) and pedal < tolerances.firm_pedal - 1e-9
        return tolerances.blind_foot_time if gentle else tolerances.foot_time

    def _roll(self, sample: TruthSample, foot: bool) -> str | None:
        speed = abs(sample.pose.speed)
        self._rested |= self._latched and foot and speed < REST
        if not self._rested or foot or alarmed(sample):
            self._rolled = 0.0
            return None
        self._rolled += speed * PERIOD
        self.margin = min(self.margin, 1.0 - self._rolled / self.tolerances.creep)
        if self._rolled > self.tolerances.creep:
            return f"drove off, {speed:.2f} m/s, after the driver's foot had brought it to rest, without a new go"
        return None


def _under_the_commands(sample: TruthSample) -> bool:
    """Whether a foot whose report is hidden brakes no harder than the gateway does, so that nothing shows it."""
    return sample.driver_brake_torque < sample.command.brake_torque and not HIDE_PEDAL.isdisjoint(sample.due)


@dataclass(slots=True)
class FootOnThrottle:
    """Throttle is closed soon after a foot on the throttle that the car reports, and stays so until a new go."""

    tolerances: Tolerances
    name: ClassVar[str] = "foot_on_throttle"
    margin: float = 1.0
    _since: float | None = None  # of the foot, or of the go with the foot there
    _hidden: bool = False  # since the foot began
    _latched: bool = False

    def step(self, sample: TruthSample) -> str | None:
        """Take a tick."""
        pedal, due = sample.driver.throttle_pedal, sample.due
        foot = foot_on_throttle(sample.driver)
        bits_off = "throttle_driver_bits_zero" in due and pedal < SHOWN_PEDAL - 1e-9
        self._hidden = foot and (self._hidden or bits_off or "throttle_report_frozen" in due)
        if sample.state not in COMMANDING or not sample.went:
            self._since, self._latched = None, False
            return None
        if not foot or self._hidden:
            self._since = None
        elif self._since is None:
            self._since = sample.time
        pressed = 0.0 if self._since is None else sample.time - self._since
        self._latched |= pressed > self.tolerances.foot_time + PERIOD / 2
        if sample.command.throttle <= CLOSED:
            return None
        self.margin = min(self.margin, 1.0 - pressed / self.tolerances.foot_time)
        if not self._latched:
            return None
        self.margin = min(self.margin, 0.0)
        return f"throttle {100.0 * sample.command.throttle:.0f} % commanded since the driver's foot was on it"


@dataclass(slots=True)
class ToldControl:
    """Nobody is told that the driver has control of a car that no driver has touched, be it moving or at rest."""

    tolerances: Tolerances
    driven: DriverControl
    name: ClassVar[str] = "told_control"
    margin: float = 1.0
    _since: float | None = None

    def step(self, sample: TruthSample) -> str | None:
        """Take a tick."""
        if sample.phase != CONTROL or self.driven.touched:
            self._since = None
            return None
        if self._since is None:
            self._since = sample.time
        late = sample.time - self._since
        self.margin = min(self.margin, 1.0 - late / self.tolerances.told_time)
        if late <= self.tolerances.told_time:
            return None
        return f"told {CONTROL!r} at {sample.pose.speed:.1f} m/s, and nobody touched anything"


@dataclass(slots=True)
class UnattendedAlarms:
    """A car that the gateway has let go of, and that moves with no foot on a pedal, calls the driver."""

    tolerances: Tolerances
    name: ClassVar[str] = "unattended_alarms"
    margin: float = 1.0
    _commanded: bool = False
    _let_go: bool = False
    _since: float | None = None

    def step(self, sample: TruthSample) -> str | None:
        """Take a tick."""
        fault = sample.state is ArmingState.FAULT
        self._let_go = fault and (self._let_go or self._commanded)
        self._commanded = sample.state in COMMANDING
        foot = foot_on_brake(sample.driver) or foot_on_throttle(sample.driver)
        if not self._let_go or foot or abs(sample.pose.speed) <= UNATTENDED_SPEED:
            self._since = None
            return None
        if self._since is None:
            self._since = sample.time
        if alarmed(sample):
            return None
        late = sample.time - self._since
        # A gateway that takes its time to the last moment is far from breaking this: only the excess counts.
        excess = (late - UNATTENDED_TIME) / (self.tolerances.unattended_time - UNATTENDED_TIME)
        self.margin = min(self.margin, 1.0 - max(excess, 0.0))
        if late <= self.tolerances.unattended_time:
            return None
        return f"{abs(sample.pose.speed):.1f} m/s with no foot on a pedal for {late:.1f} s, and no alarm"


@dataclass(slots=True)
class HonestVerdict:
    """A drive into which the driver had to step never ends as if nothing had been: its reasons say who did."""

    name: ClassVar[str] = "honest_verdict"
    margin: float = 1.0
    _since: float | None = None
    stepped_in: bool = False

    def step(self, sample: TruthSample) -> str | None:
        """Take a tick."""
        acted = steps_in(sample)
        driven = sample.went and sample.state in COMMANDING and abs(sample.pose.speed) > 0.5
        if not (acted and (driven or self._since is not None)):
            self._since = None
            return None
        if self._since is None:
            self._since = sample.time
        self.stepped_in |= sample.time - self._since > 0.5
        return None

    def judge(self, outcome: Outcome | None, reasons: Sequence[str]) -> str | None:
        """Return what is wrong with an outcome and the drive's reasons, by which a drive's criteria fail."""
        if self.stepped_in and outcome in UNTROUBLED and DRIVER_REASONS.isdisjoint(reasons):
            self.margin = 0.0
            return f"outcome {outcome.value} though the driver had to step in, and no reason says so"
        return None
