"""Reads scenario files; every complaint is one line that names file, key, what was expected and what came."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, get_origin

from pydantic import ValidationError

from vve_sumo.config_file import (
    alternatives,
    complaint,
    in_key_units,
    inside,
    is_table,
    numbers_of,
    read,
    short_repr,
    unknown_key,
)
from vve_sumo.errors import ConfigError
from vve_sumo.metrics import port as metrics
from vve_sumo.metrics.own import DeclaredMetrics
from vve_sumo.scenario.egos import alone
from vve_sumo.scenario.schema import Criteria, CriterionBand, EgoSettings, Scenario, SensorSettings
from vve_sumo.scenario.story_schema import Groups
from vve_sumo.sensors import port as sensors
from vve_sumo.units import is_quantity
from vve_sumo.values import EGO


def parse(table: dict[str, Any], file: Path) -> Scenario:
    """Return the scenario that a parsed table holds; `file` is named in the ConfigError of a wrong one.

    An installed metric that a criterion names by its entry point is added to `metrics`. Other files of metrics are not
    read here: whether they bring what the criteria name, `check_criteria` says.
    """
    table = with_installed(table, _unknown_criteria(table), file)
    try:
        scenario = Scenario.model_validate(_with_numbers(numbers_of(table, file, Scenario), file))
    except ValidationError as error:
        raise ConfigError(complaint(file, error, Scenario)) from None
    named = [(one.id, "obstacles") for one in scenario.obstacles]
    named += [(one.id, "actors") for one in scenario.actors]
    named += [(one.id, "people") for one in scenario.people]
    named += [(one.id, "egos") for one in scenario.egos]
    names = [name for name, _where in named]
    for name, where in named:
        if names.count(name) > 1:
            raise ConfigError(f"{file}: {where}: id {name!r} stands twice, expected each once")
        if name == EGO:
            raise ConfigError(f"{file}: {where}: id {EGO!r} is the car's that is tested, expected another")
    _check_stories(scenario, file)
    _check_sensors(scenario.sensors, file, "sensors")
    for one in scenario.egos:
        _check_sensors(one.sensors or (), file, f"egos.{one.id}.sensors")
        try:
            alone(scenario, one)
        except ValidationError as error:
            problem = complaint(file, error, EgoSettings).removeprefix(f"{file}: ").removeprefix("the file: ")
            raise ConfigError(f"{file}: egos.{one.id}: {problem}") from None
    for name, parameter in scenario.parameters.items():
        for place in parameter.sets:
            if not _takes_a_value(scenario, place):
                raise ConfigError(f"{file}: parameters.{name}.sets: no key {short_repr(place)} that takes a value")
    return scenario


def _check_stories(scenario: Scenario, file: Path) -> None:
    """Raise ConfigError where a story, or the end trigger, names a body or an action that there is not."""
    bodies = {EGO, *(actor.id for actor in scenario.actors)}
    stories = {actor.id: actor.story.actions for actor in scenario.actors if actor.story is not None}
    known = {f"{actor}.{action.name}" for actor, actions in stories.items() for action in actions}
    named: list[tuple[str, Groups, Sequence[str | None], Sequence[str]]]
    named = [("end_trigger.when", scenario.end_trigger.when, (), ())]
    for actor, actions in stories.items():
        for one in actions:
            bound = (one.keeps.to if one.keeps else None, one.speed.of if one.speed else None)
            named.append(
                (f"actors.{actor}.story.actions.{one.name}", (*one.armed, *one.when, *one.until), bound, one.ends)
            )
    for where, groups, others, ends in named:
        conditions = [condition for group in groups for condition in group]
        asked = [name for condition in conditions for name in (condition.of, condition.to)]
        for name in (*asked, *others):
            if name is not None and name not in bodies:
                raise ConfigError(f"{file}: {where}: no actor {name!r}, expected {' or '.join(sorted(bodies))}")
        for name in (*ends, *(name for condition in conditions for name in condition.actions or ())):
            if name not in known:
                raise ConfigError(
                    f"{file}: {where}: no action {name!r}, expected {' or '.join(sorted(known)) or 'none'}"
                )


def _check_sensors(wanted: Sequence[SensorSettings], file: Path, where: str) -> None:
    """Raise ConfigError where two of an ego's sensors have one name."""
    called = [sensors.STANDARD, *(sensor.name for sensor in wanted)]
    if len({*called}) < len(called):
        twice = next(name for name in called if called.count(name) > 1)
        whose = f", that of the table [{sensors.STANDARD}]" if twice == sensors.STANDARD else ""
        raise ConfigError(f"{file}: {where}: name {twice!r} stands twice{whose}, expected each once")


def _unknown_criteria(table: dict[str, Any]) -> list[str]:
    criteria = table.get("criteria")
    return [name for name in criteria if name not in Criteria.model_fields] if isinstance(criteria, dict) else []


def with_installed(table: dict[str, Any], names: list[str], file: Path) -> dict[str, Any]:
    """Return a scenario's table whose `metrics` name the installed ones among some names that its criteria use.

    Raises ConfigError for a name that is none where the table names no metrics, which might bring it.
    """
    named = table.get("metrics", [])
    if not names or not isinstance(named, (list, tuple)):
        return table
    there = metrics.installed()
    found = [name for name in names if name in there and name not in named]
    if len(found) < len(names) and not named:
        unknown = next(name for name in names if name not in found)
        raise ConfigError(f"{file}: {unknown_key(f'criteria.{unknown}', unknown, [*Criteria.model_fields])}")
    return table | {"metrics": [*named, *found]} if found else table


def check_criteria(scenario: Scenario, brought: DeclaredMetrics, file: Path) -> None:
    """Raise ConfigError for a criterion that is no metric, none that may judge, or no limit of its metric's kind.

    `brought` are the rows of what the scenario's `metrics` bring.
    """
    judging = {name: row for name, row in brought.per_drive.items() if row.judges}
    for name, wanted in (scenario.criteria.__pydantic_extra__ or {}).items():
        if name not in judging:
            unknown = unknown_key(f"criteria.{name}", name, [*Criteria.model_fields, *judging])
            raise ConfigError(f"{file}: {unknown}")
        if isinstance(wanted, CriterionBand) == (judging[name].kind == "bool"):
            expected = "true or false" if judging[name].kind == "bool" else "a band { min = …, max = … }"
            raise ConfigError(f"{file}: criteria.{name}: expected {expected}")


def _with_numbers(table: dict[str, Any], file: Path) -> dict[str, Any]:
    """Return a scenario's table with the quantities in sensors' settings as numbers, those of further egos, too."""
    converted, egos = _with_sensors_numbers(table, f"{file}: "), table.get("egos")
    if not isinstance(egos, list):
        return converted
    rows = [
        _with_sensors_numbers(one, f"{file}: egos.{n}.") if isinstance(one, dict) else one for n, one in enumerate(egos)
    ]
    return converted | {"egos": rows}


def _with_sensors_numbers(table: dict[str, Any], where: str) -> dict[str, Any]:
    """Return a table with the quantities in its sensors' settings as numbers, by the keys of each one's kind."""
    rows = table.get("sensors")
    if not isinstance(rows, list):
        return table  # which the schema refuses in its own words, if there is anything
    return table | {"sensors": [_with_settings_numbers(row, f"{where}sensors.{n}") for n, row in enumerate(rows)]}


def _with_settings_numbers(row: Any, where: str) -> Any:
    settings = row.get("settings") if isinstance(row, dict) else None
    if not (
        isinstance(settings, dict) and any(map(is_quantity, settings.values())) and isinstance(row.get("kind"), str)
    ):
        return row
    try:
        kind = sensors.load(row["kind"])
    except ConfigError:
        return row  # what is wrong with a kind is said where its sensor is made
    try:
        return row | {"settings": in_key_units(settings, kind)}
    except ValueError as error:
        raise ConfigError(f"{where}.settings.{error}") from None


def _takes_a_value(scenario: Scenario, place: str) -> bool:
    """Whether a dotted key leads to one value of a scenario; tables of an array go by their id, name or number."""
    kinds: list[Any] = [] if place.startswith("parameters.") else [Scenario]
    here: Any = scenario
    for part in place.split("."):
        key: int | str = part
        if isinstance(here, tuple):
            names = [getattr(one, "id", getattr(one, "name", None)) for one in here] + [
                str(number) for number in range(len(here))
            ]
            if part not in names:
                return False
            key = names.index(part) % len(here)
            here = here[key]
        else:
            here = here.get(part) if isinstance(here, dict) else getattr(here, part, None)
        kinds = list(alternatives(one for kind in kinds for one in inside(kind, key)))
    return bool(kinds) and not any(is_table(kind) or get_origin(kind) in (dict, tuple) for kind in kinds)


def load(file: Path) -> Scenario:
    """Return the scenario in a TOML file.

    Raises ConfigError naming the file and what is wrong with it.
    """
    return parse(read(file, "scenario"), file)
