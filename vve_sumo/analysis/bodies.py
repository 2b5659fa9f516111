"""The ego and the actors of a drive as bodies that move: centres of boxes over time, and what kind of body each is.

Knows a run; nothing of any format.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vve_sumo.analysis.run import Run
from vve_sumo.errors import ConfigError
from vve_sumo.geometry import Boxes
from vve_sumo.metrics.lead_vehicle import index_of_tick
from vve_sumo.values import Floats

#: Kinds that are a person on foot.
PERSONS: Final = frozenset({"pedestrian", "child"})

#: Kinds of scenario actors.
KINDS: Final = frozenset({"car", "van", "truck", "bus", "motorcycle", "bicycle"}) | PERSONS

#: Kind of an actor that no scenario declares, by its radar cross section [m2], which a drive sets by SUMO's vehicle
#: class. A bus has that of a truck.
KIND_OF_CROSS_SECTION: Final = {
    0.25: "child",
    0.5: "pedestrian",
    1.0: "bicycle",
    2.0: "bicycle",
    3.0: "motorcycle",
    5.0: "motorcycle",
    30.0: "van",
    100.0: "truck",
}


class Typical(NamedTuple):
    """What a record does not hold of a kind of body."""

    height: float  #: [m]
    mass: float  #: [kg]


#: by kind
TYPICAL: Final = {
    "car": Typical(1.5, 1500.0),
    "van": Typical(2.3, 2500.0),
    "truck": Typical(3.5, 8000.0),
    "bus": Typical(3.2, 12000.0),
    "motorcycle": Typical(1.6, 280.0),
    "bicycle": Typical(1.7, 90.0),
    "pedestrian": Typical(1.7, 75.0),
    "child": Typical(1.2, 25.0),
}


@dataclass(frozen=True, slots=True)
class RecordedBody:
    """A body over the ticks at which the record holds it; arrays have an entry a tick."""

    name: str
    kind: str  #: one of KINDS
    length: float  #: [m]
    width: float  #: [m]
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
        arrays = (values[rows] for values in (self.time, self.x, self.y, self.heading, self.speed))
        return RecordedBody(self.name, self.kind, self.length, self.width, self.at[rows], *arrays)

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
        return RecordedBody(self.name, self.kind, self.length, self.width, inside, time[inside], x, y, turned, speed)


def bodies(run: Run) -> list[RecordedBody]:
    """Return the ego and every actor, in the order in which they appear; ticks without a known pose are left out."""
    known, rows = declared_kinds(run.resolved["settings"]), run.data.actor_rows
    at_a_tick = index_of_tick(run.arrow("ticks"), run.arrow("actors")) >= 0
    sections = run.arrow("actors")["radar_cross_section_m2"].to_numpy()[at_a_tick]
    found = []
    for code in np.unique(rows.code).tolist():
        own = np.flatnonzero(rows.code == code)
        name = rows.names[code]
        kind = known.get(name) or kind_of(name, float(sections[own[0]]))
        found.append(_body(run, name, kind, rows.at[own], rows.boxes.select(own)))
    return [_ego(run), *sorted(found, key=lambda body: (int(body.at[0]), body.name))]


def obstacles(run: Run) -> frozenset[str]:
    """Return the names of what the scenario declares to stand where it is for the whole drive."""
    return frozenset(one["id"] for one in run.resolved["settings"].get("obstacles", ()))


def _ego(run: Run) -> RecordedBody:
    boxes = run.data.ego_boxes
    at = np.flatnonzero(np.isfinite(boxes.x + boxes.y + boxes.heading + boxes.speed))
    if not len(at):
        raise ConfigError(f"{run.folder}: the record holds no pose of the ego")
    return _body(run, run.data.ego, "car", at, boxes.select(at))


def _body(run: Run, name: str, kind: str, at: NDArray[np.int64], boxes: Boxes) -> RecordedBody:
    size = float(boxes.length[0]), float(boxes.width[0])
    return RecordedBody(name, kind, *size, at, run.time[at], boxes.x, boxes.y, boxes.heading, boxes.speed)


def declared_kinds(settings: Mapping[str, Any]) -> dict[str, str]:
    """Return the kinds of the actors and obstacles in a scenario's settings, by their names."""
    declared = {one["id"]: one["kind"] for one in settings.get("actors", ())}
    return dict.fromkeys((one["id"] for one in settings.get("obstacles", ())), "car") | declared


def kind_of(name: str, cross_section: float) -> str:
    """Return the kind of a vehicle of the traffic; the shipped traffic names a vehicle after its type: `bus.15`."""
    named = name.partition(".")[0]
    return named if named in KINDS else KIND_OF_CROSS_SECTION.get(cross_section, "car")
