"""SUMO's floating car data (FCD): the file that `sumo --fcd-output` writes, of the ego and the actors of a drive.

x, y are the middle of the front in the street's map, `angle` is in degrees clockwise from north (the map's +y), as in
SUMO's documentation of FCD output. Persons on foot are `person` elements, which come after a time step's vehicles.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from xml.sax.saxutils import quoteattr

import numpy as np

from vve_sumo.analysis.run import Run
from vve_sumo.export.bodies import PERSONS, Body, bodies
from vve_sumo.export.formats import Part

HEAD = """\
<?xml version="1.0" encoding="UTF-8"?>
<fcd-export xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance" \
xsi:noNamespaceSchemaLocation="http://sumo.dlr.de/xsd/fcd_file.xsd">
"""


def of_drive(run: Run) -> Iterator[Part]:
    """Yield the file: a time step for each tick at which the ego's pose is known or an actor is there."""
    vehicles: dict[int, list[str]] = defaultdict(list)
    persons: dict[int, list[str]] = defaultdict(list)
    for body in bodies(run):
        for at, line in zip(body.at.tolist(), _lines(body), strict=True):
            (persons if body.kind in PERSONS else vehicles)[at].append(line)
    steps = (
        "".join((f'    <timestep time="{run.time[at]:.3f}">\n', *vehicles[at], *persons[at], "    </timestep>\n"))
        for at in sorted({*vehicles, *persons})
    )
    yield Part("", "".join((HEAD, *steps, "</fcd-export>\n")).encode())


def _lines(body: Body) -> Iterator[str]:
    """Yield the element of a body at each of its ticks; SUMO knows no negative speed."""
    x, y = body.front
    angle = np.mod(90.0 - np.degrees(body.heading), 360.0)
    element = "person" if body.kind in PERSONS else "vehicle"
    head, kind = f"        <{element} id={quoteattr(body.name)}", f'type="{body.kind}"'
    columns = (x, y, angle, np.maximum(body.speed, 0.0))
    for at_x, at_y, clockwise, speed in zip(*(column.tolist() for column in columns), strict=True):
        yield f'{head} x="{at_x:.3f}" y="{at_y:.3f}" angle="{clockwise:.3f}" {kind} speed="{speed:.3f}"/>\n'
