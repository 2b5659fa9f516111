"""Checks whether the receiver and the car's own sensors report the same motion.

Dead reckoning from wheel speeds and gyroscope is compared with the poses in the setpoints, speed with speed, and the
steering report with the gyroscope. The result is reason codes; the module knows no arming state and commands nothing.
It cannot tell which of two disagreeing sources is wrong, so every disagreement is a reason to stop.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import Final

from vve_sumo.frozen import fast_frozen
from vve_sumo.values import Setpoint, Vehicle
from vve_sumo.vehicle.calibration import Calibration
from vve_sumo.vehicle.drift import DELAY, DriftCheck, DriftSample
from vve_sumo.vehicle.setpoint_validation import Debounce

# Allowed difference of GNSS and wheel speed: this for the noise of both, plus the wheels' calibrated scale error
# and DELAY times the acceleration.
SPEED_DIFFERENCE: Final = 0.30  # [m/s]
ACCELERATION_LAG: Final = 0.1  # of that acceleration [s]
DIFFERENCE_TIME: Final = 0.5  # a difference that lasts so long is a fault [s]
# A difference this many times the allowed one is neither slip nor delay, and is a fault after the shorter time.
GROSS_FACTOR: Final = 3.0
GROSS_TIME: Final = 0.1  # [s]
# A gyroscope's bias is of the order of 0.01 rad/s; a wrong sign or axis shows as twice the yaw rate.
YAW_RATE_DIFFERENCE: Final = 0.10  # [rad/s]

# Dead reckoning: windows over which the pose is compared with it. A step shows in the short window. A slow drift shows
# in the long one, where the calibration's errors allow a larger difference.
WINDOWS: Final[tuple[float, ...]] = (1.0, 3.0, 10.0)  # [s]
SAMPLE_PERIOD: Final = 0.1  # between two poses that are kept for later comparison [s]
POSITION_DIFFERENCE: Final = 0.15  # ten sigma of RTK noise and what the pose's filter adds [m]
# Lateral share of the distance: the receiver's heading against the car's (0.2 deg), and half of the rear axle's slip.
LATERAL_SHARE: Final = 0.008
HEADING_DIFFERENCE: Final = 0.03  # ten sigma of the receiver's heading and what the pose's filter adds [rad]
TURN_SHARE: Final = 0.02  # of the turned angle: the gyroscope's scale
BIAS_LEARNT: Final = 0.001  # what a bias that was averaged at standstill may be wrong by [rad/s]
BIAS_UNKNOWN: Final = 0.012  # what it may be otherwise [rad/s]
BIAS_TIME: Final = 10.0  # over which it is averaged at standstill [s]
BIAS_MIN_TIME: Final = 0.4  # from when on it is believed [s]
MAX_BIAS: Final = 0.05  # what turns faster at standstill is no bias [rad/s]

# The steering report against the gyroscope: single-track model on a steady circle.
STEERING_DIFFERENCE: Final = 0.06  # [rad/s]
STEERING_SHARE: Final = 0.20  # of the yaw rate that the angle should give

# A report is frozen if it is the same to the last bit while its reference has been off by these changes for this long:
# off what the reference was then, and off what the report says. The report of a car that has just stopped stays the
# same too, while a receiver whose fixes are late goes on falling towards it.
FROZEN_TIME: Final = 0.5  # [s]
FROZEN_SPEED_CHANGE: Final = 0.20  # of the receiver's speed meanwhile [m/s]
FROZEN_YAW_RATE_CHANGE: Final = 0.04  # of the receiver's yaw rate meanwhile [rad/s]
FROZEN_STEERING_CHANGE: Final = 0.03  # of the commanded road-wheel angle meanwhile [rad]


# Dataclasses and not tuples, here and below: each field is read several times, which tuples with names make dear.
@fast_frozen
@dataclass(frozen=True, slots=True)
class CarMotion:
    """The car's motion at one step by its own sensors, with the commanded steering."""

    speed: float  #: of the rear axle by the wheels [m/s], forward positive; NaN unknown
    yaw_rate: float  #: by the gyroscope [rad/s] counter-clockwise; NaN unknown
    steering: float  #: road-wheel angle as reported [rad], left positive; NaN unknown
    wheels: tuple[float, ...]  #: the wheels' angular speeds as reported [rad/s]
    commanded_steering: float  #: commanded road-wheel angle [rad]; NaN where none is commanded
    stands: bool  #: by all evidence


@fast_frozen
@dataclass(frozen=True, slots=True)
class _Place:
    """A pose of a setpoint, with the dead-reckoned pose at the same time."""

    time: float
    x: float
    y: float
    heading: float
    own_x: float
    own_y: float
    own_heading: float
    distance: float
    turned: float
    speed: float  #: by the receiver

    def seen(self, later: _Place) -> tuple[float, float]:
        """Offset of a later pose ahead and to the left [m] of where dead reckoning leads from this one."""
        cosine, sine = math.cos(self.own_heading), math.sin(self.own_heading)
        x, y = later.own_x - self.own_x, later.own_y - self.own_y
        own_ahead, own_left = x * cosine + y * sine, y * cosine - x * sine
        cosine, sine = math.cos(self.heading), math.sin(self.heading)
        x, y = later.x - self.x, later.y - self.y
        return x * cosine + y * sine - own_ahead, y * cosine - x * sine - own_left


class _Frozen:
    """Detects a report that stays the same while its reference changes away from it."""

    __slots__ = ("_change", "_long", "_reference", "_report")

    def __init__(self, change: float) -> None:
        self._change = change
        self._report: object = None
        self._long = Debounce(FROZEN_TIME)
        self._reference = math.nan

    def step(self, now: float, report: object, value: float, reference: float) -> bool:
        """Whether `report` has stayed the same for too long with `reference` off both its value of then and `value`.

        `value` is what the report says of the quantity that `reference` measures.
        """
        if report != self._report or not math.isfinite(reference):
            self._report, self._reference = report, reference
        changed = abs(reference - self._reference) > self._change
        return self._long.step(now, changed and abs(reference - value) > self._change)


class Plausibility:
    """Compares the receiver's and the car's measurements step by step."""

    def __init__(self, vehicle: Vehicle, calibration: Calibration) -> None:
        self._wheelbase = vehicle.wheelbase
        self._understeer = vehicle.understeer_gradient
        # Rear slip angle over lateral acceleration on a steady circle: the rear axle's share of the mass over its
        # cornering stiffness (Rajamani, Vehicle Dynamics and Control, 3.3).
        self._slip = vehicle.mass * vehicle.front_axle_to_mass / (vehicle.wheelbase * vehicle.cornering_stiffness_rear)
        self._speed_share = calibration.wheel_speed_tolerance
        self._speed_differs, self._speed_gross = Debounce(DIFFERENCE_TIME), Debounce(GROSS_TIME)
        self._yaw_rate_differs = Debounce(DIFFERENCE_TIME)
        self._steering_differs = Debounce(DIFFERENCE_TIME)
        self._wheels = _Frozen(FROZEN_SPEED_CHANGE)
        self._gyroscope = _Frozen(FROZEN_YAW_RATE_CHANGE)
        self._steering_report = _Frozen(FROZEN_STEERING_CHANGE)
        self._acceleration = self._gnss_acceleration = 0.0  # by the wheels, by the receiver [m/s2]
        self._gnss = (math.nan, math.nan)  # the receiver's speed [m/s], and its time [s]
        self._speed = self._yaw_rate = math.nan  # of the step before
        self._bias, self._bias_time = 0.0, 0.0  # of the gyroscope [rad/s], and for how long it was averaged [s]
        self._x = self._y = self._heading = self._distance = self._turned = 0.0  # dead reckoning
        self._windows: tuple[deque[_Place], ...] = tuple(deque() for _ in WINDOWS)
        self._sampled = -math.inf
        self._turn = 0  # of the windows
        self._way = 0.0  # driven, backwards counts negative [m]
        self._drift = DriftCheck(self._slip, self._speed_share)

    def step(
        self, now: float, elapsed: float, car: CarMotion, setpoint: Setpoint | None, fresh: bool
    ) -> list[str]:  # fmt: skip
        """Reason codes of what disagrees at `now` [s].

        `setpoint` is the newest valid one with a pose from trusted fixes, else None; `fresh` says that it arrived at
        this step. Without it, or without the car's speed or yaw rate, receiver and car are not compared, and the
        windows begin anew.
        """
        self._reckon(elapsed, car)
        reasons = self._steering(now, car)
        if setpoint is None or not math.isfinite(car.speed + car.yaw_rate):
            self._speed_differs.reset()
            self._speed_gross.reset()
            self._yaw_rate_differs.reset()
            self._forget()
            return reasons
        reasons += self._rates(now, car, setpoint)
        if fresh:
            self._accelerate(setpoint)
            reasons += self._pose(now, car, setpoint)
        return reasons

    # Comparison of single quantities.

    def _rates(self, now: float, car: CarMotion, setpoint: Setpoint) -> list[str]:
        reasons = []
        allowed = SPEED_DIFFERENCE + 2.0 * self._speed_share * abs(car.speed)
        # The smaller acceleration of the two, so that a jump of wheels or receiver alone does not widen the tolerance.
        by_wheels, by_receiver = abs(self._acceleration), abs(self._gnss_acceleration)
        allowed += DELAY * (by_receiver if by_receiver < by_wheels else by_wheels)
        difference = abs(setpoint.speed - car.speed)
        gross = self._speed_gross.step(now, not difference <= GROSS_FACTOR * allowed)
        if self._speed_differs.step(now, not difference <= allowed) or gross:
            reasons.append("speed_mismatch")
        if self._yaw_rate_differs.step(now, not abs(setpoint.yaw_rate - car.yaw_rate) <= YAW_RATE_DIFFERENCE):
            reasons.append("yaw_rate_mismatch")
        if self._wheels.step(now, car.wheels, car.speed, setpoint.speed):
            reasons.append("wheel_speeds_frozen")
        if self._gyroscope.step(now, car.yaw_rate, car.yaw_rate - self._bias, setpoint.yaw_rate):
            reasons.append("yaw_rate_frozen")
        if self._steering_report.step(now, car.steering, car.steering, car.commanded_steering):
            reasons.append("steering_report_frozen")
        return reasons

    def _accelerate(self, setpoint: Setpoint) -> None:
        """Update the filtered acceleration by the receiver."""
        (before, then), self._gnss = self._gnss, (setpoint.speed, setpoint.time)
        step = setpoint.time - then
        if 0.0 < step < ACCELERATION_LAG:
            share = step / (ACCELERATION_LAG + step)
            self._gnss_acceleration += ((setpoint.speed - before) / step - self._gnss_acceleration) * share

    def _steering(self, now: float, car: CarMotion) -> list[str]:
        """Compare the yaw rate of a steady circle at the reported angle with the gyroscope's."""
        curvature = math.tan(car.steering) / self._wheelbase
        expected = car.speed * curvature / (1.0 + self._understeer * car.speed * car.speed / self._wheelbase)
        allowed = STEERING_DIFFERENCE + STEERING_SHARE * abs(expected)
        differs = abs(expected - car.yaw_rate + self._bias) > allowed  # what is not known differs from nothing
        return ["steering_mismatch"] if self._steering_differs.step(now, differs) else []

    # Dead reckoning.

    def _reckon(self, elapsed: float, car: CarMotion) -> None:
        """Advance dead reckoning by wheels and gyroscope; at standstill learn the gyroscope's bias, and do not turn."""
        if car.stands:
            self._learn(elapsed, car.yaw_rate)
        speed, yaw_rate = car.speed, 0.0 if car.stands else car.yaw_rate - self._bias
        before, turned_before = self._speed, self._yaw_rate
        self._speed, self._yaw_rate = speed, yaw_rate
        if not (math.isfinite(speed + yaw_rate + before + turned_before) and elapsed > 0.0):
            self._forget()
            return
        self._acceleration += ((speed - before) / elapsed - self._acceleration) * elapsed / (ACCELERATION_LAG + elapsed)
        driven, turn = 0.5 * (before + speed) * elapsed, 0.5 * (turned_before + yaw_rate) * elapsed
        middle = self._heading + 0.5 * turn
        # The rear axle slips outwards in a bend: across the heading, against the lateral acceleration.
        across = -self._slip * speed * speed * yaw_rate * elapsed
        cosine, sine = math.cos(middle), math.sin(middle)
        self._x += driven * cosine - across * sine
        self._y += driven * sine + across * cosine
        self._heading += turn
        self._way += driven
        self._distance += abs(driven)
        self._turned += abs(turn)

    def _learn(self, elapsed: float, yaw_rate: float) -> None:
        if not abs(yaw_rate) < MAX_BIAS:
            return
        self._bias_time = min(self._bias_time + elapsed, BIAS_TIME)
        if self._bias_time > 0.0:
            self._bias += (yaw_rate - self._bias) * min(elapsed / self._bias_time, 1.0)

    def _forget(self) -> None:
        if self._sampled != -math.inf:
            for kept in self._windows:
                kept.clear()
            self._drift.reset()
            self._sampled = -math.inf

    def _pose(self, now: float, car: CarMotion, setpoint: Setpoint) -> list[str]:
        """Compare the setpoint's pose with an earlier one; each call takes the next window in turn."""
        place = self._place(now, car, setpoint)
        self._turn = (self._turn + 1) % len(WINDOWS)
        kept, oldest = self._windows[self._turn], place.time - WINDOWS[self._turn]
        while kept and kept[0].time < oldest:
            kept.popleft()
        explained = True
        if place.time - self._sampled >= SAMPLE_PERIOD:
            self._sampled = place.time
            for window in self._windows:
                window.append(place)
            way = self._way - car.speed * (now - setpoint.time)
            explained = self._drift.explain(
                DriftSample(setpoint.x, setpoint.y, setpoint.heading, setpoint.speed, car.speed, way)
            )
        reasons = self._compared(kept[0], place) if kept else []
        if not explained and "position_mismatch" not in reasons:
            reasons.append("position_mismatch")
        return reasons

    def _place(self, now: float, car: CarMotion, setpoint: Setpoint) -> _Place:
        """The setpoint's pose, with dead reckoning extrapolated back to its time."""
        age = now - setpoint.time
        back = car.speed * age
        return _Place(
            setpoint.time,
            setpoint.x,
            setpoint.y,
            setpoint.heading,
            self._x - back * math.cos(self._heading),
            self._y - back * math.sin(self._heading),
            self._heading - self._yaw_rate * age,
            self._distance,
            self._turned,
            setpoint.speed,
        )

    def _compared(self, then: _Place, now: _Place) -> list[str]:
        """Reason codes of where the pose moved differently from dead reckoning between two places."""
        turned, distance = now.turned - then.turned, now.distance - then.distance
        bias = BIAS_LEARNT if self._bias_time >= BIAS_MIN_TIME else BIAS_UNKNOWN
        uncertain = bias * (now.time - then.time) + TURN_SHARE * turned
        off = now.heading - then.heading - now.own_heading + then.own_heading
        # The difference of two finite headings can overflow to infinity, which has no remainder.
        off_heading = math.remainder(off, math.tau) if math.isfinite(off) else math.inf
        reasons = [] if abs(off_heading) <= HEADING_DIFFERENCE + uncertain else ["heading_mismatch"]
        ahead, left = then.seen(now)
        across = POSITION_DIFFERENCE + (LATERAL_SHARE + 0.5 * uncertain) * distance
        along = (
            POSITION_DIFFERENCE + (self._speed_share + 0.5 * uncertain) * distance + DELAY * abs(now.speed - then.speed)
        )
        allowed = math.hypot(across, along) if turned > 0.5 else across
        if not (abs(left) <= allowed and abs(ahead) <= (allowed if allowed > along else along)):
            reasons.append("position_mismatch")
        return reasons
