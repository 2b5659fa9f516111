"""Numbers, points and intervals of a CommonRoad file's elements. Knows nothing of what they are of."""

from __future__ import annotations

import math
from typing import NamedTuple

from vve_sumo.bridges.scenario_import.not_taken import NotTakenError
from vve_sumo.bridges.scenario_import.xml_tree import Element


class Interval(NamedTuple):
    """Numbers from a lowest to a greatest one."""

    low: float
    high: float


def needed(of: Element, *tags: str) -> Element:
    """Return the element at the end of a line of first children; raises NotTakenError where there is none."""
    found = of.child(*tags)
    if found is None:
        raise NotTakenError(of, f"expected a <{'/'.join(tags)}>")
    return found


def number(of: Element, *tags: str) -> float:
    """Return the number in a child; raises NotTakenError for anything that is no finite number."""
    element = needed(of, *tags)
    try:
        value = float(element.text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise NotTakenError(element, f"expected a number, got {element.text.strip()[:40]!r}")
    return value


def exact(of: Element, tag: str) -> float:
    """Return the exact value of a quantity; raises NotTakenError for an interval and for none."""
    quantity = needed(of, tag)
    if quantity.child("exact") is None:
        raise NotTakenError(quantity, "expected an <exact> value")
    return number(quantity, "exact")


def interval(of: Element) -> Interval:
    """Return the values that a quantity may have; an exact one is an interval, too."""
    if of.child("exact") is not None:
        value = number(of, "exact")
        return Interval(value, value)
    return Interval(number(of, "intervalStart"), number(of, "intervalEnd"))


def point(of: Element) -> tuple[float, float]:
    """Return the x, y [m] of an element."""
    return number(of, "x"), number(of, "y")


def points(of: Element) -> list[tuple[float, float]]:
    """Return the points in an element [m], in their order."""
    return [point(one) for one in of.all("point")]
