"""Files with the outcome of a finished sweep: that of every combination, or the result of its search."""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from vve_sumo.record.sweep_folder import read_tables
from vve_sumo.sweep.plan import MAX_RUNS, SweepQuery
from vve_sumo.sweep.statistics import Group, SweepOutcome, outcome

COMBINATIONS, SEARCH_RESULT = "combinations.csv", "search.json"


def conclude(folder: Path, query: SweepQuery) -> SweepOutcome:
    """Return the outcome of a finished sweep; write `combinations.csv`, unless there are very many combinations."""
    parameters = list(query.plan.parameters) if query.cells.points < MAX_RUNS else []
    numbers = query.plan.numbers()
    columns = [*parameters, "passed", "failed", "error", "collision", "outcome", *numbers]
    rows = (row for table in read_tables(folder) for row in table.select(columns).to_pylist())
    result = outcome(rows, parameters, numbers)
    if parameters:
        _write(folder / COMBINATIONS, parameters, numbers, result)
    return result


def _write(file: Path, parameters: Sequence[str], numbers: Sequence[str], result: SweepOutcome) -> None:
    with file.open("w", encoding="utf-8", newline="") as out:
        lines = csv.writer(out, lineterminator="\n")
        heads = [f"{name}{which}" for name in numbers for which in ("", "_half_width", "_worst", "_count")]
        counts = ["runs", "judged", "passed", "share_low", "share_high", "errors", "collisions", "stopped_by_gateway"]
        lines.writerow([*parameters, *counts, *heads])
        for values, group in result.groups.items():
            lines.writerow([*values, *map(_cell, [*_counts(group), *_statistics(group, numbers)])])


def _counts(group: Group) -> list[float]:
    share = group.interval or (math.nan, math.nan)
    return [group.runs, group.judged, group.passed, *share, group.errors, group.collisions, group.stopped_by_gateway]


def _statistics(group: Group, numbers: Sequence[str]) -> Iterator[float]:
    """Yield mean, half width, worst value and count of every metric."""
    for name in numbers:
        yield from (group.means[name].mean, group.half(name), group.worst(name), group.means[name].count)


def _cell(value: float) -> float | str:
    return "" if math.isnan(value) else value


def write_search_result(folder: Path, result: Mapping[str, Any]) -> None:
    """Write the result of a search into `search.json`."""
    (folder / SEARCH_RESULT).write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")


def first_failed(folder: Path) -> str | None:
    """Return the key of the first run that did not pass; None where all did."""
    for table in read_tables(folder):
        passed = table["passed"].to_pylist()
        if False in passed:
            return str(table["key"][passed.index(False)].as_py())
    return None
