"""`vve-sumo compare`: compares two records signal by signal, or two sweeps pair by pair."""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vve_sumo.cli.console import plain_console
from vve_sumo.cli.parser import Parser
from vve_sumo.errors import ConfigError

if TYPE_CHECKING:
    from rich.console import Console

    from vve_sumo.analysis.comparison import Comparison
    from vve_sumo.analysis.run import Run

EXIT_CODES = """exit codes:
  0  compared, however large the differences are
  2  wrong use, or neither the records of two drives nor sweeps whose runs make pairs
"""

SUMMARY = "compare two records, such as a real drive and its simulation, or two sweeps pair by pair"
TEXT = """\
Align two records at first motion and report their differences: RMSE, correlation, Theil's U and time shift of
each signal, and the outcomes of the drives. For two sweeps, or two controllers of one sweep, compare the runs
with equal seed and parameters, pair by pair.

examples:
  vve-sumo compare runs/lot runs/lockstep               a live drive and the same drive in lockstep
  vve-sumo compare runs/a runs/b --out difference.png   any two records, and a picture
  vve-sumo compare old_sweep new_sweep                  two sweeps, paired by seed and parameters
  vve-sumo compare sweep --by controller.name           the controllers of one sweep, every two of them
"""


def arguments(parser: Parser) -> None:
    """Add the command's arguments."""
    parser.add_argument("one", type=Path, metavar="ONE", help="folder of a drive or of a sweep")
    parser.add_argument(
        "other", type=Path, nargs="?", metavar="OTHER", help="folder of another; differences are other minus one"
    )
    parser.add_argument(
        "--by", metavar="PARAMETER", help="with one sweep: parameter whose values are compared pairwise"
    )
    parser.add_argument(
        "--figure", default="stop_gap_m", metavar="METRIC", help="with sweeps: metric that the picture shows"
    )
    parser.add_argument("--out", type=Path, metavar="PNG", help="picture to write; with several pairs NAME_1.png …")


def run(arguments: argparse.Namespace) -> int:
    """Compare two records, print what differs, draw the picture of `--out`; return the exit code, 0."""
    from vve_sumo.analysis.comparison import compare
    from vve_sumo.analysis.dataset import Sweep
    from vve_sumo.analysis.load import load
    from vve_sumo.cli import compare_sweeps as sweeps

    out = arguments.out
    if out is not None and out.suffix.lower() != ".png":
        raise ConfigError(f"--out: expected a file that ends in .png, got {out.name}")
    if out is not None and not out.parent.is_dir():
        raise ConfigError(f"--out: no folder {out.parent} for the picture")
    one = load(arguments.one)
    if isinstance(one, Sweep):
        return sweeps.run(one, arguments.other, arguments.by, arguments.figure, out)
    if arguments.by is not None or arguments.other is None:
        raise ConfigError(f"{arguments.one}: is the record of one drive, expected another record as OTHER and no --by")
    from vve_sumo.drive.verify import altered_parts  # all that drives, for those who compare records

    compared = compare(one, _record(arguments.other), altered_parts)
    _show(compared)
    if out is not None:
        from vve_sumo.plotting import comparison, save

        save(comparison(compared), out)
        print(f"picture: {out}")
    return 0


def _record(folder: Path) -> Run:
    from vve_sumo.analysis.load import load
    from vve_sumo.analysis.run import Run

    loaded = load(folder)
    if not isinstance(loaded, Run):
        raise ConfigError(f"{folder}: is a sweep's dataset, expected the record of one drive")
    return loaded


def _show(compared: Comparison) -> None:
    console = plain_console()
    for name, run, begin in zip(("one", "other"), (compared.one, compared.other), compared.begin, strict=True):
        mode = "live" if run.live else "in lockstep"
        console.print(f"{name + ':':<7}{run.folder}: {run.title}, {mode}, first motion at {begin:.3f} s")
    console.print("measured by " + ("the truth" if compared.true else "the pipeline's estimate"))
    for note in compared.notes:
        console.print(f"note:  {note}")
    _print_signals(console, compared)
    _print_outcomes(console, compared)


def _print_signals(console: Console, compared: Comparison) -> None:
    from vve_sumo.analysis.comparison import PATH_S

    heads = ("signal", "RMSE", "greatest", "mean", "unit", "r", "Theil's U", "other is later by", "points")
    rows = []
    for name, row in compared.signals.iterrows():
        errors = [_number(row[key]) for key in ("rmse", "max_error", "mean_error")]
        shift = _number(row["shift_m"], "m") if row["axis"] == PATH_S else _number(1e3 * row["shift_s"], "ms", 1)
        similarity = [_number(row[key]) for key in ("pearson_r", "theil_u")]
        rows.append([_label(str(name), row["unit"]), *errors, row["unit"], *similarity, shift, str(row["n"])])
    _print(console, "Signals: other minus one", heads, rows)


def _print_outcomes(console: Console, compared: Comparison) -> None:
    rows = []
    for name, row in compared.outcomes.iterrows():
        values = [value if isinstance(value, str) else _number(value) for value in (row["one"], row["other"])]
        equality = "same" if row["one"] == row["other"] else "differs"
        difference = equality if isinstance(row["one"], str) else _number(row["difference"])
        rows.append([_label(str(name), row["unit"]), *values, difference, row["unit"]])
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


def _label(column: str, unit: str) -> str:
    """Return a column's label, without its unit."""
    return (column.rpartition("_")[0] if unit else column).replace("_", " ")


def _number(value: Any, unit: str = "", digits: int = 4) -> str:
    if not math.isfinite(value):
        return "-"
    # Adding 0 removes the sign of a value that rounds to zero.
    return f"{round(value, digits) + 0.0:.{digits}f} {unit}".strip()
