"""A bag of rosbag2 in its MCAP storage: the topics of the ROS 2 bridge, as a record has them; no ROS is needed.

The messages are made by the bridge's own functions. What a record does not hold is said in `docs/ros2.md`.
"""

from __future__ import annotations

import io
import math
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import replace
from typing import Any, Final

import numpy as np

from vve_sumo.analysis.run import Run
from vve_sumo.errors import ConfigError
from vve_sumo.export.part import ExportPart
from vve_sumo.export.rosbag2_senses import RecordedSenses
from vve_sumo.export.unix_time import unix_of_drive
from vve_sumo.frames import Alignment, MapFrame, Mounting, Placement
from vve_sumo.metrics.lead_vehicle import index_of_tick
from vve_sumo.sensors.port import STANDARD
from vve_sumo.values import Actors, FixQuality, Point, Pose
from vve_sumo.version import __version__
from vve_sumo.wire.ros2 import clouds, messages
from vve_sumo.wire.ros2.path_ahead import PathAhead
from vve_sumo.wire.ros2.types import encode, store
from vve_sumo.wire.setpoints import SILENT

CHUNK: Final = 1 << 20  #: bytes of messages before compression
#: QoS profiles of topics as rosbag2 keeps them: those of the bridge
QUALITY: Final = """- history: keep_last
  depth: {depth}
  reliability: reliable
  durability: {durability}
  deadline: {{sec: 9223372036, nsec: 854775807}}
  lifespan: {{sec: 9223372036, nsec: 854775807}}
  liveliness: automatic
  liveliness_lease_duration: {{sec: 9223372036, nsec: 854775807}}
  avoid_ros_namespace_conventions: false
"""


def of_drive(run: Run) -> Iterator[ExportPart]:
    """Yield the bag, one file; raises ConfigError where a package of the extra is not installed."""
    store()
    try:
        from mcap.writer import CompressionType, Writer
    except ImportError:
        raise ConfigError("rosbag2 needs mcap: pip install 'vve-sumo[ros2]'") from None
    sink = io.BytesIO()
    writer = Writer(sink, chunk_size=CHUNK, compression=CompressionType.ZSTD)
    writer.start(profile="ros2", library=f"vve_sumo {__version__}")
    channels: dict[str, int] = {}
    for at, topic, message in messages_of(run):
        if topic not in channels:
            channels[topic] = _channel(writer, topic, message.__msgtype__)
        writer.add_message(channels[topic], at, encode(message), at)
    writer.finish()  # type: ignore[no-untyped-call]
    yield ExportPart("", sink.getvalue())


def _channel(writer: Any, topic: str, kind: str) -> int:
    definition, _ = store().generate_msgdef(kind, ros_version=2)
    schema = writer.register_schema(kind, "ros2msg", definition.encode())
    latched = topic in messages.LATCHED
    quality = QUALITY.format(depth=1 if latched else 10, durability="transient_local" if latched else "volatile")
    number: int = writer.register_channel(topic, "cdr", schema, {"offered_qos_profiles": quality})
    return number


def messages_of(run: Run) -> Iterator[tuple[int, str, Any]]:
    """Yield Unix time [ns], topic and message of everything, tick by tick, in the bridge's order."""
    mounting = Mounting(**run.resolved["vehicle_model"]["mounting"])
    placement, sensors = _placement(run, mounting), (mounting.forward, mounting.left)
    actors, scans = _actors(run), _scans(run)
    senses, bumper = RecordedSenses(run), run.vehicle.rear_axle_to_bumper
    s: float | None = None  # of the ego along the path
    ahead = PathAhead(run.path, run.resolved["settings"]["ego"]["speed_mps"])
    for number, (at, pose, status) in enumerate(_ticks(run)):
        yield at, "/clock", messages.clock(at)
        if number == 0:
            yield at, "/tf_static", messages.static_transforms(at, bumper, sensors, senses.frames)
            yield at, "/path", messages.path(at, run.path)
        for cloud in scans.get(number, ()):
            yield at, "/radar/points", cloud
        for topic, message in senses.of_tick(number):
            yield at, topic, message
        if pose is not None:
            # A record's ticks do not hold the fix' quality: that there was one is all that the message says.
            fix = replace(placement.unplace(pose), locked=True, quality=FixQuality.SINGLE)
            yield at, "/tf", messages.transforms(at, pose)
            yield at, "/fix", messages.nav_sat_fix(at, fix)
            yield at, "/imu", messages.imu(at, fix)
            s = run.path.project(pose.x, pose.y, s).s
            yield at, "/path/ahead", ahead.path(at, pose, s)
            yield at, "/path/speed", ahead.reference(at, s)
            yield at, "/odom", messages.odometry(at, pose)
            yield at, "/bodies", messages.markers(at, actors.get(number, Actors.none(pose.time)))
        yield at, "/diagnostics", status


def _placement(run: Run, mounting: Mounting) -> Placement:
    """Return what takes the estimated pose back to the lot: a record does not hold the virtual road's projection."""
    turned = run.resolved["lot_to_road"]
    alignment = Alignment(turned["rotation_rad"], turned["x_m"], turned["y_m"])
    return Placement(MapFrame(run.resolved["lot_projection"]), alignment, mounting, run.resolved["epoch_gnss_s"])


def _ticks(run: Run) -> Iterator[tuple[int, Pose | None, Any]]:
    """Yield of every tick its Unix time [ns], the estimated pose where it was known, and its diagnostics."""
    ticks = run.arrow("ticks")
    names = ("time_s", "x_m", "y_m", "heading_rad", "speed_mps", "acceleration_mps2", "yaw_rate_radps")
    numbers = zip(*(ticks[name].to_numpy().tolist() for name in names), strict=True)
    words = zip(*(ticks[name].to_pylist() for name in ("state", "faults")), strict=True)
    rows = zip(numbers, words, run.data.strip_lead.gap.tolist(), strict=True)
    for (time, x, y, heading, speed, acceleration, yaw_rate), (state, faults), gap in rows:
        at, pose = 1000 * unix_of_drive(run, time), None
        if math.isfinite(x + y + heading + speed):
            rest = (speed, 0.0, yaw_rate, acceleration, 0.0)
            pose = Pose(time, Point.REAR_AXLE, x, y, heading, *rest)
        reasons = faults.split("+") if faults else []
        valid = pose is not None and all(code == SILENT for code in reasons)
        yield at, pose, messages.drive_status(at, state, reasons, valid=valid, gap=gap)


def _actors(run: Run) -> dict[int, Actors]:
    """Return the actors of every tick that has some, by the tick's index."""
    table = run.arrow("actors")
    at = index_of_tick(run.arrow("ticks"), table)
    names = ("x_m", "y_m", "heading_rad", "speed_mps", "length_m", "width_m", "radar_cross_section_m2",
             "lateral_speed_mps", "height_m", "kind")  # fmt: skip
    columns, ids = [table[name].to_numpy() for name in names], table["actor"].to_pylist()
    rows: dict[int, list[int]] = defaultdict(list)
    for row, tick in enumerate(at.tolist()):
        rows[tick].append(row)
    return {
        tick: Actors(0.0, tuple(ids[row] for row in own), *(column[own] for column in columns))
        for tick, own in rows.items()
        if tick >= 0
    }


def _scans(run: Run) -> dict[int, list[Any]]:
    """Return the radar's clouds by the index of the tick at which they came out."""
    found: dict[int, list[Any]] = defaultdict(list)
    table = run.sensed.get(STANDARD)
    if table is None:
        return found
    columns = [table.rows[name].to_numpy().astype(np.float64) for name in ("range_m", "azimuth_rad", "range_rate_mps")]
    for number, (tick, measured) in enumerate(zip(table.at.tolist(), table.measured.tolist(), strict=True)):
        at, own = 1000 * unix_of_drive(run, measured), table.of_reading(number)
        found[tick].append(clouds.radar_cloud(at, *(column[own] for column in columns)))
    return found
