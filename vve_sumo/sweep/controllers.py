"""The controllers that a sweep compares: each with a tuning of its own, varied by itself.

Knows names and axes; neither scenarios nor what a controller is. Within a controller every value of its tuning goes
with every other; no value of one controller's tuning is ever handed to another controller.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Annotated, Final

from pydantic import Field, PlainValidator

from vve_sumo.config_file import Name, Table
from vve_sumo.metrics.metric import Kind
from vve_sumo.scenario.overrides import Value
from vve_sumo.sweep.axes import Choice, NumberRange, Steps, axes

#: keys of the scenario, and columns of a row, under which a controller's name and its tuning stand
NAME: Final = "controller.name"
TUNING: Final = "controller.tuning."

Values = Mapping[str, Value]


def _tuning(raw: object) -> Mapping[str, Choice | Steps]:
    """Return the axes that a controller's tuning says; a plain value is a list of one."""
    if not isinstance(raw, dict):
        raise ValueError(f"expected a table of tuning keys, got {raw!r}")
    found: dict[str, Choice | Steps] = {}
    for key, axis in axes(
        {key: said if isinstance(said, (list, dict)) else [said] for key, said in raw.items()}
    ).items():
        if isinstance(axis, NumberRange):
            raise ValueError(f"{key}: expected a value, a list, {{ from, to, step }} or {{ from, to, count }}")
        values = axis.values if isinstance(axis, Choice) else ()
        twice = next((value for at, value in enumerate(values) if value in values[:at]), None)
        if twice is not None:
            raise ValueError(f"{key}: {twice!r} stands twice, expected each value once")
        found[key] = axis
    return found


class VariedController(Table):
    """A controller that a sweep drives with, and the combinations of its tuning."""

    name: Name = Field(description="shipped name, file.py:make, or an entry point")
    tuning: Annotated[Mapping[str, Choice | Steps], PlainValidator(_tuning)] = Field(
        default={}, description="keys of this controller's tuning: a value, or what [parameters] takes but { min, max }"
    )

    @property
    def count(self) -> int:
        """How many combinations of its tuning there are."""
        return math.prod(axis.count for axis in self.tuning.values())

    def at(self, number: int) -> dict[str, Value]:
        """Return a combination by its number; the last key of the tuning goes round fastest."""
        chosen: dict[str, Value] = {}
        for key, axis in reversed(list(self.tuning.items())):
            number, place = divmod(number, axis.count)
            chosen[TUNING + key] = axis[place]
        return {NAME: self.name, **dict(reversed(chosen.items()))}

    def trials(self) -> Iterator[dict[str, Value]]:
        """Yield the combinations to try before a sweep: a corner, and the other end of each axis."""
        corner: dict[str, Value] = {NAME: self.name}
        corner |= {TUNING + key: axis.ends()[0] for key, axis in self.tuning.items()}
        yield corner
        for key, axis in self.tuning.items():
            yield from (corner | {TUNING + key: value} for value in axis.ends()[1:])


def compared(controllers: tuple[VariedController, ...]) -> tuple[VariedController, ...]:
    """Return controllers that may stand in one sweep, keys that several of them have being of one kind of value.

    Whole numbers become floats where another controller has floats under the same key. Raises ValueError for a
    controller that is there twice, and for a key that is a number in one tuning and none in another.
    """
    names = [one.name for one in controllers]
    twice = next((name for at, name in enumerate(names) if name in names[:at]), None)
    if twice is not None:
        raise ValueError(f"{twice!r} stands twice, expected each controller once, with lists in its tuning")
    kinds = columns(controllers)
    for one in controllers:
        for key, axis in one.tuning.items():
            if kinds[TUNING + key] != axis.kind and (kinds[TUNING + key], axis.kind) != ("float", "int"):
                raise ValueError(f"{one.name}: {key}: expected the kind of value that it has in another controller")
    return tuple(
        one.model_copy(update={"tuning": {key: _as(axis, kinds[TUNING + key]) for key, axis in one.tuning.items()}})
        for one in controllers
    )


def _as(axis: Choice | Steps, kind: Kind) -> Choice | Steps:
    if axis.kind == kind:
        return axis
    if isinstance(axis, Steps):
        return replace(axis, kind=kind)
    return Choice(tuple(map(float, axis.values)), kind)


def columns(controllers: Sequence[VariedController]) -> dict[str, Kind]:
    """Return name and kind of the columns that tell runs by their controller; none where there are no controllers."""
    found: dict[str, Kind] = {NAME: "str"} if controllers else {}
    for one in controllers:
        for key, axis in one.tuning.items():
            if found.setdefault(TUNING + key, axis.kind) == "int" and axis.kind == "float":
                found[TUNING + key] = "float"
    return found


def combinations(controllers: Sequence[VariedController]) -> Iterator[dict[str, Value]]:
    """Yield every controller with every combination of its tuning; where there are no controllers, one empty one."""
    if not controllers:
        yield {}
    for one in controllers:
        yield from map(one.at, range(one.count))
