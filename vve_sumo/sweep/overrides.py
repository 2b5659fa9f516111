"""Lays values into a scenario's table, by the place of a key or by the name that the scenario gives to one.

Knows tables as TOML gives them; not what a scenario means, and not where values come from.
"""

from __future__ import annotations

import copy
from collections.abc import Mapping
from difflib import get_close_matches
from typing import Any

from vve_sumo.errors import ConfigError

#: what a parameter may be set to
Value = bool | int | float | str


def places(table: Mapping[str, Any], name: str) -> tuple[str, ...]:
    """Return the dotted keys that take a parameter's value: those its scenario declares, or the name itself."""
    declared = table.get("parameters", {}).get(name)
    return (name,) if declared is None else tuple(declared["sets"])


def apply_overrides(table: Mapping[str, Any], values: Mapping[str, Value]) -> dict[str, Any]:
    """Return a scenario's table with values laid in; the table handed in stays as it is.

    A part of a dotted key names a table's key, the `id` of a table in a list, or its number there from 0. Tables that
    the file does not state are made. Raises ConfigError, naming the key, where a part leads nowhere.
    """
    changed: dict[str, Any] = copy.deepcopy(dict(table))
    for name, value in values.items():
        for place in places(table, name):
            _lay(changed, place, value)
    return changed


def _lay(table: dict[str, Any], place: str, value: Value) -> None:
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


def _number(rows: list[Any], part: str, place: str, before: str) -> int:
    """Return where in a list a part of a key points to: by id, else by number."""
    ids = [row.get("id", "") if isinstance(row, dict) else "" for row in rows]
    if part in ids:
        return ids.index(part)
    if part.isdecimal() and int(part) < len(rows):
        return int(part)
    near = get_close_matches(part, [one for one in ids if one], 1, 0.6)
    known = f"did you mean {near[0]!r}?" if near else f"there are {', '.join(filter(None, ids)) or len(rows)}"
    raise ConfigError(f"{place}: no {part!r} in {before}, {known}")
