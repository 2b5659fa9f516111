"""What a metric is: a row with its name, unit, label, meaning, the way in which it is worse, and its source.

A `MetricTable` holds the rows of one kind of subject in their order, each beside the function that measures it. Knows
names; nothing of drives.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, fields
from typing import Any, Generic, Literal, Self, TypeVar

#: ending of a column's name and the unit that it stands for; the longer one is meant where two fit
UNITS: dict[str, str] = {
    "_s": "s",
    "_s2": "s²",
    "_ms": "ms",
    "_m": "m",
    "_m2": "m²",
    "_mps": "m/s",
    "_mps2": "m/s²",
    "_mps3": "m/s³",
    "_mps1p5": "m/s¹·⁵",
    "_m_s": "m/s",  # of controllers' tuning keys
    "_m_s2": "m/s²",
    "_per_s": "1/s",
    "_per_s2": "1/s²",
    "_rad_per_m": "rad/m",
    "_rad": "rad",
    "_radps": "rad/s",
    "_deg": "°",
    "_nm": "N m",
    "_kg": "kg",
    "_mb": "MB",
    "_percent": "%",
    "_share": "",
}

#: source of a metric that no publication defines in this way
OURS = "this project"

#: of a value
Kind = Literal["bool", "int", "float", "str"]

Subject = TypeVar("Subject")


def unit_of(name: str) -> str:
    """Return the unit that a column's name ends in; empty for a number without one, a text, a truth value."""
    return UNITS.get(ending_of(name), "")


def ending_of(name: str) -> str:
    """Return the ending of a column's name that stands for its unit; empty for none."""
    return max((ending for ending in UNITS if name.endswith(ending)), key=len, default="")


@dataclass(frozen=True, slots=True)
class Metric:
    """A row of a table of metrics."""

    name: str  #: with its unit's ending, as in files and columns
    label: str  #: for axes and tables, without the unit
    meaning: str  #: one sentence without its full stop
    worse: Literal["lower", "higher"] | None = None  #: which way it is worse; None for neither
    source: str = OURS  #: paper, standard or program that defines it
    kind: Kind = "float"
    criterion: bool = True  #: whether a scenario's criteria may judge a drive by it
    absent: float = math.nan  #: what a criterion takes a missing value for; a NaN meets no criterion
    cap: float = math.inf  #: value that stands for itself and everything beyond
    missing: str = ""  #: what it says of a drive that the value is missing
    actor: str = ""  #: the metric that names the actor which the value is about; empty for none

    @property
    def unit(self) -> str:
        """Unit that the name ends in."""
        return unit_of(self.name)

    @property
    def judges(self) -> bool:
        """Whether a scenario's criteria may judge a drive by it; a text judges nothing."""
        return self.criterion and self.kind != "str"

    def to_dict(self) -> dict[str, Any]:
        """Return what is not the default, for JSON: `absent` and `cap` as texts, as they may be infinite."""
        values = {field.name: getattr(self, field.name) for field in fields(self)}
        usual = {field.name: repr(field.default) for field in fields(self)}
        kept = {name: value for name, value in values.items() if repr(value) != usual[name]}
        return {name: repr(value) if name in ("absent", "cap") else value for name, value in kept.items()}

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Self:
        """Return the row that `to_dict` returned; raises TypeError or ValueError for what is none."""
        numbers = {name: float(data[name]) for name in ("absent", "cap") if name in data}
        return cls(**{**data, **numbers})


class MetricTable(Mapping[str, Metric], Generic[Subject]):
    """Metrics of one kind of subject by their names, in order, with the functions that measure them."""

    def __init__(self) -> None:
        self._rows: dict[str, Metric] = {}
        self._functions: dict[str, Callable[[Subject], Any]] = {}

    def add(self, name: str, label: str, meaning: str, function: Callable[[Subject], Any], **rest: Any) -> None:
        """Enter a row of `Metric` with the function that measures it; `rest` are the row's other fields.

        Raises ValueError for a name that the table has already.
        """
        if name in self._rows:
            raise ValueError(f"{name} is added twice, expected each name once")
        self._rows[name] = Metric(name, label, meaning, **rest)
        self._functions[name] = function

    def join(self, other: MetricTable[Subject]) -> None:
        """Enter all rows of another table; raises ValueError as `add` does."""
        if twice := [name for name in other if name in self._rows]:
            raise ValueError(f"{twice[0]} is added twice, expected each name once")
        self._rows |= other._rows
        self._functions |= other._functions

    def measure(self, subject: Subject) -> dict[str, Any]:
        """Return the value of every metric by its name."""
        return {name: function(subject) for name, function in self._functions.items()}

    def functions(self) -> Mapping[str, Callable[[Subject], Any]]:
        """Return the function that measures each metric, by its name."""
        return self._functions

    def __getitem__(self, name: str) -> Metric:
        return self._rows[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._rows)

    def __len__(self) -> int:
        return len(self._rows)
