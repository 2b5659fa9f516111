"""The cubic path that the rear axle shall follow, and the corridor that the car's body sweeps along it.

It knows geometry in the map frame and nothing of cars, speeds, sensors or files. It imports nothing of other
packages, because their values hold a path.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Sequence
from itertools import pairwise
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]
Indices = NDArray[np.intp]

MIN_POINT_SPACING: Final = 0.01  #: two successive points nearer than this are one point recorded twice [m]
SAMPLE_SPACING: Final = 1.0  #: of the table for searches, small against any radius that a car can drive [m]
EXTENSION: Final = 200.0  #: straight extension of the table at both ends, beyond a long-range radar's reach [m]

#: A search of the whole path prefers an earlier branch that is at most this farther off [m]
BRANCH_TOLERANCE: Final = 1.0

ARC_LENGTH_ROUNDS: Final = 8  #: refits of the spline over its own arc length; each gains about two digits
NEWTON_ROUNDS: Final = 12
NEWTON_TOLERANCE: Final = 1e-7  #: [m]
NEWTON_MAX_STEP: Final = 4.0  #: keeps the search local, so that it never reaches the other branch of a loop [m]
NEWTON_MIN_SLOPE: Final = 0.5  #: keeps every step downhill, even from beyond the centre of curvature

# Gauss-Legendre nodes and weights of order five on [0, 1], from the closed form of their roots.
_INNER: Final = math.sqrt(5 - 2 * math.sqrt(10 / 7)) / 3
_OUTER: Final = math.sqrt(5 + 2 * math.sqrt(10 / 7)) / 3
_INNER_WEIGHT: Final = (322 + 13 * math.sqrt(70)) / 1800
_OUTER_WEIGHT: Final = (322 - 13 * math.sqrt(70)) / 1800
GAUSS_LEGENDRE = (
    ((1 - _OUTER) / 2, _OUTER_WEIGHT),
    ((1 - _INNER) / 2, _INNER_WEIGHT),
    (0.5, 64 / 225),
    ((1 + _INNER) / 2, _INNER_WEIGHT),
    ((1 + _OUTER) / 2, _OUTER_WEIGHT),
)


class Segment(NamedTuple):
    """One cubic piece: X = x0 + u (x1 + u (x2 + u x3)), Y likewise, with u = s - start [m]."""

    start: float
    x0: float
    x1: float
    x2: float
    x3: float
    y0: float
    y1: float
    y2: float
    y3: float


class PathProjection(NamedTuple):
    """The Frenet coordinates of a point, and the path at the foot of the perpendicular from it."""

    s: float  #: arc length of the foot from the path's start [m]; below 0 before the start, above length past the end
    d: float  #: lateral deviation of the point from the path [m], left positive
    heading: float  #: of the path at the foot [rad], counter-clockwise from map +x
    curvature: float  #: of the path at the foot [1/m], left turn positive


class PathPoint(NamedTuple):
    """A point of the path itself."""

    x: float  #: map [m]
    y: float  #: map [m]
    heading: float  #: [rad], counter-clockwise from map +x
    curvature: float  #: [1/m], left turn positive


class Samples(NamedTuple):
    """The path as a table, every SAMPLE_SPACING metres and EXTENSION beyond both ends."""

    s: Floats  #: arc length [m]
    x: Floats  #: map [m]
    y: Floats  #: map [m]
    tangent_x: Floats  #: cosine of the heading
    tangent_y: Floats  #: sine of the heading
    curvature: Floats  #: [1/m], left turn positive

    def project(self, x: Floats, y: Floats, rows: Indices) -> tuple[Floats, Floats, Floats]:
        """Return s and d [m] of map points, each near the sample of its row number, and the arc from there [m]."""
        dx, dy = x - self.x[rows], y - self.y[rows]
        tx, ty, curvature = self.tangent_x[rows], self.tangent_y[rows], self.curvature[rows]
        along, across = dx * tx + dy * ty, dy * tx - dx * ty
        # On the sample's circle of curvature, instead of its tangent, the foot is this arc from the sample ...
        arc = along / np.maximum(1.0 - curvature * across, NEWTON_MIN_SLOPE)
        # ... and the circle lies off the tangent by the sagitta.
        return self.s[rows] + arc, across - 0.5 * curvature * along * arc, arc

    def project_within(self, x: Floats, y: Floats, index: Indices) -> tuple[Floats, Floats, Floats]:
        """Return s, d [m] and path heading [rad] of map points (n,), each by its samples' row numbers (n, m)."""
        distance = (self.x[index] - x[:, None]) ** 2 + (self.y[index] - y[:, None]) ** 2
        rows = index[np.arange(len(x)), np.argmin(distance, axis=1)]
        s, d, arc = self.project(x, y, rows)
        return s, d, np.arctan2(self.tangent_y[rows], self.tangent_x[rows]) + self.curvature[rows] * arc


class ReferencePath:
    """A curve of cubic pieces over arc length with continuous position, slope and curvature.

    The path goes on straight before its start and beyond its end. An s is an arc length: between the points
    the parameter equals arc length to about a part in a thousand, and at the points better.
    """

    __slots__ = ("_knots", "_pieces", "_projected", "_samples", "length", "segments")

    length: float  #: arc length from the first point to the last [m]
    segments: tuple[Segment, ...]  #: one between each two points

    def __init__(self, segments: Sequence[Segment], length: float) -> None:
        self.segments = tuple(segments)
        self.length = length
        self._knots = [piece.start for piece in self.segments] + [length]
        self._pieces = [_straight(self.segments[0], 0.0), *self.segments, _straight(self.segments[-1], length)]
        self._samples = self._sampled()
        # What `project` was asked last, and its answer: pipeline, controller and record ask for the same point.
        self._projected: tuple[tuple[float, float, float | None], PathProjection] | None = None

    @classmethod
    def from_points(
        cls, x: ArrayLike, y: ArrayLike, noise: float = 0.0, rounds: int = ARC_LENGTH_ROUNDS
    ) -> ReferencePath:
        """Lay a path through points in driving order.

        x, y: map [m], shape (n,), n >= 2. `noise` is the standard deviation of the points [m]: with 0 the path
        passes through every point, otherwise it is the smoothest curve within that noise (for recorded drives).
        `rounds` is how often the spline is fitted again over its own arc length; with 0 its parameter is the chords'.
        Raises ValueError for too few points, x and y of different lengths, and non-finite or repeated points.
        """
        xs, ys = _checked(x, y)
        if noise > 0.0:
            xs, ys = _smoothed(xs, ys, noise)
        spans = np.sqrt(np.diff(xs) ** 2 + np.diff(ys) ** 2)
        for _ in range(rounds):
            pieces = _pieces(xs, spans), _pieces(ys, spans)
            spans = _arc_lengths(*pieces, spans)
        ends = np.cumsum(spans)
        starts = np.concatenate(([0.0], ends[:-1]))
        columns = np.column_stack((starts, *_pieces(xs, spans), *_pieces(ys, spans)))
        return cls([Segment(*row) for row in columns.tolist()], float(ends[-1]))

    @property
    def samples(self) -> Samples:
        """The path as a table of arrays."""
        return self._samples

    @property
    def points(self) -> list[tuple[float, float]]:
        """The points through which the path was laid, after smoothing, map [m]."""
        last = self.at(self.length)
        return [(piece.x0, piece.y0) for piece in self.segments] + [(last.x, last.y)]

    def at(self, s: float) -> PathPoint:
        """Return the path's point at arc length s [m]."""
        start, x0, x1, x2, x3, y0, y1, y2, y3 = self._pieces[bisect_right(self._knots, s)]
        u = s - start
        tx, ty = x1 + u * (2.0 * x2 + 3.0 * u * x3), y1 + u * (2.0 * y2 + 3.0 * u * y3)
        bend = tx * (2.0 * y2 + 6.0 * u * y3) - ty * (2.0 * x2 + 6.0 * u * x3)
        return PathPoint(
            x0 + u * (x1 + u * (x2 + u * x3)),
            y0 + u * (y1 + u * (y2 + u * y3)),
            math.atan2(ty, tx),
            bend / (tx * tx + ty * ty) ** 1.5,
        )

    def project(self, x: float, y: float, near: float | None = None) -> PathProjection:
        """Find the foot of the perpendicular from a map point [m] to the path.

        `near` is an s [m] close to the foot's, such as the previous tick's: the search goes downhill from there, so
        that a path may cross itself. None searches the whole path and prefers the earliest branch.
        """
        asked, last = (x, y, near), self._projected
        if last is not None and last[0] == asked:
            return last[1]
        s = self._nearest_sample(x, y) if near is None else near
        pieces, knots = self._pieces, self._knots
        for _ in range(NEWTON_ROUNDS):
            start, x0, x1, x2, x3, y0, y1, y2, y3 = pieces[bisect_right(knots, s)]
            u = s - start
            dx, dy = x0 + u * (x1 + u * (x2 + u * x3)) - x, y0 + u * (y1 + u * (y2 + u * y3)) - y
            tx, ty = x1 + u * (2.0 * x2 + 3.0 * u * x3), y1 + u * (2.0 * y2 + 3.0 * u * y3)
            ax, ay = 2.0 * x2 + 6.0 * u * x3, 2.0 * y2 + 6.0 * u * y3
            speed_squared = tx * tx + ty * ty
            slope = speed_squared + dx * ax + dy * ay
            step = -(dx * tx + dy * ty) / (slope if slope > NEWTON_MIN_SLOPE else NEWTON_MIN_SLOPE)
            if step * step < NEWTON_TOLERANCE * NEWTON_TOLERANCE:
                break
            s += min(NEWTON_MAX_STEP, max(-NEWTON_MAX_STEP, step))
        speed = math.sqrt(speed_squared)
        d = (dx * ty - dy * tx) / speed
        foot = PathProjection(s, d, math.atan2(ty, tx), (tx * ay - ty * ax) / (speed_squared * speed))
        self._projected = asked, foot
        return foot

    def frenet_near(self, s: float, x: float, y: float, heading: float) -> tuple[float, float, float, float]:
        """Return s [m], d [m] and heading error [rad] of a place near `s`, and the curvature at `s` [1/m].

        One Newton step from `s`, enough where `s` is off by centimetres; left is positive for all. The formulas of `at`
        are repeated here for speed: the fallback path needs them thirty times a tick.
        """
        start, x0, x1, x2, x3, y0, y1, y2, y3 = self._pieces[bisect_right(self._knots, s)]
        u = s - start
        tx, ty = x1 + u * (2.0 * x2 + 3.0 * u * x3), y1 + u * (2.0 * y2 + 3.0 * u * y3)
        bend = tx * (2.0 * y2 + 6.0 * u * y3) - ty * (2.0 * x2 + 6.0 * u * x3)
        bend /= (tx * tx + ty * ty) ** 1.5
        path_heading = math.atan2(ty, tx)
        cosine, sine = math.cos(path_heading), math.sin(path_heading)
        dx, dy = x - (x0 + u * (x1 + u * (x2 + u * x3))), y - (y0 + u * (y1 + u * (y2 + u * y3)))
        along, across = dx * cosine + dy * sine, dy * cosine - dx * sine
        slope = 1.0 - bend * across
        arc = along / (slope if slope > NEWTON_MIN_SLOPE else NEWTON_MIN_SLOPE)
        d = across - 0.5 * bend * along * arc
        turned = heading - path_heading - bend * arc
        # The remainder of infinity, at a place beyond all places, is an error in Python and not NaN.
        return s + arc, d, math.remainder(turned, math.tau) if math.isfinite(turned) else math.nan, bend

    def locate(self, x: Floats, y: Floats, s_from: float, s_to: float) -> tuple[Floats, Floats]:
        """Return s [m] and d (left positive) [m] of many map points, shape (n,), at once.

        Only the stretch from `s_from` to `s_to` [m] is searched (cut at EXTENSION beyond the ends); a point whose
        foot lies outside it gets NaN. Accurate to millimetres within a few metres of the path.
        """
        table = self._samples
        first = min(max(int((s_from + EXTENSION) / SAMPLE_SPACING), 0), len(table.s) - 2)
        last = min(max(int((s_to + EXTENSION) / SAMPLE_SPACING) + 2, first + 2), len(table.s))
        sx, sy = table.x[first:last], table.y[first:last]
        nearest = first + np.argmin((x[:, None] - sx) ** 2 + (y[:, None] - sy) ** 2, axis=1)
        s, d, _arc = table.project(x, y, nearest)
        outside = (s < s_from) | (s > s_to)
        return np.where(outside, math.nan, s), np.where(outside, math.nan, d)

    def project_many(self, x: Floats, y: Floats, near: Floats, window: float) -> tuple[Floats, Floats, Floats]:
        """Return s [m], d (left positive) [m] and path heading [rad] of map points, shape (n,).

        The foot of each point is searched within `window` [m] of path on either side of its own `near` [m], so that a
        path that crosses itself does not mix its branches. Beyond the ends the path is straight. As exact as `locate`.
        """
        table = self._samples
        step = float(table.s[1] - table.s[0])
        reach = math.ceil(window / step)
        centre = np.rint((near - table.s[0]) / step).astype(np.int64)
        index = np.clip(centre[:, None] + np.arange(-reach, reach + 1), 0, len(table.s) - 1)
        return table.project_within(x, y, index)

    def _nearest_sample(self, x: float, y: float) -> float:
        """Return s of the earliest sample that is nearest, to BRANCH_TOLERANCE: a loop's start, not its end."""
        first = round(EXTENSION / SAMPLE_SPACING)
        table, last = self._samples, first + math.ceil(self.length / SAMPLE_SPACING) + 1
        squares = (table.x[first:last] - x) ** 2 + (table.y[first:last] - y) ** 2
        reach = math.sqrt(float(squares.min())) + BRANCH_TOLERANCE
        return float(table.s[first + np.argmax(squares <= reach * reach)])

    def _sampled(self) -> Samples:
        count = 1 + math.ceil((self.length + 2.0 * EXTENSION) / SAMPLE_SPACING)
        s = SAMPLE_SPACING * np.arange(count, dtype=np.float64) - EXTENSION
        pieces = np.asarray(self._pieces)[np.searchsorted(self._knots, s, side="right")]
        start, x0, x1, x2, x3, y0, y1, y2, y3 = pieces.T
        u = s - start
        tx, ty = x1 + u * (2.0 * x2 + 3.0 * u * x3), y1 + u * (2.0 * y2 + 3.0 * u * y3)
        speed = np.sqrt(tx * tx + ty * ty)
        bend = tx * (2.0 * y2 + 6.0 * u * y3) - ty * (2.0 * x2 + 6.0 * u * x3)
        x, y = x0 + u * (x1 + u * (x2 + u * x3)), y0 + u * (y1 + u * (y2 + u * y3))
        samples = Samples(s, x, y, tx / speed, ty / speed, bend / (speed * speed * speed))
        for column in samples:
            # A controller gets the same object as the drive that judges it, and must not change it.
            column.setflags(write=False)
        return samples


class Corridor:
    """The band swept by a rectangle whose rear axle follows the path, widened by a margin."""

    __slots__ = ("_left", "_right")

    def __init__(self, path: ReferencePath, front: float, rear: float, width: float, margin: float) -> None:
        """`front` and `rear` are the distances from the rear axle to the bumpers; all [m]."""
        ahead, behind = math.ceil(rear / SAMPLE_SPACING), math.ceil(front / SAMPLE_SPACING)
        bends = np.pad(path.samples.curvature, (behind, ahead))
        windows = np.lib.stride_tricks.sliding_window_view(bends, behind + ahead + 1)
        _, right = swept_half_widths(windows.max(axis=1).clip(min=0.0), front, width)
        left, _ = swept_half_widths(windows.min(axis=1).clip(max=0.0), front, width)
        self._left: list[float] = (left + margin).tolist()
        self._right: list[float] = (right + margin).tolist()

    def half_widths(self, s: float) -> tuple[float, float]:
        """Return the width of the band to the left and to the right of the path at `s` [m]."""
        row = min(max(round((s + EXTENSION) / SAMPLE_SPACING), 0), len(self._left) - 1)
        return self._left[row], self._right[row]

    def contains(self, s: float, d: float) -> bool:
        """Return whether a point at `s` and `d` [m], left positive, lies in the band; NaN does not."""
        left, right = self.half_widths(s) if math.isfinite(s) else (math.nan, math.nan)
        return -right <= d <= left


def swept_half_widths(curvature: ArrayLike, front: float, width: float) -> tuple[Floats, Floats]:
    """Return the reach of a turning rectangle to the left and right of its rear axle's circle [m].

    On a steady circle of radius R = 1/|curvature| the inner side reaches in to R - width/2 beside the rear axle, and
    the outer front corner moves on sqrt((R + width/2)^2 + front^2); `front` is rear axle to front bumper [m].
    The formula needs no special case for a straight line. curvature: [1/m], left positive, any shape.
    """
    bend = np.asarray(curvature, dtype=np.float64)
    k, half = np.abs(bend), 0.5 * width
    outer = (half * (2.0 + k * half) + k * front * front) / (np.sqrt((1.0 + k * half) ** 2 + (k * front) ** 2) + 1.0)
    inner = np.full_like(outer, half)
    return np.where(bend < 0.0, outer, inner), np.where(bend > 0.0, outer, inner)


def _checked(x: ArrayLike, y: ArrayLike) -> tuple[Floats, Floats]:
    xs, ys = np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64)
    if xs.ndim != 1 or xs.shape != ys.shape:
        raise ValueError(f"path: x and y must be two lists of the same length, got shapes {xs.shape} and {ys.shape}")
    if xs.size < 2:
        raise ValueError(f"path: at least 2 points are needed, got {xs.size}")
    lost = np.flatnonzero(~(np.isfinite(xs) & np.isfinite(ys)))
    if lost.size:
        raise ValueError(f"path: point {lost[0]} is not finite: ({xs[lost[0]]}, {ys[lost[0]]})")
    twice = np.flatnonzero(np.diff(xs) ** 2 + np.diff(ys) ** 2 < MIN_POINT_SPACING**2)
    if twice.size:
        raise ValueError(
            f"path: points {twice[0]} and {twice[0] + 1} are the same place to {MIN_POINT_SPACING} m: "
            f"({xs[twice[0]]:.3f}, {ys[twice[0]]:.3f})"
        )
    return xs, ys


def _smoothed(x: Floats, y: Floats, noise: float) -> tuple[Floats, Floats]:
    """Return the points on the smoothest cubic splines with squared x and y residuals of 2 n noise^2 (Reinsch 1967)."""
    from scipy.interpolate import splev, splprep

    if x.size < 4:
        raise ValueError(f"path: smoothing needs at least 4 points, got {x.size}")
    fitted: Any = splprep((x, y), k=3, s=2.0 * x.size * noise**2)
    spline, parameters = fitted
    xs, ys = np.asarray(splev(parameters, spline), dtype=np.float64)
    return xs, ys


def _pieces(values: Floats, spans: Floats) -> tuple[Floats, Floats, Floats, Floats]:
    """Return the coefficients of the interpolating cubic spline, lowest power first."""
    moments = second_derivatives(values, spans)
    here, there = moments[:-1], moments[1:]
    slopes = np.diff(values) / spans - spans * (2.0 * here + there) / 6.0
    return values[:-1], slopes, here / 2.0, (there - here) / (6.0 * spans)


def second_derivatives(values: Floats, spans: Floats) -> Floats:
    """Return a cubic spline's second derivatives at its points: continuous slope, constant over the end pieces.

    values: at the points, shape (n,); spans: from point to point in the parameter, shape (n - 1,). The tridiagonal
    system is solved in plain floats (Thomas algorithm), so that every machine gives the same bits.
    """
    if values.size == 2:
        return np.zeros(2)
    slopes = np.diff(values) / spans
    h, right = spans.tolist(), (6.0 * np.diff(slopes)).tolist()
    diagonal = [2.0 * (before + after) for before, after in pairwise(h)]
    diagonal[0] += h[0]
    diagonal[-1] += h[-1]
    for i in range(1, len(diagonal)):
        factor = h[i] / diagonal[i - 1]
        diagonal[i] -= factor * h[i]
        right[i] -= factor * right[i - 1]
    inner = [right[-1] / diagonal[-1]]
    for i in range(len(diagonal) - 2, -1, -1):
        inner.append((right[i] - h[i + 1] * inner[-1]) / diagonal[i])
    inner.reverse()
    return np.array([inner[0], *inner, inner[-1]])


def _arc_lengths(x: tuple[Floats, ...], y: tuple[Floats, ...], spans: Floats) -> Floats:
    """Return the arc length of each cubic piece by Gauss-Legendre quadrature [m]."""
    total = np.zeros_like(spans)
    for node, weight in GAUSS_LEGENDRE:
        u = node * spans
        tx, ty = x[1] + u * (2.0 * x[2] + 3.0 * u * x[3]), y[1] + u * (2.0 * y[2] + 3.0 * u * y[3])
        total += weight * np.sqrt(tx * tx + ty * ty)
    return total * spans


def _straight(piece: Segment, s: float) -> Segment:
    """Return the straight continuation of a piece from `s` [m] on, with unit speed."""
    _, x0, x1, x2, x3, y0, y1, y2, y3 = piece
    u = s - piece.start
    tx, ty = x1 + u * (2.0 * x2 + 3.0 * u * x3), y1 + u * (2.0 * y2 + 3.0 * u * y3)
    speed = math.hypot(tx, ty)
    x, y = x0 + u * (x1 + u * (x2 + u * x3)), y0 + u * (y1 + u * (y2 + u * y3))
    return Segment(s, x, tx / speed, 0.0, 0.0, y, ty / speed, 0.0, 0.0)
