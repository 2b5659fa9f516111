"""Readings of sensors for Foxglove and Lichtblick: a cloud of points each, and the rays or boxes that are declared.

Knows the sensors' declarations and no kind of sensor.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Final

import numpy as np
import pyarrow as pa
from foxglove_schemas_protobuf.Color_pb2 import Color
from foxglove_schemas_protobuf.CubePrimitive_pb2 import CubePrimitive
from foxglove_schemas_protobuf.LinePrimitive_pb2 import LinePrimitive
from foxglove_schemas_protobuf.PackedElementField_pb2 import PackedElementField
from foxglove_schemas_protobuf.Point3_pb2 import Point3
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from foxglove_schemas_protobuf.Pose_pb2 import Pose
from foxglove_schemas_protobuf.SceneEntity_pb2 import SceneEntity
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from foxglove_schemas_protobuf.Vector3_pb2 import Vector3
from google.protobuf.message import Message

from vve_sumo.analysis.run import Run
from vve_sumo.analysis.sensed import SensedTable
from vve_sumo.export.foxglove_scene import stamp, turned
from vve_sumo.export.unix_time import unix_of_drive
from vve_sumo.record.layout import sensor_table
from vve_sumo.sensors.drawing import Boxes, heights, in_frame, quantities
from vve_sumo.values import Floats

#: layout of a column in a cloud, by its type in the record; Foxglove has no whole number of 64 bits
LAYOUTS: Final = {pa.float64(): "<f8", pa.int64(): "<f8", pa.int8(): "i1", pa.bool_(): "u1"}
TYPES: Final = {
    "<f8": PackedElementField.FLOAT64, "i1": PackedElementField.INT8, "u1": PackedElementField.UINT8
}  # fmt: skip
#: of rays and boxes, a sensor after the other: Okabe and Ito's colours
COLOURS: Final = ((0.8, 0.475, 0.655), (0.941, 0.894, 0.259), (0.337, 0.706, 0.914), (0.0, 0.62, 0.451))
HEIGHT: Final = 1.5  #: of boxes, which are measured in the plane alone: an assumption [m]
LINE_WIDTH: Final = 0.05  #: of rays [m]


def frame_of(sensor: str) -> str:
    """Return the name of a sensor's frame, which is that of its table in the record."""
    return sensor_table(sensor)


def clouds(run: Run, table: SensedTable, times: list[int]) -> Iterator[tuple[int, Message]]:
    """Yield a cloud for each reading, an empty one too, at the tick at which it came out, with its time of measurement.

    A point has x, y, z [m] in the sensor's frame, and every number of the record's table. `times` are the ticks' Unix
    times [ns].
    """
    layouts = _layouts(table)
    points = _points(table, layouts)
    offsets = np.cumsum([0, *(np.dtype(layout).itemsize for layout in layouts.values())]).tolist()
    fields = [
        PackedElementField(name=name, offset=offset, type=TYPES[layout])
        for offset, (name, layout) in zip(offsets, layouts.items(), strict=False)
    ]
    for number, at in enumerate(table.at.tolist()):
        yield (
            times[at],
            PointCloud(
                timestamp=_measured(run, table, number),
                frame_id=frame_of(table.name),
                pose=Pose(orientation=turned(0.0)),
                point_stride=points.dtype.itemsize,
                fields=fields,
                data=points[table.of_reading(number)].tobytes(),
            ),
        )


def shapes(run: Run, table: SensedTable, times: list[int], number: int) -> Iterator[tuple[int, Message]]:
    """Yield the rays or boxes of each reading, in place of those of the reading before; `number` decides the colour."""
    red, green, blue = COLOURS[number % len(COLOURS)]
    colour = Color(r=red, g=green, b=blue, a=0.7)
    numbers = _numbers(table)
    x, y = in_frame(table.drawing, numbers)
    for reading, at in enumerate(table.at.tolist()):
        rows = range(*table.of_reading(reading).indices(len(x)))
        entity = SceneEntity(timestamp=_measured(run, table, reading), frame_id=frame_of(table.name), id=table.name)
        if isinstance(table.drawing, Boxes):
            sizes = (numbers[name] for name in (table.drawing.heading, table.drawing.length, table.drawing.width))
            heading, length, width = sizes
            entity.cubes.extend(
                CubePrimitive(
                    pose=Pose(
                        position=Vector3(x=x[row], y=y[row], z=0.5 * HEIGHT), orientation=turned(float(heading[row]))
                    ),
                    size=Vector3(x=length[row], y=width[row], z=HEIGHT),
                    color=colour,
                )
                for row in rows
            )
        else:
            ends = [point for row in rows for point in (Point3(), Point3(x=x[row], y=y[row]))]
            entity.lines.append(
                LinePrimitive(
                    type=LinePrimitive.LINE_LIST,
                    pose=Pose(orientation=turned(0.0)),
                    thickness=LINE_WIDTH,
                    points=ends,
                    color=colour,
                )
            )
        yield times[at], SceneUpdate(entities=[entity])


def _measured(run: Run, table: SensedTable, reading: int) -> Any:
    return stamp(1000 * unix_of_drive(run, float(table.measured[reading])))


def _numbers(table: SensedTable) -> dict[str, Floats]:
    return {name: table.rows[name].to_numpy().astype(np.float64) for name in quantities(table.drawing).values()}


def _layouts(table: SensedTable) -> dict[str, str]:
    """Return the layout of each number of a point: its place, then every number of the table that is no coordinate."""
    layouts = {"x": "<f8", "y": "<f8", "z": "<f8"}
    for field in table.rows.schema:
        if field.name not in ("tick", *layouts) and field.type in LAYOUTS:
            layouts[field.name] = LAYOUTS[field.type]
    return layouts


def _points(table: SensedTable, layouts: dict[str, str]) -> np.ndarray[Any, Any]:
    """Return a row a point."""
    points = np.zeros(len(table.range), np.dtype({"names": [*layouts], "formats": [*layouts.values()]}))
    for name in [*layouts][3:]:
        points[name] = table.rows[name].to_numpy(zero_copy_only=False)
    numbers = _numbers(table)
    points["x"], points["y"] = in_frame(table.drawing, numbers)
    points["z"] = heights(table.drawing, numbers)
    return points
