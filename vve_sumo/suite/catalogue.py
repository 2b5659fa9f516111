"""The suites by name; what each is, in a line, and its rows.

Builds scenarios; runs nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import NamedTuple

from vve_sumo.errors import ConfigError
from vve_sumo.suite import cacc, euroncap, fmvss127, fmvss127_pedestrian, r152, r157, vru
from vve_sumo.suite.row import SuiteRow
from vve_sumo.vehicle.model import VehicleModel


class Suite(NamedTuple):
    """A suite before its rows are built."""

    title: str
    rows: Callable[[VehicleModel], Iterator[SuiteRow]]


SUITES = {
    "r152": Suite("UN R152 (M1), 00 series: cars that stand or move, a child that crosses; false reaction", r152.rows),
    "r152_01": Suite("UN R152 (M1), changes of the 01 series: a child that crosses", r152.rows_01),
    "r152_02": Suite("UN R152 (M1), additions of the 02 series: a bicycle that crosses (limits assumed)", r152.rows_02),
    "fmvss127": Suite("FMVSS 127: a car ahead that stands, drives slower, brakes", fmvss127.lead_rows),
    "fmvss127_pedestrian": Suite("FMVSS 127: a pedestrian who crosses, stands, walks ahead", fmvss127_pedestrian.rows),
    "pass_through": Suite("FMVSS 127: no braking between two cars beside the path", fmvss127.pass_through_rows),
    "euroncap": Suite("Euro NCAP 2023 CCRs, CCRm, CCRb, one overlap for all; passed without contact", euroncap.rows),
    "r157": Suite("UN R157: a car cuts in as late as has to be avoided", r157.cut_in_rows),
    "following": Suite("UN R157: the distance kept behind a steady car", r157.following_rows),
    "vru": Suite("bicyclists and pedestrians: braked for, steered around, both", vru.rows),
    "cacc": Suite("platoons of five by ACC and CACC: following, string stability, lost messages", cacc.rows),
}


def names() -> tuple[str, ...]:
    """Return the suites' names."""
    return tuple(SUITES)


def rows(name: str, car: VehicleModel) -> list[SuiteRow]:
    """Return a suite's rows for a car; raises ConfigError where there is no such suite."""
    if name not in SUITES:
        raise ConfigError(f"no suite named {name!r}; known: {', '.join(SUITES)}")
    return list(SUITES[name].rows(car))
