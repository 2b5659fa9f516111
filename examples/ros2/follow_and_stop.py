"""A ROS 2 node that drives: pure pursuit along /path/ahead, and a stop before what the radar sees in the way."""

import numpy as np
import rclpy
from geometry_msgs.msg import TwistStamped
from nav_msgs.msg import Odometry, Path
from rclpy.node import Node
from rclpy.time import Time
from sensor_msgs.msg import PointCloud2

BUMPER, HALF_WIDTH, GAP, BRAKING = 3.84, 1.3, 6.6, 1.8  # [m], [m], [m], [m/s2]


class FollowAndStop(Node):
    def __init__(self) -> None:
        super().__init__("follow_and_stop")
        self.commands, self.newest = self.create_publisher(TwistStamped, "/cmd_vel", 10), {}
        for kind, topic in ((Path, "/path/ahead"), (TwistStamped, "/path/speed"), (PointCloud2, "/radar/points")):
            self.create_subscription(kind, topic, lambda got, kind=kind: self.newest.update({kind: got}), 10)
        self.create_subscription(Odometry, "/odom", self.answer, 10)  # a tick's last message: made and taken last

    def answer(self, odometry: Odometry) -> None:
        path, wanted, scan = map(self.newest.get, (Path, TwistStamped, PointCloud2))
        now, speed = Time.from_msg(odometry.header.stamp), odometry.twist.twist.linear.x
        if scan and 0 <= (now - Time.from_msg(scan.header.stamp)).nanoseconds <= 3e8:  # else the gateway stops the car
            x, y = np.array([(each.pose.position.x, each.pose.position.y) for each in path.poses]).T
            reach = max(3.0, 0.5 * speed)
            aside = np.interp(reach, x, y)
            ahead, left, _, _, azimuth, rate = np.frombuffer(bytes(scan.data), "<f4").astype(float).reshape(-1, 6).T
            stands = abs(rate + speed * np.cos(azimuth)) < 2.0
            free = ahead[stands & (abs(left - np.interp(ahead + BUMPER, x, y)) < HALF_WIDTH)].min(initial=np.inf) - GAP
            command = TwistStamped(header=odometry.header)
            command.twist.linear.x = min(wanted.twist.linear.x, speed + 0.5, np.sqrt(2.0 * BRAKING * max(free, 0.0)))
            command.twist.angular.z = speed * 2.0 * aside / (reach**2 + aside**2)
            self.commands.publish(command)


if __name__ == "__main__":
    rclpy.init(signal_handler_options=rclpy.signals.SignalHandlerOptions.NO)
    rclpy.spin(FollowAndStop())
