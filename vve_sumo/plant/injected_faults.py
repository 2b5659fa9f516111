"""Faults that can be injected: their kinds, one fault, and which of a drive's faults are due at a time.

The module alters nothing itself, and knows neither car nor clock.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final, NamedTuple

from vve_sumo.errors import ConfigError

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
    "another_writer": "someone else commands straight steering and value [N m] of brakes, with our identifiers",
    "brake_override": "the driver is on the brake: pedal sensor at value",
    "throttle_override": "the driver is on the throttle: pedal sensor at value",
    "steering_override": "the driver turns the wheel with value [N m]",
    "driver_touch": "the driver's foot is on the brake, short of an override: pedal sensor at value",
    "brake_fault": "the brake module reports one of its two channels as broken, and works",
    "throttle_fault": "the throttle module reports one of its two channels as broken, and works",
    "steering_fault": "the steering module reports one of its two buses as broken, and works",
    "report_malformed": "steering reports come one byte short",
    "wheel_speed_invalid": "the rear left wheel's speed is marked as invalid",
    "wheel_speeds_zero": "the car says that it stands: wheel speeds, the steering module's speed, the stationary bit",
    "wheel_speeds_scaled": "wheel speeds, and the steering module's speed, are value times the true ones",
    "wheel_speeds_frozen": "wheel speeds stay what they were, to the last bit",
    "steering_report_frozen": "the steering module's report stays what it was, to the last bit",
    "yaw_rate_frozen": "roll and yaw rate stay what they were, to the last bit",
    "brake_report_frozen": "the brake module's report stays what it was, to the last bit",
    "throttle_report_frozen": "the throttle module's report stays what it was, to the last bit",
    "brakes_weak": "the brakes give value times the torque that they are told and believe; a driver's foot gets all",
    "drive_unasked": "the throttle is stuck open by value, and nobody asked",
    "dbw_dropout": "a module works no more, whatever it is told: 1 brake, 2 throttle, 3 steering, as value says",
}

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
}
NO_VALUE: Final = (math.nan, math.nan, math.nan)

START_SPEED: Final = 0.5  # the speed from which the faults' times count [m/s]


@dataclass(frozen=True, slots=True)
class InjectedFault:
    """One fault; raises ConfigError for an unknown kind or a number out of range."""

    kind: str  #: a key of `KINDS`
    at: float  #: beginning, after the car first moves [s]
    duration: float  #: [s]
    value: float = math.nan  #: see `KINDS`; NaN is the kind's default

    def __post_init__(self) -> None:
        """Raise ConfigError for what cannot be injected."""
        if self.kind not in KINDS:
            raise ConfigError(f"fault: kind must be one of {', '.join(sorted(KINDS))}; got {self.kind!r}")
        if not (0.0 <= self.at < math.inf and self.duration > 0.0):
            raise ConfigError(f"fault {self.kind}: at must be 0 s or more and duration positive, got {self}")
        _usual, least, most = VALUES.get(self.kind, NO_VALUE)
        if not (least <= self.value <= most or math.isnan(self.value)):
            wanted = f"value must be {least:g} to {most:g}" if self.kind in VALUES else "takes no value"
            raise ConfigError(f"fault {self.kind}: {wanted}, got {self.value:g}")


class Share(NamedTuple):
    """Value of a fault that is due, and the time since it began."""

    value: float  #: NaN where the kind takes none
    since: float  #: time since its beginning [s]


class Due:
    """The faults of one drive over time; times are drive times [s], none negative."""

    def __init__(self, faults: Iterable[InjectedFault]) -> None:
        self._faults = tuple(faults)
        self._kinds = frozenset(fault.kind for fault in self._faults)
        self.moved = math.inf  #: when the car first moved, from which the faults' times count

    def moves(self, time: float, speed: float) -> None:
        """Take note of the car's speed [m/s]."""
        if abs(speed) > START_SPEED:
            self.moved = min(self.moved, time)

    def ever(self, kind: str) -> bool:
        """Whether the `kind` is injected at all."""
        return kind in self._kinds

    def share(self, kind: str, time: float) -> Share | None:
        """Return the fault of the `kind` that is due at `time`; None where none is due."""
        if kind not in self._kinds:
            return None
        since = time - self.moved
        for fault in self._faults:
            if fault.kind == kind and fault.at <= since < fault.at + fault.duration:
                usual = VALUES.get(kind, NO_VALUE)[0]
                return Share(usual if math.isnan(fault.value) else fault.value, since - fault.at)
        return None

    def value(self, kind: str, time: float) -> float | None:
        """Value of the `kind` that is due at `time`, NaN where it takes none; None where none is due."""
        share = self.share(kind, time)
        return None if share is None else share.value
