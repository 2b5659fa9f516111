"""What judges of invariants have in common: tolerances, what a violation is, and what a tick says of driver and car.

A margin is 1 where an invariant is far from broken, 0 and less where it is broken.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, Final, NamedTuple, Protocol

from vve_sumo.drive.termination import Outcome
from vve_sumo.hunt.truth import TruthSample
from vve_sumo.live.wording import ALARMS, NEEDED
from vve_sumo.values import ArmingState
from vve_sumo.vehicle.arming import COMMANDING
from vve_sumo.vehicle.gateway import UNATTENDED_TIME
from vve_sumo.vehicle.interface import PEDAL_REST, DriverInputs, Gear

#: a pedal farther from rest than this has a foot on it; from there on a DBW controller calls it activity [fraction]
FOOT: Final = 0.03
#: torque on the steering wheel with which a driver has taken it [N m]
STEERS: Final = 3.0
#: the same with which a hand lies on it; an untouched wheel has less [N m]
HAND: Final = 1.5
#: a gateway that lets go so soon after the driver's last act does so because of it [s]
ACT_TIME: Final = 1.0
#: a driver who has been called for so long, for brakes that act on no command, has had the time to brake [s]
CALLED_TIME: Final = 5.0
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
#: from here on a pedal is more than the gateway takes for one at rest where the driver's bits are hidden, by the
#: position that the module reports or by the brake torque that the car reports: 172 N m, 6 % of the throttle [fraction]
SHOWN_PEDAL: Final = 0.19
#: a foot that gives this share of the commanded torque brakes as weak brakes do that still answer, by `brake_monitor`
ANSWERING_SHARE: Final = 0.6


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
    return driver.brake_pedal > PEDAL_REST + FOOT + 1e-9


def foot_on_throttle(driver: DriverInputs) -> bool:
    """Whether the driver's foot is on the throttle."""
    return driver.throttle_pedal > PEDAL_REST + FOOT + 1e-9


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


class DriverControl:
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
