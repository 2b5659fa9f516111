"""The lead vehicle: which actor is ahead in the strip that the ego covers along its course, and how far.

The course is the path while the ego keeps to it (the one that its controller commands, else the scenario's), else the
arc that it moves on.

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

from vve_sumo.commanded_path import curve
from vve_sumo.geometry import Boxes, distance, separation, vehicle_boxes
from vve_sumo.metrics import following
from vve_sumo.metrics.clipping import nearest_in_band
from vve_sumo.metrics.course import PredictedCourse, starts
from vve_sumo.metrics.routes import OWN_PATH, Routes
from vve_sumo.path import ReferencePath
from vve_sumo.values import Actors, CommandedPath, Floats, Pose, Vehicle

if TYPE_CHECKING:
    import pyarrow as pa

Indices = NDArray[np.int64]

#: an actor whose s lies further ahead than this takes no part in gap and time to collision [m]
HORIZON = 150.0
#: an actor whose centre lies further from the path than this cannot reach into the strip [m]
CLOSE_TO_PATH = 16.0
#: columns of the table of actors that a box is made of, in the order of its fields
BOX_COLUMNS = ("x_m", "y_m", "heading_rad", "length_m", "width_m", "speed_mps")
#: how far along the path the ego may be from where the drive itself placed it [m]
WINDOW = 10.0
#: how far along the course a box's corner may be from its centre [m]
CORNER_WINDOW = 15.0
#: a box's corner may be so much farther beside a bent course than its size says [m]
CORNER_MARGIN = 1.0
#: of each side of a box that is clipped to the strip
PIECES = 8
#: below this closing speed a time to collision is not counted: at rest, noise would divide by nothing [m/s]
CLOSING_FLOOR = 0.05
#: a slower actor stands [m/s]
AT_REST = 0.05
#: two whose headings differ by less go the same way [rad]
SAME_WAY = math.pi / 4.0


@dataclass(frozen=True, slots=True)
class LeadVehicle:
    """What is ahead in the strip that the ego covers along its course: an entry a tick, NaN where there is nothing."""

    gap: Floats  #: front bumper to the nearest box along the course [m]; 0 at contact, negative where bodies overlap
    closing_speed: Floats  #: ego's speed minus that box's speed along the course [m/s]
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


def own_s(path: ReferencePath, x: Floats, y: Floats, near: Floats) -> Floats:
    """Return s [m] of places of the ego on its path, each near where the drive placed it; NaN for none."""
    own = np.full(len(x), np.nan)
    placed = np.flatnonzero(np.isfinite(x) & np.isfinite(near))
    own[placed], _, _ = path.project_many(x[placed], y[placed], near[placed], WINDOW)
    return own


class InStrip(NamedTuple):
    """Actors that are ahead in the strip of the ego's width around its course: an entry an actor and tick."""

    row: Indices  #: number of the actor's row among those that were looked at
    at: Indices  #: index of the tick
    gap: Floats  #: from the ego's front bumper to the nearest point of the box in the strip, along the course [m]
    begins: Floats  #: s of that point [m]
    ends: Floats  #: s of the path's end [m]
    along: Floats  #: cosine of the box's heading against the course's
    speed: Floats  #: of the box along its heading [m/s]

    def select(self, chosen: NDArray[np.bool_]) -> InStrip:
        """Return those that are chosen."""
        row, at, *rest = self
        gap, begins, ends, along, speed = (column[chosen] for column in rest)
        return InStrip(row[chosen], at[chosen], gap, begins, ends, along, speed)


def in_strip(ticks: pa.Table, actors: pa.Table, course: PredictedCourse, ego: Boxes) -> InStrip:
    """Return the rows of the table of actors that are ahead in the strip; course and ego's box: an entry a tick."""
    rows, at = _rows_near(ticks, actors, course)
    boxes = Boxes(*(actors[name].to_numpy()[rows] for name in BOX_COLUMNS))
    found = _boxes_in_strip(at, boxes, course, ego)
    return found._replace(row=rows[found.row])


def in_the_way(strip: InStrip, vehicle: Vehicle, conflicting: NDArray[np.bool_]) -> InStrip:
    """Return what the ego may come to: before its path's end, and on its way or in conflict with it.

    conflicting: of every row of the table of actors. On the ego's way is what stands or goes the same way.
    """
    counts = (strip.along > math.cos(SAME_WAY)) | (np.abs(strip.speed) < AT_REST) | conflicting[strip.row]
    return strip.select(counts & (strip.begins < strip.ends + vehicle.rear_axle_to_bumper))


def lead_vehicle(strip: InStrip, actors: pa.Table, speed: Floats) -> LeadVehicle:
    """Return the nearest of what is in the strip for every tick; speed: of the ego, tick by tick [m/s]."""
    gap, closing, nearest = _nearest(strip, speed)
    names, found = [""] * len(speed), np.flatnonzero(nearest >= 0)
    rows = strip.row[nearest[found]]
    for tick, name in zip(found.tolist(), actors["actor"].take(rows).to_pylist(), strict=True):
        names[tick] = name
    return LeadVehicle(gap, closing, names)


def lead_vehicle_now(
    ego: Pose,
    near_s: float,
    actors: Actors,
    path: ReferencePath,
    vehicle: Vehicle,
    commanded: CommandedPath | None = None,
) -> LeadVehicle:
    """Return the lead vehicle of one tick while the drive goes on: one entry, the nearest of every actor in the strip.

    While the drive goes on nothing is known of what actors do later, so nothing is judged by predicted paths here.
    `ego` is the rear axle's pose on the virtual road, `near_s` [m] near its own s, NaN where nobody knows it yet.
    `commanded` is the path that the newest command carries, which then is the ego's in place of `path`.
    """
    if not math.isfinite(near_s):
        return LeadVehicle(np.full(1, np.nan), np.full(1, np.nan), [""])
    x, y, heading, speed, rate = (np.array([value]) for value in (ego.x, ego.y, ego.heading, ego.speed, ego.yaw_rate))
    routes = Routes.from_paths(path, () if commanded is None else [(curve(commanded), near_s)])
    route, near = np.array([OWN_PATH]), np.array([near_s])
    if commanded is not None:
        route, near = route + 1, np.zeros(1)
    own, deviation, path_heading = routes.search(route, x, y, near, WINDOW)
    start = starts(own, x, y, heading, speed, rate, path_heading, deviation, route)
    course = PredictedCourse(path, vehicle, start, routes)
    boxes = Boxes(actors.x, actors.y, actors.heading, actors.length, actors.width, actors.speed)
    at, body = np.zeros(len(actors.ids), np.int64), vehicle_boxes(x, y, heading, speed, vehicle)
    strip = _boxes_in_strip(at, boxes, course, body)
    gap, closing, nearest = _nearest(strip, np.array([ego.speed]))
    return LeadVehicle(gap, closing, [actors.ids[strip.row[nearest[0]]] if nearest[0] >= 0 else ""])


def _boxes_in_strip(at: Indices, boxes: Boxes, course: PredictedCourse, ego: Boxes) -> InStrip:
    bumper = course.vehicle.rear_axle_to_bumper
    # What lies beside or behind the middle of the ego is not ahead of it. A long body that has its own middle there may
    # reach into the strip before the ego with its front.
    middle, half = bumper - course.vehicle.length / 2.0, course.vehicle.width / 2.0
    start, near = course.starts.select(at), np.full(len(at), bumper + HORIZON / 2.0)
    centre, beside, heading = course.find(start, boxes.x, boxes.y, near, HORIZON / 2.0 + 30.0)
    radius = 0.5 * np.hypot(boxes.length, boxes.width)
    rows = np.flatnonzero((np.abs(beside) < half + radius + CORNER_MARGIN) & (centre + radius > middle))
    at, boxes, start, centre, heading = at[rows], boxes.select(rows), start.select(rows), centre[rows], heading[rows]
    corners = boxes.corners()
    ahead = np.array([course.find(start, x, y, centre, CORNER_WINDOW)[0] for x, y in zip(*corners, strict=True)])

    def project(box: Indices, x: Floats, y: Floats, near: Floats) -> tuple[Floats, Floats]:
        return course.project(start.select(box), x, y, near)

    edge = np.full(len(at), half)
    begins = nearest_in_band(corners, ahead, project, -edge, edge, PIECES)
    gap = _body_gap(begins - bumper, ego.select(at), boxes)
    along, counts = np.cos(boxes.heading - heading), (centre > middle) | (begins > middle)
    ends = course.routes.length[start.route]
    found = InStrip(rows, at, gap, start.s + bumper + gap, ends, along, boxes.speed)
    return found.select(counts & (gap < HORIZON))


def _body_gap(gap: Floats, ego: Boxes, boxes: Boxes) -> Floats:
    """Return gaps [m] that agree with the bodies where these do not lie along the course.

    On a bend, or a little off the path, the ego's body is not where its strip begins. Bodies that are apart have a gap,
    of no less than their distance. Bodies that touch have none: 0, or as much below it as the other's part in the strip
    reaches behind the front bumper, the ego's length at most.
    """
    touching = separation(ego, boxes) <= 0.0
    return np.where(touching, np.clip(gap, -ego.length, 0.0), np.maximum(gap, distance(ego, boxes)))


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


def _rows_near(ticks: pa.Table, actors: pa.Table, course: PredictedCourse) -> tuple[Indices, Indices]:
    """Return the rows of `actors` that can matter (near the course, at a tick with an ego) and their tick's index."""
    from scipy.spatial import KDTree

    if actors.num_rows == 0:
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    at, start, samples = index_of_tick(ticks, actors), course.starts, course.path.samples
    known = at >= 0
    known[known] = np.isfinite(start.s[at[known]])
    centres = np.column_stack((actors["x_m"].to_numpy(), actors["y_m"].to_numpy()))
    tree = KDTree(np.column_stack((samples.x, samples.y)))
    far = np.full(len(centres), np.inf)
    far[known], _ = tree.query(centres[known], distance_upper_bound=CLOSE_TO_PATH)
    off = known.copy()
    off[known] = start.elsewhere[at[known]]
    apart = np.hypot(centres[off, 0] - start.x[at[off]], centres[off, 1] - start.y[at[off]])
    far[off] = np.where(apart < HORIZON + 2.0 * CLOSE_TO_PATH, apart, np.inf)
    rows = np.flatnonzero(np.isfinite(far))
    return rows, at[rows]
