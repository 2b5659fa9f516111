"""Numbers, settings and verdicts in the words that people read.

Knows units of names; neither HTML nor where a value comes from.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping
from typing import Any

from vve_sumo.metrics.metric import unit_of

#: where a text stands for a number that is not there
NONE = "none"
#: between a number and its unit, which stay in one line
SPACE = "\u00a0"
MINUS = "\u2212"


def number(value: float, unit: str = "", digits: int | None = None) -> str:
    """Return a number with its unit; what is not there is `none`, small numbers keep three decimals."""
    if not math.isfinite(value):
        return NONE if math.isnan(value) else (f"{MINUS}∞" if value < 0.0 else "∞")
    places = digits if digits is not None else (2 if abs(value) >= 0.1 or value == 0.0 else 3)
    said = f"{value:.{places}f}".replace("-", MINUS)
    said = said.removeprefix(MINUS) if not float(f"{value:.{places}f}") else said
    return f"{said}{SPACE}{unit}" if unit else said


def short(value: object) -> str:
    """Return a value of a setting or parameter as briefly as it can be said without loss for people."""
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return NONE
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.6g}".replace("-", MINUS)
    return str(value) if isinstance(value, str | int) else json.dumps(value, ensure_ascii=False)


def said(key: str, value: object) -> str:
    """Return a figure's value with the unit that its key ends in."""
    if isinstance(value, bool) or value is None or isinstance(value, str):
        return short(value)
    if isinstance(value, int):
        return f"{value:,}".replace(",", "\u2009")
    return number(float(value), unit_of(key)) if isinstance(value, float) else short(value)


def with_unit(key: str, value: object) -> str:
    """Return a setting's value with the unit that its key ends in."""
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    return f"{short(value)}{SPACE}{unit_of(key)}".rstrip() if is_number else short(value)


def asked(key: str, wanted: object) -> str:
    """Return what a criterion asks for: a truth value, a word or a band with `min` and `max`."""
    if not isinstance(wanted, Mapping):
        return short(wanted)
    low, high = wanted.get("min"), wanted.get("max")
    if low is None or high is None:
        return f"at most {with_unit(key, high)}" if low is None else f"at least {with_unit(key, low)}"
    return f"{short(low)} to {with_unit(key, high)}"


def flat(settings: Mapping[str, Any], stem: str = "") -> Iterator[tuple[str, object]]:
    """Return settings as dotted keys with their values; a member of a list goes by its `id`, else by its number."""
    for key, value in settings.items():
        name = f"{stem}{key}"
        inner = value
        if isinstance(value, list) and value and all(isinstance(one, Mapping) for one in value):
            inner = {str(one.get("id") or count): one for count, one in enumerate(value)}
        if isinstance(inner, Mapping) and inner:
            yield from flat(inner, f"{name}.")
        else:
            yield name, ({} if isinstance(inner, Mapping) else value)


def count(many: int, one: str, more: str = "") -> str:
    """Return how many there are of something: 1 run, 2 runs."""
    return f"{said('', many)} {one if many == 1 else more or one + 's'}"


def share(part: float) -> str:
    """Return a share in percent, to a tenth; a whole or nothing only where it is just that."""
    if not 0.0 <= part <= 1.0:
        return NONE
    told = 100.0 * part if part in (0.0, 1.0) else min(max(100.0 * part, 0.1), 99.9)
    return f"{told:.1f} %".replace(".0 %", " %")
