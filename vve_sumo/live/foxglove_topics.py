"""From the samples of a live drive to the topics that an MCAP file of its record has, for viewers that watch it.

The ego is where the pipeline has it: while a drive goes on nobody is told the truth. Only topics that somebody asks for
are encoded. Knows samples and messages; nothing of sockets.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterator, Mapping
from typing import Any, Final

import pyarrow as pa

from vve_sumo.body_kinds import BODY_KINDS, TYPICAL
from vve_sumo.export import foxglove_messages as messages
from vve_sumo.export.foxglove_clouds import cloud, drawn_shapes, points_of
from vve_sumo.export.foxglove_messages import MAP, Schema
from vve_sumo.export.foxglove_scene import BodyBox, roads, stamp, update
from vve_sumo.export.lanes import lanes_in
from vve_sumo.export.unix_time import MICROSECONDS, unix_of_gnss
from vve_sumo.metrics.lead_vehicle import lead_vehicle_now
from vve_sumo.metrics.metric import unit_of
from vve_sumo.record.declared import recorded_path, recorded_points, recorded_vehicle
from vve_sumo.record.drawings import drawings_of
from vve_sumo.record.layout import SCHEMAS, sensor_schemas, sensor_table
from vve_sumo.sensors.drawing import Drawing
from vve_sumo.values import EGO, Point, Pose
from vve_sumo.view.sample import ReadingView, ViewSample
from vve_sumo.view.topic_stream import StreamedMessage, StreamedTopic

#: a viewer that hears nothing for so long draws no bodies any more [s]
LIFETIME: Final = 1

#: the gap is in every so many ticks' signals, because it takes milliseconds among many bodies
GAP_TICKS: Final = 5

#: of the record's ticks, what a sample holds of each
_SIGNALS: Final[Mapping[str, Callable[[ViewSample, Pose], float]]] = {
    "tick": lambda sample, pose: sample.tick,
    "time_s": lambda sample, pose: sample.time,
    "x_m": lambda sample, pose: pose.x,
    "y_m": lambda sample, pose: pose.y,
    "heading_rad": lambda sample, pose: pose.heading,
    "speed_mps": lambda sample, pose: pose.speed,
    "acceleration_mps2": lambda sample, pose: pose.acceleration,
    "yaw_rate_radps": lambda sample, pose: pose.yaw_rate,
    "s_m": lambda sample, pose: sample.s,
    "estimated_deviation_m": lambda sample, pose: sample.d,
    "acceleration_setpoint_mps2": lambda sample, pose: sample.wished,
    "steering_setpoint_rad": lambda sample, pose: sample.wished_steering,
    "granted_acceleration_mps2": lambda sample, pose: sample.status.acceleration,
    "steering_rad": lambda sample, pose: sample.status.steering,
    "brake_torque_nm": lambda sample, pose: sample.status.brake_torque,
    "throttle_percent": lambda sample, pose: 100.0 * sample.status.throttle,
    "measured_steering_rad": lambda sample, pose: sample.steering,
}
#: what else is a signal, with its meaning
_GAPS: Final = {
    "strip_gap_m": "front bumper to the nearest part of a box in the ego's strip, wherever that goes; 0 at contact, "
    "in every fifth tick",
    "strip_ttc_s": "gap over closing speed to that box",
    "wheel_speed_mps": "rear axle's speed from the wheels, as the car reports it",
    "latency_s": "of the newest completed tick: arrival of the pose's bytes to the command frame",
    "missed": "ticks skipped so far because their time had passed",
}
_STATES: Final[Mapping[str, Callable[[ViewSample], str]]] = {
    "state": lambda sample: sample.status.state.value,
    "reasons": lambda sample: "+".join(sample.status.reasons),
    "faults": lambda sample: "+".join(sample.faults),
    "pose_reasons": lambda sample: "+".join(sample.pose_reasons),
    "note": lambda sample: sample.note,
}
_OTHER_STATES: Final[Mapping[str, tuple[str, Callable[[ViewSample], str]]]] = {
    "quality": ("of the newest trusted fix", lambda sample: sample.quality.value),
    "gear": ("that the car reports; empty before the first report", lambda sample: sample.gear),
}
_NAN: Final = math.nan
#: the pose before the first trusted fix
_NOWHERE: Final = Pose(_NAN, Point.REAR_AXLE, _NAN, _NAN, _NAN, _NAN, _NAN, _NAN, _NAN, _NAN)


class LiveTopics:
    """Follows one live drive, sample by sample."""

    def __init__(self, resolved: Mapping[str, Any], lanes: pa.Table) -> None:
        """`resolved` is the content of `scenario.json`, `lanes` the record's table of roads."""
        self._path, self._vehicle = recorded_path(resolved), recorded_vehicle(resolved)
        self._drawings, self._rows = drawings_of(resolved), sensor_schemas(resolved)
        self._lot = messages.LotPlaces(resolved)
        self._epoch = unix_of_gnss(float(resolved["epoch_gnss_s"]))
        self._roads = roads(lanes_in(lanes), recorded_points(resolved), stamp(self._time(0.0)), MAP)
        self._state: tuple[str, str] | None = None  # the gateway's, with its reasons, of the sample before
        self._bodies: frozenset[str] = frozenset()  # of the sample before
        sensed = {f"/{sensor_table(name)}": messages.CLOUD for name in self._drawings}
        sensed |= {
            f"/{sensor_table(name)}/shapes": messages.SCENE
            for name, drawing in self._drawings.items()
            if drawing.shape != "points"
        }
        schemas = _SCHEMAS | sensed
        self.topics = tuple(_streamed(name, schema) for name, schema in schemas.items())
        self._numbers = {name: number for number, name in enumerate(schemas)}

    def first(self, topic: int) -> StreamedMessage | None:
        """Return what a new subscriber to a topic gets at once: the roads, which do not change."""
        if topic != self._numbers["/roads"]:
            return None
        return StreamedMessage(topic, self._time(0.0), self._roads.SerializeToString())

    def take(self, sample: ViewSample, wanted: Collection[int]) -> list[StreamedMessage]:
        """Take a sample, none of which may be left out; return its messages of the topics `wanted`, by index."""
        time = self._time(sample.time)
        state = sample.status.state.value, "+".join(sample.status.reasons)
        gone = self._bodies.difference(sample.actors.ids)
        found = [
            StreamedMessage(self._numbers[name], time, content())
            for name, content in self._contents(sample, time, state, gone)
            if self._numbers[name] in wanted
        ]
        self._state, self._bodies = state, frozenset(sample.actors.ids)
        return found

    def _time(self, time: float) -> int:
        """Return the Unix time [ns] of a drive time [s], as an export of the record has it."""
        return 1000 * (self._epoch + round(time * MICROSECONDS))

    def _contents(
        self, sample: ViewSample, time: int, state: tuple[str, str], gone: Collection[str]
    ) -> Iterator[tuple[str, Callable[[], bytes]]]:
        """Yield the topics that a sample has a message of, and what encodes it."""
        if sample.pose is not None:
            place = time, sample.pose.x, sample.pose.y, sample.pose.heading
            yield "/tf", lambda: messages.transforms(*place, self._drawings).SerializeToString()
            for name in ("/ego/pose", "/ego/pose_estimated"):
                yield name, lambda: messages.pose_in_map(*place).SerializeToString()
            yield "/ego/fix", lambda: self._lot.fix(*place).SerializeToString()
        boxes = self._boxes(sample)
        yield "/scene", lambda: update(boxes, gone, time, MAP, LIFETIME).SerializeToString()
        for number, (name, drawing) in enumerate(self._drawings.items()):
            if (reading := sample.readings.get(name)) is not None:
                yield from self._sensed(name, drawing, number, reading)
        if state != self._state:
            yield "/gateway/log", lambda: messages.state_change(time, *state).SerializeToString()
        yield "/signals", lambda: self._signals(sample)
        states = {name: value(sample) for name, value in _STATES.items()}
        states |= {name: value(sample) for name, (_, value) in _OTHER_STATES.items()}
        yield "/states", lambda: messages.json_row(states, states.values())

    def _boxes(self, sample: ViewSample) -> Iterator[BodyBox]:
        if (pose := sample.pose) is not None:
            car, ahead = self._vehicle, 0.5 * self._vehicle.length - self._vehicle.rear_overhang
            middle = pose.x + ahead * math.cos(pose.heading), pose.y + ahead * math.sin(pose.heading)
            yield BodyBox(EGO, "car", True, *middle, pose.heading, car.length, car.width, TYPICAL["car"].height)
        actors = sample.actors
        columns = (actors.x, actors.y, actors.heading, actors.length, actors.width, actors.height)
        for name, kind, *row in zip(actors.ids, actors.kind, *(column.tolist() for column in columns), strict=True):
            yield BodyBox(name, BODY_KINDS[kind], False, *row)

    def _sensed(
        self, name: str, drawing: Drawing, number: int, reading: ReadingView
    ) -> Iterator[tuple[str, Callable[[], bytes]]]:
        schema = pa.schema([field for field in self._rows[sensor_table(name)] if field.name != "tick"])
        measured = self._time(reading.measured)

        def rows() -> pa.Table:
            columns = zip(reading.columns, schema.types, strict=True)
            return pa.table([pa.array(column, kind) for column, kind in columns], schema=schema)

        yield (
            f"/{sensor_table(name)}",
            lambda: cloud(name, points_of(drawing, rows()), measured).SerializeToString(),
        )
        if drawing.shape != "points":
            yield (
                f"/{sensor_table(name)}/shapes",
                lambda: drawn_shapes(name, drawing, rows(), number, measured).SerializeToString(),
            )

    def _signals(self, sample: ViewSample) -> bytes:
        pose = sample.pose or _NOWHERE
        row = {name: value(sample, pose) for name, value in _SIGNALS.items()}
        gap, closing = self._gap(sample)
        row |= {
            "strip_gap_m": gap,
            "strip_ttc_s": gap / closing if closing > 0.0 else _NAN,
            "wheel_speed_mps": sample.wheel_speed,
            "latency_s": sample.latency,
            "missed": sample.missed,
        }
        return messages.json_row(row, row.values())

    def _gap(self, sample: ViewSample) -> tuple[float, float]:
        """Return gap [m] and closing speed [m/s] to the nearest body in the ego's strip, NaN where not computed."""
        if sample.pose is None or sample.tick % GAP_TICKS:
            return _NAN, _NAN
        lead = lead_vehicle_now(sample.pose, sample.s, sample.actors, self._path, self._vehicle, sample.commanded_path)
        return float(lead.gap[0]), float(lead.closing_speed[0])


def _streamed(name: str, schema: Schema) -> StreamedTopic:
    return StreamedTopic(name, schema.messages, schema.name, schema.encoding, schema.content)


def _tick_property(name: str) -> dict[str, str]:
    """Return the property of a column of the record's ticks."""
    field = SCHEMAS["ticks"].field(name)
    about = {key.decode(): value.decode() for key, value in field.metadata.items()}
    return messages.property_of(field.type.to_pandas_dtype().__name__[0], about["meaning"], about["unit"])


def _own_property(name: str, meaning: str) -> dict[str, str]:
    return messages.property_of("i" if name == "missed" else "f", meaning, unit_of(name))


_SIGNALS_SCHEMA: Final = messages.json_schema(
    "Signals",
    "numbers of a tick; one that is not known is left out",
    {name: _tick_property(name) for name in _SIGNALS} | {name: _own_property(name, _GAPS[name]) for name in _GAPS},
)
_STATES_SCHEMA: Final = messages.json_schema(
    "States",
    "states, reasons and names of a tick",
    {name: _tick_property(name) for name in _STATES}
    | {name: messages.property_of("O", meaning, "") for name, (meaning, _) in _OTHER_STATES.items()},
)
#: topics of every drive
_SCHEMAS: Final = {
    "/tf": messages.TRANSFORMS,
    "/ego/pose": messages.POSE,
    "/ego/pose_estimated": messages.POSE,
    "/ego/fix": messages.FIX,
    "/roads": messages.SCENE,
    "/scene": messages.SCENE,
    "/gateway/log": messages.LOG,
    "/signals": _SIGNALS_SCHEMA,
    "/states": _STATES_SCHEMA,
}
