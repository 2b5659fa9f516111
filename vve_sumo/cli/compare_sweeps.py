"""`vve-sumo compare` of sweeps: their runs pair by pair, as tables for people."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING

from vve_sumo.cli.console import plain_console
from vve_sumo.errors import ConfigError

if TYPE_CHECKING:
    from vve_sumo.analysis.dataset import Sweep
    from vve_sumo.analysis.paired import PairedComparison

#: columns of the table of metrics: head, and the column of the comparison
COLUMNS = {
    "pairs": "pairs",
    "one alone": "only_one",
    "other alone": "only_other",
    "one, median": "median_one",
    "other, median": "median_other",
    "difference, median": "median_difference",
    "95 %, from": "low_difference",
    "to": "high_difference",
    "least": "least_difference",
    "greatest": "greatest_difference",
    "less": "lower",
    "same": "same",
    "more": "higher",
    "sign test p": "sign_test_p",
    "worse is": "worse",
}


def run(one: Sweep, other: Path | None, by: str | None, metric: str, out: Path | None) -> int:
    """Compare two sweeps, or the values of a parameter of one; print what differs, draw it; return the exit code, 0."""
    comparisons = _compared(one, other, by)
    for number, compared in enumerate(comparisons, 1):
        _show(compared)
        if out is not None:
            from vve_sumo.plotting import paired, save

            file = out if len(comparisons) == 1 else out.with_name(f"{out.stem}_{number}{out.suffix}")
            save(paired(compared, metric), file)
            print(f"picture: {file}")
    return 0


def _compared(one: Sweep, other: Path | None, by: str | None) -> list[PairedComparison]:
    from vve_sumo.analysis.dataset import Sweep
    from vve_sumo.analysis.load import load
    from vve_sumo.analysis.paired import compare_each, compare_sweeps

    if (other is None) == (by is None):
        raise ConfigError(f"{one.folder}: is a sweep, expected either another sweep or --by PARAMETER")
    if by is not None:
        return compare_each(one, by)
    assert other is not None
    second = load(other)
    if not isinstance(second, Sweep):
        raise ConfigError(f"{other}: is the record of one drive, expected a sweep like {one.folder}")
    return [compare_sweeps(one, second)]


def _show(compared: PairedComparison) -> None:
    console = plain_console()
    console.print(f"one:   {compared.one}")
    console.print(f"other: {compared.other}")
    alone = f"; without a partner: {compared.unpaired[0]} of one, {compared.unpaired[1]} of other"
    console.print(f"{len(compared.pairs)} pairs by {', '.join(compared.by)}{alone if any(compared.unpaired) else ''}")
    _print_verdicts(compared)
    _print_metrics(compared)


def _print_verdicts(compared: PairedComparison) -> None:
    rows = [
        [str(name), *(str(int(count)) for count in row.iloc[:-1]), _cell(float(row.iloc[-1]))]
        for name, row in compared.verdicts.iterrows()
    ]
    heads = ["", "of both", "of one alone", "of other alone", "of neither", "McNemar p"]
    _print(f"Pairs of {_names(compared)} by what is true of them", heads, rows)


def _names(compared: PairedComparison) -> str:
    return f"{compared.one} (one) and {compared.other} (other)"


def _print_metrics(compared: PairedComparison) -> None:
    rows = []
    for name, row in compared.figures.iterrows():
        if row["pairs"] + row["only_one"] + row["only_other"]:
            rows.append([str(name), *(_cell(row[column]) for column in COLUMNS.values())])
    minus = f"{compared.other} minus {compared.one}"
    _print(f"Figures; differences are {minus}, over the pairs that both have it", ["", *COLUMNS], rows)


def _cell(value: object) -> str:
    if isinstance(value, float):
        return "none" if math.isnan(value) else f"{value:.4g}"
    return str(value)


def _print(title: str, heads: list[str], rows: list[list[str]]) -> None:
    from rich import box
    from rich.table import Table

    table = Table(title=title, title_justify="left", box=box.SIMPLE)
    for number, head in enumerate(heads):
        table.add_column(head, justify="right" if number else "left", overflow="fold", no_wrap=not number)
    for row in rows:
        table.add_row(*row)
    plain_console().print(table)
