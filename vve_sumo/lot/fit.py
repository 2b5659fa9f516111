"""Aligns a path with a lot: finds the rotation and shift with the most clearance, or how much of the path fits.

A declared corridor counts as ground that the path needs. An offline search that takes seconds. It knows the geofence
and the path and no receiver.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import groupby
from operator import attrgetter
from typing import Final, NamedTuple

import numpy as np
from scipy.optimize import linprog

from vve_sumo.errors import ConfigError
from vve_sumo.frames import Alignment, wrap_angle
from vve_sumo.lot.corridor import DeclaredCorridor
from vve_sumo.lot.geofence import DrivenPlace, Geofence
from vve_sumo.lot.polygon import Raster
from vve_sumo.path import ReferencePath
from vve_sumo.path_feasibility import MIN_PATH_LENGTH
from vve_sumo.values import Floats

SWEPT_SPACING: Final = 3  #: places of the path, a metre apart, per swept place in the search
COARSE_ROWS, FINE_ROWS = 120, 1600  #: of the lot's tables of clearances
MAX_ROTATION_STEP: Final = math.radians(5.0)  #: between neighbouring rotations
SLACK: Final = 3  #: cells by which a coarse placement may leave the lot
CANDIDATES: Final = 10  #: coarse placements that are refined
POINTS: Final = 400  #: number of points with the least clearance, which decide where to move
ROUNDS: Final = 40  #: maximum of a refinement
STILL: Final = 0.01  #: a refinement that moves less is done [m]
CUT_RESOLUTION: Final = 2.0  #: the cut of a path that doesn't fit is found to this [m]


@dataclass(frozen=True, slots=True)
class Fit:
    """How a path, with the corridor that its scenario declares beside it, lies in the lot."""

    alignment: Alignment  #: from the lot's map to the virtual road's
    clearance: float  #: least distance of the swept ground from the lot's edge less its margin [m]
    last_s: float  #: the drive can stop inside the lot from every place up to this s along the path [m]
    whole: bool  #: whether that is the whole path
    start: tuple[float, float, float]  #: rear axle at the path's start: lot x, y [m], heading [rad] in the lot's map


class CorridorExcess(NamedTuple):
    """Where a declared corridor leaves the lot, although the car that keeps to the path could stop inside."""

    begin: float  #: the first s along the path from which a car in the corridor could not stop inside [m]
    s: float  #: where it is worst, along the path [m]
    d: float  #: of the car from the path there [m], left positive
    distance: float  #: how far the ground that this car needs reaches over the lot's edge less its margin [m]

    def text(self) -> str:
        """Return that in words."""
        side = "left" if self.d > 0.0 else "right"
        return (
            f"from {self.begin:.0f} m on, the corridor leaves the lot: at {self.s:.0f} m, from "
            f"{abs(self.d):.1f} m {side} of the path, a stop reaches {self.distance:.1f} m over the margin"
        )


@dataclass(frozen=True, slots=True)
class _Placement:
    """Rotation about the middle of the swept area, then shift: from the virtual road's map to the lot's."""

    rotation: float
    x: float
    y: float


@dataclass(frozen=True, slots=True)
class _Ground:
    """Points that fill the swept area of a drive, relative to its middle, and the first place that sweeps each."""

    points: Floats  #: (n, 2) [m]
    s: Floats  #: of that place along the path, (n,) [m]
    middle: tuple[float, float]  #: virtual road's map [m]

    def until(self, s: float) -> Floats:
        return self.points[self.s <= s]

    def alignment(self, placement: _Placement) -> Alignment:
        cosine, sine = math.cos(placement.rotation), math.sin(placement.rotation)
        x, y = self.middle
        shift = placement.x - cosine * x + sine * y, placement.y - sine * x - cosine * y
        return Alignment(wrap_angle(placement.rotation), *shift).inverse()


@dataclass(frozen=True, slots=True)
class _Search:
    """A drive whose ground is laid into the lot again and again."""

    geofence: Geofence
    drive: list[DrivenPlace]
    ground: _Ground
    tables: tuple[Raster, Raster]  #: of the lot, coarse and fine

    @classmethod
    def of(cls, path: ReferencePath, geofence: Geofence, speed: float, corridor: DeclaredCorridor) -> _Search:
        drive = geofence.driven(path, speed, corridor)
        tables = geofence.lot.raster(COARSE_ROWS), geofence.lot.raster(FINE_ROWS)
        return cls(geofence, drive, _ground(geofence, drive), tables)

    def tried(self, s: float) -> Fit | None:
        """Return how the drive lies where the ground up to an s [m] has most clearance; None for an unfit start."""
        placement = _best(self.ground.until(s), *self.tables)
        return None if placement is None else _measured(self.geofence, self.drive, self.ground.alignment(placement))


def fit(path: ReferencePath, geofence: Geofence, speed: float, corridor: DeclaredCorridor = ()) -> Fit:
    """Return the alignment under which a drive of the path at `speed` [m/s] has most clearance in the lot.

    The ground that has to fit is that of the path and of its declared `corridor`. Where the whole path fits nowhere, it
    is the alignment that fits most of it, to about `CUT_RESOLUTION`. Raises ConfigError where not even the start fits.
    """
    search = _Search.of(path, geofence, speed, corridor)
    tried = search.tried
    whole = search.drive[-1].s
    best = tried(whole)
    if best is not None and best.whole:
        return best
    low, high = best.last_s if best else 0.0, whole
    while high - low > CUT_RESOLUTION:
        middle = 0.5 * (low + high)
        found = tried(middle)
        if found is not None and (best is None or found.last_s > best.last_s):
            best = found
        low, high = (max(middle, found.last_s), high) if found and found.last_s >= middle else (low, middle)
    if best is None:
        raise ConfigError("the lot has no place for the start of the path and the fallback path from there")
    return best


def fit_whole(path: ReferencePath, geofence: Geofence, speed: float, corridor: DeclaredCorridor = ()) -> Fit | None:
    """Return the alignment under which a drive of the whole path has most clearance; None where none is found.

    As `fit`, without the search for how much of the path fits.
    """
    search = _Search.of(path, geofence, speed, corridor)
    best = search.tried(search.drive[-1].s)
    return best if best is not None and best.whole else None


def measured(
    path: ReferencePath, geofence: Geofence, speed: float, alignment: Alignment, corridor: DeclaredCorridor = ()
) -> Fit | None:
    """Return how a drive of the path at `speed` [m/s] lies in the lot under an alignment; None for an unfit start."""
    return _measured(geofence, geofence.driven(path, speed, corridor), alignment)


def corridor_excess(
    path: ReferencePath, geofence: Geofence, speed: float, alignment: Alignment, corridor: DeclaredCorridor
) -> CorridorExcess | None:
    """Return where the corridor leaves the lot the farthest under an alignment, up to where the path itself does.

    None where only the path itself leaves the lot, or nothing does.
    """
    aligned, to_lot = geofence.aligned(alignment), alignment.inverse()
    found: list[CorridorExcess] = []
    for place in geofence.driven(path, speed, corridor):
        if aligned.check(place.pose, place.steering, place.fallback_path, place.s):
            if place.d == 0.0:
                break
            over = geofence.lot.excess(_swept(geofence, place, to_lot))
            begin = found[0].begin if found else place.s
            found.append(CorridorExcess(begin, place.s, place.d, over))
    return max(found, key=attrgetter("distance"), default=None)


def shortened(
    path: ReferencePath, geofence: Geofence, speed: float, end_s: float, corridor: DeclaredCorridor = ()
) -> ReferencePath:
    """Return the path up to about `end_s` [m], such that a drive of it at `speed` [m/s] can always stop in the lot.

    So can a car anywhere in what is left of the `corridor`. Beyond its new end the car is taken to go straight on,
    which may ask for a place to end a little sooner. Raises ConfigError where less than `MIN_PATH_LENGTH` is left.
    """
    # A place a metre is checked. An end half-way between two asks for the same ones however a file rounds its length.
    end_s = math.ceil(end_s) - 0.5
    while end_s >= MIN_PATH_LENGTH:
        points = [path.at(s) for s in np.linspace(0.0, end_s, round(end_s) + 1).tolist()]
        cut = ReferencePath.from_points([point.x for point in points], [point.y for point in points])
        leaves = geofence.along(cut, speed, corridor)
        if leaves is None:
            return cut
        end_s = math.ceil(min(leaves, end_s)) - 1.5
    raise ConfigError(f"the lot takes less than {MIN_PATH_LENGTH:g} m of the path")


def _ground(geofence: Geofence, drive: list[DrivenPlace]) -> _Ground:
    """Fill the swept area of the drive with points: corners, edge middles and centres of its rectangles."""
    points, sweeps_s = [], []
    for place in _searched(drive):
        shapes = geofence.sweep(place.pose, place.steering, place.fallback_path, place.s)
        if shapes is None:
            raise ConfigError(
                "the car does not come to rest: its lowest deceleration is less than the lot's slope takes"
            )
        sides = 0.5 * (shapes + np.roll(shapes, 1, axis=1))
        filled = np.concatenate((shapes, sides, shapes.mean(axis=1, keepdims=True)), axis=1).reshape(-1, 2)
        _, kept = np.unique(np.round(filled / 0.5), axis=0, return_index=True)
        points.append(filled[kept])
        sweeps_s.append(np.full(len(kept), place.s))
    every, s = np.concatenate(points), np.concatenate(sweeps_s)
    _, kept = np.unique(np.round(every / 0.25), axis=0, return_index=True)
    middle = 0.5 * (every.min(axis=0) + every.max(axis=0))
    return _Ground(every[kept] - middle, s[kept], (float(middle[0]), float(middle[1])))


def _searched(drive: list[DrivenPlace]) -> list[DrivenPlace]:
    """Return the places whose ground is searched for: of every few metres, of a corridor's ends, of the last."""
    beside = [list(places) for _, places in groupby(drive, key=attrgetter("s"))]
    last = len(beside) - 1
    chosen = [
        here
        for number, here in enumerate(beside)
        if number % SWEPT_SPACING == 0
        or not len(beside[max(number - 1, 0)]) == len(here) == len(beside[min(number + 1, last)])
    ]
    return [place for places in [*chosen, beside[last]] for place in places]


def _thinned(points: Floats, spacing: float) -> Floats:
    """One point of each square of a grid."""
    _, kept = np.unique(np.round(points / spacing), axis=0, return_index=True)
    return points[kept]


def _best(points: Floats, coarse: Raster, fine: Raster) -> _Placement | None:
    """Return the placement with most clearance; None where none comes near to fitting."""
    refined = [_refined(_thinned(points, 1.0), at, fine) for at in _candidates(points, coarse)]
    if not refined:
        return None
    _room_there, placement = max(refined, key=lambda one: one[0])
    return _refined(points, placement, fine)[1]


def _candidates(points: Floats, table: Raster) -> list[_Placement]:
    """The best placements on a coarse grid, one per rotation, no two of neighbouring rotations."""
    cell = table.cell
    some = _thinned(points, cell)
    radius = float(np.sqrt((some * some).sum(axis=1)).max())
    count = math.ceil(math.tau / min(cell / radius, MAX_ROTATION_STEP))
    scored = []
    for rotation in math.tau / count * np.arange(count):
        room = _coarse(_turned(some, rotation), table)
        if room is not None:
            scored.append((*room, rotation))
    scored.sort(key=lambda one: -one[0])
    chosen: list[_Placement] = []
    for _room, x, y, rotation in scored:
        near = (abs(wrap_angle(rotation - one.rotation)) < 2.5 * math.tau / count for one in chosen)
        if not any(near):
            chosen.append(_Placement(float(rotation), x, y))
        if len(chosen) == CANDIDATES:
            break
    return chosen


def _coarse(points: Floats, table: Raster) -> tuple[float, float, float] | None:
    """Least clearance [m] of turned points at the best shift of whole cells, and that shift; None if they stick out."""
    offsets = np.round(points / table.cell).astype(np.intp)
    (left, down), (right, up) = offsets.min(axis=0), offsets.max(axis=0)
    rows, columns = table.depth.shape
    wide, high = columns - (right - left), rows - (up - down)
    if min(wide, high) < 1:
        return None
    room = np.full((high, wide), np.inf)
    for column, row in np.unique(offsets, axis=0):
        np.minimum(room, table.depth[row - down : row - down + high, column - left : column - left + wide], out=room)
    row, column = np.unravel_index(int(room.argmax()), room.shape)
    if room[row, column] < -SLACK * table.cell:
        return None
    x, y = table.x + table.cell * float(column - left), table.y + table.cell * float(row - down)
    return float(room[row, column]), x, y


def _refined(points: Floats, at: _Placement, table: Raster) -> tuple[float, _Placement]:
    """Move a placement to where the least clearance of its points is greatest nearby; return both.

    Each round solves the linear programme "greatest c with c <= f + f' d for the most pressed points" inside a box,
    which shrinks where the answer is worse than it promised.
    """
    radius = float(np.sqrt((points * points).sum(axis=1)).max())
    room, step = _room(points, at, table), 2.0 * table.cell + 4.0
    for _ in range(ROUNDS):
        moved = _moved(points, at, table, radius, step)
        there = _room(points, moved, table)
        if there > room + 1e-6:
            at, room = moved, there
        else:
            step *= 0.5
        if step < STILL:
            break
    return room, at


def _room(points: Floats, at: _Placement, table: Raster) -> float:
    placed = _turned(points, at.rotation)
    return float(table.at(placed[:, 0] + at.x, placed[:, 1] + at.y).min())


def _moved(points: Floats, at: _Placement, table: Raster, radius: float, step: float) -> _Placement:
    arms = _turned(points, at.rotation)
    x, y = arms[:, 0] + at.x, arms[:, 1] + at.y
    depth = table.at(x, y)
    pressed = np.argsort(depth)[:POINTS]
    x, y, arms, h = x[pressed], y[pressed], arms[pressed], table.cell
    across = (table.at(x + h, y) - table.at(x - h, y)) / (2.0 * h)
    along = (table.at(x, y + h) - table.at(x, y - h)) / (2.0 * h)
    turning = (along * arms[:, 0] - across * arms[:, 1]) / radius
    rows = np.column_stack((-across, -along, -turning, np.ones(len(pressed))))
    answer = linprog((0.0, 0.0, 0.0, -1.0), A_ub=rows, b_ub=depth[pressed], bounds=[(-step, step)] * 3 + [(None, None)])
    if answer.x is None:
        return at
    dx, dy, turn = (float(answer.x[i]) for i in range(3))
    return _Placement(at.rotation + turn / radius, at.x + dx, at.y + dy)


def _turned(points: Floats, angle: float) -> Floats:
    cosine, sine = math.cos(angle), math.sin(angle)
    return np.asarray(points @ np.array([[cosine, sine], [-sine, cosine]]), dtype=np.float64)


def _measured(geofence: Geofence, drive: list[DrivenPlace], alignment: Alignment) -> Fit | None:
    """Follow the drive under an alignment, without tables; None where not even its start fits."""
    aligned, to_lot = geofence.aligned(alignment), alignment.inverse()
    room, last = math.inf, None
    for s, places in groupby(drive, key=attrgetter("s")):
        here = list(places)
        if any(aligned.check(place.pose, place.steering, place.fallback_path, place.s) for place in here):
            break
        room, last = min(room, *(geofence.lot.clearance(_swept(geofence, place, to_lot)) for place in here)), s
    if last is None:
        return None
    start = to_lot.apply(drive[0].pose)
    return Fit(alignment, room, last, last == drive[-1].s, (start.x, start.y, start.heading))


def _swept(geofence: Geofence, place: DrivenPlace, to_lot: Alignment) -> Floats:
    """Return the ground of a place, in the lot's map, under the alignment whose inverse is `to_lot`."""
    shapes = geofence.sweep(to_lot.apply(place.pose), place.steering, place.fallback_path, place.s)
    assert shapes is not None  # of a car that comes to rest, as the search's own ground shows
    return shapes
