"""A ROS 2 node for tests: the example's driver, which also writes down every message that it hears, as JSON.

    python witness_node.py EXAMPLES OUT [TOPIC:TYPE ...]

EXAMPLES is the folder of the example, OUT the file that is written when the node is told to end. The topics of the
shipped rig are heard, and those that are named besides, such as /roof/points:PointCloud2.
"""

import json
import sys
from contextlib import suppress
from functools import partial
from pathlib import Path as File
from typing import Any

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import TwistStamped
from nav_msgs.msg import Odometry, Path
from rclpy.executors import ExternalShutdownException
from rclpy.qos import DurabilityPolicy, QoSProfile
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import Imu, NavSatFix, PointCloud2
from visualization_msgs.msg import MarkerArray

sys.path.insert(0, sys.argv[1])
from follow_and_stop import FollowAndStop

KINDS = {
    "/clock": Clock,
    "/path": Path,
    "/path/ahead": Path,
    "/path/speed": TwistStamped,
    "/fix": NavSatFix,
    "/imu": Imu,
    "/radar/points": PointCloud2,
    "/bodies": MarkerArray,
    "/diagnostics": DiagnosticArray,
    "/odom": Odometry,
}
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


def plain(value: Any) -> Any:
    """Return a message, or a part of one, as JSON has it; bytes as hexadecimal digits."""
    if hasattr(value, "get_fields_and_field_types"):
        return {name: plain(getattr(value, name)) for name in value.get_fields_and_field_types()}
    if isinstance(value, bytes):
        return value.hex()
    if isinstance(value, (str, int, float, bool)):
        return value
    if isinstance(value, np.generic):
        return value.item()
    return bytes(value).hex() if getattr(value, "typecode", "") == "B" else [plain(one) for one in value]


class Witness(FollowAndStop):  # type: ignore[misc]
    def __init__(self, kinds: dict[str, Any]) -> None:
        self.heard: dict[str, list[Any]] = {topic: [] for topic in kinds}
        super().__init__()
        for topic, kind in kinds.items():
            quality = LATCHED if topic == "/path" else 100
            self.create_subscription(kind, topic, partial(self.note, topic), quality)

    def note(self, topic: str, message: Any) -> None:
        self.heard[topic].append(plain(message))  # now: once told to end, a node has 3 s


named = dict(word.split(":") for word in sys.argv[3:])
rclpy.init()
node = Witness(KINDS | {topic: {"PointCloud2": PointCloud2}[kind] for topic, kind in named.items()})
with suppress(KeyboardInterrupt, ExternalShutdownException):  # it was told to end
    rclpy.spin(node)
File(sys.argv[2]).write_text(json.dumps(node.heard), encoding="utf-8")
