"""The topics of a drive for Foxglove and Lichtblick: their names, their schemas, their messages over time."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any, Final

from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from google.protobuf.message import Message

from vve_sumo.analysis.run import Run
from vve_sumo.bus import LoggedFrame
from vve_sumo.export.can_frames import frames_of
from vve_sumo.export.csv_tables import tick_table
from vve_sumo.export.foxglove_clouds import clouds, shapes
from vve_sumo.export.foxglove_messages import (
    CLOUD,
    FIX,
    LOG,
    MAP,
    POSE,
    SCENE,
    TRANSFORMS,
    LotPlaces,
    Schema,
    frame_of,
    json_row,
    json_schema,
    pose_in_map,
    property_of,
    state_change,
    transforms,
)
from vve_sumo.export.foxglove_scene import NANOSECONDS, roads, scene, stamp
from vve_sumo.export.lanes import lanes_of
from vve_sumo.export.unix_time import MICROSECONDS, unix_of_drive
from vve_sumo.record.declared import recorded_points
from vve_sumo.values import Floats

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
    yield _of("/tf", TRANSFORMS, _transforms(run, times, driven))
    yield _of("/ego/pose", POSE, _poses(times, driven))
    yield _of("/ego/pose_estimated", POSE, _poses(times, estimate))
    yield _of("/ego/fix", FIX, _fixes(run, times, estimate))
    yield _of("/roads", SCENE, [(times[0], _roads(run, times[0]))])
    yield _of("/scene", SCENE, ((times[at], update) for at, update in scene(run, times, MAP)))
    for number, table in enumerate(run.sensed.values()):
        yield _of(f"/{frame_of(table.name)}", CLOUD, clouds(run, table, times))
        if table.drawing.shape != "points":
            yield _of(f"/{frame_of(table.name)}/shapes", SCENE, shapes(run, table, times, number))
    yield _of("/gateway/log", LOG, _changes(run, times))
    yield from _columns(run, times)
    yield Topic("/can", json_schema("CanFrame", "a CAN frame", CAN_FRAME), _can(frames_of(run)))


def _of(name: str, schema: Schema, messages: Iterable[tuple[int, Message]]) -> Topic:
    return Topic(name, schema, ((time, message.SerializeToString()) for time, message in messages))


def _known(times: list[int], places: tuple[Floats, ...]) -> Iterator[tuple[int, float, float, float]]:
    """Yield the time, x, y [m] and heading [rad] of every tick at which they are known."""
    for time, x, y, heading in zip(times, *(values.tolist() for values in places), strict=True):
        if math.isfinite(x + y + heading):
            yield time, x, y, heading


def _transforms(run: Run, times: list[int], places: tuple[Floats, ...]) -> Iterator[tuple[int, Message]]:
    drawings = {table.name: table.drawing for table in run.sensed.values()}
    return ((place[0], transforms(*place, drawings)) for place in _known(times, places))


def _poses(times: list[int], places: tuple[Floats, ...]) -> Iterator[tuple[int, Message]]:
    return ((place[0], pose_in_map(*place)) for place in _known(times, places))


def _fixes(run: Run, times: list[int], places: tuple[Floats, ...]) -> Iterator[tuple[int, Message]]:
    lot = LotPlaces(run.resolved)
    return ((place[0], lot.fix(*place)) for place in _known(times, places))


def _changes(run: Run, times: list[int]) -> Iterator[tuple[int, Message]]:
    """Yield a line wherever the gateway's state or its reasons changed."""
    ticks, before = run.arrow("ticks"), None
    states, reasons = ticks["state"].to_pylist(), ticks["reasons"].to_pylist()
    for time, now in zip(times, zip(states, reasons, strict=True), strict=True):
        if now != before:
            before = now
            yield time, state_change(time, *now)


def _roads(run: Run, time: int) -> SceneUpdate:
    return roads(lanes_of(run), recorded_points(run.resolved), stamp(time), MAP)


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
            name: property_of(table[name].dtype.kind, table.attrs["meanings"][name], table.attrs["units"][name])
            for name in names
        }
        rows = zip(*(table[name].tolist() for name in names), strict=True)
        yield Topic(topic, json_schema(schema, title, properties), _rows(times, names, rows))


def _rows(times: list[int], names: list[str], rows: Iterable[tuple[Any, ...]]) -> Iterator[tuple[int, bytes]]:
    return ((time, json_row(names, row)) for time, row in zip(times, rows, strict=True))


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
