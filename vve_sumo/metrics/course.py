"""Where the ego goes on from a tick: along its path while it keeps to it, else along the arc that it moves on.

Its path is the one that its controller's command carries at that tick, else the scenario's. Lengths count from the rear
axle's place at that tick. Knows poses and paths; neither records nor actors.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vve_sumo.geometry import Boxes, vehicle_boxes
from vve_sumo.metrics.routes import OWN_PATH, Routes
from vve_sumo.path import ReferencePath
from vve_sumo.values import Floats, Vehicle

Indices = NDArray[np.int64]

#: an ego whose rear axle is farther from its path has left it [m]: more than any shipped controller's deviation, and
#: less than it takes to pass an obstacle in the lane
MAX_DEVIATION = 0.5
#: an ego whose heading differs by more from the path's has left it [rad]
MAX_HEADING_ERROR = math.radians(10.0)
#: a curvature is a yaw rate over a speed, and a speed below this counts as this [m/s]: at rest the arc is straight
MIN_SPEED = 0.5
#: an arc that bends less is a straight line: below, a product of two small numbers is rounded to nothing [1/m]
STRAIGHT = 1e-9
#: an arc is followed no farther than it turns by this [rad]
MAX_ARC = math.pi


class Starts(NamedTuple):
    """Where the ego is when its motion is predicted: an entry a prediction, NaN where it is not known."""

    s: Floats  #: of the rear axle on its path [m]
    x: Floats  #: of the rear axle, map [m]
    y: Floats  #: as x
    heading: Floats  #: [rad]
    curvature: Floats  #: of the arc that it moves on [1/m], left positive
    leaves: NDArray[np.bool_]  #: whether it goes along that arc, because it has left its path
    route: Indices  #: number of its path: OWN_PATH for the scenario's, else one that a command carries

    @property
    def elsewhere(self) -> NDArray[np.bool_]:
        """Whether it goes on along another line than the scenario's path."""
        elsewhere: NDArray[np.bool_] = self.leaves | (self.route != OWN_PATH)
        return elsewhere

    def select(self, rows: Any) -> Starts:
        """Return the starts of these rows."""
        s, x, y, heading, curvature = (column[rows] for column in self[:5])
        return Starts(s, x, y, heading, curvature, self.leaves[rows], self.route[rows])


def starts(
    s: Floats, x: Floats, y: Floats, heading: Floats, speed: Floats, yaw_rate: Floats, path_heading: Floats,
    deviation: Floats, route: Indices | None = None,
) -> Starts:  # fmt: skip
    """Return where predictions of the ego start.

    It has left its path where its rear axle is more than MAX_DEVIATION from it, or its heading differs by more than
    MAX_HEADING_ERROR from the path's. path_heading [rad] is the path's at `s`, deviation [m] the rear axle's
    from it. `route` is the number of its path, by default the scenario's.
    """
    error = np.arctan2(np.sin(heading - path_heading), np.cos(heading - path_heading))
    curvature = np.where(np.isfinite(yaw_rate), yaw_rate, 0.0) / np.maximum(np.abs(speed), MIN_SPEED)
    leaves = (np.abs(deviation) > MAX_DEVIATION) | (np.abs(error) > MAX_HEADING_ERROR)
    if route is None:
        route = np.full(len(s), OWN_PATH)
    return Starts(s, x, y, heading, curvature, leaves, route)


class PredictedCourse:
    """The ego's predicted courses, one from every start."""

    def __init__(self, path: ReferencePath, vehicle: Vehicle, starts: Starts, routes: Routes | None = None) -> None:
        """`routes` are the paths that starts name by number, by default the scenario's alone."""
        self.path, self.vehicle, self.starts = path, vehicle, starts
        self.routes = Routes.from_paths(path) if routes is None else routes

    def end(self, start: Starts) -> Floats:
        """Return how far courses go [m]: to the path's end, and by MAX_ARC at most along an arc."""
        left = self.routes.length[start.route] - start.s
        with np.errstate(divide="ignore"):
            return np.where(start.leaves, np.minimum(left, MAX_ARC / np.abs(start.curvature)), left)

    def body(self, start: Starts, gone: Floats, speed: Floats) -> Boxes:
        """Return the ego's boxes when its rear axle has gone so far [m]."""
        x, y, heading = self.routes.at(start.route, start.s + gone)
        half = 0.5 * start.curvature * gone
        chord = gone * np.sinc(half / np.pi)
        x = np.where(start.leaves, start.x + chord * np.cos(start.heading + half), x)
        y = np.where(start.leaves, start.y + chord * np.sin(start.heading + half), y)
        heading = np.where(start.leaves, start.heading + 2.0 * half, heading)
        return vehicle_boxes(x, y, heading, np.broadcast_to(speed, x.shape), self.vehicle)

    def find(self, start: Starts, x: Floats, y: Floats, near: Floats, window: float) -> tuple[Floats, Floats, Floats]:
        """Return how far ahead and beside (left positive) [m] points are, shape (n,), and the course's heading there.

        On the path they are looked for within `window` [m] of `near` [m ahead].
        """
        ahead, beside, heading = self.routes.search(start.route, x, y, start.s + near, window)
        off = np.flatnonzero(start.leaves)
        ahead -= start.s
        arc = start.select(off)
        ahead[off], beside[off] = _on_arc(arc, x[off], y[off])
        heading[off] = arc.heading + arc.curvature * ahead[off]
        return ahead, beside, heading

    def project(self, start: Starts, x: Floats, y: Floats, near: Floats) -> tuple[Floats, Floats]:
        """Return how far ahead and beside (left positive) [m] points are that are metres from `near` [m ahead]."""
        for _ in range(2):
            s, beside, _ = self.routes.samples.project(x, y, self.routes.row(start.route, start.s + near))
            near = s - start.s
        if not start.leaves.any():
            return near, beside
        along, across = _on_arc(start, x, y)
        return np.where(start.leaves, along, near), np.where(start.leaves, across, beside)


def _on_arc(start: Starts, x: Floats, y: Floats) -> tuple[Floats, Floats]:
    """Return how far along and beside (left positive) the arcs of starts points are [m]; within half a turn."""
    cos, sin, bend = np.cos(start.heading), np.sin(start.heading), start.curvature
    u, v = (x - start.x) * cos + (y - start.y) * sin, (y - start.y) * cos - (x - start.x) * sin
    straight = np.abs(bend) < STRAIGHT
    along = np.arctan2(bend * u, 1.0 - bend * v) / np.where(straight, 1.0, bend)
    beside = (2.0 * v - bend * (u * u + v * v)) / (1.0 + np.hypot(bend * u, 1.0 - bend * v))
    return np.where(straight, u, along), beside
