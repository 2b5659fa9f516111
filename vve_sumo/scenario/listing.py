"""The scenarios that there are, a row each: what it is, where, who is there, what a drive must come to."""

from __future__ import annotations

from pathlib import Path

from vve_sumo import workspace
from vve_sumo.errors import ConfigError
from vve_sumo.scenario import descriptions
from vve_sumo.scenario.load import load
from vve_sumo.scenario.schema import Scenario

COLUMNS = ("name", "title", "network", "who else is there", "passes if")

Row = tuple[str, str, str, str, str]


def listing(working: Path) -> tuple[list[Row], list[str]]:
    """Return a row of COLUMNS for every scenario, and a line for every file that holds none."""
    rows: list[Row] = []
    wrong: list[str] = []
    for name, file in workspace.known("scenario", working).items():
        try:
            rows.append(row_of(name, load(file)))
        except ConfigError as error:
            wrong.append(str(error))
    return rows, wrong


def row_of(name: str, scenario: Scenario) -> Row:
    """Return the row of one scenario."""
    return (
        name,
        scenario.title,
        scenario.road.network,
        descriptions.others(scenario),
        descriptions.passes(scenario.criteria),
    )
