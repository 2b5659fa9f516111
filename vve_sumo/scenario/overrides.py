"""Lays values into a scenario's table, by the place of a key or by the name that the scenario gives to one.

Knows tables as TOML gives them; not what else a scenario means, and not where values come from.
"""

from __future__ import annotations

import copy
import operator
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, get_origin

from vve_sumo.config_file import alternatives, inside, is_table, key_and_number
from vve_sumo.errors import ConfigError, did_you_mean
from vve_sumo.scenario.schema import Control, Scenario

#: key of the ego's speed, and the parameter by which scenarios declare it
EGO_SPEED, SPEED = "ego.speed_mps", "speed"
#: what a parameter may be set to
Value = bool | int | float | str


def places(table: Mapping[str, Any], name: str) -> tuple[str, ...]:
    """Return the dotted keys that take a parameter's value: those its scenario declares, or the name itself."""
    declared = table.get("parameters", {}).get(name)
    return (name,) if declared is None else tuple(declared["sets"])


def check_bounds(key: str, values: Iterable[object], declared: Mapping[str, Any]) -> None:
    """Raise ConfigError, beginning with `key`, for a value outside the bounds that a scenario declares."""
    for value in values:
        for bound, good in (("min", operator.ge), ("max", operator.le)):
            limit = declared.get(bound)
            if limit is not None and not (isinstance(value, (int, float)) and good(value, limit)):
                raise ConfigError(f"{key}: the scenario declares {bound} {limit:g}, got {value!r}")


def choose(
    table: Mapping[str, Any],
    *,
    seed: int | None = None,
    speed: float | str | None = None,
    controller: str | None = None,
    vehicle: str | None = None,
) -> dict[str, Any]:
    """Return a scenario's table with another seed, speed [m/s], controller or vehicle model, where one is given.

    The speed may be a text with a unit, such as "25 mph".

    Another controller comes without the tuning, which would be no other's. Raises ConfigError for what is no seed; what
    else is wrong is found when the table is parsed.
    """
    if seed is not None and not (type(seed) is int and 0 <= seed < 2**31):
        raise ConfigError(f"seed: expected 0 to 2147483647, got {seed!r}")
    changed: dict[str, Any] = copy.deepcopy(dict(table))
    for key, value in (("seed", seed), ("ego.speed_mps", speed), ("ego.vehicle", vehicle)):
        if value is not None:
            _lay(changed, *numbered(key, value))
    if controller is not None and controller != changed.get("controller", {}).get("name", Control().name):
        changed["controller"] = {"name": controller}
    return changed


def apply_overrides(table: Mapping[str, Any], values: Mapping[str, Any]) -> dict[str, Any]:
    """Return a scenario's table with values laid in; the table handed in stays as it is.

    A part of a dotted key names a table's key, the `id` or `name` of a table in a list, or its number there from 0.
    Tables that the file does not state are made. Raises ConfigError, naming the key, where a part leads nowhere.
    """
    changed: dict[str, Any] = copy.deepcopy(dict(table))
    for name, value in values.items():
        for place in places(table, name):
            _lay(changed, *numbered(place, value))
    return changed


def numbered(place: str, value: Any) -> tuple[str, Any]:
    """Return the dotted key and the number that a quantity such as "25 mph" stands for; other values as they are.

    Raises ConfigError, naming the key, for a unit that is none of the key's.
    """
    kinds: list[Any] = [Scenario]
    *parents, last = place.split(".")
    for part in parents:
        kinds = list(
            alternatives(one for kind in kinds for one in inside(kind, 0 if get_origin(kind) is tuple else part))
        )
    fields = [name for kind in kinds if is_table(kind) for name in kind.model_fields]
    try:
        key, number = key_and_number(last, value, fields)
    except ValueError as error:
        raise ConfigError(f"{place}: {error}") from None
    return ".".join([*parents, key]), number


def checked(table: Mapping[str, Any], values: Mapping[str, Any], where: str) -> dict[str, Any]:
    """Return a scenario's table with values laid in that somebody typed; `where` begins each ConfigError.

    Raises ConfigError for a key that no scenario has, and for a value outside the bounds that the scenario declares;
    what else is wrong is found when the table is parsed.
    """
    for key, value in values.items():
        refuse_unknown(f"{where}{key}", key, table)
        numbers = [numbered(place, value)[1] for place in places(table, key)]
        check_bounds(f"{where}{key}", numbers, table.get("parameters", {}).get(key, {}))
    return apply_overrides(table, values)


def speed_bounds(table: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return the scenario's parameter of the ego's speed, with the bounds that it declares; empty for none.

    Where a scenario declares one, it sets whatever else has to go at that speed, such as the car ahead.
    """
    found: Mapping[str, Any] = table.get("parameters", {}).get(SPEED, {})
    return found if EGO_SPEED in found.get("sets", ()) else {}


def with_speed(table: Mapping[str, Any], speed: float | str) -> dict[str, Any]:
    """Return a scenario's table at another speed of the ego [m/s], which may be a text such as "25 km/h".

    The scenario's parameter `speed` takes it where it sets the ego's speed, else the ego's speed alone. Raises
    ConfigError for a speed outside the bounds that the scenario declares.
    """
    return checked(table, {SPEED if speed_bounds(table) else EGO_SPEED: speed}, "--speed: ")


def refuse_unknown(where: str, name: str, table: Mapping[str, Any]) -> None:
    """Raise ConfigError, beginning with `where`, for a name that neither is declared nor begins a key of a scenario."""
    declared, first = table.get("parameters", {}), name.partition(".")[0]
    if name in declared or first in Scenario.model_fields:
        return
    near = did_you_mean(first, [*declared, *(field for field in Scenario.model_fields if field != "seed")])
    has = f"it declares {', '.join(declared)}" if declared else "it declares no parameters"
    raise ConfigError(f"{where}: unknown to the scenario; {near or has}")


def value_at(table: Mapping[str, Any], place: str) -> Any:
    """Return what stands at a dotted key, whose parts are as in `apply_overrides`; raises ConfigError for nothing."""
    inner: Any = table
    for number, part in enumerate(parts := place.split(".")):
        if isinstance(inner, (list, tuple)):
            inner = inner[_number(inner, part, place, ".".join(parts[:number]))]
        elif isinstance(inner, dict) and part in inner:
            inner = inner[part]
        else:
            near = did_you_mean(part, inner if isinstance(inner, dict) else ())
            raise ConfigError(f"unknown key {place!r}" + (f", {near}" if near else ""))
    return inner


def _lay(table: dict[str, Any], place: str, value: Any) -> None:
    *parents, last = place.split(".")
    inner: Any = table
    for number, part in enumerate(parents):
        before = ".".join(parents[:number])
        inner = inner[_number(inner, part, place, before)] if isinstance(inner, list) else _within(inner, part, place)
    if isinstance(inner, list):
        inner[_number(inner, last, place, ".".join(parents))] = value
    elif isinstance(inner, dict):
        inner[last] = value
    else:
        raise ConfigError(f"{place}: {parents[-1]!r} is a value, not a table")


def _within(table: Any, part: str, place: str) -> Any:
    if not isinstance(table, dict):
        raise ConfigError(f"{place}: {part!r} stands in a value, not in a table")
    return table.setdefault(part, {})


def _number(rows: Sequence[Any], part: str, place: str, before: str) -> int:
    """Return where in a list a part of a key points to: by id or name, else by number."""
    ids = [row.get("id", row.get("name", "")) if isinstance(row, dict) else "" for row in rows]
    if part in ids:
        return ids.index(part)
    if part.isdecimal() and int(part) < len(rows):
        return int(part)
    known = did_you_mean(part, filter(None, ids)) or f"there are {', '.join(filter(None, ids)) or len(rows)}"
    raise ConfigError(f"{place}: no {part!r} in {before}, {known}")
