"""What a sweep's runs come to: how many passed, where their figures lie, combination by combination, the worst first.

Knows the rows of a sweep; not what was searched, nor the page.
"""

from __future__ import annotations

import shlex
from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from vve_sumo.analysis.dataset import Sweep
from vve_sumo.metrics.metric import unit_of
from vve_sumo.metrics.per_drive import PER_DRIVE
from vve_sumo.report.html import Column, Html, folded, join, sub, table, tag
from vve_sumo.report.tables import cell, head_of, named
from vve_sumo.report.words import count, number, said, share, short
from vve_sumo.statistics import wilson

if TYPE_CHECKING:
    import pandas as pd

#: rows of a table on the page at most; all of them are in the dataset
MOST = 200
#: of the runs that did not pass, how many are listed
WORST = 100
#: longer tables are folded
LONG = 12
#: figures that are told where no criterion asks for others
MAIN = ("stop_gap_m", "min_gap_m", "min_ttc_s", "max_deceleration_mps2")
#: metrics in the order in which they tell which run is worse
WORST_BY = ("impact_speed_mps", "min_gap_m", "min_ttc_s", "stop_gap_m")
#: columns of the rows that the page needs beside parameters and criteria
NEEDED = ("number", "key", "seed", "fault", "outcome", "passed", "failed", "collision", "impact_speed_mps")


@dataclass(frozen=True, slots=True)
class Counts:
    """How many runs there are, and what became of them."""

    asked: int  #: of a search, at most
    finished: int
    passed: int
    failed: int
    faults: int

    @property
    def judged(self) -> int:
        """Runs that passed or failed."""
        return self.passed + self.failed


def read(sweep: Sweep) -> pd.DataFrame:
    """Return the rows of a sweep with the columns that a report needs."""
    met = [column for column in sweep.columns if column.startswith("meets_")]
    return sweep.rows(list(dict.fromkeys([*NEEDED, *sweep.parameters, *sweep.figures, *met])))


def counts(sweep: Sweep, rows: pd.DataFrame) -> Counts:
    """Return how many runs there are."""
    passed = rows["passed"].to_numpy(np.float64, na_value=np.nan)
    faults = int((rows["fault"].fillna("") != "").sum())
    return Counts(sweep.asked, len(rows), int((passed == 1.0).sum()), int((passed == 0.0).sum()), faults)


def overview(of: Counts, search: bool) -> Html:
    """Return how many runs passed, with Wilson's interval of that share."""
    low, high = wilson(of.passed, of.judged)
    sure = f"95 % interval {share(low)} to {share(high)}" if of.judged else ""
    rows = [
        ("asked for", said("runs", of.asked), "at most: the search chooses which" if search else ""),
        ("finished", said("runs", of.finished), ""),
        (
            "passed",
            said("runs", of.passed),
            f"{share(of.passed / of.judged)} of those judged; {sure}" if of.judged else "",
        ),
        ("failed", said("runs", of.failed), ""),
        ("with a fault", said("runs", of.faults), "no figures, neither passed nor failed" if of.faults else ""),
    ]
    return sub("Runs", table(("runs", Column("number", True), "share"), rows, "runs"))


def spread(rows: pd.DataFrame, figures: Sequence[str]) -> Html:
    """Return where the figures of all runs lie."""
    lines = []
    for name in figures:
        values = rows[name].to_numpy(np.float64, na_value=np.nan)
        values = values[np.isfinite(values)]
        if len(values):
            places = (values.min(), *np.quantile(values, (0.05, 0.5, 0.95)), values.max())
            lines.append(
                (named(name), *(number(float(value)) for value in places), unit_of(name), said("runs", len(values)))
            )
    numbers = [Column(head, True) for head in ("least", "5 %", "median", "95 %", "greatest")]
    columns = [Column("figure"), *numbers, Column("unit"), Column("runs", True)]
    return sub("Figures over all runs", table(columns, lines, "figures over all runs")) if lines else Html("")


def combinations(sweep: Sweep, rows: pd.DataFrame, figures: Sequence[str]) -> Html:
    """Return what the runs come to by combination of values, the worst first; nothing where each was driven once."""
    if not sweep.parameters or not 1 < len(rows[sweep.parameters].drop_duplicates()) < len(rows):
        return Html("")
    came = sweep.grouped(figures=list(figures))
    units = came.attrs.get("units", {})
    came = came.sort_values("passed_share", kind="stable", na_position="first")
    heads = [
        *(head_of(name, units) for name in sweep.parameters),
        "runs",
        "passed",
        "share, 95 %",
        *map(head_of, figures),
    ]
    columns = [Column(head, True) for head in heads]
    lines = [_combination(row, sweep.parameters, figures) for row in came.head(MOST).to_dict("records")]
    text = "Mean ± half of Student's 95 % interval over the runs of a combination; the least share that passed first."
    text += f" The first {MOST} of {len(came):,}; the dataset has them all." if len(came) > MOST else ""
    shown = join(tag("p", text), table(columns, lines, "combinations"))
    return sub("By combination", folded(count(len(came), "combination"), shown) if len(came) > LONG else shown)


def _combination(row: Mapping[Hashable, Any], parameters: Sequence[str], figures: Sequence[str]) -> list[str]:
    interval = f"{share(row['passed_low_share'])} to {share(row['passed_high_share'])}"
    cells = [short(row[name]) for name in parameters]
    cells += [short(row["runs"]), f"{row['passed']} of {row['judged']}", interval if row["judged"] else "none"]
    return cells + [_mean(row[f"mean_{name}"], row[f"half_width_{name}"]) for name in figures]


def _mean(mean: float, half: float) -> str:
    return number(mean) if half != half or mean != mean else f"{number(mean)} ± {number(half)}"


def worst(rows: pd.DataFrame, sweep: Sweep, figures: Sequence[str], name: str) -> Html:
    """Return the runs that failed, the worst first, each with the line that drives it again."""
    failed = rows[rows["passed"].to_numpy(np.float64, na_value=np.nan) == 0.0]
    if failed.empty:
        return Html("")
    upwards = [*(PER_DRIVE[name].worse == "lower" for name in WORST_BY), True]
    ordered = failed.sort_values([*WORST_BY, "number"], ascending=upwards, kind="stable").head(WORST)
    units = rows.attrs.get("units", {})
    shown = list(dict.fromkeys(["impact_speed_mps", *figures]))
    columns = [
        "key",
        *(head_of(one, units) for one in sweep.parameters),
        "seed",
        "outcome",
        *map(head_of, shown),
        "what failed",
    ]
    numeric = {"seed", *(head_of(one, units) for one in (*sweep.parameters, *shown))}
    lines = [
        (
            tag("code", row["key"]),
            *(cell(row[one]) for one in (*sweep.parameters, "seed", "outcome", *shown)),
            row["failed"] or "",
        )
        for row in ordered.astype(object).to_dict("records")
    ]
    told = [f"{count(len(failed), 'run')} failed"]
    told += (
        [f"; the worst {WORST} of them, by impact speed and then by the least gap"]
        if len(failed) > WORST
        else ["; the hardest impact first, then the least gap"]
    )
    body = table([Column(one, one in numeric) for one in columns], lines, "runs that failed")
    again = f"vve-sumo sweep --rerun {shlex.quote(name)} {ordered['key'].iloc[0]}"
    text = tag("p", "".join(told), ". To drive the first one again, with its full record:")
    inside = folded("Runs that failed", body) if len(ordered) > LONG else body
    return sub("What failed", text, tag("pre", tag("code", again), tabindex="0"), inside)


def faults(rows: pd.DataFrame) -> Html:
    """Return why runs have no figures, how often, and a key of each."""
    ill = rows[rows["fault"].fillna("") != ""]
    if ill.empty:
        return Html("")
    each = (
        ill.groupby("fault", sort=False)["key"]
        .agg(["size", "first"])
        .sort_values("size", ascending=False, kind="stable")
    )
    lines = [(str(fault), str(row["size"]), tag("code", row["first"])) for fault, row in each.head(MOST).iterrows()]
    text = "Runs without figures: they have neither passed nor failed."
    return sub("Faults", tag("p", text), table(("fault", Column("runs", True), "one of them"), lines, "faults"))
