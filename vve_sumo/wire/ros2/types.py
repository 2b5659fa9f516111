"""The ROS 2 message types that are used, their classes and their encoding (CDR), by the package `rosbags` alone.

The definitions are those of ROS 2 Kilted's standard packages. `ackermann_msgs` and `vision_msgs` are no standard
packages: their types are made here from their fields. Knows types; it must not know what stands in a message.
"""

from __future__ import annotations

import functools
from typing import Any, Final

from vve_sumo.errors import ConfigError

#: fields of the types of ackermann_msgs 2.0, whose units its own definitions give: rad, rad/s, m/s, m/s2, m/s3
ACKERMANN: Final = {
    "ackermann_msgs/msg/AckermannDrive": "float32 steering_angle\nfloat32 steering_angle_velocity\nfloat32 speed\n"
    "float32 acceleration\nfloat32 jerk\n",
    "ackermann_msgs/msg/AckermannDriveStamped": "std_msgs/Header header\nAckermannDrive drive\n",
}
#: fields of the types of vision_msgs 4.1
VISION: Final = {
    "vision_msgs/msg/ObjectHypothesis": "string class_id\nfloat64 score\n",
    "vision_msgs/msg/ObjectHypothesisWithPose": "ObjectHypothesis hypothesis\ngeometry_msgs/PoseWithCovariance pose\n",
    "vision_msgs/msg/BoundingBox3D": "geometry_msgs/Pose center\ngeometry_msgs/Vector3 size\n",
    "vision_msgs/msg/Detection3D": "std_msgs/Header header\nObjectHypothesisWithPose[] results\nBoundingBox3D bbox\n"
    "string id\n",
    "vision_msgs/msg/Detection3DArray": "std_msgs/Header header\nDetection3D[] detections\n",
}


@functools.cache
def store() -> Any:
    """Return the store of types; raises ConfigError where the package is missing."""
    try:
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore
    except ImportError:
        raise ConfigError("ROS 2 needs rosbags and cyclonedds: pip install 'vve-sumo[ros2]'") from None
    types = get_typestore(Stores.ROS2_KILTED)
    for name, definition in {**ACKERMANN, **VISION}.items():
        types.register(get_types_from_msg(definition, name))
    return types


def make(name: str, *values: Any) -> Any:
    """Return a message of a type, such as `nav_msgs/msg/Odometry`, from its fields' values in their order."""
    return store().types[name](*values)


def encode(message: Any) -> bytes:
    """Return a message in CDR, little endian, with the encapsulation's four bytes before it."""
    return bytes(store().serialize_cdr(message, message.__msgtype__))


def decode(data: bytes, name: str) -> Any:
    """Return the message of a type in bytes of CDR; raises an exception of `rosbags` for bytes that are none."""
    return store().deserialize_cdr(data, name)
