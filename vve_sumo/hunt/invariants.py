"""The invariants of the safety layer, judged from the truth alone, each with the margin by which it holds.

Each judge sees one tick after the other. A margin is 1 where an invariant is far from broken, 0 and less where it is
broken. Knows no search and no simulation.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import ClassVar, Final, NamedTuple, Protocol

import numpy as np

from vve_sumo.drive.termination import Outcome
from vve_sumo.frames import GRAVITY
from vve_sumo.hunt.truth import TruthSample
from vve_sumo.live.wording import ALARMS, CONTROL, DRIVING, HELD, NEEDED
from vve_sumo.lot.geofence import Stop
from vve_sumo.lot.polygon import Lot
from vve_sumo.lot.swept_area import Body
from vve_sumo.plant.car import CarParameters
from vve_sumo.rig import resolve as meaning
from vve_sumo.rig.schema import Rig
from vve_sumo.timing import NOTICED, PERIOD, SETPOINT_LIFETIME
from vve_sumo.values import ArmingState, Vehicle
from vve_sumo.vehicle.arming import COMMANDING, DRIVER_SIGNS
from vve_sumo.vehicle.gateway import UNATTENDED_TIME
from vve_sumo.vehicle.interface import PEDAL_REST, DriverInputs, Gear, load
from vve_sumo.vehicle.limits import Limits

#: a pedal this far from rest has a foot on it; the least that a DBW controller calls activity [fraction]
FOOT: Final = 0.03
#: torque on the steering wheel with which a driver has taken it [N m]
STEERS: Final = 3.0
#: the same with which a hand lies on it; an untouched wheel has less [N m]
HAND: Final = 1.5
#: a gateway that lets go so soon after the driver's last act does so because of it [s]
ACT_TIME: Final = 1.0
#: a car that truly moves faster than this with nobody at the pedals is unattended [m/s]; the gateway's own is less
UNATTENDED_SPEED: Final = 0.3
#: a car that truly moves slower than this stands [m/s]; wheel speeds resolve no less
REST: Final = 0.05
#: a throttle that is commanded less than this is closed
CLOSED: Final = 1e-6
#: outcomes of a drive that nothing disturbed; its criteria alone fail it
UNTROUBLED: Final = frozenset({Outcome.STOPPED, Outcome.ARRIVED, Outcome.COMPLETED, Outcome.TIMEOUT})
#: kinds of faults that touch what the car reports of a foot on the brake: it is then seen by its effect alone
BLINDING: Final = frozenset(
    {"brake_report_frozen", "reports_stale", "bus_silent", "brake_torque_frozen", "brake_torque_scaled", "reports_old"}
)
#: kinds that hide a foot in the brake module's report, and in the brake torque that the car reports: where one of each
#: is due, a foot shows in the car's motion alone
HIDE_PEDAL: Final = frozenset({"brake_report_frozen", "reports_old"})
HIDE_TORQUE: Final = frozenset({"brake_torque_frozen", "brake_torque_scaled", "reports_old"})
#: a module that hides the driver's bits still tells where the pedal is: from here on, 172 N m and 6 % of the throttle,
#: that is more than the gateway takes for a pedal at rest [fraction]
SHOWN_PEDAL: Final = 0.19


@dataclass(frozen=True, slots=True)
class Tolerances:
    """How much an invariant allows; each figure with its reason."""

    #: from a driver's foot to a closed throttle [s]: the reports' period, two steps of the gateway, and a debounce
    foot_time: float = 0.2
    #: the same where the reports of the foot are faulty and the foot is gentle: the deceleration that nobody asked for
    #: has to rise above what slopes and noise explain [s]
    blind_foot_time: float = 0.6
    #: a brake pedal from here on is felt within `foot_time` whatever the reports say [fraction]: 0.6 m/s2 and more
    firm_pedal: float = 0.24
    #: the same where the foot shows in the car's motion alone: 2.2 m/s2 take 0.45 s to be 0.3 m/s too slow [s]
    motion_foot_time: float = 0.5
    #: a foot gentler than this shows in the car's motion alone late or never, which docs/vehicle.md says [fraction]
    motion_pedal: float = 0.26
    #: a foot that has brought the car to rest: the car may roll so far without a new go [m]
    creep: float = 0.3
    #: above the rig's limit of speed [m/s]: the 1.0 m/s at which the gateway stops, and what the car gains until then
    speed_margin: float = 1.5
    #: from the bound of a stop, or the roll of a held car, to the alarm [s]
    alarm_time: float = 0.5
    #: bound of a stop: share that speed and slip add, and what reports every 20 ms cannot time better [m]
    stop_share: float = 1.1
    stop_margin: float = 0.5
    #: a car that is told to be driven may be without an enabled module for so long [s]
    told_time: float = 0.5
    #: a car that was let go may move with no foot on a pedal for so long without an alarm [s]
    unattended_time: float = UNATTENDED_TIME + 0.5
    #: park that was requested of a car that stood is engaged by then; a car whose brakes fail meanwhile may roll [s]
    shift_time: float = 0.6
    #: lateral acceleration that steering commands may gain in a second beyond the lateral jerk that is allowed [m/s2]
    lateral_excess: float = 0.5
    #: steering rate of the commands over the limit [share]
    rate_share: float = 1.02


class Violation(NamedTuple):
    """An invariant that was broken."""

    invariant: str
    time: float  #: drive time [s]
    text: str


class Judge(Protocol):
    """One invariant."""

    name: ClassVar[str]
    margin: float

    def step(self, sample: TruthSample) -> str | None:
        """Take a tick; return what broke the invariant, in words, None while it holds."""
        ...


def foot_on_brake(driver: DriverInputs) -> bool:
    """Whether the driver's foot is on the brake."""
    return driver.brake_pedal >= PEDAL_REST + FOOT - 1e-9


def foot_on_throttle(driver: DriverInputs) -> bool:
    """Whether the driver's foot is on the throttle."""
    return driver.throttle_pedal >= PEDAL_REST + FOOT - 1e-9


def acts(driver: DriverInputs) -> bool:
    """Whether the driver does anything: a foot on a pedal, a hand on the wheel, the gear lever."""
    hand = abs(driver.steering_torque) >= HAND or driver.gear is not Gear.NONE
    return hand or foot_on_brake(driver) or foot_on_throttle(driver)


def hiding(sample: TruthSample) -> frozenset[str]:
    """Return the kinds of faults that are due now; scaled torque that tells of more than there is hides nothing."""
    return frozenset(kind for kind, value in sample.due.items() if kind != "brake_torque_scaled" or value < 1.0)


def steps_in(sample: TruthSample) -> bool:
    """Whether the driver acts on the car: a foot, a hand that turns the wheel, a lever that has moved the gear."""
    driver = sample.driver
    shifted = driver.gear is not Gear.NONE and sample.gear is driver.gear is not Gear.DRIVE
    foot = foot_on_brake(driver) or foot_on_throttle(driver)
    return foot or abs(driver.steering_torque) >= STEERS or shifted


def alarmed(sample: TruthSample) -> bool:
    """Whether the alarm calls the driver."""
    return sample.phase in ALARMS or sample.phase == NEEDED


class Driven:
    """Whether a driver has the car: the gateway has let go of it, and the driver has acted.

    What a driver does while the gateway goes on commanding takes nothing from the gateway.
    """

    def __init__(self) -> None:
        self.taken = False
        self.touched = False  #: anything, since the drive began
        self.acted_at = -math.inf  #: last time of an act [s]
        self._commanded = False

    def step(self, sample: TruthSample) -> None:
        """Take a tick."""
        commanded, now = sample.state in COMMANDING, sample.time
        if commanded:
            self.touched &= self._commanded  # another drive: what was done in the one before is over
            self.taken = False
        self._commanded = commanded
        if acts(sample.driver):
            self.acted_at, self.touched = now, True
        self.taken |= sample.state is ArmingState.FAULT and now - self.acted_at < ACT_TIME


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
        if not foot or allowed == math.inf:
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
        if "brake_driver_bits_zero" in self._hiding and pedal < SHOWN_PEDAL - 1e-9:
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
class SpeedLimit:
    """A car that the gateway drives is no faster than the rig's limit and a margin."""

    limit: float  #: [m/s]
    tolerances: Tolerances
    name: ClassVar[str] = "speed_limit"
    margin: float = 1.0
    _gas_until: float = -math.inf

    def step(self, sample: TruthSample) -> str | None:
        """Take a tick."""
        if foot_on_throttle(sample.driver) or "drive_unasked" in sample.due:
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
    """The body of a car that nobody has taken over stays inside the lot's outline."""

    lot: Lot  #: without margin
    body: Body
    driven: Driven
    name: ClassVar[str] = "inside_lot"
    margin: float = 1.0
    _count: int = 0

    def step(self, sample: TruthSample) -> str | None:
        """Take a tick."""
        self._count += 1
        if self._count % 5 or self.driven.taken or sample.state in (ArmingState.DISARMED, ArmingState.READY):
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

    stop: Stop  #: of the weakest layer that may act
    downhill: float  #: slope, as `Stop.distance` takes it
    tolerances: Tolerances
    driven: Driven
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
        if sample.phase != DRIVING or all(sample.enabled):
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


@dataclass(slots=True)
class ToldControl:
    """Nobody is told that the driver has control of a car that no driver has touched, be it moving or at rest."""

    tolerances: Tolerances
    driven: Driven
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
    driven: Driven
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
        if self.stepped_in and outcome in UNTROUBLED and DRIVER_SIGNS.isdisjoint(reasons):
            self.margin = 0.0
            return f"outcome {outcome.value} though the driver had to step in, and no reason says so"
        return None


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
        self._driven = Driven()
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


def weakest_stop(rig: Rig, parameters: CarParameters, limits: Limits) -> Stop:
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
    return Stop(true, delay, true / limits.stop_jerk, parameters.calibration.drive_lag, asked.jerk, asked.acceleration)
