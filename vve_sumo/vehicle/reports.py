"""What the car last said of itself, how old that is, and what is wrong with it.

It takes frames and gives reason codes and measurements; what follows from them is the gateway's business.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Final

from vve_sumo.values import Frame
from vve_sumo.vehicle.dataspeed import codec
from vve_sumo.vehicle.dataspeed.codec import (
    BrakeReport,
    Gear,
    GearReport,
    SteeringReport,
    ThrottleReport,
    WheelSpeeds,
    YawRate,
)

MAX_AGE: Final = 0.100  # of a report that comes at 50 or 100 Hz [s]; the kit itself gives up after the same time
MAX_GEAR_AGE: Final = 0.200  # the gear comes at 20 Hz: four periods [s]
TOLERANCE: Final = 1e-6  # so that rounding of times never decides [s]


class CarReports:
    """The newest report of every kind, each with the time it was taken in."""

    def __init__(self, wheel_radius: float, variant: codec.Variant) -> None:
        self._wheel_radius = wheel_radius
        self._variant = variant
        self._times: dict[type, float] = {}
        self._heard: dict[int, tuple[bytes, type]] = {}  # by identifier: the last understood frame's data, and its kind
        self.brake = BrakeReport(codec.BrakeReportKind.PEDAL, 0.0, 0.0, 0.0, enabled=False)
        self.throttle = ThrottleReport(0.0, 0.0, 0.0, enabled=False)
        self.steering = SteeringReport(math.nan, math.nan, math.nan, math.nan, enabled=False)
        self.gear = GearReport(Gear.NONE)
        self.speed = math.nan  #: of the rear axle, from the wheels [m/s], forward positive
        self.wheels: tuple[float, ...] = ()  #: angular speeds as last reported [rad/s]
        self._wheels_changed = -math.inf  # when they were last others than before
        self.fastest_wheel = math.nan  #: largest speed of any wheel's tread, without sign [m/s]
        self.yaw_rate = math.nan  #: [rad/s] counter-clockwise
        self.wheel_angle = math.nan  #: last valid angle of the steering wheel [rad], left positive

    @property
    def kit_heard(self) -> float:
        """When one of the kit's modules was last understood; -inf before the first time.

        Wheel speeds and the gyroscope do not count: they are the car's own, and say nothing of who could be commanded.
        """
        return max(self._times.get(kind, -math.inf) for kind in _OF_THE_KIT)

    def take(self, now: float, frames: Iterable[Frame]) -> list[str]:
        """Take in frames heard since the last call; reason codes of what can't be understood or shouldn't be there."""
        troubles: list[str] = []
        for frame in frames:
            if frame.id in codec.COMMAND_IDS:
                troubles.append("another_writer")
                continue
            if frame.id in _UNREAD:
                continue
            before = self._heard.get(frame.id)
            if before is not None and before[0] == frame.data:
                # The same bytes say the same; most reports repeat themselves.
                self._times[before[1]] = now
                continue
            message = codec.decode(frame, self._variant)
            if isinstance(message, codec.Malformed):
                troubles.append("report_malformed")
            elif message is not None:
                self._heard[frame.id] = frame.data, type(message)
                self._times[type(message)] = now
                self._store(now, message)
        return troubles

    def stale(self, now: float) -> list[str]:
        """Reason codes of the reports that are missing or too old."""
        get, never = self._times.get, -math.inf
        oldest = now - MAX_AGE - TOLERANCE
        reasons = [code for kind, code in _STALE_CODES if get(kind, never) < oldest]
        if get(GearReport, never) < now - MAX_GEAR_AGE - TOLERANCE:
            reasons.append("gear_report_stale")
        return reasons

    def faults(self) -> list[str]:
        """Reason codes of what the modules say is broken, and of measurements that they mark as invalid."""
        brake, throttle, steering = self.brake, self.throttle, self.steering
        reasons: list[str] = []
        if brake.fault_watchdog or throttle.fault_watchdog or steering.fault_watchdog:
            reasons.append("kit_watchdog")
        if brake.watchdog_braking:
            reasons.append("kit_braking")
        if brake.fault_channel_1 or brake.fault_channel_2 or brake.fault_power:
            reasons.append("brake_fault")
        if throttle.fault_channel_1 or throttle.fault_channel_2 or throttle.fault_power:
            reasons.append("throttle_fault")
        if steering.fault_bus_1 or steering.fault_bus_2 or steering.fault_calibration or steering.fault_power:
            reasons.append("steering_fault")
        if self.gear.fault_bus:
            reasons.append("gear_fault")
        if not math.isfinite(self.speed + self.yaw_rate + steering.wheel_angle):
            reasons.append("report_invalid")
        return reasons

    def dropped_out(self) -> list[str]:
        """Reason codes of the modules that don't work although they are told to."""
        reasons: list[str] = []
        for report, timeout, disabled in (
            (self.brake, "brake_timeout", "brake_disabled"),
            (self.throttle, "throttle_timeout", "throttle_disabled"),
            (self.steering, "steering_timeout", "steering_disabled"),
        ):
            if report.timeout:
                reasons.append(timeout)
            elif not report.enabled:
                reasons.append(disabled)
        return reasons

    def overrides(self) -> frozenset[str]:
        """Names of the modules whose driver override is latched."""
        if not (self.brake.override or self.throttle.override or self.steering.override or self.gear.override):
            return frozenset()
        latched = {
            "brake": self.brake.override,
            "throttle": self.throttle.override,
            "steering": self.steering.override,
            "gear": self.gear.override,
        }
        return frozenset(name for name, override in latched.items() if override)

    def driver(self) -> list[str]:
        """Reason codes of the pedals that the driver touches; the steering module does not tell of hands."""
        if not (self.brake.driver or self.throttle.driver):
            return []
        touched = (self.brake.driver, "driver_on_brake"), (self.throttle.driver, "driver_on_throttle")
        return [code for active, code in touched if active]

    def all_enabled(self) -> bool:
        """Whether brake, throttle and steering all say that they are enabled."""
        return self.brake.enabled and self.throttle.enabled and self.steering.enabled

    def any_enabled(self) -> bool:
        """Whether brake, throttle or steering says that it is enabled."""
        return self.brake.enabled or self.throttle.enabled or self.steering.enabled

    def speed_known(self, now: float) -> bool:
        """Whether the speed is fresh and valid."""
        fresh = self._times.get(WheelSpeeds, -math.inf) >= now - MAX_AGE - TOLERANCE
        return fresh and math.isfinite(self.speed)

    def in_park(self, now: float) -> bool:
        """Whether the car says that it is in park, and has just said so."""
        fresh = self._times.get(GearReport, -math.inf) >= now - MAX_GEAR_AGE - TOLERANCE
        return fresh and self.gear.gear is Gear.PARK and not self.gear.fault_bus

    def unchanged(self, now: float) -> float:
        """For how long the wheel speeds have been the same to the last bit, while they say that the car moves [s]."""
        return now - self._wheels_changed if self.fastest_wheel > 0.0 else 0.0

    def _store(self, now: float, message: codec.Message) -> None:
        match message:
            case WheelSpeeds():
                self._store_wheels(now, message)
            case YawRate():
                self.yaw_rate = message.yaw
            case SteeringReport():
                self.steering = message
                if math.isfinite(message.wheel_angle):
                    self.wheel_angle = message.wheel_angle
            case BrakeReport():
                self.brake = message
            case ThrottleReport():
                self.throttle = message
            case GearReport():
                self.gear = message
            case _:
                pass

    def _store_wheels(self, now: float, wheels: WheelSpeeds) -> None:
        if wheels != self.wheels:
            self.wheels, self._wheels_changed = wheels, now
        # The mean of the rear wheels is the rear axle's speed in a bend too. One invalid wheel makes both numbers NaN.
        self.speed = 0.5 * (wheels.rear_left + wheels.rear_right) * self._wheel_radius
        total = wheels.front_left + wheels.front_right + wheels.rear_left + wheels.rear_right
        fastest = max(
            abs(wheels.front_left), abs(wheels.front_right), abs(wheels.rear_left), abs(wheels.rear_right)
        )  # fmt: skip
        if math.isfinite(total):
            self.fastest_wheel = fastest * self._wheel_radius
        else:
            self.speed = self.fastest_wheel = math.nan


#: Reports that nothing here reads: they come as often as the others and would cost as much.
_UNREAD: Final = frozenset({codec.ACCELERATIONS, codec.BRAKE_INFO})
_OF_THE_KIT: Final[tuple[type, ...]] = (BrakeReport, ThrottleReport, SteeringReport, GearReport)

_STALE_CODES: Final[tuple[tuple[type, str], ...]] = (
    (BrakeReport, "brake_report_stale"),
    (ThrottleReport, "throttle_report_stale"),
    (SteeringReport, "steering_report_stale"),
    (WheelSpeeds, "wheel_speeds_stale"),
    (YawRate, "yaw_rate_stale"),
)
