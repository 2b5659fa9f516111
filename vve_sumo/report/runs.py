"""The results of a sweep's runs: how many passed, the figures' distributions, combination by combination, the worst.

Knows the rows of a sweep; not what was searched, nor the page.
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from vve_sumo.analysis.dataset import Sweep
from vve_sumo.analysis.survivors import contacts, without_contacts
from vve_sumo.metrics.metric import unit_of
from vve_sumo.metrics.per_drive import PER_DRIVE
from vve_sumo.report.formatting import integer, number, share, short
from vve_sumo.report.tables import Cell, Column, ReportTable, Row, cell, head_of, named

if TYPE_CHECKING:
    import pandas as pd

#: rows of a table on the page at most; all of them are in the dataset
MAX_ROWS = 200
#: of the runs that did not pass, how many are listed at most
MAX_FAILED = 500
#: figures that are shown where no criterion asks for others
MAIN = ("stop_gap_m", "min_gap_m", "min_ttc_s", "max_deceleration_mps2")
#: metrics in the order in which they decide which run is worse
WORST_BY = ("impact_speed_mps", "min_gap_m", "min_ttc_s", "stop_gap_m")
#: columns of the rows that the page needs beside parameters and criteria
NEEDED = ("number", "key", "seed", "error", "outcome", "passed", "failed", "collision", "hunting", "impact_speed_mps")


@dataclass(frozen=True, slots=True)
class Counts:
    """How many runs there are, and how they ended."""

    planned: int  #: of a search, at most
    finished: int
    passed: int
    failed: int
    errors: int

    @property
    def judged(self) -> int:
        """Runs that passed or failed."""
        return self.passed + self.failed


def read(sweep: Sweep) -> pd.DataFrame:
    """Return the rows of a sweep with the columns that a report needs.

    Of the columns' `attrs` only those of parameters are kept: metrics have theirs in the metrics' table, and pandas
    copies all `attrs` deeply whenever a column is taken.
    """
    met = [column for column in sweep.columns if column.startswith("meets_")]
    rows = sweep.rows(list(dict.fromkeys([*NEEDED, *sweep.parameters, *sweep.figures, *met])))
    for what, of in rows.attrs.items():
        rows.attrs[what] = {name: of[name] for name in sweep.parameters if name in of}
    return rows


def counts(sweep: Sweep, rows: pd.DataFrame) -> Counts:
    """Return how many runs there are."""
    passed = rows["passed"].to_numpy(np.float64, na_value=np.nan)
    errors = int((rows["error"].fillna("") != "").sum())
    return Counts(sweep.planned, len(rows), int((passed == 1.0).sum()), int((passed == 0.0).sum()), errors)


def overview(sweep: Sweep, of: Counts, search: bool) -> ReportTable:
    """Return how many runs passed, with Wilson's interval of that share where chance alone made the runs differ."""
    (all_runs,) = sweep.grouped([], []).to_dict("records")
    low, high = all_runs["passed_low_share"], all_runs["passed_high_share"]
    passed = f"{share(of.passed / of.judged)} of those judged" if of.judged else ""
    interval = f"; 95 % interval {share(low)} to {share(high)}" if of.judged and low == low else ""
    rows = [
        ("planned", integer(of.planned), "at most: the search chooses which" if search else ""),
        ("finished", integer(of.finished), ""),
        ("passed", integer(of.passed), passed + interval),
        ("failed", integer(of.failed), ""),
        ("with an error", integer(of.errors), "no figures, neither passed nor failed" if of.errors else ""),
    ]
    return ReportTable("runs", ("runs", Column("number", True), "share"), rows)


def spread(rows: pd.DataFrame, figures: Sequence[str]) -> ReportTable:
    """Return the distributions of the figures over the runs that have them, and how many have not.

    A contact is beyond every gap, time to collision and DRAC: runs with one are counted beside these.
    """
    lines: list[Row] = []
    for name in figures:
        values, hits = without_contacts(rows, name), int(contacts(rows, name).sum())
        values = values[np.isfinite(values)]
        if len(values):
            places = (values.min(), *np.quantile(values, (0.05, 0.5, 0.95)), values.max())
            counted = (len(values), hits, len(rows) - len(values) - hits)
            lines.append(
                (named(name), *(number(float(value)) for value in places), unit_of(name), *map(integer, counted))
            )
    numbers = [Column(head, True) for head in ("minimum", "5 %", "median", "95 %", "maximum")]
    counted_heads = [Column(head, True) for head in ("runs", "contacts", "without value")]
    return ReportTable("figures over all runs", ("figure", *numbers, "unit", *counted_heads), lines)


def combinations(sweep: Sweep, rows: pd.DataFrame, figures: Sequence[str]) -> ReportTable:
    """Return the results by combination of values, the worst first; no rows where each was driven once."""
    heads = ["runs", "passed", "share, 95 %", "collisions", *map(head_of, figures)]
    units = rows.attrs.get("units", {})
    columns = [Column(head, True) for head in (*(head_of(name, units) for name in sweep.parameters), *heads)]
    if not sweep.parameters or not 1 < len(rows[sweep.parameters].drop_duplicates()) < len(rows):
        return ReportTable("combinations", columns, ())
    grouped = sweep.grouped(figures=list(figures))
    grouped = grouped.sort_values("passed_share", kind="stable", na_position="first")
    lines = [_combination(row, sweep.parameters, figures) for row in grouped.head(MAX_ROWS).to_dict("records")]
    return ReportTable("combinations", columns, lines, len(grouped))


def _combination(row: Mapping[Hashable, Any], parameters: Sequence[str], figures: Sequence[str]) -> list[str]:
    low, high = row["passed_low_share"], row["passed_high_share"]
    interval = f"{share(low)} to {share(high)}" if row["judged"] and low == low else "none"
    cells = [short(row[name]) for name in parameters]
    cells += [short(row["runs"]), f"{row['passed']} of {row['judged']}", interval, short(row["collisions"])]
    return cells + [_mean(row, name) for name in figures]


def _mean(row: Mapping[Hashable, Any], figure: str) -> str:
    """Return a figure's mean with its interval, of how many runs it is where some lack it, and the worst."""
    mean, half, worst = (row[f"{which}_{figure}"] for which in ("mean", "half_width", "worst"))
    text = number(mean) if half != half or mean != mean else f"{number(mean)} ± {number(half)}"
    text += f" ({row[f'{figure}_count']} of {row['runs']})" if row[f"{figure}_count"] < row["runs"] else ""
    return text if worst != worst else f"{text}, worst {number(worst)}"


def failed_runs(rows: pd.DataFrame, parameters: Sequence[str], figures: Sequence[str]) -> ReportTable:
    """Return the runs that failed, the worst first; a row begins with the run's key."""
    failed = rows[rows["passed"].to_numpy(np.float64, na_value=np.nan) == 0.0]
    upwards = [*(PER_DRIVE[name].worse == "lower" for name in WORST_BY), True]
    ordered = failed.sort_values([*WORST_BY, "number"], ascending=upwards, kind="stable").head(MAX_FAILED)
    units = rows.attrs.get("units", {})
    shown = list(dict.fromkeys(["impact_speed_mps", *figures]))
    columns = [
        Column("key"),
        *(Column(head_of(name, units), True) for name in parameters),
        Column("seed", True),
        Column("outcome"),
        *(Column(head_of(name), True) for name in shown),
        Column("criteria not met"),
    ]
    lines = [
        (
            Cell(row["key"], kind="code"),
            *(cell(row[name]) for name in (*parameters, "seed", "outcome", *shown)),
            row["failed"],
        )
        for row in ordered.fillna({"failed": ""}).astype(object).to_dict("records")
    ]
    return ReportTable("runs that failed", columns, lines, len(failed))


def errors(rows: pd.DataFrame) -> ReportTable:
    """Return why runs have no figures, how often, and a key of each."""
    faulty = rows[rows["error"].fillna("") != ""]
    each = faulty.groupby("error", sort=False)["key"].agg(["size", "first"])
    each = each.sort_values("size", ascending=False, kind="stable")
    lines = [
        (str(error), str(row["size"]), Cell(row["first"], kind="code")) for error, row in each.head(MAX_ROWS).iterrows()
    ]
    return ReportTable("errors", ("error", Column("runs", True), "one of them"), lines, len(each))
