"""What a sweep's rows come to: how often each combination of values passed, and its mean figures, with intervals.

Knows rows; neither files nor how they are shown. Runs with a fault have neither passed nor failed; they are counted
beside.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from vve_sumo.statistics import Interval, Mean, wilson


@dataclass(slots=True)
class Group:
    """Runs that differ in their seed alone, or all runs."""

    runs: int = 0
    judged: int = 0  #: that came to an end at which they passed or failed
    passed: int = 0
    means: dict[str, Mean] = field(default_factory=dict)  #: of figures, over the runs that have one

    @property
    def interval(self) -> Interval:
        """Wilson's interval of the share that pass."""
        return wilson(self.passed, self.judged)

    def add(self, row: Mapping[str, Any], figures: Sequence[str]) -> None:
        """Take in a run."""
        self.runs += 1
        if row["passed"] is not None:
            self.judged += 1
            self.passed += row["passed"]
        for name in figures:
            mean = self.means.setdefault(name, Mean())
            if row[name] is not None:
                mean.add(row[name])


@dataclass(slots=True)
class Outcome:
    """What a sweep came to."""

    all: Group = field(default_factory=Group)
    groups: dict[tuple[Any, ...], Group] = field(default_factory=dict)  #: by the parameters' values, in cell order
    faults: Counter[str] = field(default_factory=Counter)  #: how often each, of the runs without figures

    def lines(self) -> Iterator[str]:
        """Return a line for every kind of fault, the most frequent first."""
        return (f"{count} x {fault}" for fault, count in self.faults.most_common())


def outcome(rows: Iterable[Mapping[str, Any]], parameters: Sequence[str], figures: Sequence[str]) -> Outcome:
    """Return what rows come to: pass rates and the means of `figures`, by combination of the parameters' values."""
    came = Outcome()
    for row in rows:
        values = tuple(row[name] for name in parameters)
        came.groups.setdefault(values, Group()).add(row, figures)
        came.all.add(row, ())
        if row["fault"]:
            came.faults[row["fault"]] += 1
    return came
