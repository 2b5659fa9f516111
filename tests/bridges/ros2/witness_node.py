"""A ROS 2 node for tests: the example's driver, which also writes down every message that it hears, as JSON.

    python witness_node.py EXAMPLES OUT

EXAMPLES is the folder of the example, OUT the file that is written when the node is told to end.
"""

import json
import sys
from pathlib import Path as File
from typing import Any

import numpy as np

sys.path.insert(0, sys.argv[1])
from diagnostic_msgs.msg import DiagnosticArray
from follow_and_stop import LATCHED, FollowAndStop, spin
from nav_msgs.msg import Odometry, Path
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import Imu, NavSatFix, PointCloud2
from visualization_msgs.msg import MarkerArray

KINDS = {
    "/clock": Clock,
    "/path": Path,
    "/fix": NavSatFix,
    "/imu": Imu,
    "/radar/points": PointCloud2,
    "/bodies": MarkerArray,
    "/diagnostics": DiagnosticArray,
    "/odom": Odometry,
}


def plain(value: Any) -> Any:
    """Return a message, or a part of one, as JSON has it."""
    if hasattr(value, "get_fields_and_field_types"):
        return {name: plain(getattr(value, name)) for name in value.get_fields_and_field_types()}
    if isinstance(value, bytes):
        return list(value)
    if isinstance(value, (str, int, float, bool)):
        return value
    if isinstance(value, np.generic):
        return value.item()
    return [plain(one) for one in value]


class Witness(FollowAndStop):  # type: ignore[misc]
    def __init__(self) -> None:
        self.heard: dict[str, list[Any]] = {topic: [] for topic in KINDS}
        super().__init__(11.176)
        for topic, kind in KINDS.items():
            quality = LATCHED if topic == "/path" else 100
            self.create_subscription(kind, topic, self.heard[topic].append, quality)


heard: dict[str, list[Any]] = {}


def make() -> Witness:
    """Return the node, whose messages are then `heard`."""
    node = Witness()
    heard.update(node.heard)
    return node


spin(make)
content = {topic: [plain(one) for one in came] for topic, came in heard.items()}
File(sys.argv[2]).write_text(json.dumps(content), encoding="utf-8")
