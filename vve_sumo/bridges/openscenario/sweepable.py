"""Which parameters of a file a sweep may vary here: those whose value stands in the scenario as it is.

A parameter is changed a little and the file read again: what follows it exactly, and nothing else, is what it sets.
Knows nothing of what the keys mean.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Mapping
from typing import Any, Final

from vve_sumo.bridges.openscenario.importer import Imported
from vve_sumo.errors import ConfigError

#: by this part a parameter is changed to see what follows it, and by this where it is 0
CHANGE, FROM_ZERO = 0.01, 0.01
#: file parameters that are looked at, at most: each costs one more reading
MOST: Final = 40


def parameters_of(found: Imported, again: Callable[[Mapping[str, str]], Imported]) -> dict[str, dict[str, Any]]:
    """Return the scenario's table of parameters; `again` reads the file with other values."""
    declared: dict[str, dict[str, Any]] = {}
    for name, value in list(found.numbers.items())[:MOST]:
        key = re.sub(r"[^a-z0-9_]+", "_", name.lower()).strip("_")
        if not re.match(r"[a-z]", key) or key in declared or not math.isfinite(value):
            continue
        other = value * (1.0 + CHANGE) if value else FROM_ZERO
        try:
            changed = again({name: repr(other)})
        except ConfigError:
            continue
        places = _followers(found, changed, value, other)
        if places:
            declared[key] = {"sets": places, "meaning": f"{name} of the file"}
    return declared


def _followers(found: Imported, changed: Imported, value: float, other: float) -> list[str]:
    """Return the keys that went from one value to the other, [] where anything else changed as well."""
    before, after = dict(_leaves(found.table)), dict(_leaves(changed.table))
    different = [key for key in before.keys() | after.keys() if before.get(key) != after.get(key)]
    exact = all(_near(before.get(key), value) and _near(after.get(key), other) for key in different)
    same_lines = all(changed.lines.get(name) == points for name, points in found.lines.items())
    same = same_lines and found.decided == changed.decided and found.problems == changed.problems
    return sorted(different) if exact and same else []


def _near(one: object, other: float) -> bool:
    return isinstance(one, float) and math.isclose(one, other, rel_tol=1e-9, abs_tol=1e-4)


def _leaves(table: Any, prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the values of a table by their dotted keys; tables of arrays by id, name or number."""
    if isinstance(table, dict):
        for key, value in table.items():
            yield from _leaves(value, f"{prefix}.{key}" if prefix else key)
    elif isinstance(table, list):
        for number, value in enumerate(table):
            name = value.get("id", value.get("name", number)) if isinstance(value, dict) else number
            yield from _leaves(value, f"{prefix}.{name}")
    else:
        yield prefix, table
