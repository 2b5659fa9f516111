"""The predictor: turns trusted rear-axle poses, noisy and late, into one smooth pose at the time it is needed for.

It knows how a car moves between fixes; it must not know receivers, trust, maps or SUMO. Measured acceleration and yaw
rate carry the state from fix to fix; position, speed and heading correct it with fixed time constants (a complementary
filter). So noise is averaged over the time constants, while a true manoeuvre, which the inertial sensors measure at
once, hardly lags. Plain floats throughout: the same poses give the same bits.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from vve_sumo.frames import wrap_angle
from vve_sumo.values import Point, Pose

_REAR_AXLE: Final = Point.REAR_AXLE  # found once, for every pose: looking it up in its class costs a call


@dataclass(frozen=True, slots=True)
class Tuning:
    """Time constants and limits; the defaults suit RTK-GNSS with inertial sensors at 20 to 250 Hz."""

    position: float = 0.3  #: of the correction towards the measured position [s]
    speed: float = 0.6  #: of the correction towards the measured speeds [s]
    heading: float = 0.2  #: of the correction towards the measured heading [s]
    bias: float = 4.0  #: of the estimate of the measured acceleration's bias [s]
    rates: float = 0.08  #: of the smoothing of the acceleration and yaw rate that a prediction uses [s]
    grade: float = 0.5  #: of the smoothing of the grade [s]
    innovation: float = 0.1  #: over which speed errors, and motion signs at standstill, are averaged [s]
    innovation_limit: float = 0.06  #: averaged speed error that halves the speed's time constant [m/s]
    rest_speed: float = 0.05  #: below it the car counts as standing [m/s]
    rest_time: float = 0.3  #: how long it must stand before its pose is held [s]
    rest_exit_speed: float = 0.08  #: averaged measured speed that ends the hold [m/s]
    rest_exit_distance: float = 0.05  #: averaged measured displacement that ends the hold [m]
    jump_limit: float = 1.0  #: a measured position further off starts the filter anew [m]
    gap_limit: float = 1.0  #: a longer time between poses starts the filter anew [s]
    horizon: float = 1.0  #: maximum extrapolation time [s]


def _finite(pose: Pose) -> bool:
    motion = pose.speed + pose.lateral_speed + pose.yaw_rate + pose.acceleration + pose.grade
    return math.isfinite(pose.time + pose.x + pose.y + pose.heading + motion)


class Predictor:
    """Predicts the pose: call `update` with each trusted pose and `at` for any time; `at` is None until the first pose.

    A pose that is not finite or not newer than the last is ignored. After a gap or jump beyond the tuning's limits the
    filter starts anew from the measured pose. While the car stands, pose and heading are held and all rates are 0.
    """

    _time: float  #: of the newest pose taken in; the state below is that of this time
    _x: float
    _y: float
    _heading: float
    _speed: float
    _lateral_speed: float
    _acceleration: float  #: smoothed, for extrapolation
    _yaw_rate: float  #: smoothed, for extrapolation
    _grade: float
    _direction: float  #: +1 forward, -1 reverse, 0 not moved since the filter started or a standstill ended
    _measured_acceleration: float  #: of the newest pose, for integration
    _measured_yaw_rate: float  #: of the newest pose, for integration
    _bias: float  #: of the measured acceleration [m/s2]
    _innovation: float  #: averaged speed error [m/s]
    _still: float  #: how long the car has stood [s]
    _rest_speed: float  #: averaged measured speed while the pose is held [m/s]
    _rest_x: float  #: averaged measured displacement while the pose is held [m]
    _rest_y: float

    def __init__(self, tuning: Tuning = Tuning()) -> None:
        self._tuning = tuning
        self._count = 0  #: poses since the filter started
        self._resting = False

    def update(self, pose: Pose) -> None:
        """Feed the filter with a pose of the rear axle; times must increase, their spacing may vary."""
        tuning = self._tuning
        if not _finite(pose):
            return
        if self._count == 0:
            self._start(pose)
            return
        step = pose.time - self._time
        if step <= 0.0:
            return
        travelled = abs(self._speed * step)
        if step > tuning.gap_limit or math.hypot(pose.x - self._x, pose.y - self._y) > tuning.jump_limit + travelled:
            self._start(pose)
            return
        self._time = pose.time
        self._count += 1
        if self._resting:
            self._rest(pose, step)
        else:
            self._drive(pose, step)
        self._measured_acceleration, self._measured_yaw_rate = pose.acceleration, pose.yaw_rate

    def at(self, time: float) -> Pose | None:
        """Return the rear axle's pose at `time` [s of drive time] by constant acceleration and turn rate.

        Braking ends at standstill, never in reverse. Beyond the horizon the car's place is not known: its pose is held
        there, at rest.
        """
        if self._count == 0:
            return None
        ahead = time - self._time
        if ahead > self._tuning.horizon:
            lost = self.at(self._time + self._tuning.horizon)
            return None if lost is None else self._pose(time, lost.x, lost.y, lost.heading, 0.0, 0.0, 0.0, 0.0)
        if self._resting or abs(self._speed) < self._tuning.rest_speed:
            return self._pose(time, self._x, self._y, self._heading, 0.0, 0.0, 0.0, 0.0)
        speed, acceleration, yaw_rate = self._speed, self._acceleration, self._yaw_rate
        moving = ahead
        if speed * (speed + acceleration * ahead) < 0.0 < ahead:
            moving = -speed / acceleration
        distance = (speed + 0.5 * acceleration * moving) * moving
        lateral = self._lateral_speed * moving
        x, y = self._along(distance, lateral, yaw_rate * moving)
        heading = wrap_angle(self._heading + yaw_rate * moving)
        speed += acceleration * moving
        if moving != ahead or abs(speed) < self._tuning.rest_speed:
            return self._pose(time, x, y, heading, 0.0, 0.0, 0.0, 0.0)
        return self._pose(time, x, y, heading, speed, self._lateral_speed, yaw_rate, acceleration)

    def _pose(
        self,
        time: float,
        x: float,
        y: float,
        heading: float,
        speed: float,
        lateral_speed: float,
        yaw_rate: float,
        acceleration: float,
    ) -> Pose:
        return Pose(time, _REAR_AXLE, x, y, heading, speed, lateral_speed, yaw_rate, acceleration, self._grade)

    def _start(self, pose: Pose) -> None:
        self._time, self._count, self._resting = pose.time, 1, False
        self._x, self._y, self._heading = pose.x, pose.y, pose.heading
        self._speed, self._lateral_speed = pose.speed, pose.lateral_speed
        self._acceleration = self._measured_acceleration = pose.acceleration
        self._yaw_rate = self._measured_yaw_rate = pose.yaw_rate
        self._grade = pose.grade
        self._bias = self._innovation = self._still = self._direction = 0.0

    def _along(self, distance: float, lateral: float, turn: float) -> tuple[float, float]:
        """End point of an arc of `distance` and `turn`, shifted by `lateral`; chord shortened to second order."""
        middle = self._heading + 0.5 * turn
        cosine, sine = math.cos(middle), math.sin(middle)
        chord = distance * (1.0 - turn * turn / 24.0)
        return self._x + chord * cosine - lateral * sine, self._y + chord * sine + lateral * cosine

    def _drive(self, pose: Pose, step: float) -> None:
        self._advance(pose, step)
        self._correct(pose, step)
        self._keep_direction()
        self._still = self._still + step if abs(self._speed) < self._tuning.rest_speed else 0.0
        if self._still >= self._tuning.rest_time:
            self._resting = True
            self._speed = self._lateral_speed = self._acceleration = self._yaw_rate = 0.0
            self._rest_speed = self._rest_x = self._rest_y = 0.0

    def _advance(self, pose: Pose, step: float) -> None:
        acceleration = 0.5 * (self._measured_acceleration + pose.acceleration) - self._bias
        turn = 0.5 * (self._measured_yaw_rate + pose.yaw_rate) * step
        distance = (self._speed + 0.5 * acceleration * step) * step
        self._x, self._y = self._along(distance, self._lateral_speed * step, turn)
        self._speed += acceleration * step
        self._heading = wrap_angle(self._heading + turn)

    def _keep_direction(self) -> None:
        """Let the speed change sign only after a rest: braking must not end in reverse."""
        if self._speed * self._direction < 0.0:
            self._speed = 0.0
        elif abs(self._speed) > self._tuning.rest_exit_speed:
            self._direction = math.copysign(1.0, self._speed)

    def _correct(self, pose: Pose, step: float) -> None:
        """Correct each quantity by the share of its error that `step` is of its time constant."""
        tuning = self._tuning
        least = 1.0 / self._count  # after a start the filter averages instead
        error = pose.speed - self._speed
        self._innovation += (error - self._innovation) * step / (tuning.innovation + step)
        # A speed error that outlasts the noise means a wrong acceleration: weight the measured speed more.
        surprise = self._innovation / tuning.innovation_limit
        correction = error * max(step / (tuning.speed / (1.0 + surprise * surprise) + step), least)
        self._speed += correction
        self._bias -= correction / tuning.bias
        self._lateral_speed += (pose.lateral_speed - self._lateral_speed) * max(step / (tuning.speed + step), least)
        share = max(step / (tuning.position + step), least)
        self._x += (pose.x - self._x) * share
        self._y += (pose.y - self._y) * share
        share = max(step / (tuning.heading + step), least)
        self._heading = wrap_angle(self._heading + wrap_angle(pose.heading - self._heading) * share)
        share = max(step / (tuning.rates + step), least)
        self._acceleration += (pose.acceleration - self._bias - self._acceleration) * share
        self._yaw_rate += (pose.yaw_rate - self._yaw_rate) * share
        self._grade += (pose.grade - self._grade) * max(step / (tuning.grade + step), least)

    def _rest(self, pose: Pose, step: float) -> None:
        """Hold the pose until averaged speed or displacement shows motion."""
        tuning = self._tuning
        share = step / (tuning.innovation + step)
        self._rest_speed += (pose.speed - self._rest_speed) * share
        self._rest_x += (pose.x - self._x - self._rest_x) * share
        self._rest_y += (pose.y - self._y - self._rest_y) * share
        moved = math.hypot(self._rest_x, self._rest_y) > tuning.rest_exit_distance
        if moved or abs(self._rest_speed) > tuning.rest_exit_speed:
            self._resting = False
            self._still = self._innovation = self._direction = 0.0
            self._speed = self._rest_speed + (pose.acceleration - self._bias) * tuning.innovation
            self._count = 10
