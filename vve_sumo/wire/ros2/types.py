"""The ROS 2 message types that are used, their classes and their encoding (CDR), by the package `rosbags` alone.

The definitions are those of ROS 2 Kilted's standard packages, and of `ackermann_msgs`, which is no standard package:
its two types are made here from their fields. Knows types; it must not know what stands in a message.
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


@functools.cache
def store() -> Any:
    """Return the store of types; raises ConfigError where the package is missing."""
    try:
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore
    except ImportError:
        raise ConfigError("ROS 2 needs rosbags and cyclonedds: pip install 'vve-sumo[ros2]'") from None
    types = get_typestore(Stores.ROS2_KILTED)
    for name, definition in ACKERMANN.items():
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
