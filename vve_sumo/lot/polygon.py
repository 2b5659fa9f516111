"""The surveyed lot, a polygon with holes shrunk by its margin: checks whether the car may be at a place.

Pure geometry in the lot's map; knows no car, no path and no receiver. The only module that imports shapely.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np
import shapely
from shapely import LinearRing, Polygon

from vve_sumo.errors import ConfigError
from vve_sumo.values import Floats

Pair = tuple[float, float]

MIN_AREA: Final = 200.0  #: a lot that holds a car and its stopping distance from walking pace is larger [m2]
MAX_AREA: Final = 25e6  #: larger than the largest proving grounds [m2]
ARC_STEPS: Final = 16  #: chords of a quarter circle where the margin rounds a corner
MIN_CELL_SIZE: Final = 0.25  #: cell of a table of clearances [m]
OUTLINE_TOLERANCE: Final = 0.02  #: of a line that is drawn around covered ground [m]
CLEARANCE_TOLERANCE: Final = 1e-6  #: more than what rounding adds to a distance in a lot [m]
BORDER_CELLS: Final = 4  #: cells of such a table beyond the lot


class Lot:
    """Ground that the car may cover: inside the outline, outside the holes, `margin` [m] away from both.

    `outline` and `holes` are corners in the lot's map [m], in either direction, the last joined to the first. Raises
    ConfigError for invalid corners or margin, naming "outline", the hole or "margin".
    """

    def __init__(self, outline: Sequence[Pair], holes: Sequence[Sequence[Pair]] = (), margin: float = 1.0) -> None:
        if not (math.isfinite(margin) and margin >= 0.0):
            raise ConfigError(f"margin: expected 0 m or more, got {margin!r}")
        whole = _ring(outline, "outline")
        if not MIN_AREA <= whole.area <= MAX_AREA:
            raise ConfigError(f"outline: encloses {whole.area:.1f} m2, expected {MIN_AREA:g} to {MAX_AREA:g} m2")
        cut = [_ring(hole, f"holes[{number}]") for number, hole in enumerate(holes)]
        for number, hole in enumerate(cut):
            if not whole.contains_properly(hole):
                raise ConfigError(f"holes[{number}]: does not lie inside the outline")
        self.margin = margin
        self.outline = np.asarray(outline, dtype=np.float64)
        self.holes = tuple(np.asarray(hole, dtype=np.float64) for hole in holes)
        ground = whole.difference(shapely.union_all(cut)) if cut else whole
        self.area = float(ground.area)  #: without its holes, margin included [m2]
        # Chords cut the round corners of the margin short; the margin grows by as much.
        self._inner = ground.buffer(-margin / math.cos(math.pi / (4 * ARC_STEPS)), quad_segs=ARC_STEPS)
        if self._inner.is_empty:
            raise ConfigError(f"margin: {margin:g} m leaves nothing of the lot")
        self._edge = self._inner.boundary
        shapely.prepare((self._inner, self._edge))
        # A place inside, x and y, and its distance to the edge [m], which bounds that of every place near it.
        self._cleared = (0.0, 0.0, -math.inf)

    @property
    def edges(self) -> list[Floats]:
        """Closed lines around what is left inside the margin, (n, 2) [m]."""
        return [np.asarray(shapely.get_coordinates(line), dtype=np.float64) for line in shapely.get_parts(self._edge)]

    def holds(self, shapes: Floats) -> bool:
        """Tell whether every convex shape lies inside; `shapes`: corners in order, map [m], (n, k, 2).

        False where a coordinate is not finite.
        """
        if not np.isfinite(shapes).all():
            return False
        return bool(shapely.covers(self._inner, shapely.polygons(shapes)).all())

    def holds_disc(self, x: float, y: float, radius: float) -> bool:
        """Tell whether everything within `radius` of a place lies inside [m]; False where a value is not finite."""
        if not 0.0 <= radius < math.inf:
            return False
        cleared_x, cleared_y, clearance = self._cleared
        if math.hypot(x - cleared_x, y - cleared_y) + radius < clearance - CLEARANCE_TOLERANCE:
            return True
        place = shapely.Point(x, y)
        if not self._inner.contains(place) or shapely.dwithin(self._edge, place, radius):
            return False
        self._cleared = x, y, float(shapely.distance(self._edge, place))
        return True

    def clearance(self, shapes: Floats) -> float:
        """Return the distance from shapes that lie inside to the nearest edge [m]; -inf where they don't."""
        if not self.holds(shapes):
            return -math.inf
        return float(shapely.distance(self._edge, shapely.polygons(shapes)).min())

    def excess(self, shapes: Floats) -> float:
        """Return how far shapes reach over the nearest edge [m]; 0 for shapes that lie inside.

        Exact where they reach over an edge; of a hole that they cover whole it is the depth of its centroid.
        """
        over = shapely.difference(shapely.polygons(shapes), self._inner)
        over = over[~shapely.is_empty(over)]
        points = [*shapely.get_coordinates(over), *shapely.get_coordinates(shapely.centroid(shapely.get_parts(over)))]
        return float(shapely.distance(self._inner, shapely.points(points)).max()) if points else 0.0

    def clearances(self, shapes: Floats) -> Floats:
        """Return every shape's distance to the nearest edge [m], (n,); 0 of one that reaches over it."""
        polygons = shapely.polygons(shapes)
        distance = shapely.distance(self._edge, polygons)
        return np.asarray(np.where(shapely.covers(self._inner, polygons), distance, 0.0), np.float64)

    def raster(self, rows: int) -> Raster:
        """Return a table of clearances of the lot and a little around it, its longer side cut into `rows`."""
        from scipy.ndimage import distance_transform_edt

        span = self.outline.max(axis=0) - self.outline.min(axis=0)
        cell = max(MIN_CELL_SIZE, float(span.max()) / rows)
        low, span = self.outline.min(axis=0) - BORDER_CELLS * cell, span + 2 * BORDER_CELLS * cell
        columns, rows = (int(length) for length in np.ceil(span / cell) + 1)
        x, y = low[0] + cell * np.arange(columns), low[1] + cell * np.arange(rows)
        inside = shapely.contains_xy(self._inner, *np.meshgrid(x, y))
        # The transform measures to the centre of the nearest cell across the edge; the edge is half a cell nearer.
        depth = np.where(inside, distance_transform_edt(inside) - 0.5, 0.5 - distance_transform_edt(~inside))
        return Raster(float(low[0]), float(low[1]), cell, cell * np.asarray(depth, dtype=np.float64))


def outline(shapes: Floats) -> Floats:
    """Return the line around the ground that convex shapes cover together, (m, 2) [m]; of its parts, the largest's.

    `shapes`: corners in order, (n, k, 2). The line is good to OUTLINE_TOLERANCE.
    """
    covered = shapely.union_all(shapely.polygons(shapes))
    largest = max(shapely.get_parts(covered), key=shapely.area)
    line = shapely.simplify(shapely.get_exterior_ring(largest), OUTLINE_TOLERANCE)
    return np.asarray(shapely.get_coordinates(line), np.float64)


def simplified_ring(points: Floats, tolerance: float) -> Floats:
    """Return the corners of a closed line through points (n, 2) [m], no point farther than `tolerance` [m] from it.

    Corners are points; the last one is not repeated (Douglas, Peucker, 1973).
    """
    closed = shapely.LineString(np.vstack((points, points[:1])))
    line = shapely.simplify(closed, tolerance, preserve_topology=False)
    return np.asarray(shapely.get_coordinates(line), np.float64)[:-1]


def distances_outside(outline: Floats, points: Floats) -> Floats:
    """Return how far points (n, 2) lie outside a closed line [m]; inside negative."""
    polygon = Polygon(outline)
    distance = shapely.distance(polygon.exterior, shapely.points(points))
    inside = shapely.contains_xy(polygon, points)
    return np.asarray(np.where(inside, -distance, distance), np.float64)


def distance_between(outline: Sequence[Pair], other: Sequence[Pair]) -> float:
    """Return the distance between the grounds inside two closed lines [m]; 0 where they overlap or touch."""
    return float(shapely.distance(Polygon(outline), Polygon(other)))


class Raster:
    """Clearance on a grid [m]: positive inside the lot less its margin, negative outside; good to a cell."""

    __slots__ = ("cell", "depth", "x", "y")

    def __init__(self, x: float, y: float, cell: float, depth: Floats) -> None:
        self.x, self.y, self.cell = x, y, cell  #: map of the first sample, and spacing [m]
        self.depth = depth  #: rows count up in y, columns in x

    def at(self, x: Floats, y: Floats) -> Floats:
        """Return the clearance of places [m], linear between samples; beyond the grid it falls with the distance."""
        rows, columns = self.depth.shape
        column, row = (x - self.x) / self.cell, (y - self.y) / self.cell
        held_column, held_row = np.clip(column, 0.0, columns - 1.001), np.clip(row, 0.0, rows - 1.001)
        i, j = held_row.astype(np.intp), held_column.astype(np.intp)
        u, v = held_row - i, held_column - j
        depth = self.depth
        lower = depth[i, j] * (1.0 - v) + depth[i, j + 1] * v
        upper = depth[i + 1, j] * (1.0 - v) + depth[i + 1, j + 1] * v
        beyond = np.abs(column - held_column) + np.abs(row - held_row)
        return np.asarray(lower * (1.0 - u) + upper * u - self.cell * beyond, dtype=np.float64)


def _ring(corners: Sequence[Pair], name: str) -> Polygon:
    """Return the polygon of a closed line; raises ConfigError for one that encloses no ground."""
    if len(corners) < 3:
        raise ConfigError(f"{name}: expected three corners or more, got {len(corners)}")
    if not all(math.isfinite(x) and math.isfinite(y) for x, y in corners):
        raise ConfigError(f"{name}: a corner is not finite")
    if not LinearRing(corners).is_simple:
        raise ConfigError(f"{name}: crosses or touches itself{_where(corners)}")
    ring = Polygon(corners)
    if not (ring.is_valid and ring.area > 0.0):
        raise ConfigError(f"{name}: encloses no ground")
    return ring


def _where(corners: Sequence[Pair]) -> str:
    """Which two edges of a line meet where they should not, in words, counted from 0."""
    count = len(corners)
    edges = [shapely.LineString([corners[i], corners[(i + 1) % count]]) for i in range(count)]
    for first in range(count):
        for second in range(first + 2, count - (first == 0)):
            if edges[first].intersects(edges[second]):
                return f": the edge after corner {first} meets the edge after corner {second}"
    return ""
