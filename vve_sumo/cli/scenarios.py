"""`vve-sumo scenarios`: lists the scenarios that there are, draws them, writes down what a scenario file may say."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path

from vve_sumo.cli.console import notify
from vve_sumo.cli.parser import OF_FILES, Parser, add_command, add_json, add_subcommands
from vve_sumo.errors import ConfigError

#: a terminal with fewer characters in a line shows name and title alone
WIDE_ENOUGH = 150
#: the same columns as `--json` names them
KEYS = ("name", "title", "network", "others", "passes_if")
#: characters in a line of what is no terminal
UNLIMITED = 400

EXIT_CODES = OF_FILES

SUMMARY = "list the scenarios, draw one as a picture, write their schema"
TEXT = """\
List every scenario with a line: what it is, who is there, what a drive must come to.

examples:
  vve-sumo scenarios                            the list
  vve-sumo scenarios show cut_in --out cut.png   a picture: the street, who moves how, what fires when
  vve-sumo scenarios schema --out scenario.schema.json   for editors that complete and check
"""


def arguments(parser: Parser) -> None:
    """Add what the command takes."""
    add_json(parser, "the list")
    inner = add_subcommands(parser, required=False)
    show = add_command(
        inner,
        "show",
        "say what a scenario is, and draw it as a PNG file",
        "Say in words what the scenario is: traffic, signals, what is wrong with the car, faults, who does what when,\n"
        "what passes. Draw the street from above, the ego's path, everybody's line of motion, and where and when\n"
        "triggers fire if the ego never braked. Nothing is driven.",
    )
    show.add_argument("scenario", nargs="?", help="name or .toml file")
    show.add_argument("--out", type=Path, metavar="PNG", help="picture to write (default: NAME.png here)")
    show.add_argument("--all", dest="every", type=Path, metavar="DIR", help="draw every scenario into a folder")
    show.set_defaults(run=_show)
    schema = add_command(
        inner, "schema", "print the JSON Schema of a scenario file", "Print the JSON Schema of a scenario file."
    )
    schema.add_argument("--out", type=Path, metavar="FILE", help="write it into a file instead")
    schema.set_defaults(run=_schema)


def run(arguments: argparse.Namespace) -> int:
    """Print every scenario with its title, network, who else is there, and what a drive must come to."""
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    from vve_sumo.scenario.listing import COLUMNS, listing

    rows, wrong = listing(Path.cwd())
    if arguments.json:
        print(json.dumps([dict(zip(KEYS, row, strict=True)) for row in rows], ensure_ascii=False))
        return _complain_of(wrong)
    console = Console() if sys.stdout.isatty() else Console(width=UNLIMITED)
    columns = COLUMNS if console.width >= WIDE_ENOUGH else COLUMNS[:2]
    table = Table(*columns, box=None, pad_edge=False)
    for column in table.columns:
        column.no_wrap, column.overflow = True, "ellipsis"
    table.columns[0].min_width = max((len(row[0]) for row in rows), default=0)  # a name is there to be copied
    for row in rows:
        table.add_row(*(Text(cell) for cell in row[: len(columns)]))
    console.print(table)
    if len(columns) < len(COLUMNS):
        console.print(f"{WIDE_ENOUGH} columns show also the network, who else is there, and what passes")
    return _complain_of(wrong)


def _complain_of(wrong: Sequence[str]) -> int:
    """Print what is wrong with files that hold no scenario; return the exit code."""
    for line in wrong:
        notify(f"vve-sumo scenarios: {line}")
    return ConfigError.exit_code if wrong else 0


def _show(arguments: argparse.Namespace) -> int:
    """Draw one scenario into a PNG file, or each one into a folder; raises ConfigError for what is wrong."""
    from vve_sumo import workspace

    name, out, every = arguments.scenario, arguments.out, arguments.every
    if (name is None) == (every is None):
        raise ConfigError("scenarios show: expected either a scenario's name or --all DIR")
    if every is None:
        _draw(name, out if out is not None else Path(f"{Path(name).name.removesuffix('.toml')}.png"), text=True)
        return 0
    if out is not None:
        raise ConfigError("scenarios show: --out names the picture of one scenario, --all DIR has a folder of them")
    if every.exists() and not every.is_dir():
        raise ConfigError(f"--all: {every} is a file, expected a folder for the pictures")
    every.mkdir(parents=True, exist_ok=True)
    for one in workspace.known("scenario", Path.cwd()):
        _draw(one, every / f"{one}.png", text=False)
    return 0


def _draw(name: str, file: Path, *, text: bool) -> None:
    """Draw a scenario into a PNG file; with `text` print also what it says."""
    from vve_sumo.drive.run import resolve_by_name

    if not file.parent.is_dir():
        raise ConfigError(f"--out: there is no folder {file.parent}")
    if file.suffix.lower() != ".png":
        raise ConfigError(f"--out: expected the name of a PNG file, got {file}")
    resolved = resolve_by_name(name, Path.cwd())
    # Only now: matplotlib leaves folders of its own behind, also where the name is wrong.
    from vve_sumo.drive.scenario_text import circumstances, lines
    from vve_sumo.plotting.scenario import draw

    draw(resolved, file, circumstances(resolved, Path.cwd()))
    if text:
        print("\n  ".join([f"{resolved.name}: {resolved.scenario.title}", *lines(resolved, Path.cwd())]))
    print(f"{name}: drawn into {file}")


def _schema(arguments: argparse.Namespace) -> int:
    """Print the JSON Schema of a scenario file, or write it into a file."""
    from vve_sumo.scenario.export import json_schema

    out = arguments.out
    text = json.dumps(json_schema(), indent=2, ensure_ascii=False)
    if out is None:
        print(text)
        return 0
    try:
        out.write_text(text + "\n", encoding="utf-8")
    except OSError as error:
        raise ConfigError(f"--out {out}: cannot be written: {error.strerror}") from None
    print(f"schema of a scenario file written to {out}")
    return 0
