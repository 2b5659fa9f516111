"""The figures of a drive: gap, time to collision, deviations, read from the record's tables after the drive.

Knows tables and the path; neither SUMO nor how the drive was run.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray
from scipy.spatial import KDTree

from vve_sumo.metrics.stopping import AT_REST, Stop, last_stop
from vve_sumo.path import Path
from vve_sumo.values import Actors, Floats, Pose, Vehicle

Indices = NDArray[np.int64]

#: an actor whose station lies further ahead than this takes no part in gap and time to collision [m]
HORIZON = 150.0
#: an actor whose centre lies further from the path than this cannot reach into the strip [m]
CLOSE_TO_PATH = 16.0
#: below this closing speed a time to collision is not counted: at rest, noise would divide by nothing [m/s]
CLOSING_FLOOR = 0.05


@dataclass(frozen=True, slots=True)
class LeadVehicle:
    """What stands in the strip that the ego covers along its path: one entry a tick, NaN where there is nothing."""

    gap: Floats  #: front bumper to the nearest box along the path [m]; negative is overlap
    closing_speed: Floats  #: ego's speed minus that box's speed along the path [m/s]
    actor: list[str]  #: its name, empty where there is nothing


class Boxes(NamedTuple):
    """Actors' boxes, a row each."""

    at: Indices  #: index of the tick that the box was seen at
    x: Floats  #: centre, map [m]
    y: Floats  #: centre, map [m]
    heading: Floats  #: [rad] counter-clockwise from the map's +x
    speed: Floats  #: along the heading [m/s]
    length: Floats  #: [m]
    width: Floats  #: [m]


@dataclass(frozen=True, slots=True)
class Metrics:
    """What a drive comes to; NaN where the drive held nothing to measure."""

    stop_gap_m: float
    min_ttc_s: float
    max_drac_mps2: float
    min_gap_m: float
    impact_speed_mps: float
    max_lateral_deviation_m: float
    max_deceleration_mps2: float
    max_speed_mps: float
    stop_onset_speed_mps: float
    stop_distance_m: float
    stop_bound_m: float
    stop_demand_mps2: float
    stop_reaction_s: float
    stop_build_up_s: float
    mfdd_mps2: float


#: figures of the last stop
_STOP = (
    "stop_onset_speed_mps",
    "stop_distance_m",
    "stop_bound_m",
    "stop_demand_mps2",
    "stop_reaction_s",
    "stop_build_up_s",
    "mfdd_mps2",
)


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


def ahead(ticks: pa.Table, actors: pa.Table, path: Path, vehicle: Vehicle) -> LeadVehicle:
    """Return, for every tick, the nearest actor in the strip of the ego's width around the path, and its gap.

    The strip follows the path; the gap counts along it from the ego's front bumper to the nearest corner of the box.
    """
    x, y, _heading, speed, _acceleration = _ego(ticks)
    station = ticks["station_m"].to_numpy()
    own = np.full(ticks.num_rows, np.nan)
    placed = np.flatnonzero(np.isfinite(x) & np.isfinite(station))
    own[placed], _, _ = locate(path, x[placed], y[placed], station[placed], 10.0)
    rows, at = _rows_near(ticks, actors, own, path)
    columns = ("x_m", "y_m", "heading_rad", "speed_mps", "length_m", "width_m")
    boxes = Boxes(at, *(actors[name].to_numpy()[rows] for name in columns))
    gap, closing, nearest = _nearest(boxes, own, speed, path, vehicle)
    names, found = [""] * ticks.num_rows, np.flatnonzero(nearest >= 0)
    for tick, name in zip(found.tolist(), actors["actor"].take(rows[nearest[found]]).to_pylist(), strict=True):
        names[tick] = name
    return LeadVehicle(gap, closing, names)


def ahead_now(ego: Pose, station: float, actors: Actors, path: Path, vehicle: Vehicle) -> LeadVehicle:
    """Return what `ahead` says of one tick while the drive goes on: one entry.

    `ego` is the rear axle's pose on the street, `station` [m] near its own, NaN where nobody knows it yet.
    """
    if not math.isfinite(station):
        return LeadVehicle(np.full(1, np.nan), np.full(1, np.nan), [""])
    own, _, _ = locate(path, np.array([ego.x]), np.array([ego.y]), np.array([station]), 10.0)
    columns = (actors.x, actors.y, actors.heading, actors.speed, actors.length, actors.width)
    boxes = Boxes(np.zeros(len(actors.ids), np.int64), *columns)
    gap, closing, nearest = _nearest(boxes, own, np.array([ego.speed]), path, vehicle)
    return LeadVehicle(gap, closing, [actors.ids[nearest[0]] if nearest[0] >= 0 else ""])


def _nearest(boxes: Boxes, own: Floats, speed: Floats, path: Path, vehicle: Vehicle) -> tuple[Floats, Floats, Indices]:
    """Return gap [m], closing speed [m/s] and row of the nearest box ahead for every tick; NaN and -1 for none.

    `own` [m] and `speed` [m/s] are the ego's rear axle's, tick by tick.
    """
    # What lies beside or behind the middle of the ego is not ahead of it.
    middle = vehicle.rear_axle_to_bumper - vehicle.length / 2.0
    at, half = boxes.at, vehicle.width / 2.0
    bumper = own[at] + vehicle.rear_axle_to_bumper
    centre, stations, offsets, along = _corners(boxes, path, bumper)
    in_strip = (offsets.min(axis=0) < half) & (offsets.max(axis=0) > -half)
    row_gap = stations.min(axis=0) - bumper
    counted = np.flatnonzero(in_strip & (centre > own[at] + middle) & (row_gap < HORIZON))
    # The farthest first: of several boxes at one tick the last one written stays.
    order = counted[np.argsort(-row_gap[counted], kind="stable")]
    nearest = np.full(len(own), -1, np.int64)
    nearest[at[order]] = order
    gap, closing = np.full(len(own), np.nan), np.full(len(own), np.nan)
    found = np.flatnonzero(nearest >= 0)
    row = nearest[found]
    gap[found], closing[found] = row_gap[row], speed[found] - boxes.speed[row] * along[row]
    return gap, closing, nearest


def index_of_tick(ticks: pa.Table, rows: pa.Table) -> Indices:
    """Return the index in `ticks` of the tick of every row of another table; -1 for a tick that it does not hold.

    A live drive's ticks have gaps where it missed some.
    """
    numbers, wanted = ticks["tick"].to_numpy(), rows["tick"].to_numpy()
    if not len(numbers):
        return np.full(len(wanted), -1)
    at = np.minimum(np.searchsorted(numbers, wanted), len(numbers) - 1)
    return np.where(numbers[at] == wanted, at, -1)


def _rows_near(ticks: pa.Table, actors: pa.Table, own: Floats, path: Path) -> tuple[Indices, Indices]:
    """Return the rows of `actors` that can matter (close to the path, at a tick with an ego) and their tick's index."""
    if actors.num_rows == 0:
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    at = index_of_tick(ticks, actors)
    known = at >= 0
    known[known] = np.isfinite(own[at[known]])
    centres = np.column_stack((actors["x_m"].to_numpy(), actors["y_m"].to_numpy()))
    tree = KDTree(np.column_stack((path.samples.x, path.samples.y)))
    distance, _ = tree.query(centres, distance_upper_bound=CLOSE_TO_PATH)
    rows = np.flatnonzero(known & np.isfinite(distance))
    return rows, at[rows]


def _corners(boxes: Boxes, path: Path, bumper: Floats) -> tuple[Floats, Floats, Floats, Floats]:
    """Return stations of the boxes' centres (n), stations and offsets of their corners (4 x n), and the cosine of each
    heading against the path's (n).
    """
    x, y, heading = boxes.x, boxes.y, boxes.heading
    length, width = boxes.length / 2.0, boxes.width / 2.0
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


def time_to_collision(seen: LeadVehicle) -> Floats:
    """Return gap over closing speed [s] for every tick; NaN where nothing is ahead or the gap does not close."""
    closes = _closes(seen)
    safe = np.where(closes, seen.closing_speed, 1.0)
    return np.where(closes, seen.gap / safe, np.nan)


def deceleration_to_avoid(seen: LeadVehicle) -> Floats:
    """Return the deceleration rate to avoid a crash, closing speed squared over twice the gap [m/s2], for every tick.

    NaN where `time_to_collision` is; both count nothing once the boxes overlap.
    """
    closes = _closes(seen)
    safe = np.where(closes, seen.gap, 1.0)
    return np.where(closes, 0.5 * seen.closing_speed * seen.closing_speed / safe, np.nan)


def _closes(seen: LeadVehicle) -> NDArray[np.bool_]:
    closes: NDArray[np.bool_] = (seen.closing_speed > CLOSING_FLOOR) & (seen.gap > 0.0)
    return closes


def impact_speed(ticks: pa.Table, actors: pa.Table) -> float:
    """Return the relative speed at the first contact [m/s]; 0 where nothing was touched.

    It is |v - w|: v the ego's speed, w the velocity of what it touched, laid along the ego's heading, both as the
    street had them at the step that found their boxes overlapping; of several touched at once the greatest. NaN where
    the record ends before it holds what was touched.
    """
    first = pc.index(pc.not_equal(ticks["contacts"], ""), True).as_py()
    if first < 0:
        return 0.0
    # A tick's row tells of the step that it ended with; what the street then held stands under the next tick.
    tick = actors["tick"].to_numpy()
    later = tick[tick > ticks["tick"][first].as_py()]
    rows = np.flatnonzero(tick == later.min()) if len(later) else np.zeros(0, np.int64)
    touched = np.isin(actors["actor"].take(rows).to_pylist(), ticks["contacts"][first].as_py().split("+"))
    heading, speed = (actors[name].to_numpy()[rows[touched]] for name in ("heading_rad", "speed_mps"))
    relative = ticks["asked_speed_mps"][first].as_py() - speed * np.cos(
        heading - ticks["asked_heading_rad"][first].as_py()
    )
    return -_least(-np.abs(relative))


def measure(ticks: pa.Table, actors: pa.Table, path: Path, vehicle: Vehicle) -> Metrics:
    """Return the figures of a drive from its tables; the stop gap is the gap at the last tick, if the car stands."""
    _x, _y, _heading, speed, acceleration = _ego(ticks)
    seen = ahead(ticks, actors, path, vehicle)
    deviation = ticks["lateral_deviation_m"].to_numpy()
    if not np.isfinite(deviation).any():
        deviation = ticks["estimated_deviation_m"].to_numpy()
    return Metrics(
        stop_gap_m=float(seen.gap[-1]) if len(speed) and abs(speed[-1]) < AT_REST else math.nan,
        min_ttc_s=_least(time_to_collision(seen)),
        max_drac_mps2=-_least(-deceleration_to_avoid(seen)),
        min_gap_m=_least(seen.gap),
        impact_speed_mps=impact_speed(ticks, actors),
        max_lateral_deviation_m=-_least(-np.abs(deviation)),
        max_deceleration_mps2=max(0.0, -_least(acceleration)),
        max_speed_mps=-_least(-speed),
        **_of_stop(last_stop(ticks, speed, acceleration, vehicle.deceleration_limit), vehicle),
    )


def _of_stop(stop: Stop | None, vehicle: Vehicle) -> dict[str, float]:
    if stop is None:
        return dict.fromkeys(_STOP, math.nan)
    values = (stop.onset_speed, stop.distance, stop.bound(vehicle), stop.demand)
    return dict(zip(_STOP, (*values, stop.reaction.duration, stop.build_up.duration, stop.mfdd), strict=True))


def _least(values: Floats) -> float:
    finite = values[np.isfinite(values)]
    return float(finite.min()) if len(finite) else math.nan
