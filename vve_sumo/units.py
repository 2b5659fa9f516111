"""Quantities as people write them, such as "25 mph": what each is in the unit that a key's name ends in.

Knows units and endings of keys; nothing of files or of what a key is about. Conversions are
exact but for one rounding.
"""

from __future__ import annotations

import re
from fractions import Fraction
from typing import Final, NamedTuple


class Dimension(NamedTuple):
    """Units of one kind of quantity."""

    name: str
    units: dict[str, Fraction]  #: each in the unit that a key's name ends in


_MILE, _FOOT, _POUND = Fraction("1609.344"), Fraction("0.3048"), Fraction("0.45359237")  # international, NIST SP 811
_SPEED = {
    "m/s": Fraction(1),
    "km/h": Fraction(1000, 3600),
    "kph": Fraction(1000, 3600),
    "kmh": Fraction(1000, 3600),
    "mph": _MILE / 3600,
    "mi/h": _MILE / 3600,
    "ft/s": _FOOT,
    "kn": Fraction(1852, 3600),
}
_LENGTH = {
    "m": Fraction(1),
    "mm": Fraction(1, 1000),
    "cm": Fraction(1, 100),
    "km": Fraction(1000),
    "in": _FOOT / 12,
    "ft": _FOOT,
    "mi": _MILE,
}
_TIME = {"s": Fraction(1), "ms": Fraction(1, 1000), "min": Fraction(60), "h": Fraction(3600)}
_ACCELERATION = {"m/s2": Fraction(1), "m/s²": Fraction(1), "m/s^2": Fraction(1), "g": Fraction("9.80665")}
_ANGLE = {"deg": Fraction(1), "°": Fraction(1), "rad": Fraction("57.295779513082320877")}
_MASS = {"kg": Fraction(1), "t": Fraction(1000), "lb": _POUND}

#: endings of keys, and what may be written there
DIMENSIONS: Final = {
    "_mps": Dimension("speed", _SPEED),
    "_m": Dimension("length", _LENGTH),
    "_s": Dimension("time", _TIME),
    "_mps2": Dimension("acceleration", _ACCELERATION),
    "_deg": Dimension("angle", _ANGLE),
    "_kg": Dimension("mass", _MASS),
}

_QUANTITY = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d{1,2})?)\s*([^\s\d.+-].*?)\s*")


def dimension_of(key: str) -> Dimension | None:
    """Return what a key's name says that it holds; None for a name without one of the endings."""
    stem, _, ending = key.rpartition("_")
    return DIMENSIONS.get(f"_{ending}") if stem else None


def is_quantity(value: object) -> bool:
    """Return whether a value is a text of a number and a unit, known or not."""
    return isinstance(value, str) and _QUANTITY.fullmatch(value) is not None


def converted(text: str, dimension: Dimension) -> float:
    """Return a quantity in the unit of a key; raises ValueError for a unit that is not one of its dimension."""
    found = _QUANTITY.fullmatch(text)
    factor = dimension.units.get(found[2]) if found else None
    if found is None or factor is None:
        raise ValueError(f"expected a {dimension.name} in {', '.join(dimension.units)}, got {text!r}")
    return float(Fraction(found[1]) * factor)
