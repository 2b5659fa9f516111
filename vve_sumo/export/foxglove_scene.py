"""What Foxglove's and Lichtblick's 3D panel draws of a drive: the lanes, the path, and the bodies as boxes."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable, Iterator
from typing import Final, NamedTuple

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
from google.protobuf.duration_pb2 import Duration
from google.protobuf.timestamp_pb2 import Timestamp

from vve_sumo.analysis.bodies import RecordedBody, bodies
from vve_sumo.analysis.run import Run
from vve_sumo.body_kinds import PERSONS
from vve_sumo.export.commonroad import bounds
from vve_sumo.export.lanes import RecordedLane
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


class BodyBox(NamedTuple):
    """A body as it is drawn: a box on the ground."""

    name: str
    kind: str  #: one of BODY_KINDS
    is_ego: bool
    x: float  #: centre, map [m]
    y: float  #: [m]
    heading: float  #: [rad], counter-clockwise from the map's +x
    length: float  #: [m]
    width: float  #: [m]
    height: float  #: [m]


def stamp(time: int) -> Timestamp:
    """Return a Unix time [ns] as protobuf has it."""
    seconds, nanos = divmod(time, NANOSECONDS)
    return Timestamp(seconds=seconds, nanos=nanos)


def turned(heading: float) -> Quaternion:
    """Return the rotation about the vertical by a heading [rad]."""
    return Quaternion(z=math.sin(0.5 * heading), w=math.cos(0.5 * heading))


def roads(lanes: Iterable[RecordedLane], path: Floats, at: Timestamp, frame: str) -> SceneUpdate:
    """Return both bounds of every lane, and the points (n, 2) of the path [m]."""
    drawn = [_line(bound, ROAD_WIDTH, ROAD_COLOUR) for lane in lanes for bound in bounds(lane.line, lane.width)]
    entities = [
        SceneEntity(timestamp=at, frame_id=frame, id=name, lines=lines)
        for name, lines in (("lanes", drawn), ("path", [_line(path, PATH_WIDTH, PATH_COLOUR)]))
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
        names = {body.name for body, _ in here}
        if names or before:
            yield at, update([_box(body, row, body.name == run.ego) for body, row in here], before - names, time, frame)
        before = names


def update(boxes: Iterable[BodyBox], gone: Iterable[str], time: int, frame: str, lifetime: int = 0) -> SceneUpdate:
    """Return the bodies at a Unix time [ns], and the names of those to delete.

    A viewer that hears nothing new of a body for `lifetime` [s] deletes it; 0 for never.
    """
    at, lasting = stamp(time), Duration(seconds=lifetime) if lifetime else None
    kind = SceneEntityDeletion.MATCHING_ID
    return SceneUpdate(
        deletions=[SceneEntityDeletion(timestamp=at, type=kind, id=name) for name in sorted(gone)],
        entities=[_entity(box, at, frame, lasting) for box in boxes],
    )


def _box(body: RecordedBody, row: int, is_ego: bool) -> BodyBox:
    place = float(body.x[row]), float(body.y[row]), float(body.heading[row])
    return BodyBox(body.name, body.kind, is_ego, *place, body.length, body.width, body.height)


def _entity(box: BodyBox, at: Timestamp, frame: str, lifetime: Duration | None) -> SceneEntity:
    colour = _colour(box)
    cube = CubePrimitive(
        pose=Pose(position=Vector3(x=box.x, y=box.y, z=0.5 * box.height), orientation=turned(box.heading)),
        size=Vector3(x=box.length, y=box.width, z=box.height),
        color=colour,
    )
    label = TextPrimitive(
        pose=Pose(position=Vector3(x=box.x, y=box.y, z=box.height + LETTERS), orientation=turned(0.0)),
        billboard=True,
        font_size=LETTERS,
        color=colour,
        text=box.name,
    )
    return SceneEntity(timestamp=at, frame_id=frame, id=box.name, lifetime=lifetime, cubes=[cube], texts=[label])


def _colour(box: BodyBox) -> Color:
    if box.is_ego:
        return EGO_COLOUR
    return PERSON_COLOUR if box.kind in PERSONS else VEHICLE_COLOUR


def _line(points: Floats, width: float, colour: Color) -> LinePrimitive:
    return LinePrimitive(
        type=LinePrimitive.LINE_STRIP,
        pose=Pose(orientation=turned(0.0)),
        thickness=width,
        points=[Point3(x=x, y=y) for x, y in points.tolist()],
        color=colour,
    )
