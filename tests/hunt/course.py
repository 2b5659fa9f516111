"""The course that the hunt's tests drive on: the paper's drive in the simulated rig's lot."""

from __future__ import annotations

from functools import cache

from tests.conftest import REPOSITORY
from vve_sumo.hunt.run import course_of
from vve_sumo.hunt.simulation import HuntSetup


@cache
def course() -> HuntSetup:
    """Return the course; read once."""
    return course_of("parked_car", "simulated", REPOSITORY)[0]
