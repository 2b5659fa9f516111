"""`vve-sumo suite`: a standard's tests on the test track, as a pass/fail table."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from vve_sumo import progress_bar
from vve_sumo.cli.console import note
from vve_sumo.cli.parser import Parser, add_json

if TYPE_CHECKING:
    from rich.table import Table

    from vve_sumo.suite.query import SuiteQuery
    from vve_sumo.suite.row import JudgedRow

EXIT_CODES = """exit codes:
  0  every row passed that full braking could have met
  1  such a row failed, or a row was not driven as the standard requires
  2  wrong use or configuration; nothing was written
  4  the simulation cannot be started, or the disk is full
  130  interrupted from the keyboard; there is no table then; of --out finished drives are kept, --resume continues
"""

#: width of the table where there is no terminal [characters]
WIDTH = 190

SUMMARY = "drive a standard's tests on the test track: a pass/fail table"
TEXT = """\
Drive every row of a standard's table with the simulated vehicle on a long straight track, and report which rows
passed, which failed, and whether full braking could have met them. Without a name: list the suites.

examples:
  vve-sumo suite                            the list
  vve-sumo suite r152 --out r152            the table, also as CSV, JSON and Markdown
  vve-sumo suite r152 --seeds 10 --out r152   ten drives a row; a row passes if all of them pass
  vve-sumo suite r152 --seeds 10 --out r152 --resume   continue after a kill
  vve-sumo suite fmvss127 --out a --keep-records   with the full record of every drive
  vve-sumo suite r152 --controller mine.py:make
  vve-sumo suite r152 --rig ours            the simulated vehicle as the rig declares and calibrates it
"""


def arguments(parser: Parser) -> None:
    """Add the command's arguments."""
    parser.add_argument("name", nargs="?", help="name of the suite")
    parser.add_argument("--out", type=Path, metavar="DIR", help="folder for the table, absent or empty")
    parser.add_argument("--seeds", type=int, default=1, metavar="N", help="drives of each row, by seed (default: 1)")
    parser.add_argument("--workers", type=int, metavar="N", help="drives in parallel (default: one a processor)")
    parser.add_argument(
        "--controller", metavar="NAME", help="shipped name, file.py:make or entry point, with its default tuning"
    )
    parser.add_argument("--vehicle", metavar="NAME", help="a name under vehicles/ or a file (default: ford_fusion)")
    parser.add_argument("--rig", metavar="NAME", help="the simulated vehicle as this rig declares and calibrates it")
    parser.add_argument("--keep-records", action="store_true", help="keep every drive's record under DIR/records")
    parser.add_argument("--resume", action="store_true", help="continue the suite in DIR; finished drives are kept")
    add_json(parser, "the rows of the table")
    parser.add_argument("--quiet", action="store_true", help="no progress, only the table at the end")


def run(arguments: argparse.Namespace) -> int:
    """List the suites, or drive one; return the exit code."""
    from vve_sumo.suite import catalogue
    from vve_sumo.suite.query import SuiteQuery

    if arguments.name is None:
        for known, listed in catalogue.SUITES.items():
            print(f"{known:<20} {listed.title}")
        return 0
    query = SuiteQuery(
        out=arguments.out,
        seeds=arguments.seeds,
        workers=arguments.workers,
        controller=arguments.controller,
        vehicle=arguments.vehicle,
        rig=arguments.rig,
        keep=arguments.keep_records,
        resume=arguments.resume,
    )
    return drive(arguments.name, query, quiet=arguments.quiet, as_json=arguments.json)


def drive(name: str, query: SuiteQuery, *, quiet: bool = False, as_json: bool = False) -> int:
    """Drive a suite, show and write its table; return the exit code."""
    from vve_sumo.suite import catalogue, table
    from vve_sumo.suite import query as queries

    working = Path.cwd()
    car = queries.car_of(query, working)
    rows = queries.rows_of(name, query, car, working)
    if car.note:
        note(car.note)
    with progress_bar.of_runs(quiet=quiet) as shown:
        judged = queries.drive(name, rows, query, car, working, shown)
    files = () if query.out is None else table.write(name, judged, query.out)
    if as_json:
        print(json.dumps([table.record_of(row) for row in judged]))
    else:
        _show(catalogue.SUITES[name].title, judged)
        for file in files:
            print(f"written: {file}")
    return 1 if any(row.verdict in queries.BAD for row in judged) else 0


def _show(title: str, rows: Sequence[JudgedRow]) -> None:
    from rich.console import Console

    from vve_sumo.suite.table import reason_lines, summary_line

    console = Console(width=None if sys.stdout.isatty() else WIDTH)
    console.print(_table(title, rows))
    for line in (*reason_lines(rows), summary_line(rows)):
        print(line)


def _table(title: str, rows: Sequence[JudgedRow]) -> Table:
    from rich.table import Table
    from rich.text import Text

    from vve_sumo.suite.row import RowVerdict
    from vve_sumo.suite.table import HEADINGS, NUMBERS, cells

    colours = {
        RowVerdict.PASSED: "green",
        RowVerdict.FAILED: "red",
        RowVerdict.UNAVOIDABLE: "yellow",
        RowVerdict.INVALID: "red",
        RowVerdict.NOT_APPLICABLE: "dim",
    }
    drawn = Table(title=Text(title), title_justify="left")
    for number, heading in enumerate(HEADINGS):
        drawn.add_column(heading, justify="right" if number in NUMBERS else "left")
    for judged in rows:
        *others, verdict = (Text(cell) for cell in cells(judged))
        verdict.stylize(colours[judged.verdict])
        drawn.add_row(*others, verdict)
    return drawn
