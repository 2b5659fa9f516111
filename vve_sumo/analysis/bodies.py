"""The ego and the actors of a drive as bodies that move: centres of boxes over time, and what kind of body each is.

Knows a run; nothing of any format.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from vve_sumo.analysis.run import Run
from vve_sumo.body_kinds import BODY_KINDS, TYPICAL
from vve_sumo.errors import ConfigError
from vve_sumo.geometry import Boxes
from vve_sumo.metrics.lead_vehicle import index_of_tick
from vve_sumo.values import Floats


@dataclass(frozen=True, slots=True)
class RecordedBody:
    """A body over the ticks at which the record holds it; arrays have an entry a tick."""

    name: str
    kind: str  #: one of BODY_KINDS
    length: float  #: [m]
    width: float  #: [m]
    height: float  #: [m]
    at: NDArray[np.int64]  #: index of the tick in the table of ticks, rising
    time: Floats  #: drive time [s]
    x: Floats  #: centre of the box, map [m]
    y: Floats  #: centre of the box, map [m]
    heading: Floats  #: [rad] counter-clockwise from the map's +x
    speed: Floats  #: along the heading [m/s]

    @property
    def front(self) -> tuple[Floats, Floats]:
        """Middle of the front side, map [m]."""
        half = 0.5 * self.length
        return self.x + half * np.cos(self.heading), self.y + half * np.sin(self.heading)

    def select(self, rows: NDArray[np.intp] | slice) -> RecordedBody:
        """Return the body at some of its ticks."""
        arrays = {name: getattr(self, name)[rows] for name in ("time", "x", "y", "heading", "speed")}
        return replace(self, at=self.at[rows], **arrays)

    def stretches(self) -> Iterator[RecordedBody]:
        """Yield the body of each stretch of ticks without a gap; an actor may leave and return."""
        ends = np.flatnonzero(np.diff(self.at) > 1) + 1
        for begin, end in zip([0, *ends.tolist()], [*ends.tolist(), len(self.at)], strict=True):
            yield self.select(slice(begin, end))

    def sampled(self, time: Floats) -> RecordedBody:
        """Return the body at those of these times [s] that lie within its own; `at` counts them.

        Values lie on straight lines between ticks.
        """
        inside = np.flatnonzero((time >= self.time[0] - 1e-9) & (time <= self.time[-1] + 1e-9))
        heading = np.interp(time[inside], self.time, np.unwrap(self.heading))
        x, y, speed = (np.interp(time[inside], self.time, values) for values in (self.x, self.y, self.speed))
        turned = np.arctan2(np.sin(heading), np.cos(heading))
        return replace(self, at=inside, time=time[inside], x=x, y=y, heading=turned, speed=speed)


def bodies(run: Run) -> list[RecordedBody]:
    """Return the ego and every actor, in the order in which they appear; ticks without a known pose are left out."""
    rows, table = run.data.actor_rows, run.arrow("actors")
    at_a_tick = index_of_tick(run.arrow("ticks"), table) >= 0
    kinds, heights = (table[name].to_numpy()[at_a_tick] for name in ("kind", "height_m"))
    found = []
    for code in np.unique(rows.code).tolist():
        own = np.flatnonzero(rows.code == code)
        what = BODY_KINDS[kinds[own[0]]], float(heights[own[0]])
        found.append(_body(run, rows.names[code], *what, rows.at[own], rows.boxes.select(own)))
    return [_ego(run), *sorted(found, key=lambda body: (int(body.at[0]), body.name))]


def obstacles(run: Run) -> frozenset[str]:
    """Return the names of what the scenario declares to stand where it is for the whole drive."""
    own = [one["id"] for one in run.resolved["settings"].get("obstacles", ())]
    return frozenset([*own, *(run.resolved.get("further_ego") or {}).get("obstacles", ())])


def _ego(run: Run) -> RecordedBody:
    boxes = run.data.ego_boxes
    at = np.flatnonzero(np.isfinite(boxes.x + boxes.y + boxes.heading + boxes.speed))
    if not len(at):
        raise ConfigError(f"{run.folder}: the record holds no pose of the ego")
    return _body(run, run.data.ego, "car", TYPICAL["car"].height, at, boxes.select(at))


def _body(run: Run, name: str, kind: str, height: float, at: NDArray[np.int64], boxes: Boxes) -> RecordedBody:
    size = float(boxes.length[0]), float(boxes.width[0]), height
    return RecordedBody(name, kind, *size, at, run.time[at], boxes.x, boxes.y, boxes.heading, boxes.speed)
