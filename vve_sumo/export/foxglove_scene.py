"""What Foxglove's and Lichtblick's 3D panel draws of a drive: the lanes, the path, and the bodies as boxes."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterator
from typing import Final

from foxglove_schemas_protobuf.Color_pb2 import Color
from foxglove_schemas_protobuf.CubePrimitive_pb2 import CubePrimitive
from foxglove_schemas_protobuf.LinePrimitive_pb2 import LinePrimitive
from foxglove_schemas_protobuf.Point3_pb2 import Point3
from foxglove_schemas_protobuf.Pose_pb2 import Pose
from foxglove_schemas_protobuf.Quaternion_pb2 import Quaternion
from foxglove_schemas_protobuf.SceneEntity_pb2 import SceneEntity
from foxglove_schemas_protobuf.SceneEntityDeletion_pb2 import SceneEntityDeletion
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from foxglove_schemas_protobuf.TextPrimitive_pb2 import TextPrimitive
from foxglove_schemas_protobuf.Vector3_pb2 import Vector3
from google.protobuf.timestamp_pb2 import Timestamp

from vve_sumo.analysis.bodies import RecordedBody, bodies
from vve_sumo.analysis.run import Run
from vve_sumo.body_kinds import PERSONS
from vve_sumo.export.commonroad import bounds
from vve_sumo.export.lanes import lanes_of
from vve_sumo.record.declared import recorded_points
from vve_sumo.values import Floats

# Colours of Okabe and Ito (2008), which people who are colour-blind tell apart.
EGO_COLOUR: Final = Color(r=0.0, g=0.447, b=0.698, a=1.0)
VEHICLE_COLOUR: Final = Color(r=0.835, g=0.369, b=0.0, a=1.0)
PERSON_COLOUR: Final = Color(r=0.8, g=0.475, b=0.655, a=1.0)
PATH_COLOUR: Final = Color(r=0.0, g=0.62, b=0.451, a=1.0)
ROAD_COLOUR: Final = Color(r=0.5, g=0.5, b=0.5, a=1.0)
ROAD_WIDTH, PATH_WIDTH = 0.12, 0.25  #: of drawn lines [m]
LETTERS: Final = 1.0  #: height of a body's name above it [m]
NANOSECONDS: Final = 1_000_000_000


def stamp(time: int) -> Timestamp:
    """Return a Unix time [ns] as protobuf has it."""
    seconds, nanos = divmod(time, NANOSECONDS)
    return Timestamp(seconds=seconds, nanos=nanos)


def turned(heading: float) -> Quaternion:
    """Return the rotation about the vertical by a heading [rad]."""
    return Quaternion(z=math.sin(0.5 * heading), w=math.cos(0.5 * heading))


def roads(run: Run, at: Timestamp, frame: str) -> SceneUpdate:
    """Return both bounds of every lane, as far as the record has them, and the path."""
    lanes = [_line(bound, ROAD_WIDTH, ROAD_COLOUR) for lane in lanes_of(run) for bound in bounds(lane.line, lane.width)]
    path = [_line(recorded_points(run.resolved), PATH_WIDTH, PATH_COLOUR)]
    entities = [
        SceneEntity(timestamp=at, frame_id=frame, id=name, lines=lines)
        for name, lines in (("lanes", lanes), ("path", path))
        if lines
    ]
    return SceneUpdate(entities=entities)


def scene(run: Run, times: list[int], frame: str) -> Iterator[tuple[int, SceneUpdate]]:
    """Yield the index of a tick and its bodies; those that have left since the last tick are deleted.

    `times` are the ticks' Unix times [ns].
    """
    present: dict[int, list[tuple[RecordedBody, int]]] = defaultdict(list)
    for body in bodies(run):
        for row, at in enumerate(body.at.tolist()):
            present[at].append((body, row))
    before: set[str] = set()
    for at, time in enumerate(times):
        here = present.get(at, [])
        now, names = stamp(time), {body.name for body, _ in here}
        if not names and not before:
            continue
        gone = [
            SceneEntityDeletion(timestamp=now, type=SceneEntityDeletion.MATCHING_ID, id=name)
            for name in sorted(before - names)
        ]
        boxes = [_box(body, row, now, frame, _colour(body, run.ego)) for body, row in here]
        yield at, SceneUpdate(deletions=gone, entities=boxes)
        before = names


def _box(body: RecordedBody, row: int, at: Timestamp, frame: str, colour: Color) -> SceneEntity:
    height, heading = body.height, float(body.heading[row])
    x, y = float(body.x[row]), float(body.y[row])
    cube = CubePrimitive(
        pose=Pose(position=Vector3(x=x, y=y, z=0.5 * height), orientation=turned(heading)),
        size=Vector3(x=body.length, y=body.width, z=height),
        color=colour,
    )
    label = TextPrimitive(
        pose=Pose(position=Vector3(x=x, y=y, z=height + LETTERS), orientation=turned(0.0)),
        billboard=True,
        font_size=LETTERS,
        color=colour,
        text=body.name,
    )
    return SceneEntity(timestamp=at, frame_id=frame, id=body.name, cubes=[cube], texts=[label])


def _colour(body: RecordedBody, ego: str) -> Color:
    if body.name == ego:
        return EGO_COLOUR
    return PERSON_COLOUR if body.kind in PERSONS else VEHICLE_COLOUR


def _line(points: Floats, width: float, colour: Color) -> LinePrimitive:
    return LinePrimitive(
        type=LinePrimitive.LINE_STRIP,
        pose=Pose(orientation=turned(0.0)),
        thickness=width,
        points=[Point3(x=x, y=y) for x, y in points.tolist()],
        color=colour,
    )
