"""The topics of a drive for Foxglove and Lichtblick: their names, their schemas, their messages over time.

Poses, places, scene and sensors' readings are messages of Foxglove's own schemas as protobuf; what those have no schema
for (CAN frames, signals, states) is JSON with a schema of its own, which says of every field its unit and its meaning.
The frames are `map` (the virtual road's), `ego` (rear axle, on the ground) and one of each sensor that declares how it
is drawn, by the name of its table in the record.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Final

from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.LocationFix_pb2 import LocationFix
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from foxglove_schemas_protobuf.Pose_pb2 import Pose
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from foxglove_schemas_protobuf.Vector3_pb2 import Vector3
from google.protobuf.message import Message
from mcap_protobuf.schema import build_file_descriptor_set

from vve_sumo.analysis.run import Run
from vve_sumo.bus import LoggedFrame
from vve_sumo.export.can_frames import frames_of
from vve_sumo.export.csv_tables import tick_table
from vve_sumo.export.foxglove_clouds import clouds, frame_of, shapes
from vve_sumo.export.foxglove_scene import NANOSECONDS, roads, scene, stamp, turned
from vve_sumo.export.unix_time import MICROSECONDS, unix_of_drive
from vve_sumo.frames import Alignment, MapFrame
from vve_sumo.values import ArmingState, Floats

MAP, EGO = "map", "ego"
CAN_FRAME: Final = {
    "timestamp": {
        "type": "object",
        "properties": {"sec": {"type": "integer"}, "nsec": {"type": "integer"}},
        "description": "Unix time at which it was heard or sent",
    },
    "bus": {"type": "integer", "description": "number of the bus, from 1"},
    "id": {"type": "integer", "description": "identifier; of 29 bits with bit 31 set"},
    "sent": {"type": "boolean", "description": "the gateway sent it; else it heard it"},
    "length": {"type": "integer", "description": "bytes of the payload"},
    "data": {"type": "string", "description": "payload, two hexadecimal digits a byte"},
}
#: how a change to a state is shown; other states are INFO
LEVELS: Final = {ArmingState.STOPPING: Log.WARNING, ArmingState.FAULT: Log.ERROR}


@dataclass(frozen=True, slots=True)
class Schema:
    """What the messages of a topic look like, as MCAP has it."""

    name: str
    encoding: str  #: of the schema
    content: bytes
    messages: str  #: encoding of the messages


@dataclass(frozen=True, slots=True)
class Topic:
    """A stream of messages."""

    name: str
    schema: Schema
    messages: Iterator[tuple[int, bytes]]  #: Unix time [ns], which never falls, and content


def topics_of(run: Run) -> Iterator[Topic]:
    """Yield all topics of a drive."""
    ticks, motion = run.arrow("ticks"), run.motion
    times = [1000 * unix_of_drive(run, time) for time in run.time.tolist()]
    estimate = tuple(ticks[name].to_numpy() for name in ("x_m", "y_m", "heading_rad"))
    driven = motion.x, motion.y, motion.heading
    yield _of("/tf", FrameTransforms, _transforms(run, times, driven))
    yield _of("/ego/pose", PoseInFrame, _poses(times, driven))
    yield _of("/ego/pose_estimated", PoseInFrame, _poses(times, estimate))
    yield _of("/ego/fix", LocationFix, _fixes(run, times, estimate))
    yield _of("/roads", SceneUpdate, [(times[0], roads(run, stamp(times[0]), MAP))])
    yield _of("/scene", SceneUpdate, ((times[at], update) for at, update in scene(run, times, MAP)))
    for number, table in enumerate(run.sensed.values()):
        yield _of(f"/{frame_of(table.name)}", PointCloud, clouds(run, table, times))
        if table.drawing.shape != "points":
            yield _of(f"/{frame_of(table.name)}/shapes", SceneUpdate, shapes(run, table, times, number))
    yield _of("/gateway/log", Log, _changes(run, times))
    yield from _columns(run, times)
    yield Topic("/can", _json_schema("CanFrame", "a CAN frame", CAN_FRAME), _can(frames_of(run)))


def _of(name: str, kind: type[Message], messages: Iterable[tuple[int, Message]]) -> Topic:
    content = build_file_descriptor_set(kind).SerializeToString()
    schema = Schema(kind.DESCRIPTOR.full_name, "protobuf", content, "protobuf")
    return Topic(name, schema, ((time, message.SerializeToString()) for time, message in messages))


def _json_schema(name: str, title: str, properties: Mapping[str, Any]) -> Schema:
    content = {"title": f"vve_sumo.{name}", "description": title, "type": "object", "properties": properties}
    return Schema(f"vve_sumo.{name}", "jsonschema", json.dumps(content).encode(), "json")


def _known(times: list[int], places: tuple[Floats, ...]) -> Iterator[tuple[int, float, float, float]]:
    """Yield the time, x, y [m] and heading [rad] of every tick at which they are known."""
    for time, x, y, heading in zip(times, *(values.tolist() for values in places), strict=True):
        if math.isfinite(x + y + heading):
            yield time, x, y, heading


def _transforms(run: Run, times: list[int], places: tuple[Floats, ...]) -> Iterator[tuple[int, Message]]:
    frames = {frame_of(table.name): table.drawing.frame for table in run.sensed.values()}
    for time, x, y, heading in _known(times, places):
        at, turn = stamp(time), turned(heading)
        ego = FrameTransform(
            timestamp=at, parent_frame_id=MAP, child_frame_id=EGO, translation=Vector3(x=x, y=y), rotation=turn
        )
        sensors = [
            FrameTransform(
                timestamp=at,
                parent_frame_id=EGO,
                child_frame_id=name,
                translation=Vector3(x=frame.x_m, y=frame.y_m, z=frame.z_m),
                rotation=turned(frame.yaw_rad),
            )
            for name, frame in frames.items()
        ]
        yield time, FrameTransforms(transforms=[ego, *sensors])


def _poses(times: list[int], places: tuple[Floats, ...]) -> Iterator[tuple[int, Message]]:
    for time, x, y, heading in _known(times, places):
        pose = Pose(position=Vector3(x=x, y=y), orientation=turned(heading))
        yield time, PoseInFrame(timestamp=stamp(time), frame_id=MAP, pose=pose)


def _fixes(run: Run, times: list[int], places: tuple[Floats, ...]) -> Iterator[tuple[int, Message]]:
    """Yield where the rear axle really was on Earth: in the lot, whatever street the car drove on."""
    turned = run.resolved["lot_to_road"]
    back = Alignment(turned["rotation_rad"], turned["x_m"], turned["y_m"]).inverse()
    lot = MapFrame(run.resolved["lot_projection"])
    cos, sin = math.cos(back.rotation), math.sin(back.rotation)
    for time, x, y, heading in _known(times, places):
        latitude, longitude = lot.to_geodetic(cos * x - sin * y + back.x, sin * x + cos * y + back.y)
        from_east = heading + back.rotation - lot.convergence(latitude, longitude)
        yield (
            time,
            LocationFix(
                timestamp=stamp(time),
                frame_id=EGO,
                latitude=math.degrees(latitude),
                longitude=math.degrees(longitude),
                heading=(0.5 * math.pi - from_east) % math.tau,
            ),
        )


def _changes(run: Run, times: list[int]) -> Iterator[tuple[int, Message]]:
    """Yield a line wherever the gateway's state or its reasons changed."""
    ticks, before = run.arrow("ticks"), None
    states, reasons = ticks["state"].to_pylist(), ticks["reasons"].to_pylist()
    for time, now in zip(times, zip(states, reasons, strict=True), strict=True):
        if now != before:
            state, why = before = now
            level = LEVELS.get(state, Log.INFO)
            text = f"{state}: {why}" if why else state
            yield time, Log(timestamp=stamp(time), level=level, message=text, name="gateway")


def _columns(run: Run, times: list[int]) -> Iterator[Topic]:
    """Yield the columns of the table of ticks that CSV has: numbers as signals, the rest as states."""
    table = tick_table(run)
    numbers = [str(name) for name in table.select_dtypes("number").columns]
    rest = [str(name) for name in table.columns if name not in numbers]
    for topic, schema, title, names in (
        ("/signals", "Signals", "numbers of a tick; one that is not known is left out", numbers),
        ("/states", "States", "states, reasons and names of a tick", rest),
    ):
        properties = {
            name: {
                "type": _json_type(table[name].dtype.kind),
                "description": " ".join(filter(None, (table.attrs["meanings"][name], _in(table.attrs["units"][name])))),
            }
            for name in names
        }
        rows = zip(*(table[name].tolist() for name in names), strict=True)
        yield Topic(topic, _json_schema(schema, title, properties), _rows(times, names, rows))


def _json_type(kind: str) -> str:
    return {"f": "number", "i": "integer", "b": "boolean"}.get(kind, "string")


def _in(unit: str) -> str:
    return f"[{unit}]" if unit else ""


def _rows(times: list[int], names: list[str], rows: Iterable[tuple[Any, ...]]) -> Iterator[tuple[int, bytes]]:
    for time, row in zip(times, rows, strict=True):
        known = {
            name: value
            for name, value in zip(names, row, strict=True)
            if not isinstance(value, float) or math.isfinite(value)
        }
        yield time, json.dumps(known, allow_nan=False, separators=(",", ":")).encode()


def _can(frames: Iterable[LoggedFrame]) -> Iterator[tuple[int, bytes]]:
    for one in sorted(frames, key=lambda frame: frame.time):
        time = 1000 * round(one.time * MICROSECONDS)
        seconds, nanos = divmod(time, NANOSECONDS)
        content = {
            "timestamp": {"sec": seconds, "nsec": nanos},
            "bus": 1 + one.channel,
            "id": one.frame.id,
            "sent": one.sent,
            "length": len(one.frame.data),
            "data": one.frame.data.hex(),
        }
        yield time, json.dumps(content, separators=(",", ":")).encode()
