"""What the analysis says on the screen: `vve-sumo compare`.

The only module of the room that prints.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vve_sumo.analysis.comparison import STATION, Comparison
from vve_sumo.analysis.comparison import compare as lay_together
from vve_sumo.analysis.load import load
from vve_sumo.analysis.run import Run
from vve_sumo.errors import ConfigError

if TYPE_CHECKING:
    from rich.console import Console

#: of a table that goes into a file and not onto a screen
WIDE = 160


def compare(one: Path, other: Path, out: Path | None) -> int:
    """Run the command: compare two records, print what differs, draw it into `out`; return the exit code."""
    if out is not None and out.suffix.lower() != ".png":
        raise ConfigError(f"--out: expected a file that ends in .png, got {out.name}")
    if out is not None and not out.parent.is_dir():
        raise ConfigError(f"--out: no folder {out.parent} for the picture")
    compared = lay_together(_record(one), _record(other))
    _show(compared)
    if out is not None:
        from vve_sumo.plotting import comparison, save

        save(comparison(compared), out)
        print(f"picture: {out}")
    return 0


def _record(folder: Path) -> Run:
    found = load(folder)
    if not isinstance(found, Run):
        raise ConfigError(f"{folder}: a sweep's dataset; expected the record of one drive")
    return found


def _show(compared: Comparison) -> None:
    from rich.console import Console

    console = Console(soft_wrap=True, highlight=False, markup=False, width=None if sys.stdout.isatty() else WIDE)
    for name, run, begin in zip(("one", "other"), (compared.one, compared.other), compared.begin, strict=True):
        how = "live" if run.live else "in lockstep"
        console.print(f"{name + ':':<7}{run.folder}: {run.title}, {how}, first motion at {begin:.3f} s")
    console.print("measured by " + ("the truth" if compared.true else "the chain's estimate"))
    for note in compared.notes:
        console.print(f"note:  {note}")
    _print_signals(console, compared)
    _print_outcomes(console, compared)


def _print_signals(console: Console, compared: Comparison) -> None:
    heads = ("signal", "RMSE", "greatest", "mean", "unit", "r", "Theil's U", "other is later by", "points")
    rows = []
    for name, row in compared.signals.iterrows():
        errors = [_number(row[key]) for key in ("rmse", "max_error", "mean_error")]
        shift = _number(row["shift_m"], "m") if row["axis"] == STATION else _number(1e3 * row["shift_s"], "ms", 1)
        likeness = [_number(row[key]) for key in ("pearson_r", "theil_u")]
        rows.append([_words(str(name), row["unit"]), *errors, row["unit"], *likeness, shift, str(row["n"])])
    _print(console, "Signals: other minus one", heads, rows)


def _print_outcomes(console: Console, compared: Comparison) -> None:
    rows = []
    for name, row in compared.outcomes.iterrows():
        values = [value if isinstance(value, str) else _number(value) for value in (row["one"], row["other"])]
        alike = "same" if row["one"] == row["other"] else "differs"
        difference = alike if isinstance(row["one"], str) else _number(row["difference"])
        rows.append([_words(str(name), row["unit"]), *values, difference, row["unit"]])
    _print(console, "Outcomes", ("figure", "one", "other", "other minus one", "unit"), rows)


def _print(console: Console, title: str, heads: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    from rich import box
    from rich.table import Table

    table = Table(title=title, title_justify="left", box=box.SIMPLE)
    for head in heads:
        table.add_column(head, justify="left" if head in (heads[0], "unit") else "right", no_wrap=True)
    for row in rows:
        table.add_row(*row)
    console.print(table)


def _words(column: str, unit: str) -> str:
    """What a column is about, without its unit."""
    return (column.rpartition("_")[0] if unit else column).replace("_", " ")


def _number(value: Any, unit: str = "", digits: int = 4) -> str:
    if not math.isfinite(value):
        return "-"
    # Adding 0 takes the sign from what rounds to nothing.
    return f"{round(value, digits) + 0.0:.{digits}f} {unit}".strip()
