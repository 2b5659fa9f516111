"""ASAM OSI traces of a drive: the virtual road as SensorView with ground truth, the radar's sight as SensorData.

Messages and time (GNSS) are those of the outgoing wire. A trace is a file for each kind of message, or one MCAP file
with a channel for each, named as OSI's convention for trace files has it.
"""

from __future__ import annotations

import math
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from vve_sumo.analysis.run import Run
from vve_sumo.errors import ConfigError
from vve_sumo.export.part import ExportPart
from vve_sumo.export.unix_time import date_of, unix_of_drive
from vve_sumo.record.layout import ACTOR_COLUMNS, sensor_table
from vve_sumo.sensors.port import STANDARD
from vve_sumo.values import Actors, Detections, Point, Pose
from vve_sumo.version import __version__
from vve_sumo.wire.osi import VERSION, Encoder

if TYPE_CHECKING:
    from google.protobuf.message import Message

OSI_VERSION: Final = ".".join(map(str, VERSION))
#: the moment that the messages' times count from
GNSS_ZERO: Final = "1980-01-06T00:00:00Z"
#: of a trace of several kinds
MULTI: Final = "multi"
CHANNEL: Final = "net.asam.osi.trace.channel"
#: columns of the record that a detection consists of, in the order of `Detections`
DETECTED: Final = ("range_m", "azimuth_rad", "range_rate_mps", "mode")


@dataclass(frozen=True, slots=True)
class Trace:
    """Messages of one kind."""

    code: str  #: of the kind, in names of files
    topic: str
    meaning: str
    messages: list[Message]


def of_drive(run: Run) -> Iterator[ExportPart]:
    """Yield a single-channel trace for each kind of message; raises ConfigError where the extra is not installed."""
    for trace in _traces(run):
        pieces = [message.SerializeToString() for message in trace.messages]
        content = b"".join(len(piece).to_bytes(4, "little") + piece for piece in pieces)
        yield ExportPart("", content, _head(run, trace.code, len(pieces)))


def mcap_of_drive(run: Run) -> Iterator[ExportPart]:
    """Yield a multi-channel trace of all kinds of messages; raises ConfigError as `of_drive` does."""
    try:
        from osi_utilities import MultiTraceWriter
    except ImportError:
        raise ConfigError("OSI needs asam-osi-utilities: pip install 'vve-sumo[osi]'") from None
    traces = _traces(run)
    with tempfile.TemporaryDirectory(prefix="vve_sumo_") as folder:
        file = Path(folder) / "trace.mcap"
        with MultiTraceWriter() as writer:
            writer.open(file, _about(run))
            for trace in traces:
                versions = {f"{CHANNEL}.osi_version": OSI_VERSION, f"{CHANNEL}.protobuf_version": _protobuf()}
                about = versions | {f"{CHANNEL}.description": trace.meaning}
                writer.add_channel(trace.topic, type(trace.messages[0]), about)
            everything = [(trace.topic, message) for trace in traces for message in trace.messages]
            for topic, message in sorted(everything, key=_time):
                if not writer.write_message(message, topic):
                    raise OSError(f"{folder}: the trace cannot be written there")
        yield ExportPart("", file.read_bytes(), _head(run, MULTI, max(len(trace.messages) for trace in traces)))


def _traces(run: Run) -> list[Trace]:
    """Return the traces that have messages."""
    # A record does not hold the projection of the virtual road's map.
    encoder, epoch = Encoder(run.vehicle, projection=""), float(run.resolved["epoch_gnss_s"])
    views = Trace(
        "sv", "ground_truth", "ego and actors on the virtual road, every tick", [*_views(run, encoder, epoch)]
    )
    scans = [*_scans(run, encoder, epoch)] if STANDARD in run.resolved["sensors"] else []
    return [views, Trace("sd", "radar", "detections of the radar, every scan", scans)] if scans else [views]


def _views(run: Run, encoder: Encoder, epoch: float) -> Iterator[Message]:
    """Yield the virtual road at every tick at which the ego's pose is known, by the truth where there is one."""
    motion, rows, table = run.motion, run.data.actor_rows, run.arrow("actors")
    columns = [table[name].to_numpy()[rows.rows] for name in ACTOR_COLUMNS]
    yaw_rates = np.nan_to_num(run.arrow("ticks")["yaw_rate_radps"].to_numpy())
    ends = np.searchsorted(rows.at, np.arange(len(run.time) + 1))
    moved = motion.time, motion.x, motion.y, motion.heading, motion.speed, motion.acceleration, yaw_rates
    for at, (time, x, y, heading, speed, acceleration, yaw_rate) in enumerate(np.column_stack(moved).tolist()):
        if not math.isfinite(x + y + heading + speed):
            continue
        here = slice(ends[at], ends[at + 1])
        names = tuple(rows.names[code] for code in rows.code[here].tolist())
        pose = Pose(time, Point.REAR_AXLE, x, y, heading, speed, 0.0, yaw_rate, acceleration, 0.0)
        yield encoder.sensor_view(epoch + time, pose, Actors(time, names, *(column[here] for column in columns)))


def _scans(run: Run, encoder: Encoder, epoch: float) -> Iterator[Message]:
    """Yield every scan, an empty one too, at the tick at which it came out."""
    time_of = dict(zip(run.arrow("ticks")["tick"].to_pylist(), run.time.tolist(), strict=True))
    columns = [run.arrow(sensor_table(STANDARD))[name].to_numpy() for name in DETECTED]
    begin = 0
    for row in run.arrow("readings").to_pylist():
        if row["sensor"] == STANDARD:
            end, now = begin + row["rows"], time_of[row["tick"]]
            scan = Detections(row["measured_s"], *(column[begin:end] for column in columns))
            yield encoder.sensor_data(epoch + now, scan, now - row["measured_s"])
            begin = end


def _head(run: Run, code: str, frames: int) -> str:
    """Return what OSI's convention puts before the name of a trace: date, kind, versions, number of messages."""
    date = date_of(unix_of_drive(run, 0.0)).strftime("%Y%m%dT%H%M%SZ")
    versions = (version.replace(".", "") for version in (OSI_VERSION, _protobuf()))
    return "_".join((date, code, *versions, str(frames)))


def _about(run: Run) -> dict[str, str]:
    """Return what a multi-channel trace says of itself; as the moment of its creation, when the drive began."""
    return {
        "version": OSI_VERSION,
        "min_osi_version": OSI_VERSION,
        "max_osi_version": OSI_VERSION,
        "min_protobuf_version": _protobuf(),
        "max_protobuf_version": _protobuf(),
        "zero_time": GNSS_ZERO,
        "creation_time": date_of(unix_of_drive(run, 0.0)).strftime("%Y-%m-%dT%H:%M:%SZ"),
        "description": run.title,
        "data_sources": f"vve_sumo {__version__}",
    }


def _time(one: tuple[str, Any]) -> tuple[int, int]:
    stamp = one[1].timestamp
    return stamp.seconds, stamp.nanos


def _protobuf() -> str:
    return metadata.version("protobuf")
