"""The lead vehicle: which actor is ahead in the strip that the ego covers along its path, and how far.

Of a whole drive, either every actor in the strip counts, or those alone that the ego may come to: before the path's
end, and on the ego's way or in conflict with the ego.

Knows actors' boxes and the path, of a record's tables or of one tick under way; neither SUMO nor how a drive is run.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from vve_sumo.geometry import Boxes
from vve_sumo.metrics import following
from vve_sumo.path import Path
from vve_sumo.values import Actors, Floats, Pose, Vehicle

if TYPE_CHECKING:
    import pyarrow as pa

Indices = NDArray[np.int64]

#: an actor whose station lies further ahead than this takes no part in gap and time to collision [m]
HORIZON = 150.0
#: an actor whose centre lies further from the path than this cannot reach into the strip [m]
CLOSE_TO_PATH = 16.0
#: columns of the table of actors that a box is made of, in the order of its fields
BOX_COLUMNS = ("x_m", "y_m", "heading_rad", "length_m", "width_m", "speed_mps")
#: how far along the path the ego may be from where the drive itself placed it [m]
WINDOW = 10.0
#: how far along the path a box's corner may be from its centre [m]
CORNER_WINDOW = 15.0
#: below this closing speed a time to collision is not counted: at rest, noise would divide by nothing [m/s]
CLOSING_FLOOR = 0.05
#: a slower actor stands [m/s]
AT_REST = 0.05
#: two whose headings differ by less go the same way [rad]
SAME_WAY = math.pi / 4.0


@dataclass(frozen=True, slots=True)
class LeadVehicle:
    """What is ahead in the strip that the ego covers along its path: one entry a tick, NaN where there is nothing."""

    gap: Floats  #: front bumper to the nearest box along the path [m]; negative is overlap
    closing_speed: Floats  #: ego's speed minus that box's speed along the path [m/s]
    actor: list[str]  #: its name, empty where there is nothing

    @property
    def closes(self) -> NDArray[np.bool_]:
        """Whether the gap is there and closes; elsewhere time to collision and DRAC have nothing to say."""
        closes: NDArray[np.bool_] = (self.closing_speed > CLOSING_FLOOR) & (self.gap > 0.0)
        return closes

    @property
    def time_to_collision(self) -> Floats:
        """Gap over closing speed [s]; NaN where it does not close."""
        return np.where(self.closes, following.time_to_collision(self.gap, self.closing_speed), np.nan)

    @property
    def required_deceleration(self) -> Floats:
        """Deceleration rate to avoid a crash (DRAC), MAX_DECELERATION at most [m/s2]; NaN as `time_to_collision`."""
        needed = following.required_deceleration(self.gap, self.closing_speed)
        return np.where(self.closes, np.minimum(needed, following.MAX_DECELERATION), np.nan)


def own_stations(path: Path, x: Floats, y: Floats, near: Floats) -> Floats:
    """Return the stations [m] of places of the ego on its path, each near where the drive placed it; NaN for none."""
    own = np.full(len(x), np.nan)
    placed = np.flatnonzero(np.isfinite(x) & np.isfinite(near))
    own[placed], _, _ = path.project_many(x[placed], y[placed], near[placed], WINDOW)
    return own


def lead_vehicle(
    ticks: pa.Table,
    actors: pa.Table,
    path: Path,
    vehicle: Vehicle,
    own: Floats,
    speed: Floats,
    conflicting: NDArray[np.bool_] | None = None,
) -> LeadVehicle:
    """Return, for every tick, the nearest actor in the strip of the ego's width around the path, and its gap.

    The strip follows the path; the gap counts along it from the ego's front bumper to the nearest corner of the box.
    own [m] and speed [m/s] are the ego's rear axle's on the path, an entry a tick. `conflicting` says of every row of
    `actors` that it is in conflict with the ego: then an actor counts that is, or stands, or goes the ego's way, and
    none beyond the path's end. Without it every actor in the strip counts.
    """
    rows, at = _rows_near(ticks, actors, own, path)
    boxes = Boxes(*(actors[name].to_numpy()[rows] for name in BOX_COLUMNS))
    chosen = None if conflicting is None else conflicting[rows]
    gap, closing, nearest = _nearest(at, boxes, own, speed, path, vehicle, chosen)
    names, found = [""] * ticks.num_rows, np.flatnonzero(nearest >= 0)
    for tick, name in zip(found.tolist(), actors["actor"].take(rows[nearest[found]]).to_pylist(), strict=True):
        names[tick] = name
    return LeadVehicle(gap, closing, names)


def lead_vehicle_now(ego: Pose, station: float, actors: Actors, path: Path, vehicle: Vehicle) -> LeadVehicle:
    """Return what `lead_vehicle` says of one tick while the drive goes on: one entry, of every actor in the strip.

    While the drive goes on nothing is known of what actors do later, so nothing is judged by predicted paths here.
    `ego` is the rear axle's pose on the street, `station` [m] near its own, NaN where nobody knows it yet.
    """
    if not math.isfinite(station):
        return LeadVehicle(np.full(1, np.nan), np.full(1, np.nan), [""])
    own, _, _ = path.project_many(np.array([ego.x]), np.array([ego.y]), np.array([station]), WINDOW)
    boxes = Boxes(actors.x, actors.y, actors.heading, actors.length, actors.width, actors.speed)
    gap, closing, nearest = _nearest(
        np.zeros(len(actors.ids), np.int64), boxes, own, np.array([ego.speed]), path, vehicle
    )
    return LeadVehicle(gap, closing, [actors.ids[nearest[0]] if nearest[0] >= 0 else ""])


def _nearest(
    at: Indices,
    boxes: Boxes,
    own: Floats,
    speed: Floats,
    path: Path,
    vehicle: Vehicle,
    conflicting: NDArray[np.bool_] | None = None,
) -> tuple[Floats, Floats, Indices]:
    """Return gap [m], closing speed [m/s] and row of the nearest box ahead for every tick; NaN and -1 for none.

    `at` is the index of each box's tick; `own` [m] and `speed` [m/s] are the ego's rear axle's, tick by tick;
    `conflicting`, of each box, as `lead_vehicle` has it.
    """
    # What lies beside or behind the middle of the ego is not ahead of it.
    middle = vehicle.rear_axle_to_bumper - vehicle.length / 2.0
    half = vehicle.width / 2.0
    bumper = own[at] + vehicle.rear_axle_to_bumper
    centre, _, path_heading = path.project_many(boxes.x, boxes.y, bumper + HORIZON / 2.0, HORIZON / 2.0 + 30.0)
    along = np.cos(boxes.heading - path_heading)
    corners = [path.project_many(x, y, centre, CORNER_WINDOW)[:2] for x, y in zip(*boxes.corners(), strict=True)]
    s, d = np.array(corners).swapaxes(0, 1)
    in_strip = (d.min(axis=0) < half) & (d.max(axis=0) > -half)
    row_gap = s.min(axis=0) - bumper
    counts = in_strip & (centre > own[at] + middle) & (row_gap < HORIZON)
    if conflicting is not None:
        counts &= (along > math.cos(SAME_WAY)) | (np.abs(boxes.speed) < AT_REST) | conflicting
        counts &= s.min(axis=0) < path.length + vehicle.rear_axle_to_bumper
    counted = np.flatnonzero(counts)
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
    from scipy.spatial import KDTree

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
