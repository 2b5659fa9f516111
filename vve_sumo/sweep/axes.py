"""The values of one parameter of a sweep: a list, steps between two ends, or a range to draw from.

Knows numbers; nothing of scenarios, files or designs. Steps are counted in fractions, so that 0.1, 0.2, 0.3 are exact,
and no list of them is kept in memory.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from decimal import Decimal
from fractions import Fraction
from typing import Any

from vve_sumo.metrics.metric import Kind
from vve_sumo.scenario.overrides import Value

#: keys of an axis' table: those of steps, and those of a range
STEPS, BETWEEN = ("from", "to", "step", "count"), ("min", "max", "log")

EXPECTED = "expected a list, { from, to, step }, { from, to, count } or { min, max }"

_MAX_INTEGER = 2**63


@dataclass(frozen=True, slots=True)
class Choice:
    """One of several values."""

    values: tuple[Value, ...]
    kind: Kind

    @property
    def count(self) -> int:
        """Number of values."""
        return len(self.values)

    def __getitem__(self, number: int) -> Value:
        return self.values[number]

    def ends(self) -> tuple[Value, ...]:
        """Return the values to try before a sweep: the outermost numbers, or every text."""
        if self.kind in ("bool", "str"):
            return self.values
        numbers = [value for value in self.values if not isinstance(value, str)]
        return (min(numbers), max(numbers))


@dataclass(frozen=True, slots=True)
class Steps:
    """Numbers at equal distances."""

    start: Fraction
    step: Fraction
    count: int  #: which may be more than a list could hold
    kind: Kind

    def __getitem__(self, number: int) -> Value:
        exact = self.start + number * self.step
        return int(exact) if self.kind == "int" else float(exact)

    def ends(self) -> tuple[Value, ...]:
        """Return the values to try before a sweep."""
        return (self[0], self[self.count - 1])


@dataclass(frozen=True, slots=True)
class NumberRange:
    """A range of numbers to draw from; `log` draws evenly in the logarithm."""

    low: float
    high: float
    log: bool
    kind: Kind = "float"

    def at(self, share: float) -> float:
        """Return the number at a share of the range, 0 to 1; bit-identical on every processor."""
        if self.log:
            # Decimal arithmetic uses integers, so it does not depend on a mathematics library's last bit.
            value = float(Decimal(self.low) * (Decimal(self.high) / Decimal(self.low)) ** Decimal(share))
        else:
            value = self.low + share * (self.high - self.low)
        return min(max(value, self.low), self.high)

    def ends(self) -> tuple[Value, ...]:
        """Return the values to try before a sweep."""
        return (self.low, self.high)


Axis = Choice | Steps | NumberRange


def axes(raw: object) -> dict[str, Axis]:
    """Return the axes of a `[parameters]` table, by dotted key, in its order.

    Keys may be quoted or not: `"ego.speed_mps" = …` is the same as `ego.speed_mps = …`. Raises ValueError naming the
    key.
    """
    if not isinstance(raw, dict):
        raise ValueError(f"expected a table, got {raw!r}")
    by_key: dict[str, Axis] = {}
    for key, entry in flattened(raw):
        if key in by_key:
            raise ValueError(f"{key}: occurs twice, expected each key once")
        by_key[key] = _axis(key, entry)
    return by_key


def flattened(table: Mapping[str, Any], before: str = "") -> Iterator[tuple[str, object]]:
    """Yield the entries of a `[parameters]` table by dotted key; raises ValueError for an empty table."""
    for key, entry in table.items():
        if isinstance(entry, dict) and (not entry or any(isinstance(one, (dict, list)) for one in entry.values())):
            if not entry:
                raise ValueError(f"{before}{key}: is empty, {EXPECTED}")
            yield from flattened(entry, f"{before}{key}.")
        else:
            yield f"{before}{key}", entry


def _axis(key: str, entry: object) -> Axis:
    if isinstance(entry, list):
        return _choice(key, entry)
    if not isinstance(entry, dict):
        raise ValueError(f"{key}: {EXPECTED}, got {entry!r}")
    unknown = next((one for one in entry if one not in (*STEPS, *BETWEEN)), None)
    if unknown is not None:
        raise ValueError(f"{key}: unknown key {unknown!r}, {EXPECTED}")
    return _steps(key, entry) if "from" in entry or "to" in entry else _between(key, entry)


def _choice(key: str, entry: list[Any]) -> Choice:
    if not entry:
        raise ValueError(f"{key}: the list is empty, expected at least one value")
    kinds = {type(value) for value in entry}
    if kinds == {int, float}:
        entry, kinds = [float(value) for value in entry], {float}
    if len(kinds) != 1 or not kinds <= {bool, int, float, str}:
        raise ValueError(f"{key}: expected numbers, texts or true and false, one kind of them, got {entry!r}")
    for value in entry:
        _check_number(key, value)
    kind: Kind = {bool: "bool", int: "int", float: "float", str: "str"}[kinds.pop()]  # type: ignore[assignment]
    return Choice(tuple(entry), kind)


def _check_number(key: str, value: Value) -> None:
    if isinstance(value, float) and not math.isfinite(value):
        raise ValueError(f"{key}: expected finite numbers, got {value!r}")
    if isinstance(value, int) and not -_MAX_INTEGER <= value < _MAX_INTEGER:
        raise ValueError(f"{key}: expected an integer of 64 bits, got {value}")


def _numbers(key: str, entry: Mapping[str, Any], names: tuple[str, ...], where: str) -> list[int | float]:
    if set(entry) - {"log"} != set(names):
        raise ValueError(f"{key}: {where}, got {', '.join(entry)}")
    for name in names:
        if isinstance(entry[name], bool) or not isinstance(entry[name], (int, float)):
            raise ValueError(f"{key}: {name}: expected a number, got {entry[name]!r}")
        _check_number(key, entry[name])
    return [entry[name] for name in names]


def _steps(key: str, entry: Mapping[str, Any]) -> Steps:
    third = "count" if "count" in entry else "step"
    start, end, last = _numbers(key, entry, ("from", "to", third), "expected from, to and one of step and count")
    if "log" in entry:
        raise ValueError(f"{key}: log: expected min and max with it, got from and to")
    first, reach = _exact(start), _exact(end) - _exact(start)
    if reach < 0:
        raise ValueError(f"{key}: expected from <= to, got from {start:g}, to {end:g}")
    if third == "step":
        step = _exact(last)
        if step <= 0:
            raise ValueError(f"{key}: step: expected a number above 0, got {last!r}")
        count = reach // step + 1
    else:
        if not isinstance(last, int) or last < 2 or reach == 0:
            raise ValueError(f"{key}: count: expected 2 or more values between two different ends, got {last!r}")
        count, step = last, reach / (last - 1)
    integers = isinstance(start, int) and isinstance(end, int) and step.denominator == 1 and not isinstance(last, float)
    return Steps(first, step, count, "int" if integers else "float")


def _exact(number: int | float) -> Fraction:
    """Return a number exactly as written: 0.1 is a tenth."""
    return Fraction(repr(number))


def _between(key: str, entry: Mapping[str, Any]) -> NumberRange:
    low, high = _numbers(key, entry, ("min", "max"), EXPECTED)
    log = entry.get("log", False)
    if not isinstance(log, bool):
        raise ValueError(f"{key}: log: expected true or false, got {log!r}")
    if not low < high:
        raise ValueError(f"{key}: expected min < max, got min {low:g}, max {high:g}")
    if log and not low > 0:
        raise ValueError(f"{key}: min: expected a number above 0 for log, got {low:g}")
    return NumberRange(float(low), float(high), log)
