"""What a finished sweep came to, and the files that say it: every combination, or the result of a search."""

from __future__ import annotations

import csv
import json
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vve_sumo.analysis.dataset import Sweep
from vve_sumo.analysis.groups import NEEDED, grouped
from vve_sumo.metrics.table import label_of
from vve_sumo.sweep.plan import MAX_RUNS, SweepQuery

if TYPE_CHECKING:
    import pandas as pd

COMBINATIONS, SEARCH_RESULT = "combinations.csv", "search.json"
#: columns of combinations.csv after the parameters, by those of `groups.grouped`; then those of each figure
_COUNTS = {
    "runs": "runs", "judged": "judged", "passed": "passed", "share_low": "passed_low_share",
    "share_high": "passed_high_share", "errors": "errors", "collisions": "collisions",
    "stopped_by_gateway": "stopped_by_gateway",
}  # fmt: skip
_FIGURE = {"{}": "mean_{}", "{}_half_width": "half_width_{}", "{}_worst": "worst_{}", "{}_count": "{}_count"}


@dataclass(frozen=True, slots=True)
class SweepOutcome:
    """The outcome of a sweep."""

    all: Mapping[str, Any]  #: the counts of `groups.grouped` over all runs
    combinations: pd.DataFrame  #: a row a combination of the parameters, as `groups.grouped`; of very many none
    errors: Counter[str]  #: number of runs with each error
    unmet: Mapping[str, list[str]]  #: by criterion: the lines of the runs that missed it

    def unmet_lines(self) -> Iterator[str]:
        """Return a line for every criterion that a run did not meet, the most frequent first, with one such run."""
        for name, lines in sorted(self.unmet.items(), key=lambda one: -len(one[1])):
            yield f"{label_of(name)} not met by {len(lines)} of {self.all['judged']}, as: {lines[0]}"

    def lines(self) -> Iterator[str]:
        """Return a line for every kind of error, the most frequent first."""
        return (f"{count} x {error}" for error, count in self.errors.most_common())


def conclude(folder: Path, query: SweepQuery) -> SweepOutcome:
    """Return the outcome of a finished sweep; write `combinations.csv`, unless there are very many combinations."""
    import pandas as pd

    sweep = Sweep(folder)
    few = bool(query.plan.parameters) and query.cells.points < MAX_RUNS
    combinations = sweep.grouped() if few else pd.DataFrame()
    if few:
        _write(folder / COMBINATIONS, list(query.plan.parameters), query.plan.numbers(), combinations)
    return outcome(sweep.rows([*NEEDED, "failed"]), combinations)


def outcome(rows: pd.DataFrame, combinations: pd.DataFrame) -> SweepOutcome:
    """Return the outcome of rows, given that of their combinations."""
    (counts,) = grouped(rows, [], []).to_dict("records")
    unmet: dict[str, list[str]] = {}
    for line in (line for lines in rows["failed"].fillna("") for line in lines.split("; ") if line):
        unmet.setdefault(line.partition(" is ")[0], []).append(line)
    errors = Counter(error for error in rows["error"].fillna("") if error)
    return SweepOutcome({str(name): count for name, count in counts.items()}, combinations, errors, unmet)


def _write(file: Path, parameters: Sequence[str], numbers: Sequence[str], combinations: pd.DataFrame) -> None:
    figures = {head.format(name): column.format(name) for name in numbers for head, column in _FIGURE.items()}
    columns = {**{name: name for name in parameters}, **_COUNTS, **figures}
    table = combinations[list(columns.values())].astype(object)
    with file.open("w", encoding="utf-8", newline="") as out:
        lines = csv.writer(out, lineterminator="\n")
        lines.writerow(columns)
        lines.writerows(table.where(table.notna(), "").itertuples(index=False, name=None))


def write_search_result(folder: Path, result: Mapping[str, Any]) -> None:
    """Write the result of a search into `search.json`."""
    (folder / SEARCH_RESULT).write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")


def first_failed(folder: Path) -> str | None:
    """Return the key of the first run that did not pass; None where all did."""
    for rows in Sweep(folder).batches(["key", "passed"]):
        failed = rows["key"][rows["passed"].eq(False).fillna(False)]
        if len(failed):
            return str(failed.iloc[0])
    return None
