"""Invariants of the car: its speed, place, stop, gear, standstill and steering."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from vve_sumo.hunt.judging import (
    ACT_TIME,
    ANSWERING_SHARE,
    CALLED_TIME,
    HIDE_PEDAL,
    REST,
    DriverControl,
    Tolerances,
    alarmed,
    foot_on_throttle,
)
from vve_sumo.hunt.truth import TruthSample
from vve_sumo.live.wording import DRIVING, HELD
from vve_sumo.lot.geofence import StopModel
from vve_sumo.lot.polygon import Lot
from vve_sumo.lot.swept_area import Body
from vve_sumo.timing import PERIOD
from vve_sumo.values import ArmingState, Vehicle
from vve_sumo.vehicle.arming import COMMANDING
from vve_sumo.vehicle.interface import Gear
from vve_sumo.vehicle.limits import Limits


@dataclass(slots=True)
class SpeedLimit:
    """A car that the gateway drives is no faster than the rig's limit and a margin."""

    limit: float  #: [m/s]
    tolerances: Tolerances
    name: ClassVar[str] = "speed_limit"
    margin: float = 1.0
    _gas_until: float = -math.inf

    def step(self, sample: TruthSample) -> str | None:
        """Take a tick."""
        pushed = foot_on_throttle(sample.driver) or "drive_unasked" in sample.due
        # One without brakes rolls on for long; its driver is called.
        rolls_on = sample.time < self._gas_until and not sample.enabled[0] and alarmed(sample)
        if pushed or rolls_on:
            # Such a car gains speed by what the gateway can only brake against; that it does is another invariant's.
            self._gas_until = sample.time + 5.0
        if sample.state not in COMMANDING or sample.time < self._gas_until:
            return None
        excess = sample.pose.speed - self.limit
        self.margin = min(self.margin, 1.0 - max(excess, 0.0) / self.tolerances.speed_margin)
        if excess > self.tolerances.speed_margin:
            return f"{sample.pose.speed:.1f} m/s where the limit is {self.limit:g} m/s"
        return None


@dataclass(slots=True)
class InsideLot:
    """The body of a car that nobody has taken over, and that not only its driver can brake, stays inside the lot."""

    lot: Lot  #: without margin
    body: Body
    driven: DriverControl
    name: ClassVar[str] = "inside_lot"
    margin: float = 1.0
    _count: int = 0
    _ours_at: float | None = None  # when brakes last acted on commands, or no alarm called the driver

    def step(self, sample: TruthSample) -> str | None:
        """Take a tick."""
        self._count += 1
        if self._ours_at is None or sample.enabled[0] or not alarmed(sample):
            self._ours_at = sample.time
        left = self.driven.taken or sample.time - self._ours_at >= CALLED_TIME
        if self._count % 5 or left or sample.state in (ArmingState.DISARMED, ArmingState.READY):
            return None
        pose = sample.pose
        turn = complex(math.cos(pose.heading), math.sin(pose.heading))
        corners = complex(pose.x, pose.y) + self.body.corners * turn
        if self.lot.holds_disc(pose.x, pose.y, self.body.reach + 5.0):
            return None
        clearance = self.lot.clearance(np.stack([corners.real, corners.imag], axis=1)[None])
        self.margin = min(self.margin, max(clearance, -1.0) / 5.0)
        return None if clearance > 0.0 else f"the body left the lot at x {pose.x:.1f} m, y {pose.y:.1f} m"


@dataclass(slots=True)
class StopsInBound:
    """A car that the gateway stops, or has let go of with no driver, is at rest within a bound or raises the alarm."""

    stop: StopModel  #: of the weakest layer that may act
    downhill: float  #: slope, as `Stop.distance` takes it
    tolerances: Tolerances
    driven: DriverControl
    name: ClassVar[str] = "stops_in_bound"
    margin: float = 1.0
    _bound: float | None = None
    _driven: float = 0.0
    _alarmed: bool = False
    _exceeded_at: float | None = None
    _commanded: bool = False

    def step(self, sample: TruthSample) -> str | None:
        """Take a tick."""
        stopping = sample.state is ArmingState.STOPPING
        let_go = self._commanded and sample.state is ArmingState.FAULT
        self._commanded |= sample.state in COMMANDING
        driver = self.driven.acted_at > sample.time - ACT_TIME or self.driven.taken
        if not (stopping or let_go) or driver:
            self._bound = None
            return None
        speed = abs(sample.pose.speed)
        if self._bound is None:
            self._bound = self._bound_of(speed, sample.pose.acceleration)
            self._driven, self._alarmed, self._exceeded_at = 0.0, False, None
        self._driven += speed * PERIOD
        self._alarmed |= alarmed(sample)
        if speed < REST:
            if self._alarmed:
                return None
            self.margin = min(self.margin, 1.0 - self._driven / self._bound)
            return None
        if self._driven <= self._bound:
            return None
        if self._exceeded_at is None:
            self._exceeded_at = sample.time
        late = sample.time - self._exceeded_at
        if self._alarmed:
            return None
        self.margin = min(self.margin, 0.2 * (1.0 - late / self.tolerances.alarm_time))
        if late <= self.tolerances.alarm_time:
            return None
        return f"{self._driven:.1f} m since the stop, bound {self._bound:.1f} m, still {speed:.1f} m/s, and no alarm"

    def _bound_of(self, speed: float, acceleration: float) -> float:
        distance = self.stop.distance(speed, acceleration, self.downhill)
        return distance * self.tolerances.stop_share + self.tolerances.stop_margin


@dataclass(slots=True)
class ToldDriving:
    """Nobody is told that the car is driven while a module of it acts on no command."""

    tolerances: Tolerances
    name: ClassVar[str] = "told_driving"
    margin: float = 1.0
    _since: float | None = None

    def step(self, sample: TruthSample) -> str | None:
        """Take a tick."""
        if sample.phase != DRIVING or all(sample.enabled) or _foot_stands_in(sample):
            self._since = None
            return None
        if self._since is None:
            self._since = sample.time
        late = sample.time - self._since
        self.margin = min(self.margin, 1.0 - late / self.tolerances.told_time)
        if late <= self.tolerances.told_time:
            return None
        parts = zip(("brake", "throttle", "steering"), sample.enabled, strict=True)
        return f"told {DRIVING!r} while not enabled: {', '.join(name for name, on in parts if not on)}"


def _foot_stands_in(sample: TruthSample) -> bool:
    """Whether only the brakes act on no command, their report is hidden, and a foot brakes as they would."""
    brake, *others = sample.enabled
    hidden = not HIDE_PEDAL.isdisjoint(sample.due)
    braked = sample.driver_brake_torque >= ANSWERING_SHARE * sample.command.brake_torque > 0.0
    return not brake and all(others) and hidden and braked


@dataclass(slots=True)
class NoParkWhileMoving:
    """Park is never requested of a car that moves."""

    tolerances: Tolerances
    name: ClassVar[str] = "no_park_while_moving"
    margin: float = 1.0
    _begun: float = math.nan  # of the request [s]

    def step(self, sample: TruthSample) -> str | None:
        """Take a tick."""
        if sample.command.gear is not Gear.PARK or not sample.command.enable:
            self._begun = math.nan
            return None
        if math.isnan(self._begun):
            self._begun = sample.time
        elif sample.time - self._begun < self.tolerances.shift_time:
            return None
        speed = abs(sample.pose.speed)
        self.margin = min(self.margin, 1.0 - speed / (2.0 * REST))
        return None if speed <= 2.0 * REST else f"park requested at {speed:.2f} m/s"


@dataclass(slots=True)
class HeldStands:
    """A car that is said to be held or at rest stands, or the alarm comes."""

    tolerances: Tolerances
    driven: DriverControl
    name: ClassVar[str] = "held_stands"
    margin: float = 1.0
    _rolled: float = 0.0
    _since: float | None = None

    def step(self, sample: TruthSample) -> str | None:
        """Take a tick."""
        held = sample.state is ArmingState.STOPPED or sample.phase == HELD or "waiting_for_go" in sample.reasons
        if not held or alarmed(sample) or self.driven.acted_at > sample.time - ACT_TIME:
            self._rolled, self._since = 0.0, None
            return None
        self._rolled += abs(sample.pose.speed) * PERIOD
        self.margin = min(self.margin, 1.0 - 0.5 * self._rolled / self.tolerances.creep)
        if self._rolled <= self.tolerances.creep:
            return None
        if self._since is None:
            self._since = sample.time
        if sample.time - self._since <= self.tolerances.alarm_time:
            return None
        return f"rolled {self._rolled:.2f} m while told {sample.phase!r}, and no alarm"


@dataclass(slots=True)
class SteeringCommands:
    """Steering rate and lateral jerk of the commands keep to the limits."""

    vehicle: Vehicle
    limits: Limits
    tolerances: Tolerances
    name: ClassVar[str] = "steering_commands"
    margin: float = 1.0
    _last: float | None = None
    _excess: deque[tuple[float, float]] = field(default_factory=deque)
    _sum: float = 0.0

    def step(self, sample: TruthSample) -> str | None:
        """Take a tick."""
        last, angle = self._last, sample.command.wheel_angle / self.vehicle.steering_ratio
        self._last = angle if sample.command.enable else None
        if last is None or not sample.command.enable:
            return None
        change, allowed = abs(angle - last), self.vehicle.steering_rate_limit * PERIOD
        # Speed, and with it what is allowed, is the car's true one: whoever reports another is found out soon.
        square = sample.pose.speed * sample.pose.speed
        driven = sample.state is ArmingState.ENGAGED
        jerk = self.limits.comfort.lateral_jerk if driven else self.limits.stop_lateral_jerk
        gained = max(change * square / self.vehicle.wheelbase - 1.05 * jerk * PERIOD, 0.0)
        self._excess.append((sample.time, gained))
        self._sum += gained
        while self._excess[0][0] < sample.time - 1.0:
            self._sum -= self._excess.popleft()[1]
        self.margin = min(self.margin, 1.0 - self._sum / self.tolerances.lateral_excess)
        if change > allowed * self.tolerances.rate_share:
            self.margin = min(self.margin, 0.0)
            return f"steering command moved by {change / PERIOD:.2f} rad/s, limit {allowed / PERIOD:.2f} rad/s"
        if self._sum > self.tolerances.lateral_excess:
            return f"steering commands gained {self._sum:.1f} m/s2 in a second beyond the lateral jerk of {jerk:g} m/s3"
        return None
