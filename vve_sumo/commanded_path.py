"""Checks the path that a controller's command carries, and lays the curve through its points that the car follows.

Knows geometry in the map frame and where the car is; neither lot nor actors, nor what is done about a refused path.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache
from itertools import groupby, pairwise
from operator import itemgetter
from typing import TYPE_CHECKING, Final

from vve_sumo.errors import ConfigError
from vve_sumo.path import ReferencePath, Segment
from vve_sumo.values import CommandedPath, Pose

if TYPE_CHECKING:
    import pyarrow as pa

MIN_POINTS, MAX_POINTS = 2, 100  #: points of a path
MAX_LENGTH: Final = 500.0  #: of the lines from point to point together [m], far beyond any stop
MIN_SPACING: Final = 0.1  #: from one point to the next [m]
#: from the car's rear axle to the first point [m]: a controller that plans every 0.1 s may send the same path meanwhile
MAX_START_DISTANCE: Final = 3.0
#: between the car's heading and the first line [rad]; for a larger error there is no fallback path either
MAX_START_TURN: Final = 1.0
#: of the curve along the line between two of its points, per metre of that line, at least: nowhere does it turn back
MIN_ADVANCE: Final = 0.5
#: of the curve across that line, per metre of it, at most
MAX_ASIDE: Final = 1.0
#: refits of the curve over its own arc length. Its parameter is the length of the lines between its points: on a bend
#: of 10 m radius with points 2 m apart, 0.2 % less than the arc. Each refit would take as long again.
ROUNDS: Final = 0


def plain(path: CommandedPath) -> CommandedPath:
    """Return a path as tuples of plain floats; raises TypeError or ValueError for what is no sequence of numbers."""
    columns: tuple[Sequence[float], ...] = (path.x, path.y, path.speed)
    if any(isinstance(column, str | bytes) for column in columns):
        raise TypeError("a text in place of numbers")
    # Adding 0 turns -0.0 into 0.0: equal paths have equal bits.
    x, y, speed = (tuple(float(value) + 0.0 for value in column) for column in columns)
    return CommandedPath(x, y, speed)


def flaw(path: CommandedPath, pose: Pose) -> str:
    """Return in one line what is wrong with a path that a controller commands from `pose`; empty for nothing.

    The path has 2 to 100 points, as many speeds, and only finite numbers. No speed is negative. Points are at least
    MIN_SPACING apart, and the curve through them advances from each to the next. It begins within MAX_START_DISTANCE
    of the rear axle, in about its heading. `path` holds tuples of floats, `pose` is the rear axle's.
    """
    x, y, speed = path.x, path.y, path.speed
    if not len(x) == len(y) == len(speed):
        return f"{len(x)} x, {len(y)} y and {len(speed)} speeds, expected as many of each"
    if not MIN_POINTS <= len(x) <= MAX_POINTS:
        return f"{len(x)} points, expected {MIN_POINTS} to {MAX_POINTS}"
    for number, point in enumerate(zip(x, y, speed, strict=True)):
        if not all(map(math.isfinite, point)):
            return f"point {number} is not finite: ({point[0]}, {point[1]}) at {point[2]} m/s"
        if point[2] < 0.0:
            return f"point {number} has the negative speed {point[2]:g} m/s"
    return _flaw_of_start(path, pose) or _flaw_of_course(path)


def _flaw_of_start(path: CommandedPath, pose: Pose) -> str:
    away = math.hypot(path.x[0] - pose.x, path.y[0] - pose.y)
    if not away <= MAX_START_DISTANCE:
        return f"point 0 is {away:.2f} m from the rear axle, expected {MAX_START_DISTANCE:g} m at most"
    along, across = path.x[1] - path.x[0], path.y[1] - path.y[0]
    turn = math.remainder(math.atan2(across, along) - pose.heading, math.tau)
    if not abs(turn) <= MAX_START_TURN:
        return f"it begins at {turn:.2f} rad to the car's heading, expected {MAX_START_TURN:g} rad at most"
    return ""


@lru_cache(maxsize=4)
def _flaw_of_course(path: CommandedPath) -> str:
    """Return what is wrong with the path wherever the car is; remembered, for a controller says it at many ticks."""
    length = 0.0
    for number, ((x, y), (next_x, next_y)) in enumerate(pairwise(zip(path.x, path.y, strict=True))):
        step = math.hypot(next_x - x, next_y - y)
        if not step >= MIN_SPACING:
            return f"points {number} and {number + 1} are {step:.3f} m apart, expected {MIN_SPACING:g} m at least"
        length += step
    if not length <= MAX_LENGTH:
        return f"it is {length:.0f} m long, expected {MAX_LENGTH:g} m at most"
    followed = curve(path)
    starts = [piece.start for piece in followed.segments[1:]]
    for number, (piece, end) in enumerate(zip(followed.segments, [*starts, followed.length], strict=True)):
        chord = path.x[number + 1] - path.x[number], path.y[number + 1] - path.y[number]
        if not _advances(piece, end - piece.start, *chord):
            return f"it does not advance from point {number} to point {number + 1}: a bend that no car can follow"
    return ""


@lru_cache(maxsize=4)
def curve(path: CommandedPath) -> ReferencePath:
    """Return the curve through a path's points, straight on before its start and beyond its end.

    Raises ConfigError for points that `flaw` refuses. The newest are remembered: a tick asks for the same one again.
    """
    try:
        return ReferencePath.from_points(path.x, path.y, rounds=ROUNDS)
    except ValueError as error:
        raise ConfigError(f"commanded {error}") from None


def _advances(piece: Segment, span: float, dx: float, dy: float) -> bool:
    """Return whether a cubic piece over a span [m] nowhere turns back or far aside from its chord (dx, dy) [m].

    Its tangent along and across the chord is a quadratic each, whose extremes lie at the ends and at its vertex.
    """
    _, _, x1, x2, x3, _, y1, y2, y3 = piece
    away = math.hypot(dx, dy)
    cos, sin = dx / away, dy / away
    along = _extremes(x1 * cos + y1 * sin, x2 * cos + y2 * sin, x3 * cos + y3 * sin, span)
    across = _extremes(y1 * cos - x1 * sin, y2 * cos - x2 * sin, y3 * cos - x3 * sin, span)
    return min(along) >= MIN_ADVANCE and max(map(abs, across)) <= MAX_ASIDE


def _extremes(first: float, second: float, third: float, span: float) -> tuple[float, ...]:
    """Return the slope of u (first + u (second + u third)) at 0, at `span`, and at its extreme between, if any."""

    def slope(u: float) -> float:
        return first + u * (2.0 * second + 3.0 * u * third)

    # The vertex is at -second / (3 third); it lies between the ends where that is so without dividing.
    if 0.0 < -second * third < 3.0 * third * third * span:
        return slope(0.0), slope(span), slope(-second / (3.0 * third))
    return slope(0.0), slope(span)


def by_tick(table: pa.Table) -> dict[int, CommandedPath]:
    """Return the paths in a record's table of commanded paths, by the number of the tick, in their order."""
    rows = zip(*(table[name].to_pylist() for name in ("tick", "x_m", "y_m", "speed_mps")), strict=True)
    points = groupby(rows, itemgetter(0))
    return {tick: CommandedPath(*tuple(zip(*own, strict=True))[1:]) for tick, own in points}
