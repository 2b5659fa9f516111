"""Reads a path's file and lays it in a network's map; refuses a path that no car could drive along on its roads.

Knows nothing of scenarios.
"""

from __future__ import annotations

import math
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vve_sumo.csv_numbers import CsvNumbers
from vve_sumo.errors import ConfigError
from vve_sumo.frames import MapFrame
from vve_sumo.network_tools.path_file import PATH_COLUMNS
from vve_sumo.path import ReferencePath
from vve_sumo.path_feasibility import find_reversal
from vve_sumo.values import Floats
from vve_sumo.world.network import Network, NetworkLane, lanes_near

#: a path's point that is farther than this from every lane is a mistake in the coordinates [m]
MAX_DISTANCE_FROM_LANES = 50.0
#: successive points of a path that are farther apart than this need a lane between them, along which the path runs [m]:
#: nearer ones leave no place of the path farther than half of it from a point, which lies near a lane itself
MAX_FREE_SPACING = 50.0
#: how far the path may be from a lane between such points [m]: the breadth of a road with a verge
MAX_DISTANCE_BETWEEN = 10.0
#: successive points of a path are not farther apart than this [m], on the straightest road: more is a part that was not
#: recorded
MAX_POINT_SPACING = 250.0
#: greatest spacing of the points on lanes with which the path is compared [m]
LANE_POINT_SPACING = 10.0
#: lanes that come within this distance of the path are kept for the record [m]; it reaches what the sensors see
MAX_DISTANCE_FROM_PATH = 150.0
#: points of a line that are looked at together when others are looked for near it
DISTANCE_BATCH = 64
#: comment in a path's file that names the edges it runs along
EDGES_PREFIX = "# edges:"


class LoadedPath(NamedTuple):
    """A path's file, laid in a network's map."""

    path: ReferencePath  #: on the network's map
    edges: tuple[str, ...]  #: that the path runs along, as the file's comment names them; empty without that comment
    lanes: tuple[NetworkLane, ...]  #: that come within MAX_DISTANCE_FROM_PATH of the path, in the network's order


def read_path(file: Path, map_frame: MapFrame, network: Network) -> LoadedPath:
    """Return the path in a CSV file, laid in the network's map, with its edges and the lanes around it.

    Raises ConfigError naming file and line for an invalid coordinate, for a point outside the network or more than
    MAX_DISTANCE_FROM_LANES from every lane, for one at which the path turns back, and for one that is too far from the
    point before it.
    """
    table = CsvNumbers(file, "path")
    edges = next(
        (tuple(line[len(EDGES_PREFIX) :].split()) for line in table.comments if line.startswith(EDGES_PREFIX)), ()
    )
    places, placed = [], []
    for where, (latitude, longitude) in table.numbers(PATH_COLUMNS):
        if not (abs(latitude) <= 90.0 and abs(longitude) <= 180.0):
            raise ConfigError(f"{where}: {latitude}, {longitude} is no place on Earth, in degrees")
        places.append(where)
        placed.append(map_frame.to_map(math.radians(latitude), math.radians(longitude)))
    for where, (x, y) in zip(places, placed, strict=True):
        _inside(where, x, y, network)
    points = np.array(placed).reshape(-1, 2)
    lanes = _lanes_around(points, network)
    lines = [_dense(lane.shape) for lane in lanes]
    _on_the_roads(places, points, lines, network)
    try:
        path = ReferencePath.from_points([x for x, _y in placed], [y for _x, y in placed])
    except ValueError as error:
        raise ConfigError(f"{table.name}: {error}") from None
    _forward(places, points)
    _without_gaps(places, points, path, lines, network)
    return LoadedPath(path, edges, _lanes_along(path, lanes, lines))


def _lanes_around(points: Floats, network: Network) -> list[NetworkLane]:
    """Return the lanes near the box that holds a path's points (n, 2)."""
    if len(points) == 0:
        return []
    low, high = points.min(axis=0) - MAX_DISTANCE_FROM_PATH, points.max(axis=0) + MAX_DISTANCE_FROM_PATH
    return lanes_near(network.path, (low[0], low[1], high[0], high[1]))


def _lanes_along(path: ReferencePath, lanes: list[NetworkLane], lines: list[Floats]) -> tuple[NetworkLane, ...]:
    """Return those of the lanes, drawn as `lines`, that come within MAX_DISTANCE_FROM_PATH of the path."""
    if not lanes:
        return ()
    close = within_distance(np.vstack(lines), _dense(np.array(path.points)), MAX_DISTANCE_FROM_PATH)
    first = np.cumsum([0, *map(len, lines[:-1])])
    kept = np.logical_or.reduceat(close, first)
    return tuple(lane for lane, near in zip(lanes, kept.tolist(), strict=True) if near)


def _on_the_roads(places: list[str], points: Floats, lines: list[Floats], network: Network) -> None:
    """Raise ConfigError at the first point that is far from every lane: a wrong network or wrong coordinates."""
    spots = np.vstack(lines) if lines else np.zeros((0, 2))
    far = np.flatnonzero(~within_distance(points, spots, MAX_DISTANCE_FROM_LANES))
    if len(far):
        at = int(far[0])
        raise ConfigError(
            f"{places[at]}: ({points[at, 0]:.1f}, {points[at, 1]:.1f}) m is more than "
            f"{MAX_DISTANCE_FROM_LANES:.0f} m from every lane of {network.path.name}"
        )


def _forward(places: list[str], points: Floats) -> None:
    """Raise ConfigError at the first point at which a path turns back."""
    at = find_reversal(points)
    if at is None:
        return
    here = math.atan2(*(points[at] - points[at - 1])[::-1])
    there = math.atan2(*(points[at + 1] - points[at])[::-1])
    turned = math.degrees(abs(math.remainder(there - here, math.tau)))
    raise ConfigError(
        f"{places[at]}: ({points[at, 0]:.1f}, {points[at, 1]:.1f}) m, the path turns back by {turned:.0f} deg; "
        "expected points in driving order, none recorded standing still or in reverse"
    )


def _without_gaps(
    places: list[str], points: Floats, path: ReferencePath, lines: list[Floats], network: Network
) -> None:
    """Raise ConfigError at the first point that is too far from the one before it."""
    starts = [piece.start for piece in path.segments] + [path.length]
    spots = np.vstack(lines) if lines else np.zeros((0, 2))
    spacings = np.sqrt((np.diff(points, axis=0) ** 2).sum(axis=1))
    for at in (np.flatnonzero(spacings > MAX_FREE_SPACING) + 1).tolist():
        spacing, (x, y) = float(spacings[at - 1]), points[at]
        gap = f"{places[at]}: ({x:.1f}, {y:.1f}) m is {spacing:.0f} m from the point before it, expected"
        if spacing > MAX_POINT_SPACING:
            raise ConfigError(f"{gap} at most {MAX_POINT_SPACING:g} m")
        between = [path.at(s)[:2] for s in np.linspace(starts[at - 1], starts[at], math.ceil(spacing)).tolist()]
        if not within_distance(np.array(between), spots, MAX_DISTANCE_BETWEEN).all():
            raise ConfigError(
                f"{gap} at most {MAX_FREE_SPACING:g} m where the path leaves the lanes of {network.path.name} between "
                "them"
            )


def within_distance(points: Floats, others: Floats, distance: float) -> NDArray[np.bool_]:
    """Return for each point (n, 2) whether one of the others (m, 2) is at most so far away.

    The others are best in the order of a line. A tree of scipy's would be no faster than its import is slow.
    """
    near = np.zeros(len(points), dtype=np.bool_)
    for first in range(0, len(others), DISTANCE_BATCH):
        some = others[first : first + DISTANCE_BATCH]
        inside = (points >= some.min(axis=0) - distance) & (points <= some.max(axis=0) + distance)
        left = np.flatnonzero(inside.all(axis=1) & ~near)
        apart = points[left, None] - some
        near[left] = (np.sqrt((apart * apart).sum(axis=2)) <= distance).any(axis=1)
    return near


def _dense(line: Floats) -> Floats:
    """Return points of a polyline, none farther than LANE_POINT_SPACING from the next."""
    pieces = []
    for start, end in pairwise(line):
        count = max(2, math.ceil(math.dist(start, end) / LANE_POINT_SPACING) + 1)
        pieces.append(start + (end - start) * np.linspace(0.0, 1.0, count)[:, None])
    return np.vstack(pieces) if pieces else line


def _inside(where: str, x: float, y: float, network: Network) -> None:
    least_x, least_y, greatest_x, greatest_y = network.boundary
    if not (
        least_x - MAX_DISTANCE_FROM_LANES <= x <= greatest_x + MAX_DISTANCE_FROM_LANES
        and least_y - MAX_DISTANCE_FROM_LANES <= y <= greatest_y + MAX_DISTANCE_FROM_LANES
    ):
        raise ConfigError(
            f"{where}: ({x:.1f}, {y:.1f}) m lies off the network {network.path.name}, which spans "
            f"{least_x:.0f} to {greatest_x:.0f} and {least_y:.0f} to {greatest_y:.0f}"
        )
