"""Clouds of further sensors against the rows of a record: what the bridge sent, and what a bag holds."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vve_sumo.analysis import Run
from vve_sumo.export.unix_time import unix_of_drive

Cloud = tuple[int, str, NDArray[Any]]  # Unix time [ns], frame, points
Columns = Mapping[str, str]  # of the record, by the field of a point
FORMATS = {1: "i1", 2: "u1", 4: "<u2", 6: "<u4", 7: "<f4", 8: "<f8"}
OBJECTS = {"number": "number", "kind": "kind", "status": "status", "x": "x_m", "y": "y_m",
           "relative_speed": "relative_speed_mps", "width": "width_m", "length": "length_m"}  # fmt: skip
STATIONS = {"x": "x_m", "y": "y_m", "speed": "speed_mps", "heading": "heading_rad", "length": "length_m",
            "width": "width_m", "uncertainty": "uncertainty_m", "age": "age_s"}  # fmt: skip
STOP_LINES = {"intersection": "intersection", "group": "group", "x": "x_m", "y": "y_m", "heading": "heading_rad",
              "width": "width_m", "exit_x": "exit_x_m", "exit_y": "exit_y_m", "phase": "phase", "age": "age_s",
              "remaining": "remaining_s", "green_begin": "green_begin_s", "green_end": "green_end_s"}  # fmt: skip


def points_of(fields: list[tuple[str, int, int]], step: int, data: bytes) -> NDArray[Any]:
    """Read a cloud by what its own fields say: name, datatype, offset."""
    names, kinds, offsets = zip(*fields, strict=True)
    layout = {"names": names, "formats": [FORMATS[kind] for kind in kinds], "offsets": offsets, "itemsize": step}
    return np.frombuffer(data, np.dtype(layout))


def recorded(run: Run, sensor: str, *columns: str) -> dict[int, dict[str, NDArray[Any]]]:
    """Return each reading's columns of the record, by the Unix time of its measurement [ns]."""
    table = run.sensed[sensor]
    whole = {name: table.rows[name].to_numpy() for name in columns}
    return {1000 * unix_of_drive(run, at): {name: column[table.of_reading(number)] for name, column in whole.items()}
            for number, at in enumerate(table.measured.tolist())}  # fmt: skip


def same_turns(clouds: list[Cloud], run: Run, sensor: str) -> None:
    """The points of every cloud are those of the turn that the record has of its time."""
    turns = recorded(run, sensor, "channel", "azimuth_rad", "elevation_rad", "range_m", "reflectivity")
    for at, _, points in clouds:
        channel, azimuth, elevation, far, reflectivity = turns[at].values()
        assert len(points) == len(far) > 5000
        level = far * np.cos(elevation)
        wanted = np.stack([level * np.cos(azimuth), level * np.sin(azimuth), far * np.sin(elevation)], axis=1)
        got = np.stack([points[axis] for axis in "xyz"], axis=1)
        assert np.abs(got - wanted).max() < 2e-5
        assert (points["ring"] == channel).all()
        assert (points["intensity"] == reflectivity).all()


def same_rows(clouds: list[Cloud], run: Run, sensor: str, columns: Columns) -> None:
    """The points of every cloud are the rows of the reading that the record has of its time; some have any."""
    rows = recorded(run, sensor, *columns.values())
    assert sum(len(points) for _, _, points in clouds) > 10
    for at, _, points in clouds:
        for name, column in columns.items():
            assert points[name].tolist() == rows[at][column].astype(points[name].dtype).tolist(), name


def same_scans(clouds: list[Cloud], run: Run, sensor: str) -> None:
    """The points of every cloud are the detections of the scan that the record has of its time; some have any."""
    columns = {"range": "range_m", "azimuth": "azimuth_rad", "range_rate": "range_rate_mps"}
    same_rows(clouds, run, sensor, columns)
    for _, _, points in clouds:
        far, azimuth = (points[name].astype(np.float64) for name in ("range", "azimuth"))
        assert np.abs(points["x"] - far * np.cos(azimuth)).max(initial=0.0) < 1e-4
        assert np.abs(points["y"] - far * np.sin(azimuth)).max(initial=0.0) < 1e-4
