"""The lead vehicle: which actor is ahead in the strip that the ego covers along its path, and how far.

Of a whole drive, either every actor in the strip counts, or those alone that the ego may come to: before the path's
end, and on the ego's way or in conflict with the ego.

Knows actors' boxes and the path, of a record's tables or of one tick under way; neither SUMO nor how a drive is run.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

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
#: a box's corner may be so much farther beside a bent path than its size says [m]
CORNER_MARGIN = 1.0
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


class InStrip(NamedTuple):
    """Actors that are ahead in the strip of the ego's width around its path: an entry an actor and tick."""

    row: Indices  #: number of the actor's row among those that were looked at
    at: Indices  #: index of the tick
    gap: Floats  #: from the ego's front bumper to the nearest corner of the box, along the path [m]
    begins: Floats  #: station of that corner [m]
    along: Floats  #: cosine of the box's heading against the path's
    speed: Floats  #: of the box along its heading [m/s]

    def select(self, chosen: NDArray[np.bool_]) -> InStrip:
        """Return those that are chosen."""
        row, at, *rest = self
        gap, begins, along, speed = (column[chosen] for column in rest)
        return InStrip(row[chosen], at[chosen], gap, begins, along, speed)


def in_strip(ticks: pa.Table, actors: pa.Table, path: Path, vehicle: Vehicle, own: Floats) -> InStrip:
    """Return the rows of the table of actors that are ahead in the strip; own: station of the rear axle, tick by tick.

    The strip follows the path, and so does the gap.
    """
    rows, at = _rows_near(ticks, actors, own, path)
    boxes = Boxes(*(actors[name].to_numpy()[rows] for name in BOX_COLUMNS))
    found = _boxes_in_strip(at, boxes, own, path, vehicle)
    return found._replace(row=rows[found.row])


def in_the_way(strip: InStrip, path: Path, vehicle: Vehicle, conflicting: NDArray[np.bool_]) -> InStrip:
    """Return what the ego may come to: before its path's end, and on its way or in conflict with it.

    conflicting: of every row of the table of actors. On the ego's way is what stands or goes the same way.
    """
    counts = (strip.along > math.cos(SAME_WAY)) | (np.abs(strip.speed) < AT_REST) | conflicting[strip.row]
    return strip.select(counts & (strip.begins < path.length + vehicle.rear_axle_to_bumper))


def lead_vehicle(strip: InStrip, actors: pa.Table, speed: Floats) -> LeadVehicle:
    """Return the nearest of what is in the strip for every tick; speed: of the ego, tick by tick [m/s]."""
    gap, closing, nearest = _nearest(strip, speed)
    names, found = [""] * len(speed), np.flatnonzero(nearest >= 0)
    rows = strip.row[nearest[found]]
    for tick, name in zip(found.tolist(), actors["actor"].take(rows).to_pylist(), strict=True):
        names[tick] = name
    return LeadVehicle(gap, closing, names)


def lead_vehicle_now(ego: Pose, station: float, actors: Actors, path: Path, vehicle: Vehicle) -> LeadVehicle:
    """Return the lead vehicle of one tick while the drive goes on: one entry, the nearest of every actor in the strip.

    While the drive goes on nothing is known of what actors do later, so nothing is judged by predicted paths here.
    `ego` is the rear axle's pose on the street, `station` [m] near its own, NaN where nobody knows it yet.
    """
    if not math.isfinite(station):
        return LeadVehicle(np.full(1, np.nan), np.full(1, np.nan), [""])
    own, _, _ = path.project_many(np.array([ego.x]), np.array([ego.y]), np.array([station]), WINDOW)
    boxes = Boxes(actors.x, actors.y, actors.heading, actors.length, actors.width, actors.speed)
    strip = _boxes_in_strip(np.zeros(len(actors.ids), np.int64), boxes, own, path, vehicle)
    gap, closing, nearest = _nearest(strip, np.array([ego.speed]))
    return LeadVehicle(gap, closing, [actors.ids[strip.row[nearest[0]]] if nearest[0] >= 0 else ""])


def _boxes_in_strip(at: Indices, boxes: Boxes, own: Floats, path: Path, vehicle: Vehicle) -> InStrip:
    # What lies beside or behind the middle of the ego is not ahead of it.
    middle = vehicle.rear_axle_to_bumper - vehicle.length / 2.0
    half = vehicle.width / 2.0
    near = own[at] + vehicle.rear_axle_to_bumper + HORIZON / 2.0
    centre, beside, path_heading = path.project_many(boxes.x, boxes.y, near, HORIZON / 2.0 + 30.0)
    reach = half + 0.5 * np.hypot(boxes.length, boxes.width) + CORNER_MARGIN
    rows = np.flatnonzero((np.abs(beside) < reach) & (centre > own[at] + middle))
    at, boxes, centre, path_heading = at[rows], boxes.select(rows), centre[rows], path_heading[rows]
    corners = [path.project_many(x, y, centre, CORNER_WINDOW)[:2] for x, y in zip(*boxes.corners(), strict=True)]
    s, d = np.array(corners).swapaxes(0, 1)
    begins = s.min(axis=0)
    gap = begins - (own[at] + vehicle.rear_axle_to_bumper)
    found = InStrip(rows, at, gap, begins, np.cos(boxes.heading - path_heading), boxes.speed)
    return found.select((d.min(axis=0) < half) & (d.max(axis=0) > -half) & (gap < HORIZON))


def _nearest(strip: InStrip, speed: Floats) -> tuple[Floats, Floats, Indices]:
    """Return gap [m], closing speed [m/s] and entry of the nearest for every tick; NaN and -1 for none."""
    # The farthest first: of several boxes at one tick the last one written stays.
    order = np.argsort(-strip.gap, kind="stable")
    nearest = np.full(len(speed), -1, np.int64)
    nearest[strip.at[order]] = order
    gap, closing = np.full(len(speed), np.nan), np.full(len(speed), np.nan)
    found = np.flatnonzero(nearest >= 0)
    entry = nearest[found]
    gap[found], closing[found] = strip.gap[entry], speed[found] - strip.speed[entry] * strip.along[entry]
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
    distance = np.full(len(centres), np.inf)
    distance[known], _ = tree.query(centres[known], distance_upper_bound=CLOSE_TO_PATH)
    rows = np.flatnonzero(np.isfinite(distance))
    return rows, at[rows]
