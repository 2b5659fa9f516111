"""What a sweep's rows come to: how often each combination of values passed, and its mean figures, with intervals.

Knows rows; neither files nor how they are shown. Runs with an error have neither passed nor failed; they are counted
beside, and so are the runs that lack a figure and are in no mean of it.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from vve_sumo.metrics.contacts import BEYOND, at_contact
from vve_sumo.metrics.table import METRICS, label_of
from vve_sumo.statistics import Interval, Mean, wilson


@dataclass(slots=True)
class Group:
    """Runs that differ in their seed alone, or all runs."""

    runs: int = 0
    judged: int = 0  #: that came to an end at which they passed or failed
    passed: int = 0
    errors: int = 0  #: without figures
    collisions: int = 0
    stopped_by_gateway: int = 0  #: for a reason code: the outcome is fault
    #: of figures, over the runs that have one; a contact, beyond every gap, time to collision and DRAC, is in no mean
    means: dict[str, Mean] = field(default_factory=dict)
    differ: bool = False  #: whether any figure is another in one of the runs than in the first
    _first: dict[str, Any] = field(default_factory=dict)

    @property
    def interval(self) -> Interval | None:
        """Wilson's interval of the share that pass; None where chance did not make the runs differ."""
        return wilson(self.passed, self.judged) if self.differ and self.judged else None

    def half(self, figure: str) -> float:
        """Half of Student's interval of a figure's mean; NaN where chance did not make the runs differ."""
        return self.means[figure].half if self.differ else math.nan

    def worst(self, figure: str) -> float:
        """Worst value of a figure, that at a contact where there was one; NaN where neither way is worse."""
        if figure in BEYOND and self.collisions:
            return at_contact(figure)
        mean, worse = self.means[figure], METRICS[figure].worse if figure in METRICS else None
        return {"lower": mean.least, "higher": mean.greatest, None: math.nan}[worse]

    def add(self, row: Mapping[str, Any], figures: Sequence[str]) -> None:
        """Take in a run."""
        self.runs += 1
        self.errors += bool(row["error"])
        self.collisions += bool(row["collision"])
        self.stopped_by_gateway += row["outcome"] == "fault"
        if row["passed"] is not None:
            self.judged += 1
            self.passed += row["passed"]
        if not row["error"]:  # that has no figures, and so differs in none
            self._first = self._first or {name: row[name] for name in ("passed", "collision", *figures)}
            self.differ = self.differ or any(row[name] != value for name, value in self._first.items())
        for name in figures:
            mean = self.means.setdefault(name, Mean())
            if row[name] is not None and not (name in BEYOND and row["collision"]):
                mean.add(row[name])


@dataclass(slots=True)
class SweepOutcome:
    """What a sweep came to."""

    all: Group = field(default_factory=Group)
    groups: dict[tuple[Any, ...], Group] = field(default_factory=dict)  #: by the parameters' values, in cell order
    errors: Counter[str] = field(default_factory=Counter)  #: how often each, of the runs without figures

    unmet: dict[str, list[str]] = field(default_factory=dict)  #: by criterion: what each run that missed it says

    def unmet_lines(self) -> Iterator[str]:
        """Return a line for every criterion that a run did not meet, the most frequent first, with one such run."""
        for name, said in sorted(self.unmet.items(), key=lambda one: -len(one[1])):
            yield f"{label_of(name)} not met by {len(said)} of {self.all.judged}, as: {said[0]}"

    def lines(self) -> Iterator[str]:
        """Return a line for every kind of error, the most frequent first."""
        return (f"{count} x {error}" for error, count in self.errors.most_common())


def outcome(rows: Iterable[Mapping[str, Any]], parameters: Sequence[str], figures: Sequence[str]) -> SweepOutcome:
    """Return what rows come to: pass rates and the means of `figures`, by combination of the parameters' values."""
    came = SweepOutcome()
    for row in rows:
        values = tuple(row[name] for name in parameters)
        came.groups.setdefault(values, Group()).add(row, figures)
        came.all.add(row, ())
        if row["error"]:
            came.errors[row["error"]] += 1
        for line in filter(None, (row.get("failed") or "").split("; ")):
            came.unmet.setdefault(line.partition(" is ")[0], []).append(line)
    return came
