"""What the radar should see, by brute force: rays cast between all critical angles against every edge of every box.

Shares nothing with the room it checks: angles instead of slopes, edges instead of planes, corners in the map, one ray
at a time. Must stay slow and plain.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

Vector = tuple[float, float]


class Box(NamedTuple):
    """A rectangle in the antenna's frame [m, rad]."""

    x: float
    y: float
    heading: float
    length: float
    width: float


class Seen(NamedTuple):
    """Nearest visible point of a box, from the antenna."""

    range: float
    azimuth: float
    mode: int


def corners(box: Box) -> list[Vector]:
    """Counter-clockwise."""
    cos, sin = math.cos(box.heading), math.sin(box.heading)
    half = [(0.5, -0.5), (0.5, 0.5), (-0.5, 0.5), (-0.5, -0.5)]
    return [
        (box.x + u * box.length * cos - v * box.width * sin, box.y + u * box.length * sin + v * box.width * cos)
        for u, v in half
    ]


def edges(box: Box) -> Iterator[tuple[Vector, Vector]]:
    points = corners(box)
    return zip(points, points[1:] + points[:1], strict=True)


def cross(a: Vector, b: Vector) -> float:
    return a[0] * b[1] - a[1] * b[0]


def minus(a: Vector, b: Vector) -> Vector:
    return a[0] - b[0], a[1] - b[1]


def on_ray(angle: float, edge: tuple[Vector, Vector]) -> float | None:
    """Distance at which a ray from the origin meets an edge."""
    direction, along = (math.cos(angle), math.sin(angle)), minus(edge[1], edge[0])
    turn = cross(direction, along)
    if turn == 0.0:
        return None
    distance, share = cross(edge[0], along) / turn, cross(edge[0], direction) / turn
    return distance if distance > 0.0 and 0.0 <= share <= 1.0 else None


def meeting(first: tuple[Vector, Vector], second: tuple[Vector, Vector]) -> Vector | None:
    """Point in which two edges cross."""
    a, b = minus(first[1], first[0]), minus(second[1], second[0])
    turn = cross(a, b)
    if turn == 0.0:
        return None
    gap = minus(second[0], first[0])
    s, t = cross(gap, b) / turn, cross(gap, a) / turn
    return (first[0][0] + s * a[0], first[0][1] + s * a[1]) if 0.0 <= s <= 1.0 and 0.0 <= t <= 1.0 else None


def critical_angles(boxes: Sequence[Box], half_angles: Sequence[float]) -> list[float]:
    walls = [(row, edge) for row, box in enumerate(boxes) for edge in edges(box)]
    points = [edge[0] for _, edge in walls]
    for index, (row, edge) in enumerate(walls):
        points += [
            point for other, wall in walls[index + 1 :] if other != row and (point := meeting(edge, wall)) is not None
        ]
    widest = max(half_angles)
    angles = [math.atan2(y, x) for x, y in points] + [sign * half for half in half_angles for sign in (-1.0, 1.0)]
    return sorted(angle for angle in angles if -widest <= angle <= widest)


def nearest_between(start: float, end: float, edge: tuple[Vector, Vector]) -> Vector:
    """Nearest point to the origin of the part of an edge's line between two rays."""
    ends = []
    along = minus(edge[1], edge[0])
    for angle in (start, end):
        direction = math.cos(angle), math.sin(angle)
        distance = cross(edge[0], along) / cross(direction, along)
        ends.append((distance * direction[0], distance * direction[1]))
    (x, y), (dx, dy) = ends[0], minus(ends[1], ends[0])
    share = min(max(-(x * dx + y * dy) / (dx * dx + dy * dy), 0.0), 1.0)
    return x + share * dx, y + share * dy


def seen(boxes: Sequence[Box], modes: Sequence[tuple[float, float]]) -> dict[int, Seen]:
    """Nearest visible point of every box that a mode (farthest range [m], half angle [rad]) covers, by row."""
    angles = critical_angles(boxes, [half_angle for _, half_angle in modes])
    best: dict[int, Seen] = {}
    for start, end in itertools.pairwise(angles):
        if end - start < 1e-9:
            continue
        middle = 0.5 * (start + end)
        hits = [
            (distance, row, edge)
            for row, box in enumerate(boxes)
            for edge in edges(box)
            if (distance := on_ray(middle, edge)) is not None
        ]
        if hits:
            _, row, edge = min(hits)
            x, y = nearest_between(start, end, edge)
            distance = math.hypot(x, y)
            covering = [mode for mode, (far, half) in enumerate(modes) if abs(middle) <= half and distance <= far]
            if covering and (row not in best or distance < best[row].range):
                best[row] = Seen(distance, math.atan2(y, x), covering[0])
    return best
