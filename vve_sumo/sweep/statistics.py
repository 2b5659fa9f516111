"""Statistics of a sweep's rows: pass rate and mean metrics of each combination of values, with intervals.

Knows rows; neither files nor how they are shown. Runs with an error have neither passed nor failed and are counted
separately, as are runs without a value of a metric, which its mean leaves out.
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
    judged: int = 0  #: runs that passed or failed
    passed: int = 0
    errors: int = 0  #: runs without metrics
    collisions: int = 0
    stopped_by_gateway: int = 0  #: runs with outcome fault
    #: of metrics, over the runs with a value; gap, time to collision and DRAC of a run with a contact are in no mean
    means: dict[str, Mean] = field(default_factory=dict)
    differ: bool = False  #: whether any metric differs between the runs
    _first: dict[str, Any] = field(default_factory=dict)

    @property
    def interval(self) -> Interval | None:
        """Wilson's interval of the pass rate; None where the runs do not differ by chance."""
        return wilson(self.passed, self.judged) if self.differ and self.judged else None

    def half(self, metric: str) -> float:
        """Half of Student's interval of a metric's mean; NaN where the runs do not differ by chance."""
        return self.means[metric].half if self.differ else math.nan

    def worst(self, metric: str) -> float:
        """Worst value of a metric, at a contact if there was one; NaN for a metric without a worse direction."""
        if metric in BEYOND and self.collisions:
            return at_contact(metric)
        mean, worse = self.means[metric], METRICS[metric].worse if metric in METRICS else None
        return {"lower": mean.least, "higher": mean.greatest, None: math.nan}[worse]

    def add(self, row: Mapping[str, Any], metrics: Sequence[str]) -> None:
        """Add a run."""
        self.runs += 1
        self.errors += bool(row["error"])
        self.collisions += bool(row["collision"])
        self.stopped_by_gateway += row["outcome"] == "fault"
        if row["passed"] is not None:
            self.judged += 1
            self.passed += row["passed"]
        if not row["error"]:  # a run with an error has no metrics to compare
            self._first = self._first or {name: row[name] for name in ("passed", "collision", *metrics)}
            self.differ = self.differ or any(row[name] != value for name, value in self._first.items())
        for name in metrics:
            mean = self.means.setdefault(name, Mean())
            if row[name] is not None and not (name in BEYOND and row["collision"]):
                mean.add(row[name])


@dataclass(slots=True)
class SweepOutcome:
    """The outcome of a sweep."""

    all: Group = field(default_factory=Group)
    groups: dict[tuple[Any, ...], Group] = field(default_factory=dict)  #: by the parameters' values, in cell order
    errors: Counter[str] = field(default_factory=Counter)  #: number of runs with each error

    unmet: dict[str, list[str]] = field(default_factory=dict)  #: by criterion: the lines of the runs that missed it

    def unmet_lines(self) -> Iterator[str]:
        """Return a line for every criterion that a run did not meet, the most frequent first, with one such run."""
        for name, lines in sorted(self.unmet.items(), key=lambda one: -len(one[1])):
            yield f"{label_of(name)} not met by {len(lines)} of {self.all.judged}, as: {lines[0]}"

    def lines(self) -> Iterator[str]:
        """Return a line for every kind of error, the most frequent first."""
        return (f"{count} x {error}" for error, count in self.errors.most_common())


def outcome(rows: Iterable[Mapping[str, Any]], parameters: Sequence[str], metrics: Sequence[str]) -> SweepOutcome:
    """Return the outcome of rows: pass rates and means of `metrics`, by combination of the parameters' values."""
    result = SweepOutcome()
    for row in rows:
        values = tuple(row[name] for name in parameters)
        result.groups.setdefault(values, Group()).add(row, metrics)
        result.all.add(row, ())
        if row["error"]:
            result.errors[row["error"]] += 1
        for line in filter(None, (row.get("failed") or "").split("; ")):
            result.unmet.setdefault(line.partition(" is ")[0], []).append(line)
    return result
