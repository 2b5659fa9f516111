"""Keeps the car's newest reports and their age, and finds what is wrong with them.

Frames, decoded by the interface, become measurements and reason codes; the gateway decides what follows from them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from typing import Any, Final

from vve_sumo.timing import MAX_GEAR_REPORT_AGE, MAX_REPORT_AGE
from vve_sumo.values import Frame
from vve_sumo.vehicle.interface import (
    REQUIRED,
    BrakeState,
    BrakeTorque,
    Gear,
    GearState,
    Malformed,
    Report,
    SteeringState,
    ThrottleState,
    VehicleInterface,
    WheelSpeeds,
    YawRate,
    error_text,
)
from vve_sumo.vehicle.report_consistency import ReportConsistency

TOLERANCE: Final = 1e-6  # so that rounding of times never decides [s]

# Inputs that are a driver's, whatever the module's own bits say: both are between an untouched pedal and the position
# that a Dataspeed module calls activity (0.18 of the sensor's range: 57 N m, 0.046), with room for a sensor's offset.
FOOT_TORQUE: Final = 150.0  # that the driver's brake pedal asks for [N m]
FOOT_OPENING: Final = 0.05  # that the driver's throttle pedal asks for, 0 to 1
#: Torque of a driver on the steering wheel that confirms an override; an untouched wheel's friction gives less [N m].
HAND_TORQUE: Final = 2.0
IDLE_TORQUE: Final = 40.0  # less brake torque than this is nobody's braking [N m]; the lightest touch asks for 57
STILL_TIME: Final = 0.5  # a throttle report without a change by a bit for this long shows no foot [s]

#: Reports that are read: the required ones, and where there is one the brake torque, in which a foot shows too.
_READ: Final = REQUIRED | {BrakeTorque}


class CarReports:
    """The newest report of every kind, each with the time it was taken in."""

    def __init__(self, wheel_radius: float, interface: VehicleInterface) -> None:
        self._wheel_radius = wheel_radius
        self._decode = interface.decode
        facts = interface.facts
        self._commands = facts.commands
        # Other reports are not decoded: they come as often as those needed here and would cost as much.
        self._read = frozenset(number for number, kinds in facts.reports.items() if not _READ.isdisjoint(kinds))
        self._times: dict[type, float] = dict.fromkeys(REQUIRED, -math.inf)
        self._newest: dict[type, Report] = {}
        self._throttle_changed = -math.inf  # when the throttle report last said something new [s]
        self.brake = BrakeState(enabled=False)
        self.throttle = ThrottleState(enabled=False)
        self.steering = SteeringState(math.nan, enabled=False)
        self.gear = GearState(Gear.NONE)
        self.speed = math.nan  #: of the rear axle, from the wheels [m/s], forward positive
        self.wheels: tuple[float, ...] = ()  #: angular speeds as last reported [rad/s]
        self._wheels_changed = -math.inf  # when they were last others than before
        self.fastest_wheel = math.nan  #: largest speed of any wheel's tread, without sign [m/s]
        self.yaw_rate = math.nan  #: [rad/s] counter-clockwise
        self._brake_torque = math.nan
        self.error = ""  #: what the interface's decoder raised last, with the place; empty while it has raised nothing
        self.consistency = ReportConsistency()  #: of the reports among each other
        self.wheel_angle = math.nan  #: last valid angle of the steering wheel [rad], left positive

    @property
    def last_dbw_report(self) -> float:
        """Time at which a report of one of the interface's subsystems was last decoded [s]; -inf before the first.

        Wheel speeds and yaw rate do not count: the car itself measures them, whether or not it could be commanded.
        """
        return max(self._times[kind] for kind in _OF_THE_INTERFACE)

    def take(self, now: float, frames: Iterable[Frame]) -> list[str]:
        """Take in frames received since the last call; reason codes of malformed reports and foreign commands."""
        troubles: list[str] = []
        read, decode, times, newest = self._read, self._decode, self._times, self._newest
        reports: Any  # a tuple of reports, or Malformed; None of an interface that forgets to return
        for frame in frames:
            number, _data = frame
            if number in read:
                try:
                    reports = decode(frame)
                except Exception as error:
                    # A bug in an interface's decoder must not keep the gateway from stopping the car.
                    self.error = error_text(error)
                    troubles.append("interface_raised")
                    continue
                if reports is None or isinstance(reports, Malformed):
                    troubles.append("report_malformed")
                else:
                    for report in reports:
                        kind = type(report)
                        times[kind] = now
                        if newest.get(kind) is not report:
                            newest[kind] = report
                            if (store := _STORES.get(kind)) is not None:
                                store(self, now, report)
            elif number in self._commands:
                troubles.append("another_writer")
        return troubles

    def stale(self, now: float) -> list[str]:
        """Reason codes of the reports that are missing or too old."""
        times, oldest = self._times, now - MAX_REPORT_AGE - TOLERANCE
        if min(times.values()) >= oldest:
            return []
        reasons = [code for kind, code in _STALE_CODES if times[kind] < oldest]
        if times[GearState] < now - MAX_GEAR_REPORT_AGE - TOLERANCE:
            reasons.append("gear_report_stale")
        return reasons

    def faults(self) -> list[str]:
        """Reason codes of faults that the subsystems report, and of measurements marked as invalid."""
        brake, throttle, steering = self.brake, self.throttle, self.steering
        reasons: list[str] = []
        if brake.watchdog or throttle.watchdog or steering.watchdog:
            reasons.append("dbw_watchdog")
        if brake.watchdog_braking:
            reasons.append("dbw_braking")
        if brake.fault:
            reasons.append("brake_fault")
        if throttle.fault:
            reasons.append("throttle_fault")
        if steering.fault:
            reasons.append("steering_fault")
        if self.gear.fault:
            reasons.append("gear_fault")
        if not math.isfinite(self.speed + self.yaw_rate + steering.wheel_angle):
            reasons.append("report_invalid")
        return reasons

    def dropped_out(self) -> list[str]:
        """Reason codes of the subsystems that are disabled or timed out although they are commanded."""
        brake, throttle, steering = self.brake, self.throttle, self.steering
        if self.all_enabled() and not (brake.timeout or throttle.timeout or steering.timeout):
            return []
        reasons: list[str] = []
        for report, timeout, disabled in (
            (brake, "brake_timeout", "brake_disabled"),
            (throttle, "throttle_timeout", "throttle_disabled"),
            (steering, "steering_timeout", "steering_disabled"),
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
        """Reason codes of the pedals that the driver touches, by the modules' bits or by the pedals' positions."""
        brake, throttle = self.brake, self.throttle
        on_brake = brake.driver or brake.driver_torque > FOOT_TORQUE
        on_throttle = throttle.driver or throttle.driver_opening > FOOT_OPENING
        if not (on_brake or on_throttle):
            return []
        return ["driver_on_brake"] * on_brake + ["driver_on_throttle"] * on_throttle

    def attended(self, now: float) -> bool:
        """Whether a foot is on a pedal, by a report that is fresh and not contradicted.

        Brake torque of none contradicts a foot on the brake; a throttle pedal that has not moved by a bit of its sensor
        for long is none that a foot is on.
        """
        brake, throttle = self.brake, self.throttle
        torque = self.brake_torque(now)
        on_brake = self.age(BrakeState, now) <= MAX_REPORT_AGE + TOLERANCE and not torque < IDLE_TORQUE
        if on_brake and (brake.driver or brake.driver_torque > FOOT_TORQUE):
            return True
        on_throttle = throttle.driver or throttle.driver_opening > FOOT_OPENING
        fresh = self.age(ThrottleState, now) <= MAX_REPORT_AGE + TOLERANCE
        return on_throttle and fresh and now - self._throttle_changed < STILL_TIME

    def confirmed(self, override: str) -> bool:
        """Whether something besides the module's own word says that the driver caused its latched `override`.

        A module whose interface reports nothing else is believed. What confirms that of the shifter, the gateway knows.
        """
        match override:
            case "brake":
                return bool(self.driver()) or self.brake.driver_torque != self.brake.driver_torque
            case "throttle":
                return bool(self.driver()) or self.throttle.driver_opening != self.throttle.driver_opening
            case "steering":
                torque = self.steering.driver_torque
                return abs(torque) > HAND_TORQUE or torque != torque
            case _:
                return False

    def brake_torque(self, now: float) -> float:
        """Brake torque that the car itself reports, of all wheels [N m]; NaN where it reports none that is fresh."""
        fresh = self._times.get(BrakeTorque, -math.inf) >= now - MAX_REPORT_AGE - TOLERANCE
        return self._brake_torque if fresh else math.nan

    def age(self, kind: type, now: float) -> float:
        """Time since a report of this kind was last decoded [s]; inf before the first."""
        return now - self._times.get(kind, -math.inf)

    def all_enabled(self) -> bool:
        """Whether brake, throttle and steering all say that they are enabled."""
        return self.brake.enabled and self.throttle.enabled and self.steering.enabled

    def any_enabled(self) -> bool:
        """Whether brake, throttle or steering says that it is enabled."""
        return self.brake.enabled or self.throttle.enabled or self.steering.enabled

    def speed_known(self, now: float) -> bool:
        """Whether the speed is fresh and valid."""
        fresh = self._times.get(WheelSpeeds, -math.inf) >= now - MAX_REPORT_AGE - TOLERANCE
        return fresh and math.isfinite(self.speed)

    def in_park(self, now: float) -> bool:
        """Whether a fresh gear report without fault says park."""
        fresh = self._times.get(GearState, -math.inf) >= now - MAX_GEAR_REPORT_AGE - TOLERANCE
        return fresh and self.gear.gear is Gear.PARK and not self.gear.fault

    def unchanged(self, now: float) -> float:
        """For how long nonzero wheel speeds have been the same to the last bit [s]; 0 for none or zero ones."""
        return now - self._wheels_changed if self.fastest_wheel > 0.0 else 0.0

    def _store_brake(self, _: float, brake: BrakeState) -> None:
        self.brake = brake

    def _store_throttle(self, now: float, throttle: ThrottleState) -> None:
        self.throttle, self._throttle_changed = throttle, now

    def _store_steering(self, now: float, steering: SteeringState) -> None:
        self.steering, angle = steering, steering.wheel_angle
        if math.isfinite(angle):
            self.wheel_angle = angle
            self.consistency.wheel_angle.step(now, angle)

    def _store_gear(self, _: float, gear: GearState) -> None:
        self.gear = gear

    def _store_yaw_rate(self, now: float, rate: YawRate) -> None:
        self.yaw_rate = yaw_rate = rate.yaw
        self.consistency.yaw_rate.step(now, yaw_rate)

    def _store_brake_torque(self, _: float, torque: BrakeTorque) -> None:
        self._brake_torque = torque.actual

    def _store_wheels(self, now: float, wheels: WheelSpeeds) -> None:
        if wheels != self.wheels:
            self.wheels, self._wheels_changed = wheels, now
        front_left, front_right, rear_left, rear_right = wheels
        # One invalid wheel makes both numbers NaN.
        if not math.isfinite(front_left + front_right + rear_left + rear_right):
            self.speed = self.fastest_wheel = math.nan
            return
        # The mean of the rear wheels is the rear axle's speed in a bend too.
        self.speed = 0.5 * (rear_left + rear_right) * self._wheel_radius
        self.consistency.speed.step(now, self.speed)
        self.fastest_wheel = (
            max(abs(front_left), abs(front_right), abs(rear_left), abs(rear_right)) * self._wheel_radius
        )


#: What is done with a report that says something new, by its kind; others are stored nowhere.
_STORES: Final[dict[type, Callable[[CarReports, float, Any], None]]] = {
    BrakeState: CarReports._store_brake,
    ThrottleState: CarReports._store_throttle,
    SteeringState: CarReports._store_steering,
    GearState: CarReports._store_gear,
    WheelSpeeds: CarReports._store_wheels,
    YawRate: CarReports._store_yaw_rate,
    BrakeTorque: CarReports._store_brake_torque,
}

_OF_THE_INTERFACE: Final[tuple[type, ...]] = (BrakeState, ThrottleState, SteeringState, GearState)

_STALE_CODES: Final[tuple[tuple[type, str], ...]] = (
    (BrakeState, "brake_report_stale"),
    (ThrottleState, "throttle_report_stale"),
    (SteeringState, "steering_report_stale"),
    (WheelSpeeds, "wheel_speeds_stale"),
    (YawRate, "yaw_rate_stale"),
)
