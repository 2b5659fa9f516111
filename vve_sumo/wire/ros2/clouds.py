"""What of a sensor's measurement stands in which field of a PointCloud2, and of a Detection3DArray.

A cloud has one field for each column of the measurement, whose names are those of `vve_sumo.values`. Places count from
the sensor's own frame: the front bumper, or where a lidar is mounted. Knows values and fields; it must not know what
carries a message.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from vve_sumo.body_kinds import BODY_KINDS, TYPICAL
from vve_sumo.values import CameraObjects, Floats, Stations, StopLines
from vve_sumo.wire.ros2.messages import (
    RADAR,
    UNKNOWN_VARIANCE,
    header_of,
    pose_of,
    vector_of,
)
from vve_sumo.wire.ros2.types import make
from vve_sumo.wire.sample import LidarTurn
from vve_sumo.wire.vlp16 import AZIMUTHS, RANGE_QUANTUM

Ints = NDArray[Any]  #: whole numbers
#: PointField.datatype of a column's type
DATATYPES: Final[Mapping[str, int]] = {"|i1": 1, "|u1": 2, "<u2": 4, "<u4": 6, "<f4": 7, "<f8": 8}
#: columns of a table whose place is at `x`, `y` on the ground, and their types
OBJECT: Final = {"x": "<f4", "y": "<f4", "number": "<u4", "kind": "|u1", "status": "|u1", "relative_speed": "<f4",
                 "width": "<f4", "length": "<f4"}  # fmt: skip
STATION: Final = {"x": "<f4", "y": "<f4", "number": "<u4", "message": "|u1", "kind": "|u1", "age": "<f4",
                  "heading": "<f4", "speed": "<f4", "yaw_rate": "<f4", "acceleration": "<f4", "length": "<f4",
                  "width": "<f4", "uncertainty": "<f4"}  # fmt: skip
STOP_LINE: Final = {"x": "<f4", "y": "<f4", "intersection": "<u4", "group": "<u4", "heading": "<f4", "width": "<f4",
                    "exit_x": "<f4", "exit_y": "<f4", "phase": "|u1", "age": "<f4", "remaining": "<f4",
                    "green_begin": "<f4", "green_end": "<f4"}  # fmt: skip


def _cloud(at: int, frame: str, columns: Sequence[tuple[str, str, NDArray[Any]]]) -> Any:
    """Return sensor_msgs/PointCloud2 of columns: name, type, numbers; a point's fields follow each other."""
    layout = np.dtype([(name, kind) for name, kind, _ in columns])
    points = np.zeros(len(columns[0][2]), layout)
    for name, _, numbers in columns:
        points[name] = numbers
    fields = [
        make("sensor_msgs/msg/PointField", name, layout.fields[name][1], DATATYPES[kind], 1)  # type: ignore[index]
        for name, kind, _ in columns
    ]
    size, count = layout.itemsize, len(points)
    data = np.frombuffer(points.tobytes(), np.uint8)
    return make(
        "sensor_msgs/msg/PointCloud2", header_of(at, frame), 1, count, fields, False, size, size * count, data, True
    )


def radar_cloud(at: int, far: Floats, azimuth: Floats, range_rate: Floats, frame: str = RADAR) -> Any:
    """Return the cloud of a radar's scan measured at a Unix time [ns]: x, y, z, range, azimuth, range_rate.

    Ranges and azimuths are from the middle of the front bumper, whose height nobody measures: z is 0.
    """
    far, azimuth, rate = (np.asarray(column, np.float32).astype(np.float64) for column in (far, azimuth, range_rate))
    named = {"x": far * np.cos(azimuth), "y": far * np.sin(azimuth), "z": np.zeros(len(far)), "range": far,
             "azimuth": azimuth, "range_rate": rate}  # fmt: skip
    return _cloud(at, frame, [(name, "<f4", column) for name, column in named.items()])


def lidar_cloud(at: int, turn: LidarTurn, frame: str) -> Any:
    """Return the cloud of a lidar's turn whose last firing was at a Unix time [ns]: the rays that came back.

    The fields are those of ROS' driver of Velodynes: x, y, z [m], intensity (reflectivity [percent]), ring (the
    channel), time (of the ray's firing from the header's [s], at most 0).
    """
    firings, channels = len(turn.azimuth), len(turn.elevation)
    range_, reflectivity = turn.range.reshape(firings, channels), turn.reflectivity.reshape(firings, channels)
    firing, channel = np.nonzero(range_)
    azimuth = turn.azimuth_offset[channel] - turn.azimuth[firing] * (2.0 * np.pi / AZIMUTHS)
    far: Floats = RANGE_QUANTUM * range_[firing, channel].astype(np.float64)
    elevation = turn.elevation[channel]
    returns = _returns(far, azimuth, elevation, reflectivity[firing, channel], channel)
    return _cloud(at, frame, [*returns, ("time", "<f4", turn.firing_period * (firing - (firings - 1)))])


def returns_cloud(
    at: int, far: Floats, azimuth: Floats, elevation: Floats, reflectivity: Ints, channel: Ints, frame: str
) -> Any:
    """Return the cloud of rays that came back, as `lidar_cloud`, but for `time`, which is not known.

    An entry a ray: range [m], azimuth from the lidar's x axis [rad], left positive, elevation [rad], up positive,
    reflectivity [percent], number of the channel.
    """
    return _cloud(at, frame, _returns(far, azimuth, elevation, reflectivity, channel))


def _returns(
    far: Floats, azimuth: Floats, elevation: Floats, reflectivity: Ints, channel: Ints
) -> list[tuple[str, str, NDArray[Any]]]:
    level = far * np.cos(elevation)
    return [
        ("x", "<f4", level * np.cos(azimuth)),
        ("y", "<f4", level * np.sin(azimuth)),
        ("z", "<f4", far * np.sin(elevation)),
        ("intensity", "<f4", reflectivity),
        ("ring", "<u2", channel),
    ]


def table_cloud(at: int, table: CameraObjects | Stations | StopLines, frame: str) -> Any:
    """Return the cloud of a camera's list, of the stations that V2X knows of, or of stop lines, a point for each row.

    Places are in the table's own terms, z is 0.
    """
    columns = OBJECT if isinstance(table, CameraObjects) else STATION if isinstance(table, Stations) else STOP_LINE
    named = [(name, kind, getattr(table, name)) for name, kind in columns.items()]
    return _cloud(at, frame, [*named[:2], ("z", "<f4", np.zeros(len(table.x))), *named[2:]])


def detections(at: int, listed: CameraObjects, frame: str) -> Any:
    """Return vision_msgs/Detection3DArray of a camera's list: boxes on the ground, along the car's axis.

    The list knows the middle of an object's near side; the box begins there and has the height that is usual for its
    kind. The hypothesis is the kind with score 1, and its pose's variances are unknown.
    """
    header = header_of(at, frame)
    columns = (listed.number, listed.kind, listed.x, listed.y, listed.length, listed.width)
    found = []
    for number, kind, x, y, length, width in zip(*(column.tolist() for column in columns), strict=True):
        height = TYPICAL[BODY_KINDS[kind]].height
        pose = pose_of(x + 0.5 * length, y, 0.0, 0.5 * height)
        covariance = np.diag([UNKNOWN_VARIANCE] * 6).ravel()
        hypothesis = make("vision_msgs/msg/ObjectHypothesis", BODY_KINDS[kind], 1.0)
        with_pose = make("geometry_msgs/msg/PoseWithCovariance", pose, covariance)
        result = make("vision_msgs/msg/ObjectHypothesisWithPose", hypothesis, with_pose)
        box = make("vision_msgs/msg/BoundingBox3D", pose, vector_of(length, width, height))
        found.append(make("vision_msgs/msg/Detection3D", header, [result], box, str(number)))
    return make("vision_msgs/msg/Detection3DArray", header, found)
