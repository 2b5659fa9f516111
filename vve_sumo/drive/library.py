"""`vve-sumo scenarios`: lists the scenarios that there are, draws them, writes down what a scenario file may say.

Prints; drives nothing.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path as FilePath

from vve_sumo import workspace
from vve_sumo.errors import ConfigError
from vve_sumo.scenario import descriptions
from vve_sumo.scenario.load import load
from vve_sumo.scenario.schema import Scenario

COLUMNS = ("name", "title", "network", "who else is there", "passes if")
#: a terminal with fewer characters in a line shows name and title alone
WIDE_ENOUGH = 150
#: characters in a line of what is no terminal
UNLIMITED = 400


def listed() -> int:
    """Print every scenario with its title, network, who else is there, and what a drive must come to."""
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    console = Console() if sys.stdout.isatty() else Console(width=UNLIMITED)
    columns = COLUMNS if console.width >= WIDE_ENOUGH else COLUMNS[:2]
    table = Table(*columns, box=None, pad_edge=False)
    for column in table.columns:
        column.no_wrap, column.overflow = True, "ellipsis"
    known = workspace.known("scenario", FilePath.cwd())
    table.columns[0].min_width = max(map(len, known), default=0)  # a name is there to be copied
    wrong: list[str] = []
    for name, file in known.items():
        try:
            table.add_row(*(Text(cell) for cell in _row(name, load(file))[: len(columns)]))
        except ConfigError as error:
            wrong.append(str(error))
    console.print(table)
    if len(columns) < len(COLUMNS):
        console.print(f"{WIDE_ENOUGH} columns show also the network, who else is there, and what passes")
    for line in wrong:
        print(f"vve-sumo scenarios: {line}", file=sys.stderr)
    return ConfigError.exit_code if wrong else 0


def _row(name: str, scenario: Scenario) -> tuple[str, str, str, str, str]:
    return (
        name,
        scenario.title,
        scenario.street.network,
        descriptions.others(scenario),
        descriptions.passes(scenario.criteria),
    )


def shown(name: str | None, out: FilePath | None, every: FilePath | None) -> int:
    """Draw one scenario into a PNG file, or each one into a folder; raises ConfigError for what is wrong."""
    if (name is None) == (every is None):
        raise ConfigError("scenarios show: expected either a scenario's name or --all DIR")
    if every is not None:
        if out is not None:
            raise ConfigError("scenarios show: --out names the picture of one scenario, --all DIR has a folder of them")
        if every.exists() and not every.is_dir():
            raise ConfigError(f"--all: {every} is a file, expected a folder for the pictures")
        every.mkdir(parents=True, exist_ok=True)
        for one in workspace.known("scenario", FilePath.cwd()):
            _draw(one, every / f"{one}.png")
        return 0
    assert name is not None
    _draw(name, out if out is not None else FilePath(f"{FilePath(name).name.removesuffix('.toml')}.png"))
    return 0


def _draw(name: str, file: FilePath) -> None:
    from vve_sumo.drive.command import choose
    from vve_sumo.plotting.scenario import draw

    if not file.parent.is_dir():
        raise ConfigError(f"--out: there is no folder {file.parent}")
    if file.suffix.lower() != ".png":
        raise ConfigError(f"--out: expected the name of a PNG file, got {file}")
    draw(choose(name, FilePath.cwd()), file)
    print(f"{name}: drawn into {file}")


def schema(out: FilePath | None) -> int:
    """Print the JSON Schema of a scenario file, or write it into a file."""
    from vve_sumo.scenario.export import json_schema

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
