"""`vve-sumo metrics`: lists the metrics of a drive, and checks a user's files of metrics."""

from __future__ import annotations

import argparse
import json
import sys
from typing import Any

from vve_sumo.cli.console import notify
from vve_sumo.cli.parser import OF_FILES, Parser, add_json

#: heads of the table, and how `--json` names its columns
HEADS = ("name", "unit", "of", "worse", "from", "meaning")
#: line width of an output that is no terminal [characters]
UNLIMITED = 400

EXIT_CODES = OF_FILES

SUMMARY = "list the metrics, and check metrics of your own"
TEXT = """\
List every metric: its name, its unit, whether it has one value a drive or one a tick, which direction is worse,
and its meaning; the shipped metrics, those of installed packages, and those of the named files. For a faulty file, one
line says what is wrong, and the exit code is 2. Nothing is driven.

examples:
  vve-sumo metrics                      all metrics
  vve-sumo metrics comfort.py:make      also those of a file of your own
"""


def arguments(parser: Parser) -> None:
    """Add the command's arguments."""
    parser.add_argument("files", nargs="*", metavar="FILE.py:make", help="a file of your own")
    add_json(parser, "the list")


def run(arguments: argparse.Namespace) -> int:
    """Print the list; return the exit code."""
    from vve_sumo.errors import ConfigError
    from vve_sumo.metrics import port
    from vve_sumo.metrics.own import load_own

    wrong, rows = [], [row for name in port.PORT.shipped for row in _rows("vve_sumo", port.load(name))]
    for name in dict.fromkeys([*port.installed(), *arguments.files]):
        try:
            rows += [row for part in load_own([name]).parts.values() for row in _rows(name, part)]
        except ConfigError as error:
            wrong.append(str(error))
    _show(rows, as_json=arguments.json)
    for line in wrong:
        notify(f"vve-sumo metrics: {line}")
    return ConfigError.exit_code if wrong else 0


def _rows(file: str, offered: Any) -> list[tuple[str, ...]]:
    return [
        (name, row.unit, of, row.worse or "", file, row.meaning)
        for of, table in (("drive", offered.per_drive), ("tick", offered.per_tick))
        for name, row in table.items()
    ]


def _show(rows: list[tuple[str, ...]], *, as_json: bool) -> None:
    if as_json:
        print(json.dumps([dict(zip(HEADS, row, strict=True)) for row in rows], ensure_ascii=False))
        return
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    table = Table(*HEADS, box=None, pad_edge=False)
    for column in table.columns[:-1]:
        column.no_wrap = True
    for row in rows:
        table.add_row(*map(Text, row))
    (Console() if sys.stdout.isatty() else Console(width=UNLIMITED)).print(table)
