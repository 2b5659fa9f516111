"""The controllers that a sweep compares, each with its own varied tuning.

Knows names and axes; neither scenarios nor what a controller is. Within a controller the values of
its tuning are combined in full; no controller receives a value of another controller's tuning.
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
    """Return the axes of a controller's tuning; a plain value is a list of one."""
    if not isinstance(raw, dict):
        raise ValueError(f"expected a table of tuning keys, got {raw!r}")
    tuning_axes: dict[str, Choice | Steps] = {}
    for key, axis in axes(
        {key: entry if isinstance(entry, (list, dict)) else [entry] for key, entry in raw.items()}
    ).items():
        if isinstance(axis, NumberRange):
            raise ValueError(f"{key}: expected a value, a list, {{ from, to, step }} or {{ from, to, count }}")
        values = axis.values if isinstance(axis, Choice) else ()
        duplicate = next((value for at, value in enumerate(values) if value in values[:at]), None)
        if duplicate is not None:
            raise ValueError(f"{key}: {duplicate!r} occurs twice, expected each value once")
        tuning_axes[key] = axis
    return tuning_axes


class VariedController(Table):
    """A controller that a sweep drives with, and the combinations of its tuning."""

    name: Name = Field(description="shipped name, file.py:make, or an entry point")
    tuning: Annotated[Mapping[str, Choice | Steps], PlainValidator(_tuning)] = Field(
        default={}, description="keys of this controller's tuning: a value, or what [parameters] takes but { min, max }"
    )

    @property
    def count(self) -> int:
        """Number of combinations of its tuning."""
        return math.prod(axis.count for axis in self.tuning.values())

    def at(self, number: int) -> dict[str, Value]:
        """Return a combination by its number; the last key of the tuning varies fastest."""
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
    """Return the controllers of one sweep, with values of one type under each common key.

    Integers become floats where another controller has floats under the same key. Raises ValueError for a duplicate
    controller, and for a key that is a number in one tuning and not in another.
    """
    names = [one.name for one in controllers]
    duplicate = next((name for at, name in enumerate(names) if name in names[:at]), None)
    if duplicate is not None:
        raise ValueError(f"{duplicate!r} occurs twice, expected each controller once, with lists in its tuning")
    kinds = columns(controllers)
    for one in controllers:
        for key, axis in one.tuning.items():
            if kinds[TUNING + key] != axis.kind and (kinds[TUNING + key], axis.kind) != ("float", "int"):
                raise ValueError(
                    f"{one.name}: {key}: expected the type of value that the key has in another controller"
                )
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
    """Return name and type of the columns that identify a run's controller; none without controllers."""
    kinds: dict[str, Kind] = {NAME: "str"} if controllers else {}
    for one in controllers:
        for key, axis in one.tuning.items():
            if kinds.setdefault(TUNING + key, axis.kind) == "int" and axis.kind == "float":
                kinds[TUNING + key] = "float"
    return kinds


def combinations(controllers: Sequence[VariedController]) -> Iterator[dict[str, Value]]:
    """Yield every controller with every combination of its tuning; where there are no controllers, one empty one."""
    if not controllers:
        yield {}
    for one in controllers:
        yield from map(one.at, range(one.count))
