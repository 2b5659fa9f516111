"""A person in a field of their own, as the tests of this room have them."""

from __future__ import annotations

import math
from dataclasses import replace

from vve_sumo.frames import Alignment
from vve_sumo.people.reports import PositionReport
from vve_sumo.people.setup import PersonSetup, PresenceLimits

LIMITS = PresenceLimits(exact=1.0, warning=12.0, lost=20.0, warning_age=3.0, lost_age=5.0)
LATITUDE, LONGITUDE = math.radians(40.0), math.radians(-83.0)
#: the car's ground: from 60 m east of the anchor on, 100 m long and wide
FENCE = ((60.0, -50.0), (160.0, -50.0), (160.0, 50.0), (60.0, 50.0))
SETUP = PersonSetup(
    id="anna",
    kind="pedestrian",
    length=0.6,
    width=0.5,
    latitude=LATITUDE,
    longitude=LONGITUDE,
    heading=0.0,
    road_heading=0.3,
    alignment=Alignment(math.radians(90.0), 1000.0, 2000.0),
    limits=LIMITS,
    pages=False,
)
FENCED = replace(SETUP, fence=FENCE, least_distance=20.0)
FRAME = SETUP.frame()


def report(time: float, x: float = 0.0, y: float = 0.0, accuracy: float = 0.5, **others: float) -> PositionReport:
    """A position in the field's map."""
    latitude, longitude = FRAME.to_geodetic(x, y)
    return PositionReport("anna", time, latitude, longitude, accuracy, **others)
