"""A ROS 2 node for tests in the place of a receiver's driver: it publishes what it hears as JSON over UDP.

    python driver_node.py PORT FORWARD LEFT

PORT is where the fixes come, one a datagram, as `car_over_ros.py` writes them; FORWARD and LEFT are the receiver's
mounting on the car [m].
"""

import json
import math
import socket
import sys

import rclpy
from builtin_interfaces.msg import Time
from nav_msgs.msg import Odometry
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import Imu, NavSatFix

UNIX_OF_GNSS_NS = (315_964_800 - 18) * 1_000_000_000

rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
node = rclpy.create_node("receiver_driver")
publishers = {kind: node.create_publisher(kind, f"/receiver/{name}", 10)
              for kind, name in ((NavSatFix, "fix"), (Imu, "imu"), (Odometry, "odom"))}  # fmt: skip
end = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
end.bind(("127.0.0.1", int(sys.argv[1])))
forward, left = float(sys.argv[2]), float(sys.argv[3])


def turn(imu: Imu, yaw: float, pitch: float, roll: float) -> None:
    (cy, sy), (cp, sp), (cr, sr) = ((math.cos(0.5 * angle), math.sin(0.5 * angle)) for angle in (yaw, pitch, roll))
    imu.orientation.w = cr * cp * cy + sr * sp * sy
    imu.orientation.x = sr * cp * cy - cr * sp * sy
    imu.orientation.y = cr * sp * cy + sr * cp * sy
    imu.orientation.z = cr * cp * sy - sr * sp * cy


while True:
    fix = json.loads(end.recv(65_535))
    seconds, nanoseconds = divmod(1000 * round(fix["time"] * 1e6) + UNIX_OF_GNSS_NS, 1_000_000_000)
    imu, odometry, place = Imu(), Odometry(), NavSatFix()
    for message in (imu, odometry, place):
        message.header.stamp = Time(sec=seconds, nanosec=nanoseconds)
    turn(imu, fix["heading"], -(fix["pitch"] or 0.0), fix["roll"] or 0.0)
    imu.orientation_covariance[8] = fix["heading_sigma"] ** 2
    imu.angular_velocity.z, imu.linear_acceleration.x = fix["yaw_rate"], fix["acceleration"]
    cos, sin = math.cos(fix["heading"]), math.sin(fix["heading"])
    north, east, yaw_rate = fix["velocity_north"], fix["velocity_east"], fix["yaw_rate"]
    odometry.twist.twist.linear.x = east * cos + north * sin + yaw_rate * left
    odometry.twist.twist.linear.y = north * cos - east * sin - yaw_rate * forward
    odometry.twist.covariance[0] = odometry.twist.covariance[7] = fix["velocity_sigma"] ** 2
    place.latitude, place.longitude = math.degrees(fix["latitude"]), math.degrees(fix["longitude"])
    place.altitude, place.status.status = fix["altitude"], 2 if fix["locked"] else -1
    place.position_covariance[0] = place.position_covariance[4] = fix["position_sigma"] ** 2
    place.position_covariance_type = NavSatFix.COVARIANCE_TYPE_DIAGONAL_KNOWN
    for message in (imu, odometry, place):
        publishers[type(message)].publish(message)
