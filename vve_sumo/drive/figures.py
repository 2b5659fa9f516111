"""The figures of a drive: gap, time to collision, deviations, read from the record's tables after the drive.

Knows tables and the path; neither SUMO nor how the drive was run.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray
from scipy.spatial import KDTree

from vve_sumo.path import Path
from vve_sumo.values import Floats, Vehicle

Indices = NDArray[np.int64]

#: an actor whose station lies further ahead than this takes no part in gap and time to collision [m]
HORIZON = 150.0
#: an actor whose centre lies further from the path than this cannot reach into the strip [m]
CLOSE_TO_PATH = 16.0
#: below this speed the car is at rest, and has a gap to talk of [m/s]
AT_REST = 0.05
#: below this closing speed a time to collision is not counted: at rest, noise would divide by nothing [m/s]
CLOSING_FLOOR = 0.05


@dataclass(frozen=True, slots=True)
class Ahead:
    """What stands in the strip that the ego covers along its path: one entry a tick, NaN where there is nothing."""

    gap: Floats  #: front bumper to the nearest box along the path [m]; negative is overlap
    closing_speed: Floats  #: ego's speed minus that box's speed along the path [m/s]
    actor: list[str]  #: its name, empty where there is nothing


@dataclass(frozen=True, slots=True)
class Figures:
    """What a drive comes to; NaN where the drive held nothing to measure."""

    stop_gap_m: float
    min_ttc_s: float
    max_lateral_deviation_m: float
    max_deceleration_mps2: float
    max_speed_mps: float


def locate(path: Path, x: Floats, y: Floats, near: Floats, window: float) -> tuple[Floats, Floats, Floats]:
    """Return station [m], offset (left positive) [m] and path heading [rad] of points (x, y).

    Each is matched within `window` metres of path on either side of its own `near` station, so that a path that
    crosses itself does not mix its branches; beyond the ends the path is taken as straight.
    """
    table = path.samples
    step = float(table.s[1] - table.s[0])
    reach = math.ceil(window / step)
    centre = np.rint((near - table.s[0]) / step).astype(np.int64)
    index = np.clip(centre[:, None] + np.arange(-reach, reach + 1), 0, len(table.s) - 1)
    distance = (table.x[index] - x[:, None]) ** 2 + (table.y[index] - y[:, None]) ** 2
    best = index[np.arange(len(x)), np.argmin(distance, axis=1)]
    dx, dy = x - table.x[best], y - table.y[best]
    tx, ty, curvature = table.tangent_x[best], table.tangent_y[best], table.curvature[best]
    along, across = dx * tx + dy * ty, dy * tx - dx * ty
    arc = along / np.maximum(1.0 - curvature * across, 0.5)
    heading = np.arctan2(ty, tx) + curvature * arc
    return table.s[best] + arc, across - 0.5 * curvature * along * arc, heading


def _ego(ticks: pa.Table) -> tuple[Floats, Floats, Floats, Floats, Floats]:
    """Return x, y, heading, speed, acceleration of the rear axle: the truth where there is one, else the estimate."""
    true_x = ticks["true_x_m"].to_numpy()
    prefix = "true_" if np.isfinite(true_x).any() else ""
    names = (f"{prefix}{name}" for name in ("x_m", "y_m", "heading_rad", "speed_mps", "acceleration_mps2"))
    x, y, heading, speed, acceleration = (ticks[name].to_numpy() for name in names)
    return x, y, heading, speed, acceleration


def ahead(ticks: pa.Table, actors: pa.Table, path: Path, vehicle: Vehicle) -> Ahead:
    """Return, for every tick, the nearest actor in the strip of the ego's width around the path, and its gap.

    The strip follows the path; the gap counts along it from the ego's front bumper to the nearest corner of the box.
    """
    x, y, _heading, speed, _acceleration = _ego(ticks)
    count = ticks.num_rows
    gap, closing, names = np.full(count, np.nan), np.full(count, np.nan), [""] * count
    # What lies beside or behind the middle of the ego is not ahead of it.
    middle = vehicle.rear_axle_to_bumper - vehicle.length / 2.0
    own = np.full(count, np.nan)
    placed = np.flatnonzero(np.isfinite(x) & np.isfinite(ticks["station_m"].to_numpy()))
    own[placed], _, _ = locate(path, x[placed], y[placed], ticks["station_m"].to_numpy()[placed], 10.0)
    rows, at = _rows_near(ticks, actors, own, path)
    bumper = own[at] + vehicle.rear_axle_to_bumper
    centre, stations, offsets, along = _corners(actors, rows, path, bumper)
    half = vehicle.width / 2.0
    in_strip = (offsets.min(axis=0) < half) & (offsets.max(axis=0) > -half)
    row_gap = stations.min(axis=0) - bumper
    counted = np.flatnonzero(in_strip & (centre > own[at] + middle) & (row_gap < HORIZON))
    actor_speed = actors["speed_mps"].to_numpy()[rows] * along
    for row in counted[np.argsort(-row_gap[counted], kind="stable")].tolist():
        tick = int(at[row])
        gap[tick], closing[tick] = row_gap[row], speed[tick] - actor_speed[row]
        names[tick] = actors["actor"][int(rows[row])].as_py()
    return Ahead(gap, closing, names)


def _rows_near(ticks: pa.Table, actors: pa.Table, own: Floats, path: Path) -> tuple[Indices, Indices]:
    """Return the rows of `actors` that can matter (close to the path, at a tick with an ego) and their tick's index."""
    if actors.num_rows == 0:
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    at = actors["tick"].to_numpy() - int(ticks["tick"][0].as_py())
    known = (at >= 0) & (at < ticks.num_rows)
    known[known] = np.isfinite(own[at[known]])
    centres = np.column_stack((actors["x_m"].to_numpy(), actors["y_m"].to_numpy()))
    tree = KDTree(np.column_stack((path.samples.x, path.samples.y)))
    distance, _ = tree.query(centres, distance_upper_bound=CLOSE_TO_PATH)
    rows = np.flatnonzero(known & np.isfinite(distance))
    return rows, at[rows]


def _corners(actors: pa.Table, rows: Indices, path: Path, bumper: Floats) -> tuple[Floats, Floats, Floats, Floats]:
    """Return stations of the boxes' centres (n), stations and offsets of their corners (4 x n), and the cosine of each
    heading against the path's (n).
    """
    x, y, heading = (actors[name].to_numpy()[rows] for name in ("x_m", "y_m", "heading_rad"))
    length, width = (actors[name].to_numpy()[rows] / 2.0 for name in ("length_m", "width_m"))
    cos, sin = np.cos(heading), np.sin(heading)
    centre, _, path_heading = locate(path, x, y, bumper + HORIZON / 2.0, HORIZON / 2.0 + 30.0)
    stations, offsets = [], []
    for forward, left in ((1, 1), (1, -1), (-1, 1), (-1, -1)):
        corner_x = x + forward * length * cos - left * width * sin
        corner_y = y + forward * length * sin + left * width * cos
        station, offset, _ = locate(path, corner_x, corner_y, centre, 15.0)
        stations.append(station)
        offsets.append(offset)
    return centre, np.array(stations), np.array(offsets), np.cos(heading - path_heading)


def time_to_collision(seen: Ahead) -> Floats:
    """Return gap over closing speed [s] for every tick; NaN where nothing is ahead or the gap does not close."""
    closes = (seen.closing_speed > CLOSING_FLOOR) & (seen.gap > 0.0)
    safe = np.where(closes, seen.closing_speed, 1.0)
    return np.where(closes, seen.gap / safe, np.nan)


def measure(ticks: pa.Table, actors: pa.Table, path: Path, vehicle: Vehicle) -> Figures:
    """Return the figures of a drive from its tables; the stop gap is the gap at the last tick, if the car stands."""
    _x, _y, _heading, speed, acceleration = _ego(ticks)
    seen = ahead(ticks, actors, path, vehicle)
    deviation = ticks["lateral_deviation_m"].to_numpy()
    if not np.isfinite(deviation).any():
        deviation = ticks["estimated_deviation_m"].to_numpy()
    return Figures(
        stop_gap_m=float(seen.gap[-1]) if len(speed) and abs(speed[-1]) < AT_REST else math.nan,
        min_ttc_s=_least(time_to_collision(seen)),
        max_lateral_deviation_m=-_least(-np.abs(deviation)),
        max_deceleration_mps2=max(0.0, -_least(acceleration)),
        max_speed_mps=-_least(-speed),
    )


def _least(values: Floats) -> float:
    finite = values[np.isfinite(values)]
    return float(finite.min()) if len(finite) else math.nan
