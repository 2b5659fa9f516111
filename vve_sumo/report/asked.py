"""What was asked of a drive: its settings, its parameters, its criteria, each beside what came of it.

Knows scenarios as records and sweeps keep them; neither how a drive went nor the page.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from typing import Any

from vve_sumo.metrics.metric import unit_of
from vve_sumo.metrics.table import label_of
from vve_sumo.report.html import Column, Html, folded, sub, table, tag
from vve_sumo.report.tables import about
from vve_sumo.report.words import NONE, asked, flat, number, said, short, with_unit

#: settings that everybody asks for first
MAIN: dict[str, str] = {
    "ego.speed_mps": "speed asked of the car",
    "ego.path": "path",
    "street.network": "street",
    "street.demand": "traffic",
    "controller.name": "controller",
    "weather.friction": "friction of tyre on road",
    "ego.car.gnss_delay_s": "delay of the receiver",
    "ego.car.gnss_hidden_delay_s": "delay that the receiver hides",
    "ego.car.noise_factor": "factor on the receiver's noise",
}
#: parts of a scenario that have a place of their own on the page
ELSEWHERE = frozenset({"title", "description", "criteria", "parameters", "seed"})


def settings(
    scenario: Mapping[str, Any], live: bool, more: Sequence[tuple[str, str]], varied: Collection[str] = ()
) -> Html:
    """Return the settings that matter most as a table, `more` before them, and all of them folded.

    What is said of the hardware-free car is nothing to a `live` drive, whose rig says what its car is. What a sweep
    `varied` is said to be.
    """
    every = dict(flat({key: value for key, value in scenario.items() if key not in ELSEWHERE}))
    rows = [*more, *((name, _value(key, every[key], varied)) for key, name in _main(live) if key in every)]
    rows += [("on the street", text) for text in [_others(scenario)] if text]
    whole = table(
        ("key", "value"), [(tag("code", key), _value(key, value, varied)) for key, value in every.items()], "settings"
    )
    return Html(table(("what", "value"), rows, "main settings") + folded("Every setting", whole))


def varied_keys(scenario: Mapping[str, Any], parameters: Collection[str]) -> set[str]:
    """Return the keys of a scenario that the runs of a sweep differ in, given what its parameters are called."""
    declared = scenario.get("parameters") or {}
    return {key for name in parameters for key in (declared.get(name) or {}).get("sets") or (name,)}


def varied_criteria(scenario: Mapping[str, Any], parameters: Collection[str]) -> set[str]:
    """Return the criteria that ask something else of one run than of another."""
    return {key.split(".")[1] for key in varied_keys(scenario, parameters) if key.startswith("criteria.")}


def _main(live: bool) -> list[tuple[str, str]]:
    return [(key, name) for key, name in MAIN.items() if not (live and key.startswith("ego.car."))]


def _value(key: str, value: object, varied: Collection[str]) -> str:
    if key in varied:
        return f"varied; {with_unit(key, value)} in the scenario"
    if isinstance(value, list):
        return ", ".join(map(short, value)) or NONE
    return NONE if value == {} else with_unit(key, value)


def _others(scenario: Mapping[str, Any]) -> str:
    there = [*(scenario.get("actors") or ()), *(scenario.get("obstacles") or ())]
    return ", ".join(str(one.get("id", "")) for one in there if isinstance(one, Mapping))


def parameters(scenario: Mapping[str, Any]) -> Html:
    """Return the parameters that a scenario declares, with their values."""
    every = dict(flat(scenario))
    rows = []
    for name, one in (scenario.get("parameters") or {}).items():
        keys = one.get("sets") or ()
        value = next((with_unit(key, every[key]) for key in keys if key in every), NONE)
        rows.append((about(tag("code", name), one.get("meaning") or ""), value, ", ".join(keys)))
    columns = ("parameter", Column("value", True), "sets")
    return sub("Parameters", table(columns, rows, "parameters")) if rows else Html("")


def criteria(wanted: Mapping[str, Any], figures: Mapping[str, Any], judged: bool) -> Html:
    """Return the criteria: what each asks, what was reached, and whether that meets it.

    `figures` hold `failed`, the lines of what was not met, where the drive was judged.
    """
    failed = [str(line) for line in figures.get("failed") or ()]
    rows = [
        (label_of(key), asked(key, want), _reached(key, figures.get(key)), _met(key, failed, judged))
        for key, want in wanted.items()
        if want is not None
    ]
    if not rows:
        return sub("Criteria", tag("p", "The scenario states none."))
    columns = ("criterion", "asked", "reached", "met")
    return sub("Criteria", table(columns, rows, "criteria"))


def _reached(key: str, value: object) -> str:
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return NONE
    # With as many digits as the verdict's own lines, so that what just fails does not look as if it passed.
    return number(value, unit_of(key), 3) if isinstance(value, float) else said(key, value)


def _met(key: str, failed: Sequence[str], judged: bool) -> Html:
    if not judged:
        return tag("span", "not judged", class_="quiet")
    missed = any(line.startswith(f"{key} is ") for line in failed)
    return tag("span", "✗ not met", class_="no") if missed else tag("span", "✓ met", class_="yes")
