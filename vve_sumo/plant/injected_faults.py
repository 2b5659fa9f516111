"""Faults that can be injected: their kinds, one fault, and which of a drive's faults are due at a time.

The module alters nothing itself, and knows neither car nor clock.
"""

from __future__ import annotations

import enum
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

from vve_sumo.errors import ConfigError
from vve_sumo.vehicle.interface import PEDAL_REST

#: Kind of fault to plain words.
KINDS: Final[dict[str, str]] = {
    "pose_lost": "no fixes are sent",
    "pose_frozen": "position, heading and velocity stay what they were, while time goes on",
    "pose_jump": "the position lies to the left of the true one by value [m]",
    "pose_rtk_lost": "RTK falls back to float, with value [m] of standard deviation",
    "pose_backwards": "the receiver's clock is set back by value [s]",
    "pose_nan": "latitude is not a number",
    "pose_heading_invalid": "the receiver marks its heading as invalid",
    "pose_bursts": "packets are held back and let go together, every value [s]",
    "pose_garbage": "random bytes between the packets, and instead of every value-th one",
    "pose_duplicates": "every packet comes twice",
    "pose_reordered": "of every two packets the later one comes first",
    "pose_late": "packets come value [s] later",
    "pose_drift_lateral": "the position drifts to the left with value [m/s], and the velocity agrees",
    "pose_drift_along": "the position drifts ahead with value [m/s], and the velocity agrees",
    "pose_steps": "the position steps to the left by value [m] each second, and the velocity knows nothing of it",
    "pose_heading_drift": "the heading drifts to the left with value [rad/s], the yaw rate agrees; positions are true",
    "pose_forged": "between the packets come those of another sender, 10 ms ahead of them, drifting to the left with "
    "value [m/s]",
    "pose_overtaken": "just before each packet comes another sender's of the same time, drifting to the left with "
    "value [m/s]",
    "pose_minute_wrong": "one packet says a minute 5 later, with right checksums",
    "pose_ahead_once": "one fix is dated 12 s ahead",
    "bus_silent": "the bus is dead: reports are not heard, nor are commands",
    "reports_stale": "the car reports nothing any more but obeys",
    "reports_old": "every second report is followed by the one of its kind from value [s] before",
    "commands_lost": "the bus takes our commands, but the drive-by-wire controller does not receive them",
    "another_writer": "someone else commands straight steering and value [N m] of brakes, with our identifiers",
    "brake_override": "the driver is on the brake: pedal sensor at value",
    "throttle_override": "the driver is on the throttle: pedal sensor at value",
    "steering_override": "the driver turns the wheel with value [N m]",
    "driver_touch": "the driver's foot is on the brake, short of an override: pedal sensor at value",
    "gear_lever": "the driver moves the gear lever: 1 park, 2 reverse, 3 neutral, 4 drive, as value says",
    "override_false": "a module reports an override, and nobody touches anything: 1 brake, 2 throttle, 3 steering, "
    "4 gear, as value says",
    "brake_driver_bits_zero": "the brake module's report hides the driver: override and activity stay off",
    "throttle_driver_bits_zero": "the throttle module's report hides the driver: override and activity stay off",
    "brake_fault": "the brake module reports one of its two channels as broken, and works",
    "throttle_fault": "the throttle module reports one of its two channels as broken, and works",
    "steering_fault": "the steering module reports one of its two buses as broken, and works",
    "report_malformed": "steering reports come one byte short",
    "wheel_speed_invalid": "the rear left wheel's speed is marked as invalid",
    "wheel_speeds_zero": "the car says that it stands: wheel speeds, the steering module's speed, the stationary bit",
    "wheel_speeds_scaled": "wheel speeds, and the steering module's speed, are value times the true ones",
    "wheel_speeds_frozen": "wheel speeds stay what they were, to the last bit",
    "wheel_speeds_noisy": "each wheel's speed has white noise, value [rad/s] of standard deviation",
    "steering_report_frozen": "the steering module's report stays what it was, to the last bit",
    "yaw_rate_frozen": "roll and yaw rate stay what they were, to the last bit",
    "yaw_rate_biased": "the yaw rate is too large by value [rad/s], counter-clockwise",
    "brake_report_frozen": "the brake module's report stays what it was, to the last bit",
    "throttle_report_frozen": "the throttle module's report stays what it was, to the last bit",
    "brake_torque_frozen": "the brake torque that the car reports stays what it was",
    "brake_torque_scaled": "the brake torque that the car reports is value times the true one",
    "brakes_weak": "the brakes give value times the torque that is commanded and reported; a driver's foot gets all",
    "brakes_drag": "the brakes bind with value [N m], nobody asked, and no report shows it",
    "throttle_weak": "the engine gives value times the force of its throttle",
    "steering_weak": "the steering wheel turns value times as far as its motor is commanded in each step",
    "steering_stuck": "the steering wheel stays where it is",
    "drive_unasked": "the throttle is stuck open by value, and nobody asked",
    "dbw_dropout": "a module works no more, whatever is commanded: 1 brake, 2 throttle, 3 steering, as value says",
}

MAX_REPORT_AGE: Final = 2.0  # of an old report that is sent again [s]

#: Default of `value`, and the range that it must lie in; the other kinds take none.
VALUES: Final[dict[str, tuple[float, float, float]]] = {
    "pose_jump": (5.0, -1e4, 1e4),
    "pose_rtk_lost": (0.5, 0.0, 60.0),
    "pose_backwards": (1.0, 0.0, 20.0),
    "pose_bursts": (0.048, 0.01, 10.0),
    "pose_garbage": (5.0, 1.0, 1e6),
    "pose_late": (0.05, 0.0, 10.0),
    "pose_drift_lateral": (0.4, -100.0, 100.0),
    "pose_drift_along": (0.4, -100.0, 100.0),
    "pose_steps": (0.2, -1e4, 1e4),
    "pose_heading_drift": (0.08, -1.0, 1.0),
    "pose_forged": (0.4, -100.0, 100.0),
    "pose_overtaken": (0.4, -100.0, 100.0),
    "wheel_speeds_scaled": (0.75, 0.0, 2.0),
    "brakes_weak": (0.5, 0.0, 1.0),
    "drive_unasked": (0.1, 0.0, 1.0),
    "another_writer": (1000.0, 0.0, 3250.0),
    "brake_override": (0.26, 0.15, 0.5),
    "throttle_override": (0.35, 0.15, 0.8),
    "steering_override": (5.0, -7.9, 7.9),
    "driver_touch": (0.20, 0.15, 0.22),
    "dbw_dropout": (3.0, 1.0, 3.0),
    "reports_old": (0.4, 0.01, MAX_REPORT_AGE),
    "gear_lever": (3.0, 1.0, 4.0),
    "override_false": (1.0, 1.0, 4.0),
    "wheel_speeds_noisy": (1.0, 0.0, 20.0),
    "yaw_rate_biased": (0.05, -2.0, 2.0),
    "brake_torque_scaled": (0.5, 0.0, 2.0),
    "brakes_drag": (500.0, 0.0, 5000.0),
    "throttle_weak": (0.5, 0.0, 1.0),
    "steering_weak": (0.3, 0.0, 1.0),
}
#: kinds whose value is a number of something
NUMBERS: Final = frozenset({"dbw_dropout", "gear_lever", "override_false"})
#: Value at which a kind does nothing, from which a ramp begins; the other kinds have no ramp.
NEUTRAL: Final[dict[str, float]] = {
    "pose_jump": 0.0,
    "pose_backwards": 0.0,
    "pose_late": 0.0,
    "pose_drift_lateral": 0.0,
    "pose_drift_along": 0.0,
    "pose_steps": 0.0,
    "pose_heading_drift": 0.0,
    "wheel_speeds_scaled": 1.0,
    "wheel_speeds_noisy": 0.0,
    "yaw_rate_biased": 0.0,
    "brake_torque_scaled": 1.0,
    "brakes_weak": 1.0,
    "brakes_drag": 0.0,
    "throttle_weak": 1.0,
    "steering_weak": 1.0,
    "drive_unasked": 0.0,
    "brake_override": PEDAL_REST,
    "throttle_override": PEDAL_REST,
    "steering_override": 0.0,
    "driver_touch": PEDAL_REST,
}

#: Kinds that concern the receiver and its packets.
POSE_KINDS: Final = frozenset(kind for kind in KINDS if kind.startswith("pose_"))
#: Kinds that are no fault: what the driver does.
DRIVER_ACTIONS: Final = frozenset(
    {"brake_override", "throttle_override", "steering_override", "driver_touch", "gear_lever"}
)
NO_VALUE: Final = (math.nan, math.nan, math.nan)

ROUNDING: Final = 1e-9  # of times that are sums [s]
START_SPEED: Final = 0.5  # the speed from which the faults' times count [m/s]


class Shape(enum.StrEnum):
    """How a fault's strength goes over its duration."""

    STEP = "step"  #: `value` at once and to the end
    RAMP = "ramp"  #: grows linearly, from the neutral value of its kind to `value`
    FLAPPING = "flapping"  #: in turn on for `period` and off for `period`; each time begins anew


class FaultClock(enum.StrEnum):
    """What a fault's beginning counts from."""

    MOVED = "moved"  #: the moment at which the car first moves
    DRIVE = "drive"  #: drive time 0


@dataclass(frozen=True, slots=True)
class InjectedFault:
    """One fault, or one action of the driver; raises ConfigError for an unknown kind or a number out of range."""

    kind: str  #: a key of `KINDS`
    at: float  #: beginning, see `clock` [s]
    duration: float  #: [s]
    value: float = math.nan  #: see `KINDS`; NaN is the kind's default
    shape: Shape = Shape.STEP
    period: float = math.nan  #: of `Shape.FLAPPING`, of each half [s]
    clock: FaultClock = FaultClock.MOVED

    def __post_init__(self) -> None:
        """Raise ConfigError for what cannot be injected."""
        if self.kind not in KINDS:
            raise ConfigError(f"fault: kind must be one of {', '.join(sorted(KINDS))}; got {self.kind!r}")
        if not (0.0 <= self.at < math.inf and self.duration > 0.0):
            raise ConfigError(
                f"fault {self.kind}: at must be 0 s or more and duration positive, "
                f"got {self.at:g} s and {self.duration:g} s"
            )
        _usual, least, most = VALUES.get(self.kind, NO_VALUE)
        if not (least <= self.value <= most or math.isnan(self.value)):
            wanted = f"value must be {least:g} to {most:g}" if self.kind in VALUES else "takes no value"
            raise ConfigError(f"fault {self.kind}: {wanted}, got {self.value:g}")
        if self.kind in NUMBERS and self.value % 1.0 > 0.0:
            raise ConfigError(f"fault {self.kind}: value must be a whole number, got {self.value:g}")
        self._check_shape()

    def _check_shape(self) -> None:
        flapping = self.shape is Shape.FLAPPING
        if self.shape is Shape.RAMP and not (self.kind in NEUTRAL and self.duration < math.inf):
            wanted = "shape ramp needs a duration" if self.kind in NEUTRAL else "its strength does not grow: no ramp"
            raise ConfigError(f"fault {self.kind}: {wanted}")
        if flapping and not 0.0 < self.period < math.inf:
            raise ConfigError(f"fault {self.kind}: shape flapping needs a positive period, got {self.period:g}")
        if not flapping and not math.isnan(self.period):
            raise ConfigError(f"fault {self.kind}: only shape flapping takes a period, got {self.period:g}")

    def __str__(self) -> str:
        """Return the fault in words: kind, value, shape and times."""
        value = VALUES.get(self.kind, NO_VALUE)[0] if math.isnan(self.value) else self.value
        size = "" if math.isnan(value) else f" {value:g}"
        shape = {Shape.STEP: "", Shape.RAMP: ", ramp", Shape.FLAPPING: f", flapping each {self.period:g} s"}[self.shape]
        since = "the start" if self.clock is FaultClock.DRIVE else "the first motion"
        return f"{self.kind}{size}{shape}, from {self.at:g} s after {since} for {self.duration:g} s"

    def to_dict(self) -> dict[str, Any]:
        """Return the fault as plain JSON, by the keys of a rig's table."""
        return {
            "kind": self.kind,
            "at_s": self.at,
            "for_s": self.duration,
            "value": None if math.isnan(self.value) else self.value,
            "shape": str(self.shape),
            "period_s": None if math.isnan(self.period) else self.period,
            "from_start": self.clock is FaultClock.DRIVE,
        }

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> InjectedFault:
        """Return the fault that `to_dict` gave; raises KeyError, ValueError or ConfigError for other data."""
        value, period = data["value"], data["period_s"]
        return cls(
            data["kind"],
            data["at_s"],
            data["for_s"],
            math.nan if value is None else value,
            Shape(data["shape"]),
            math.nan if period is None else period,
            FaultClock.DRIVE if data["from_start"] else FaultClock.MOVED,
        )


class Share(NamedTuple):
    """A fault that is due."""

    value: float  #: now; NaN where the kind takes none
    began: float  #: drive time at which it began; each turn of a flapping fault is a beginning [s]
    since: float  #: time since then [s]
    total: float  #: integral of the value since then


class Due:
    """The faults of one drive over time; times are drive times [s], none negative."""

    def __init__(self, faults: Iterable[InjectedFault]) -> None:
        self._faults: dict[str, list[InjectedFault]] = {}
        for fault in faults:
            self._faults.setdefault(fault.kind, []).append(fault)
        self.moved = math.inf  #: when the car first moved

    def moves(self, time: float, speed: float) -> None:
        """Take note of the car's speed [m/s]."""
        if abs(speed) > START_SPEED:
            self.moved = min(self.moved, time)

    def ever(self, *kinds: str) -> bool:
        """Whether one of the `kinds` is injected at all."""
        return not self._faults.keys().isdisjoint(kinds)

    def share(self, kind: str, time: float) -> Share | None:
        """Return the fault of the `kind` that is due at `time`; None where none is due."""
        for fault in self._faults.get(kind, ()):
            since = time - (self.moved if fault.clock is FaultClock.MOVED else 0.0)
            if fault.at <= since < fault.at + fault.duration and (share := _share(fault, time, since - fault.at)):
                return share
        return None

    def value(self, kind: str, time: float) -> float | None:
        """Value of the `kind` that is due at `time`, NaN where it takes none; None where none is due."""
        if kind not in self._faults:  # as nearly every one of those asked for in each step
            return None
        share = self.share(kind, time)
        return None if share is None else share.value


def _share(fault: InjectedFault, time: float, since: float) -> Share | None:
    """The share of a fault that began `since` seconds before `time`; None in the off half of a flapping one."""
    value = VALUES.get(fault.kind, NO_VALUE)[0] if math.isnan(fault.value) else fault.value
    if fault.shape is Shape.RAMP:
        neutral = NEUTRAL[fault.kind]
        grown = (value - neutral) * since / fault.duration
        return Share(neutral + grown, time - since, since, (neutral + grown / 2.0) * since)
    if fault.shape is Shape.FLAPPING:
        turn, since = divmod(since + ROUNDING, fault.period)
        since = max(since - ROUNDING, 0.0)
        if turn % 2.0:
            return None
    return Share(value, time - since, since, value * since)
