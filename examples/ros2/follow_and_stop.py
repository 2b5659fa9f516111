"""A ROS 2 node that drives: it follows /path by pure pursuit and stops before what the radar sees in its way.

    python follow_and_stop.py [SPEED]        m/s, 11.176 by default

It answers every /odom, the last message of a tick, with one command on /cmd_vel that carries its stamp. By a radar scan
that is older than 0.3 s it does not drive: it says nothing, and the gateway stops the car.
"""

import math
import sys
from collections.abc import Callable
from contextlib import suppress

import numpy as np
import rclpy
from builtin_interfaces.msg import Time
from geometry_msgs.msg import TwistStamped
from nav_msgs.msg import Odometry, Path
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import PointCloud2

BUMPER, HALF_WIDTH, MAX_AGE = 3.84, 1.3, 0.3  # [m], [m], [s]
GAP = 6.6  # [m], 1.6 of which pass while the car comes to the speeds that it is told
BRAKING, SLOWING, SIDEWAYS = 1.8, 1.0, 1.2  # [m/s2]: for what stands, before bends, in bends
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class FollowAndStop(Node):
    def __init__(self, speed: float) -> None:
        super().__init__("follow_and_stop")
        self.speed, self.line, self.scan, self.scanned = speed, None, None, -math.inf
        self.commands = self.create_publisher(TwistStamped, "/cmd_vel", 10)
        self.create_subscription(Path, "/path", self.follow, LATCHED)
        self.create_subscription(PointCloud2, "/radar/points", self.see, 10)  # before /odom: it is taken first
        self.create_subscription(Odometry, "/odom", self.answer, 10)

    def follow(self, path: Path) -> None:
        self.line = np.array([(each.pose.position.x, each.pose.position.y) for each in path.poses])
        (x, y), steps = np.gradient(self.line, axis=0).T, np.hypot(*np.diff(self.line, axis=0).T)
        bends = np.abs(np.gradient(np.unwrap(np.arctan2(y, x)))) / np.hypot(x, y)
        self.speeds = np.minimum(self.speed, np.sqrt(SIDEWAYS / np.maximum(bends, 1e-6)))
        for at in range(len(steps) - 1, -1, -1):  # slow enough for the bends to come
            self.speeds[at] = min(self.speeds[at], math.sqrt(self.speeds[at + 1] ** 2 + 2.0 * SLOWING * steps[at]))

    def see(self, cloud: PointCloud2) -> None:
        self.scan = np.frombuffer(bytes(cloud.data), "<f4").reshape(-1, 6)  # x, y, z, range, azimuth, range rate
        self.scanned = seconds(cloud.header.stamp)

    def answer(self, odometry: Odometry) -> None:
        if self.line is None or not 0.0 <= seconds(odometry.header.stamp) - self.scanned <= MAX_AGE:
            return
        place, turn, speed = odometry.pose.pose.position, odometry.pose.pose.orientation, odometry.twist.twist.linear.x
        away = self.line - (place.x, place.y)
        far = np.hypot(*away.T)
        nearest = int(far.argmin())
        ahead = nearest + int(np.argmax(np.append(far[nearest:] >= max(3.0, 0.5 * speed), True)))
        goal = away[min(ahead, len(away) - 1)]
        aside = math.atan2(goal[1], goal[0]) - 2.0 * math.atan2(turn.z, turn.w)
        curvature = 2.0 * math.sin(aside) / max(math.hypot(*goal), 1.0)
        x, y, rate = self.scan[:, 0], self.scan[:, 1], self.scan[:, 5]
        stands = abs(rate + speed * np.cos(self.scan[:, 4])) < 2.0
        in_way = stands & (abs(y - 0.5 * curvature * (x + BUMPER) ** 2) < HALF_WIDTH)
        left = x[in_way].min(initial=math.inf) - GAP
        command = TwistStamped(header=odometry.header)
        command.twist.linear.x = float(
            min(self.speeds[nearest], speed + 0.5, math.sqrt(2.0 * BRAKING * max(left, 0.0)))
        )
        command.twist.angular.z = float(curvature * speed)
        self.commands.publish(command)


def seconds(stamp: Time) -> float:
    return stamp.sec + 1e-9 * stamp.nanosec


def spin(make: Callable[[], Node]) -> None:
    rclpy.init()
    with suppress(KeyboardInterrupt, rclpy.executors.ExternalShutdownException):  # it was told to end
        rclpy.spin(make())


if __name__ == "__main__":
    spin(lambda: FollowAndStop(float(sys.argv[1]) if len(sys.argv) > 1 else 11.176))
