"""Lines that bodies move along: the files of their points, and the path that a drive makes of them."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Final

from vve_sumo.bridges.scenario_import.not_taken import NotTakenError
from vve_sumo.bridges.scenario_import.xml_tree import Element
from vve_sumo.path import ReferencePath

Points = list[tuple[float, float]]

#: any line at most [m]: roads of wrong numbers have lines of any length
MAX_LENGTH: Final = 100_000.0
#: a trajectory goes straight on behind its end [m], so that who comes there need not stop
RUN_OUT: Final = 20.0


@dataclass(slots=True)
class LineFiles:
    """The lines of a scenario by the names of their files; the same line has one file."""

    prefix: str
    points: dict[str, Points] = field(default_factory=dict)

    def named(self, name: str, points: Points) -> str:
        """Return the name of the file of a line, a new one where no file has the line yet."""
        if len(points) < 2:
            raise ValueError("a line of less than two points")
        wanted, number = f"{self.prefix}_{name}", 1
        while wanted in self.points and self.points[wanted] != points:
            number += 1
            wanted = f"{self.prefix}_{name}_{number}"
        self.points[wanted] = points
        return wanted


def reference(points: Points, of: Element) -> ReferencePath:
    """Return the cubic path through the points of an element, as a drive has it; raises NotTakenError for none."""
    if not sum(map(math.dist, points, points[1:])) <= MAX_LENGTH:
        raise NotTakenError(of, f"its line is longer than {MAX_LENGTH / 1000.0:g} km")
    try:
        return ReferencePath.from_points([x for x, _ in points], [y for _, y in points])
    except ValueError as error:
        raise NotTakenError(of, f"no body can follow its line: {error}") from None


def extended(points: Points) -> Points:
    """Return the points of a trajectory without those that repeat another, and a straight line at its end."""
    kept = [points[0]]
    for one in points[1:]:
        if math.dist(one, kept[-1]) > 0.05:
            kept.append(one)
    if len(kept) < 2:
        return kept
    (x, y), (before_x, before_y) = kept[-1], kept[-2]
    heading = math.atan2(y - before_y, x - before_x)
    return kept + straight(x, y, heading, RUN_OUT)[1:]


def straight(x: float, y: float, heading: float, length: float) -> Points:
    """Return points of a straight line, a metre apart."""
    return [(x + n * math.cos(heading), y + n * math.sin(heading)) for n in range(round(length) + 1)]
