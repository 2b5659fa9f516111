"""What the further sensors of a drive measured, as the topics that the ROS 2 bridge gives them.

The messages are made by the bridge's own functions, out of the columns of the kinds that this package ships; a sensor
of another kind has no topic.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping
from typing import Any, Final

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from vve_sumo.analysis.run import Run
from vve_sumo.analysis.sensed import SensedTable
from vve_sumo.errors import ConfigError
from vve_sumo.export.unix_time import unix_of_drive
from vve_sumo.sensors.drawing import Mounting
from vve_sumo.sensors.port import PORT, STANDARD, Content, load
from vve_sumo.sensors.v2x_messages import CAM, VAM
from vve_sumo.values import CameraObjects, Floats, Stations, StopLines
from vve_sumo.wire.ros2 import clouds
from vve_sumo.wire.ros2.messages import sense_refusal

Columns = Mapping[str, np.ndarray[Any, Any]]  #: of a reading, by the names of the record's table


class RecordedSenses:
    """The readings of the further sensors of a drive."""

    def __init__(self, run: Run) -> None:
        """Raises ConfigError for a sensor with the name of another frame of the bridge."""
        self._run, self._sensors = run, dict(_further(run))
        self._readings: dict[int, list[tuple[str, int]]] = defaultdict(list)  # by the tick at which they came out
        for name, (table, _) in self._sensors.items():
            for number, tick in enumerate(table.at.tolist()):
                self._readings[tick].append((name, number))

    @property
    def frames(self) -> dict[str, Mounting]:
        """Where the measurements of each sensor count from, by name."""
        return {name: table.drawing.frame for name, (table, _) in self._sensors.items()}

    def of_tick(self, tick: int) -> Iterator[tuple[str, Any]]:
        """Yield topic and message of what came out at a tick, by its index."""
        for name, number in self._readings[tick]:
            table, contents = self._sensors[name]
            rows = table.rows.slice(table.first[number], table.first[number + 1] - table.first[number])
            at = 1000 * unix_of_drive(self._run, float(table.measured[number]))
            for content in contents:
                for below, message in MADE[content](at, rows, name):
                    yield f"/{name}/{below}", message


def _further(run: Run) -> Iterator[tuple[str, tuple[SensedTable, tuple[Content, ...]]]]:
    """Yield name, table and contents of each sensor of a shipped kind beside the one that every scenario has."""
    kinds = {one["name"]: one["kind"] for one in run.resolved["settings"].get("sensors") or ()}
    for name, table in run.sensed.items():
        if name == STANDARD or kinds[name] not in PORT.shipped or not load(kinds[name]).serves:
            continue
        if why := sense_refusal(name):
            raise ConfigError(f"rosbag2: {why}")
        yield name, (table, load(kinds[name]).serves)


def _columns(rows: pa.Table) -> Columns:
    return {name: rows[name].to_numpy() for name in rows.column_names if not pa.types.is_string(rows[name].type)}


def _detections(at: int, rows: pa.Table, name: str) -> Iterator[tuple[str, Any]]:
    of = _columns(rows)
    yield "points", clouds.radar_cloud(at, of["range_m"], of["azimuth_rad"], of["range_rate_mps"], frame=name)


def _points(at: int, rows: pa.Table, name: str) -> Iterator[tuple[str, Any]]:
    of = _columns(rows)
    yield (
        "points",
        clouds.returns_cloud(
            at, of["range_m"], of["azimuth_rad"], of["elevation_rad"], of["reflectivity"], of["channel"], frame=name
        ),
    )


def _objects(at: int, rows: pa.Table, name: str) -> Iterator[tuple[str, Any]]:
    of = _columns(rows)
    listed = CameraObjects(
        math.nan, of["number"], of["kind"], of["status"], of["x_m"], of["y_m"], of["relative_speed_mps"], of["width_m"],
        of["length_m"], lane_known=False, lane_left=0.0, lane_right=0.0,
    )  # fmt: skip
    yield "objects", clouds.table_cloud(at, listed, name)
    yield "detections", clouds.detections(at, listed, name)


def _stations(at: int, rows: pa.Table, name: str) -> Iterator[tuple[str, Any]]:
    of = _columns(rows.filter(pc.is_in(rows["message"], pa.array([CAM, VAM], rows["message"].type))))
    unknown: Floats = np.full(len(of["station"]), np.nan)
    heard = Stations(
        math.nan, of["station"], of["message"], of["kind"], of["age_s"], unknown, unknown, of["x_m"], of["y_m"],
        of["heading_rad"], unknown, of["speed_mps"], unknown, unknown, of["length_m"], of["width_m"],
        of["uncertainty_m"],
    )  # fmt: skip
    yield "stations", clouds.table_cloud(at, heard, name)


def _stop_lines(at: int, rows: pa.Table, name: str) -> Iterator[tuple[str, Any]]:
    of = _columns(rows)
    names = ("intersection", "group", "x_m", "y_m", "heading_rad", "width_m", "exit_x_m", "exit_y_m", "phase", "age_s",
             "remaining_s", "green_begin_s", "green_end_s")  # fmt: skip
    yield "stop_lines", clouds.table_cloud(at, StopLines(math.nan, *(of[column] for column in names)), name)


#: what gives topic below the sensor's name, and message, of a reading's rows, by what the sensor serves
MADE: Final[Mapping[Content, Callable[[int, pa.Table, str], Iterator[tuple[str, Any]]]]] = {
    "detections": _detections,
    "points": _points,
    "objects": _objects,
    "stations": _stations,
    "stop_lines": _stop_lines,
}
