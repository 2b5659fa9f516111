"""Numbers, settings and criteria as text that people read.

Knows units of names; neither HTML nor where a value comes from.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping
from typing import Any

from vve_sumo.metrics.metric import unit_of

#: text that stands for a number that is not there
NONE = "none"
#: between a number and its unit, which stay in one line
SPACE = "\u00a0"
MINUS = "\u2212"


def number(value: float, unit: str = "", digits: int | None = None) -> str:
    """Return a number with its unit; NaN is `none`, numbers below 0.1 keep three decimals."""
    if not math.isfinite(value):
        return NONE if math.isnan(value) else (f"{MINUS}∞" if value < 0.0 else "∞")
    places = digits if digits is not None else (2 if abs(value) >= 0.1 or value == 0.0 else 3)
    text = f"{value:.{places}f}"
    text = text.replace("-", MINUS if float(text) else "")
    return f"{text}{SPACE}{unit}" if unit else text


def short(value: object) -> str:
    """Return a value of a setting or parameter without its unit; numbers have six digits at most."""
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return NONE
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.6g}".replace("-", MINUS)
    return str(value) if isinstance(value, str | int) else json.dumps(value, ensure_ascii=False)


def integer(value: int) -> str:
    """Return an integer with its thousands apart."""
    return f"{value:,}".replace(",", "\u2009")


def figure(key: str, value: object) -> str:
    """Return the value of a figure with the unit that its key ends in."""
    if isinstance(value, int) and not isinstance(value, bool):
        return integer(value)
    return number(value, unit_of(key)) if isinstance(value, float) else short(value)


def setting(key: str, value: object) -> str:
    """Return the value of a setting with the unit that its key ends in."""
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    return f"{short(value)}{SPACE}{unit_of(key)}".rstrip() if is_number else short(value)


def criterion(key: str, required: object) -> str:
    """Return what a criterion asks for: a truth value, a word or a band with `min` and `max`."""
    if not isinstance(required, Mapping):
        return short(required)
    low, high = required.get("min"), required.get("max")
    if low is None or high is None:
        return f"at most {setting(key, high)}" if low is None else f"at least {setting(key, low)}"
    return f"{short(low)} to {setting(key, high)}"


def flatten(settings: Mapping[str, Any], stem: str = "") -> Iterator[tuple[str, object]]:
    """Return settings as dotted keys with their values; a member of a list goes by its `id`, else by its number."""
    for key, value in settings.items():
        name = f"{stem}{key}"
        inner = value
        if isinstance(value, list) and value and all(isinstance(one, Mapping) for one in value):
            inner = {str(one.get("id") or index): one for index, one in enumerate(value)}
        if isinstance(inner, Mapping) and inner:
            yield from flatten(inner, f"{name}.")
        else:
            yield name, ({} if isinstance(inner, Mapping) else value)


def count(many: int, one: str, more: str = "") -> str:
    """Return how many there are of something: 1 run, 2 runs."""
    return f"{integer(many)} {one if many == 1 else more or one + 's'}"


def share(part: float) -> str:
    """Return a share in percent, to a tenth; 100 % and 0 % only where the share is exactly that."""
    if not 0.0 <= part <= 1.0:
        return NONE
    percent = 100.0 * part if part in (0.0, 1.0) else min(max(100.0 * part, 0.1), 99.9)
    return f"{percent:.1f} %".replace(".0 %", " %")
