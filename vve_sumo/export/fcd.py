"""SUMO's floating car data (FCD): the file that `sumo --fcd-output` writes, of the ego and the actors of a drive.

x, y are the middle of the front in the virtual road's map, `angle` is in degrees clockwise from north (the map's +y),
as in SUMO's documentation of FCD output. Persons on foot are `person` elements, which come after a time
step's vehicles.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence
from xml.sax.saxutils import quoteattr

import numpy as np

from vve_sumo.analysis.bodies import RecordedBody, bodies
from vve_sumo.analysis.run import Run
from vve_sumo.body_kinds import PERSONS
from vve_sumo.export.lanes import ON_FOOT, RecordedLane, lanes_of, places
from vve_sumo.export.part import ExportPart

HEAD = """\
<?xml version="1.0" encoding="UTF-8"?>
<fcd-export xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance" \
xsi:noNamespaceSchemaLocation="http://sumo.dlr.de/xsd/fcd_file.xsd">
"""


def of_drive(run: Run) -> Iterator[ExportPart]:
    """Yield the file: a time step for each tick at which the ego's pose is known or an actor is there."""
    lanes = lanes_of(run)
    ways = [lane for lane in lanes if lane.kind not in ON_FOOT]
    vehicles: dict[int, list[str]] = defaultdict(list)
    persons: dict[int, list[str]] = defaultdict(list)
    for body in bodies(run):
        on_foot = body.kind in PERSONS
        lines = _persons(body, lanes) if on_foot else _vehicles(body, ways)
        for at, line in zip(body.at.tolist(), lines, strict=True):
            (persons if on_foot else vehicles)[at].append(line)
    steps = (
        "".join((f'    <timestep time="{run.time[at]:.3f}">\n', *vehicles[at], *persons[at], "    </timestep>\n"))
        for at in sorted({*vehicles, *persons})
    )
    yield ExportPart("", "".join((HEAD, *steps, "</fcd-export>\n")).encode())


def _vehicles(body: RecordedBody, lanes: Sequence[RecordedLane]) -> Iterator[str]:
    """Yield the element of a vehicle at each of its ticks; one beside the road has an empty lane, as SUMO's has."""
    for motion, lane, position in _rows(body, lanes):
        name = "" if lane is None else quoteattr(lane.name)
        place = f' pos="{position:.3f}" lane={name}' if name else ' lane=""'
        yield f"        <vehicle {motion}{place if lanes else ''}/>\n"


def _persons(body: RecordedBody, lanes: Sequence[RecordedLane]) -> Iterator[str]:
    """Yield the element of a person at each tick, with the edge instead of the lane."""
    for motion, lane, position in _rows(body, lanes):
        edge = "" if lane is None else quoteattr(lane.name.rpartition("_")[0])
        place = f' pos="{position:.3f}" edge={edge}' if edge else ' edge=""'
        yield f"        <person {motion}{place if lanes else ''}/>\n"


def _rows(body: RecordedBody, lanes: Sequence[RecordedLane]) -> Iterator[tuple[str, RecordedLane | None, float]]:
    """Yield the attributes of a body's motion, its lane and the position on it [m]; SUMO knows no negative speed."""
    x, y = body.front
    angle = np.mod(90.0 - np.degrees(body.heading), 360.0)
    head, kind = f"id={quoteattr(body.name)}", f'type="{body.kind}"'
    on, position = places(lanes, x, y, body.heading)
    columns = (x, y, angle, np.maximum(body.speed, 0.0), on, position)
    for at_x, at_y, clockwise, speed, number, along in zip(*(column.tolist() for column in columns), strict=True):
        motion = f'{head} x="{at_x:.3f}" y="{at_y:.3f}" angle="{clockwise:.3f}" {kind} speed="{speed:.3f}"'
        yield motion, lanes[number] if number >= 0 else None, along
