"""The settings of a drive: what was set, its parameters, its criteria, each beside the result.

Knows scenarios as records and sweeps keep them; neither how a drive went nor the page.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from typing import Any

from vve_sumo.metrics.metric import unit_of
from vve_sumo.report import formatting
from vve_sumo.report.formatting import NONE, flatten, number, short
from vve_sumo.report.tables import Cell, Column, ReportTable, named

#: settings that a reader looks for first
MAIN: dict[str, str] = {
    "ego.speed_mps": "set speed of the car",
    "ego.path": "path",
    "road.network": "road network",
    "road.demand": "traffic",
    "controller.name": "controller",
    "weather.friction": "tyre-road friction coefficient",
    "ego.car.gnss_delay_s": "delay of the receiver",
    "ego.car.gnss_hidden_delay_s": "delay that the receiver hides",
    "ego.car.noise_factor": "factor on the receiver's noise",
}
#: parts of a scenario that have a place of their own on the page
ELSEWHERE = frozenset({"title", "description", "criteria", "parameters", "seed"})


def main_settings(
    scenario: Mapping[str, Any], live: bool, more: Sequence[tuple[str, str]], varied: Collection[str] = ()
) -> ReportTable:
    """Return the settings that matter most, `more` before them; those that a sweep `varied` are marked so.

    Settings of the simulated vehicle are left out of a `live` drive, whose rig says what its car is.
    """
    values = _values(scenario)
    shown = [(key, name) for key, name in MAIN.items() if key in values and not (live and key.startswith("ego.car."))]
    rows = [*more, *((name, _value(key, values[key], varied)) for key, name in shown)]
    if others := _others(scenario):
        rows.append(("on the road", others))
    return ReportTable("main settings", ("what", "value"), rows)


def every_setting(scenario: Mapping[str, Any], varied: Collection[str] = ()) -> ReportTable:
    """Return all settings; those that a sweep `varied` are marked so."""
    rows = [(Cell(key, kind="code"), _value(key, value, varied)) for key, value in _values(scenario).items()]
    return ReportTable("settings", ("key", "value"), rows)


def varied_keys(scenario: Mapping[str, Any], parameters: Collection[str]) -> set[str]:
    """Return the keys of a scenario that the runs of a sweep differ in, given the names of its parameters."""
    declared = scenario.get("parameters") or {}
    return {key for name in parameters for key in (declared.get(name) or {}).get("sets") or (name,)}


def varied_criteria(scenario: Mapping[str, Any], parameters: Collection[str]) -> set[str]:
    """Return the criteria whose limits differ from run to run."""
    return {key.split(".")[1] for key in varied_keys(scenario, parameters) if key.startswith("criteria.")}


def _values(scenario: Mapping[str, Any]) -> dict[str, object]:
    return dict(flatten({key: value for key, value in scenario.items() if key not in ELSEWHERE}))


def _value(key: str, value: object, varied: Collection[str]) -> str:
    if key in varied:
        return f"varied; {formatting.setting(key, value)} in the scenario"
    if isinstance(value, list):
        return ", ".join(map(short, value)) or NONE
    return NONE if value == {} else formatting.setting(key, value)


def _others(scenario: Mapping[str, Any]) -> str:
    others = [*(scenario.get("actors") or ()), *(scenario.get("obstacles") or ())]
    return ", ".join(str(one.get("id", "")) for one in others if isinstance(one, Mapping))


def parameters(scenario: Mapping[str, Any]) -> ReportTable:
    """Return the parameters that a scenario declares, with their values."""
    values = dict(flatten(scenario))
    rows = []
    for name, declared in (scenario.get("parameters") or {}).items():
        keys = declared.get("sets") or ()
        value = next((formatting.setting(key, values[key]) for key in keys if key in values), NONE)
        rows.append((Cell(name, str(declared.get("meaning") or ""), "code"), value, ", ".join(keys)))
    return ReportTable("parameters", ("parameter", Column("value", True), "sets"), rows)


def criteria(required: Mapping[str, Any], figures: Mapping[str, Any], judged: bool) -> ReportTable:
    """Return the criteria: what was found, what each asks, and whether that meets it.

    `figures` hold `failed`, the lines of what was not met, where the drive was judged.
    """
    failed = [str(line) for line in figures.get("failed") or ()]
    rows = [
        (named(key), _reached(key, figures.get(key)), formatting.criterion(key, want), _met(key, failed, judged))
        for key, want in required.items()
        if want is not None
    ]
    return ReportTable("criteria", ("criterion", "found", "asked", "met"), rows)


def _reached(key: str, value: object) -> str:
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return NONE
    # With as many digits as the verdict's own lines, so that what just fails does not look as if it passed.
    return number(value, unit_of(key), 3) if isinstance(value, float) else formatting.figure(key, value)


def _met(key: str, failed: Sequence[str], judged: bool) -> Cell:
    if not judged:
        return Cell("not judged", kind="quiet")
    missed = any(line.startswith(f"{key} is ") for line in failed)
    return Cell("✗ not met", kind="no") if missed else Cell("✓ met", kind="yes")
