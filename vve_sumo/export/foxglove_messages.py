"""Single messages of a drive in Foxglove's schemas, and the schemas as topics name them.

Made of plain values, so that a record's file and a live drive's topics have the same messages. What Foxglove has no
schema for is JSON with a schema that says of every field its unit and its meaning. The frames are `map` (the virtual
road's), `ego` (rear axle, on the ground) and one of each sensor that declares how it is drawn, by the name of its table
in the record.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping
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

from vve_sumo.export.foxglove_scene import stamp, turned
from vve_sumo.frames import Alignment, MapFrame
from vve_sumo.record.layout import sensor_table
from vve_sumo.sensors.drawing import Drawing
from vve_sumo.values import ArmingState

MAP, EGO = "map", "ego"
#: how a change to a state is shown; other states are INFO
LEVELS: Final = {ArmingState.STOPPING: Log.WARNING, ArmingState.FAULT: Log.ERROR}


@dataclass(frozen=True, slots=True)
class Schema:
    """What the messages of a topic look like, as MCAP and Foxglove's WebSocket protocol have it."""

    name: str
    encoding: str  #: of the schema
    content: bytes
    messages: str  #: encoding of the messages


def schema_of(kind: type[Message]) -> Schema:
    """Return the schema of messages of a protobuf type, with every type that it is made of."""
    content = build_file_descriptor_set(kind).SerializeToString()
    return Schema(kind.DESCRIPTOR.full_name, "protobuf", content, "protobuf")


TRANSFORMS, POSE, FIX, SCENE, CLOUD, LOG = map(
    schema_of, (FrameTransforms, PoseInFrame, LocationFix, SceneUpdate, PointCloud, Log)
)


def json_schema(name: str, title: str, properties: Mapping[str, Any]) -> Schema:
    """Return the schema of JSON messages with these properties, named `vve_sumo.NAME`."""
    content = {"title": f"vve_sumo.{name}", "description": title, "type": "object", "properties": properties}
    return Schema(f"vve_sumo.{name}", "jsonschema", json.dumps(content).encode(), "json")


def property_of(kind: str, meaning: str, unit: str) -> dict[str, str]:
    """Return a property of a JSON schema; `kind` is numpy's letter of its type."""
    named = {"f": "number", "i": "integer", "b": "boolean"}.get(kind, "string")
    return {"type": named, "description": f"{meaning} [{unit}]" if unit else meaning}


def json_row(names: Iterable[str], values: Iterable[Any]) -> bytes:
    """Return a row of numbers, truth values and texts as JSON; a number that is not finite is left out."""
    known = {
        name: value
        for name, value in zip(names, values, strict=True)
        if not isinstance(value, float) or math.isfinite(value)
    }
    return json.dumps(known, allow_nan=False, separators=(",", ":")).encode()


def frame_of(sensor: str) -> str:
    """Return the name of a sensor's frame, which is that of its table in the record."""
    return sensor_table(sensor)


def transforms(time: int, x: float, y: float, heading: float, sensors: Mapping[str, Drawing]) -> FrameTransforms:
    """Return where the frames of the ego and of its sensors are at a Unix time [ns]; x, y [m], heading [rad], map."""
    at = stamp(time)
    ego = FrameTransform(
        timestamp=at,
        parent_frame_id=MAP,
        child_frame_id=EGO,
        translation=Vector3(x=x, y=y),
        rotation=turned(heading),
    )
    frames = {frame_of(name): drawing.frame for name, drawing in sensors.items()}
    mounted = [
        FrameTransform(
            timestamp=at,
            parent_frame_id=EGO,
            child_frame_id=name,
            translation=Vector3(x=frame.x_m, y=frame.y_m, z=frame.z_m),
            rotation=turned(frame.yaw_rad),
        )
        for name, frame in frames.items()
    ]
    return FrameTransforms(transforms=[ego, *mounted])


def pose_in_map(time: int, x: float, y: float, heading: float) -> PoseInFrame:
    """Return a pose of the rear axle at a Unix time [ns]; x, y [m], heading [rad], map."""
    pose = Pose(position=Vector3(x=x, y=y), orientation=turned(heading))
    return PoseInFrame(timestamp=stamp(time), frame_id=MAP, pose=pose)


class LotPlaces:
    """Where the rear axle really is on Earth: in the lot, whatever street the car drives on."""

    def __init__(self, resolved: Mapping[str, Any]) -> None:
        """`resolved` is the content of `scenario.json`."""
        turned = resolved["lot_to_road"]
        self._back = Alignment(turned["rotation_rad"], turned["x_m"], turned["y_m"]).inverse()
        self._lot = MapFrame(resolved["lot_projection"])
        self._cos, self._sin = math.cos(self._back.rotation), math.sin(self._back.rotation)

    def fix(self, time: int, x: float, y: float, heading: float) -> LocationFix:
        """Return the fix of a pose on the virtual road at a Unix time [ns]; x, y [m], heading [rad], map."""
        back, cos, sin = self._back, self._cos, self._sin
        latitude, longitude = self._lot.to_geodetic(cos * x - sin * y + back.x, sin * x + cos * y + back.y)
        from_east = heading + back.rotation - self._lot.convergence(latitude, longitude)
        return LocationFix(
            timestamp=stamp(time),
            frame_id=EGO,
            latitude=math.degrees(latitude),
            longitude=math.degrees(longitude),
            heading=(0.5 * math.pi - from_east) % math.tau,
        )


def state_change(time: int, state: str, reasons: str) -> Log:
    """Return the line for a change of the gateway's state or its reasons, codes joined by +, at a Unix time [ns]."""
    text = f"{state}: {reasons}" if reasons else state
    level = LEVELS.get(ArmingState(state), Log.INFO)
    return Log(timestamp=stamp(time), level=level, message=text, name="gateway")
