"""Fixes made of a ROS 2 driver's messages: NavSatFix for the place, Imu for the heading, Odometry for the speed.

Messages belong together by their stamps. What is missing or no number makes no fix, and has a reason; what the driver
states as unknown stays unknown, and the trust gate of the drive refuses it. Knows messages and values; it must not know
DDS or sockets.
"""

from __future__ import annotations

import math
from collections import Counter, deque
from collections.abc import Sequence
from typing import Any, Final, NamedTuple

from vve_sumo.frames import Mounting, wrap_angle
from vve_sumo.pose.nmea_encoder import LEAP_SECONDS
from vve_sumo.values import Fix, FixQuality
from vve_sumo.wire.ros2.messages import GNSS_EPOCH

#: types of the topics that are heard
FIX, IMU, ODOM = "sensor_msgs/msg/NavSatFix", "sensor_msgs/msg/Imu", "nav_msgs/msg/Odometry"
#: an Imu and an Odometry belong to a fix whose stamp is no farther off than this [s]: a car at 12 m/s brakes by 0.1 m/s
NEAR: Final = 0.02
#: how many of each wait for a fix: 0.2 s of an inertial unit of 100 Hz
KEPT: Final = 20
#: NavSatStatus knows no fixed ambiguities: a fix by a base station with this accuracy or better counts as such [m]; a
#: float solution states decimetres
FIXED_SIGMA: Final = 0.05
#: NavSatStatus.status, and what it is worth where the accuracy is no better than FIXED_SIGMA
QUALITY: Final = {0: FixQuality.SINGLE, 1: FixQuality.DIFFERENTIAL, 2: FixQuality.RTK_FLOAT}
BASE_STATION: Final = 2
MAX_ALTITUDE: Final = 1e5  #: of a fix, up or down; it may also be unknown, NaN [m]
#: why messages make no fix
NOT_FINITE, NOT_NEWER, ALONE = "not_finite", "stamp_not_newer", "without_imu_or_odometry"
NO_ORIENTATION, MALFORMED, SECOND = "without_orientation", "malformed", "second_publisher"


class _Turning(NamedTuple):
    stamp: float  # Unix time [s]
    heading: float  # from true east [rad], counter-clockwise
    pitch: float  # nose up [rad]
    roll: float  # right side down [rad]
    yaw_rate: float  # [rad/s]
    acceleration: float  # specific force ahead [m/s2]
    sigma: float  # of the heading [rad]; NaN unknown


class _Motion(NamedTuple):
    stamp: float  # Unix time [s]
    speed: float  # of the rear axle, ahead [m/s]
    lateral: float  # of the rear axle, to the left [m/s]
    sigma: float  # of the speed [m/s]; NaN unknown


class FixAssembler:
    """Takes messages in the order in which they came; each is heard of one publisher alone."""

    def __init__(self, mounting: Mounting, corrections_age: float) -> None:
        """`mounting` is the receiver's output point on the car.

        `corrections_age` is how old corrections may be before the receiver no longer says that it has a fix by a base
        station [s]: the messages do not say it.
        """
        self._mounting, self._corrections_age = mounting, corrections_age
        self._publishers: dict[str, int] = {}
        self._turning: deque[_Turning] = deque(maxlen=KEPT)
        self._motion: deque[_Motion] = deque(maxlen=KEPT)
        self._waiting: Any = None  # a NavSatFix without its Imu or Odometry
        self._newest = -math.inf  # stamp of the newest NavSatFix
        self.made = 0  #: fixes
        self.refused: Counter[str] = Counter()  #: messages that made none, by reason
        self.silenced = False  #: a topic has a second publisher: no fix is made any more

    def take(self, kind: str, writer: int, message: Any) -> Fix | None:
        """Return the fix that a publisher's message completes, if any; a message of None is bytes that are none."""
        reason = self._taken(kind, writer, message)
        if reason:
            self.refused[reason] += 1
            return None
        return self._completed()

    def _taken(self, kind: str, writer: int, message: Any) -> str:
        """Keep what a message says; return why it is not taken, empty where it is."""
        if message is None:
            return MALFORMED
        if self._publishers.setdefault(kind, writer) != writer:
            # Whose receiver it is cannot be told.
            self.silenced = True
        if self.silenced:
            return SECOND
        return {IMU: self._take_imu, ODOM: self._take_odometry, FIX: self._take_fix}[kind](message)

    def _take_imu(self, message: Any) -> str:
        turn, force, rate = message.orientation, message.linear_acceleration, message.angular_velocity
        if message.orientation_covariance[0] == -1.0:
            return NO_ORIENTATION
        norm = math.hypot(turn.x, turn.y, turn.z, turn.w)
        measured = message.linear_acceleration_covariance[0] != -1.0 != message.angular_velocity_covariance[0]
        if not measured or not math.isfinite(force.x + rate.z) or not abs(norm - 1.0) < 0.01:
            return NOT_FINITE
        x, y, z, w = turn.x / norm, turn.y / norm, turn.z / norm, turn.w / norm
        heading = math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
        pitch = -math.asin(max(-1.0, min(1.0, 2.0 * (w * y - z * x))))
        roll = math.atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
        sigma = _sigma(message.orientation_covariance[8])
        self._turning.append(_Turning(_stamp(message), heading, pitch, roll, rate.z, force.x, sigma))
        return ""

    def _take_odometry(self, message: Any) -> str:
        moves, variances = message.twist.twist.linear, message.twist.covariance
        if not math.isfinite(moves.x + moves.y):
            return NOT_FINITE
        self._motion.append(_Motion(_stamp(message), moves.x, moves.y, _sigma(variances[0])))
        return ""

    def _take_fix(self, message: Any) -> str:
        if self._waiting is not None:
            self.refused[ALONE] += 1
            self._waiting = None
        stamp = _stamp(message)
        if not math.isfinite(message.latitude + message.longitude):
            return NOT_FINITE
        if abs(message.latitude) > 90.0 or abs(message.longitude) > 180.0 or abs(message.altitude) > MAX_ALTITUDE:
            return NOT_FINITE
        if stamp <= self._newest:
            return NOT_NEWER
        self._newest, self._waiting = stamp, message
        return ""

    def _completed(self) -> Fix | None:
        if self._waiting is None:
            return None
        turning, motion = (_nearest(kept, self._newest) for kept in (self._turning, self._motion))
        if turning is None or motion is None:
            return None
        message, self._waiting = self._waiting, None
        self.made += 1
        return self._fix(message, turning, motion)

    def _fix(self, message: Any, turning: _Turning, motion: _Motion) -> Fix:
        sigma = _position_sigma(message)
        quality = QUALITY.get(message.status.status, FixQuality.NONE)
        if message.status.status == BASE_STATION and sigma <= FIXED_SIGMA:
            quality = FixQuality.RTK_FIXED
        heading = wrap_angle(turning.heading + turning.yaw_rate * (self._newest - turning.stamp))
        ahead = motion.speed - turning.yaw_rate * self._mounting.left
        aside = motion.lateral + turning.yaw_rate * self._mounting.forward
        cos, sin = math.cos(heading), math.sin(heading)
        known = all(map(math.isfinite, (sigma, motion.sigma, turning.sigma)))
        return Fix(
            time=self._newest - GNSS_EPOCH + LEAP_SECONDS,
            time_received=math.nan,
            latitude=math.radians(message.latitude),
            longitude=math.radians(message.longitude),
            altitude=message.altitude,
            heading=heading,
            pitch=turning.pitch,
            roll=turning.roll,
            velocity_north=ahead * sin + aside * cos,
            velocity_east=ahead * cos - aside * sin,
            velocity_down=math.nan,
            yaw_rate=turning.yaw_rate,
            acceleration=turning.acceleration,
            # What the wire says seldom, such as an accuracy, would be believed for some packets more.
            locked=known and quality is FixQuality.RTK_FIXED,
            quality=quality,
            position_sigma=sigma,
            velocity_sigma=motion.sigma,
            heading_sigma=turning.sigma,
            differential_age=self._corrections_age,
        )


def _stamp(message: Any) -> float:
    return float(message.header.stamp.sec) + 1e-9 * float(message.header.stamp.nanosec)


def _sigma(variance: float) -> float:
    """Return the standard deviation of a variance; NaN where it is unknown, which ROS says by 0 or a negative one."""
    return math.sqrt(variance) if 0.0 < variance < math.inf else math.nan


def _position_sigma(message: Any) -> float:
    """Return the larger of east and north [m]; NaN where it is unknown."""
    if message.position_covariance_type == 0:
        return math.nan
    east, north = _sigma(message.position_covariance[0]), _sigma(message.position_covariance[4])
    return max(east, north) if math.isfinite(east + north) else math.nan


def _nearest(kept: Sequence[Any], stamp: float) -> Any:
    """Return what is nearest to a stamp, None where nothing is near."""
    near = [one for one in kept if abs(one.stamp - stamp) <= NEAR]
    return min(near, key=lambda one: abs(one.stamp - stamp), default=None)
