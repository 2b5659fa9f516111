"""The lines that the ego means to go along: its scenario's path, and the paths that its controller's commands carried.

One table of samples holds them all, so that a tick is predicted along its own line as along any other. Knows paths and
where they lead to; neither records nor actors.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vve_sumo.path import EXTENSION, SAMPLE_SPACING, ReferencePath, Samples
from vve_sumo.values import Floats

Indices = NDArray[np.int64]

#: number of the scenario's path among the lines
OWN_PATH = 0
#: of a commanded path's line before its start [m], straight: longer than a car, over whose length a band is widened
BEFORE = 20
#: a commanded path that ends no farther from the scenario's, and turned no more against it, leads back onto it
JOINED_OFFSET, JOINED_TURN = 0.5, math.radians(10.0)  # [m], [rad]
#: of the scenario's path behind a commanded one that leads back onto it [m]: more than is looked ahead
JOINED_LENGTH = 250.0


class Place(NamedTuple):
    """Points of lines."""

    x: Floats  #: map [m]
    y: Floats  #: map [m]
    heading: Floats  #: [rad]


@dataclass(frozen=True, slots=True)
class Routes:
    """Lines as one table of samples, SAMPLE_SPACING apart, one line after the other; straight on beyond both ends."""

    samples: Samples  #: `s` counts along each line from its own start [m]
    heading: Floats  #: of each sample [rad], continuous along each line
    first: Indices  #: number of each line's first sample
    count: Indices  #: of each line's samples
    length: Floats  #: where each line ends [m]; inf for one that goes on straight

    @classmethod
    def from_paths(cls, own: ReferencePath, commanded: Iterable[tuple[ReferencePath, float]] = ()) -> Routes:
        """Return the scenario's path, and after it commanded ones, each with the s of that at which it begins [m].

        A commanded path that leads back onto the scenario's goes on along that to its end, any other one straight.
        """
        table = own.samples
        base = cls._from_lines([table], [own.length])
        lines, lengths = [table], [own.length]
        for path, start_s in commanded:
            line, length = _line(path, start_s, own, base)
            lines.append(line)
            lengths.append(length)
        return cls._from_lines(lines, lengths) if len(lines) > 1 else base

    @classmethod
    def _from_lines(cls, lines: list[Samples], lengths: list[float]) -> Routes:
        samples = Samples(*(np.concatenate(columns) for columns in zip(*lines, strict=True)))
        count = np.array([len(line.s) for line in lines], np.int64)
        heading = np.unwrap(np.arctan2(samples.tangent_y, samples.tangent_x))
        return cls(samples, heading, np.cumsum(count) - count, count, np.array(lengths))

    def row(self, route: Indices, s: Floats) -> Indices:
        """Return the number of the sample that is nearest to an s [m] of a line; any for NaN."""
        row = np.rint((s - self.samples.s[self.first[route]]) / SAMPLE_SPACING)
        last = self.count[route] - 1
        return self.first[route] + np.clip(np.where(np.isfinite(row), row, 0.0), 0, last).astype(np.int64)

    def at(self, route: Indices, s: Floats) -> Place:
        """Return the points of lines at their s [m], on the circle of curvature of the nearest sample."""
        table, row = self.samples, self.row(route, s)
        arc, bend, tx, ty = s - table.s[row], table.curvature[row], table.tangent_x[row], table.tangent_y[row]
        sagitta = 0.5 * bend * arc * arc
        x, y = table.x[row] + arc * tx - sagitta * ty, table.y[row] + arc * ty + sagitta * tx
        return Place(x, y, self.heading[row] + bend * arc)

    def search(
        self, route: Indices, x: Floats, y: Floats, near: Floats, window: float
    ) -> tuple[Floats, Floats, Floats]:
        """Return s, d (left positive) [m] and the line's heading [rad] of points, as `ReferencePath.project_many`."""
        table, reach = self.samples, math.ceil(window / SAMPLE_SPACING)
        centre = np.rint((near - table.s[self.first[route]]) / SAMPLE_SPACING).astype(np.int64)
        index = np.clip(centre[:, None] + np.arange(-reach, reach + 1), 0, self.count[route][:, None] - 1)
        return table.project_within(x, y, index + self.first[route][:, None])


def _line(path: ReferencePath, start_s: float, own: ReferencePath, base: Routes) -> tuple[Samples, float]:
    """Return the samples of a commanded path that begins at an s of the scenario's [m], and where it ends [m]."""
    start, last = round(EXTENSION / SAMPLE_SPACING), math.ceil(path.length / SAMPLE_SPACING)
    line = Samples(*(column[start - BEFORE : start + last + 1] for column in path.samples))
    end = path.at(path.length)
    foot = own.project(end.x, end.y, start_s + path.length if math.isfinite(start_s) else None)
    turn = math.remainder(end.heading - foot.heading, math.tau)
    if not (abs(foot.d) <= JOINED_OFFSET and abs(turn) <= JOINED_TURN and foot.s < own.length):
        return line, math.inf
    after = min(JOINED_LENGTH, own.length - foot.s + 1.0)
    s = SAMPLE_SPACING * np.arange(last, last + math.ceil(after) + 1, dtype=np.float64)
    own_s, route = foot.s + (s - path.length), np.full(len(s), OWN_PATH)
    place, curvature = base.at(route, own_s), own.samples.curvature[base.row(route, own_s)].copy()
    curvature[-1] = 0.0  # straight on from there
    tail = Samples(s, place.x, place.y, np.cos(place.heading), np.sin(place.heading), curvature)
    joined = Samples(*(np.concatenate((one[:-1], other)) for one, other in zip(line, tail, strict=True)))
    return joined, path.length + own.length - foot.s
