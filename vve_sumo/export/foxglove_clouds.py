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
from vve_sumo.export.foxglove_messages import frame_of
from vve_sumo.export.foxglove_scene import stamp, turned
from vve_sumo.export.unix_time import unix_of_drive
from vve_sumo.sensors.drawing import Boxes, Drawing, heights, in_frame, quantities
from vve_sumo.values import Floats

Points = np.ndarray[Any, Any]  #: a structured array, a row a point

#: layout of a column in a cloud, by its type in the record; Foxglove has no whole number of 64 bits
LAYOUTS: Final = {pa.float64(): "<f8", pa.int64(): "<f8", pa.int8(): "i1", pa.bool_(): "u1"}
TYPES: Final = {"f8": PackedElementField.FLOAT64, "i1": PackedElementField.INT8, "u1": PackedElementField.UINT8}
#: of rays and boxes, a sensor after the other: Okabe and Ito's colours
COLOURS: Final = ((0.8, 0.475, 0.655), (0.941, 0.894, 0.259), (0.337, 0.706, 0.914), (0.0, 0.62, 0.451))
HEIGHT: Final = 1.5  #: of boxes, which are measured in the plane alone: an assumption [m]
LINE_WIDTH: Final = 0.05  #: of rays [m]


def clouds(run: Run, table: SensedTable, times: list[int]) -> Iterator[tuple[int, Message]]:
    """Yield a cloud for each reading, an empty one too, at the tick at which it came out, with its time of measurement.

    `times` are the ticks' Unix times [ns].
    """
    points = points_of(table.drawing, table.rows)
    for number, at in enumerate(table.at.tolist()):
        yield times[at], cloud(table.name, points[table.of_reading(number)], _measured(run, table, number))


def cloud(sensor: str, points: Points, measured: int) -> PointCloud:
    """Return the cloud of a reading, in the frame of its sensor; `measured` is its Unix time [ns]."""
    assert points.dtype.fields is not None
    fields = [
        PackedElementField(name=name, offset=offset, type=TYPES[kind.str[-2:]])
        for name, (kind, offset, *_) in points.dtype.fields.items()
    ]
    return PointCloud(
        timestamp=stamp(measured),
        frame_id=frame_of(sensor),
        pose=Pose(orientation=turned(0.0)),
        point_stride=points.dtype.itemsize,
        fields=fields,
        data=points.tobytes(),
    )


def points_of(drawing: Drawing, rows: pa.Table) -> Points:
    """Return a point for each row of a sensor's table.

    A point has x, y, z [m] in the sensor's frame, and every number of the table that is no coordinate.
    """
    layouts = _layouts(rows.schema)
    points = np.zeros(len(rows), np.dtype({"names": [*layouts], "formats": [*layouts.values()]}))
    for name in [*layouts][3:]:
        points[name] = rows[name].to_numpy(zero_copy_only=False)
    numbers = _numbers(drawing, rows)
    points["x"], points["y"] = in_frame(drawing, numbers)
    points["z"] = heights(drawing, numbers)
    return points


def shapes(run: Run, table: SensedTable, times: list[int], number: int) -> Iterator[tuple[int, Message]]:
    """Yield the rays or boxes of each reading, in place of those of the reading before; `number` decides the colour."""
    for reading, at in enumerate(table.at.tolist()):
        rows = table.rows.slice(table.first[reading], table.first[reading + 1] - table.first[reading])
        yield times[at], drawn_shapes(table.name, table.drawing, rows, number, _measured(run, table, reading))


def drawn_shapes(sensor: str, drawing: Drawing, rows: pa.Table, number: int, measured: int) -> SceneUpdate:
    """Return the rays or boxes of a reading with these rows.

    `number` decides the colour, `measured` is its Unix time [ns].
    """
    red, green, blue = COLOURS[number % len(COLOURS)]
    colour = Color(r=red, g=green, b=blue, a=0.7)
    numbers = _numbers(drawing, rows)
    x, y = in_frame(drawing, numbers)
    entity = SceneEntity(timestamp=stamp(measured), frame_id=frame_of(sensor), id=sensor)
    if isinstance(drawing, Boxes):
        sizes = (numbers[name] for name in (drawing.heading, drawing.length, drawing.width))
        entity.cubes.extend(_cube(colour, *map(float, values)) for values in zip(x, y, *sizes, strict=True))
    else:
        ends = [point for end in zip(x, y, strict=True) for point in (Point3(), Point3(x=end[0], y=end[1]))]
        entity.lines.append(
            LinePrimitive(
                type=LinePrimitive.LINE_LIST,
                pose=Pose(orientation=turned(0.0)),
                thickness=LINE_WIDTH,
                points=ends,
                color=colour,
            )
        )
    return SceneUpdate(entities=[entity])


def _cube(colour: Color, x: float, y: float, heading: float, length: float, width: float) -> CubePrimitive:
    return CubePrimitive(
        pose=Pose(position=Vector3(x=x, y=y, z=0.5 * HEIGHT), orientation=turned(heading)),
        size=Vector3(x=length, y=width, z=HEIGHT),
        color=colour,
    )


def _measured(run: Run, table: SensedTable, reading: int) -> int:
    return 1000 * unix_of_drive(run, float(table.measured[reading]))


def _numbers(drawing: Drawing, rows: pa.Table) -> dict[str, Floats]:
    return {name: rows[name].to_numpy().astype(np.float64) for name in quantities(drawing).values()}


def _layouts(schema: pa.Schema) -> dict[str, str]:
    """Return the layout of each number of a point: its place, then every number of the table that is no coordinate."""
    layouts = {"x": "<f8", "y": "<f8", "z": "<f8"}
    for field in schema:
        if field.name not in ("tick", *layouts) and field.type in LAYOUTS:
            layouts[field.name] = LAYOUTS[field.type]
    return layouts
