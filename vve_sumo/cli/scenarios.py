"""`vve-sumo scenarios`: lists, draws and imports scenarios, and writes the schema of a scenario file."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from vve_sumo.cli.console import notify
from vve_sumo.cli.network import latitude_longitude
from vve_sumo.cli.parser import OF_FILES, Commands, Parser, add_command, add_json, add_subcommands, values_of
from vve_sumo.errors import ConfigError

if TYPE_CHECKING:
    from vve_sumo.bridges.scenario_import.workspace_files import Written

#: line width below which a terminal shows name and title alone [characters]
WIDE_ENOUGH = 150
#: the same columns as `--json` names them
KEYS = ("name", "title", "network", "others", "passes_if")
#: line width of an output that is no terminal [characters]
UNLIMITED = 400

EXIT_CODES = OF_FILES

SUMMARY = "list the scenarios, draw one, import one of OpenSCENARIO or CommonRoad, write their schema"
TEXT = """\
List every scenario: its title, network, other road users and pass criteria. With --fit-lot: whether the meeting with
whom an ego that never brakes would touch first fits into the lot of a rig, at which speed, and on which part of the
path, which others of the scenario are then left out, or why none was found; vve-sumo align --around lays it there.
That takes seconds to a minute a scenario.

examples:
  vve-sumo scenarios                            the list
  vve-sumo scenarios --fit-lot ours             which of them fit into the lot of the rig `ours`
  vve-sumo scenarios --fit-lot ours --scenario cut_in   whether this one does
  vve-sumo scenarios show cut_in --out cut.png   a picture: the road, the actors' motion, the triggers
  vve-sumo scenarios schema --out scenario.schema.json   for editors that complete and check
  vve-sumo scenarios import cut-in.xosc         a scenario of OpenSCENARIO, into this folder
  vve-sumo scenarios import ZAM_Tutorial-1_1_T-1.xml   one of CommonRoad
"""
IMPORT_TEXT = """\
Write a scenario of OpenSCENARIO XML 1.x into the working folder: scenarios/NAME.toml, its paths under routes/, and the
network of its OpenDRIVE roads under networks/. Then `vve-sumo drive NAME` drives it, the file's ego by a controller.
A file that varies the parameters of another gives a scenario for each set of values. What is not taken is named with
file, line and element, and nothing is written; with --partial it is left out. docs/openscenario.md says what is taken.
A file of CommonRoad (XML 2018b, 2020a) is told by its root element; docs/commonroad.md says what of one is taken.
Needs netconvert: pip install 'vve-sumo[network]'.
"""


def arguments(parser: Parser) -> None:
    """Add the command's arguments."""
    add_json(parser, "the list")
    parser.add_argument(
        "--fit-lot", metavar="RIG", help="list what fits into the lot of this rig: a name under rigs/ or a .toml file"
    )
    parser.add_argument(
        "--scenario",
        action="append",
        metavar="NAME",
        help="with --fit-lot: only this scenario, a name or a .toml file; may be given several times",
    )
    inner = add_subcommands(parser, required=False)
    show = add_command(
        inner,
        "show",
        "describe a scenario, and draw it as a PNG file",
        "Describe the scenario: traffic, signals, disturbances of the car, faults, the actors' events, pass criteria.\n"
        "Draw the road from above, the ego's path, every actor's line of motion, and where and when triggers fire if\n"
        "the ego never brakes. Nothing is driven.",
        EXIT_CODES,
    )
    show.add_argument("scenario", nargs="?", help="name or .toml file")
    show.add_argument("--out", type=Path, metavar="PNG", help="picture to write (default: NAME.png here)")
    show.add_argument("--all", dest="all_folder", type=Path, metavar="DIR", help="draw every scenario into a folder")
    show.set_defaults(run=_show)
    schema = add_command(
        inner,
        "schema",
        "print the JSON Schema of a scenario file",
        "Print the JSON Schema of a scenario file.",
        EXIT_CODES,
    )
    schema.add_argument("--out", type=Path, metavar="FILE", help="write it into a file instead")
    schema.set_defaults(run=_schema)
    _add_import(inner)


def _add_import(inner: Commands) -> None:
    imported = add_command(
        inner, "import", "write a scenario of OpenSCENARIO or CommonRoad into this folder", IMPORT_TEXT, OF_FILES
    )
    imported.add_argument("file", type=Path, metavar="FILE", help="scenario of OpenSCENARIO 1.x or CommonRoad")
    imported.add_argument("--out", metavar="NAME", help="name of the scenario (default: the file's)")
    imported.add_argument(
        "--ego", metavar="NAME", help="entity or planning problem of the ego (default: one named Ego)"
    )
    imported.add_argument("--partial", action="store_true", help="leave out what is not taken, and say so")
    imported.add_argument(
        "--set",
        type=_value_of_parameter,
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help="another value of a parameter that the file declares; may be given several times",
    )
    imported.add_argument(
        "--origin",
        type=latitude_longitude,
        metavar="LAT,LON",
        help="where the middle of the roads lies, in degrees (default: the file's georeference, else a place in Ohio)",
    )
    imported.set_defaults(run=_import)


def _value_of_parameter(text: str) -> tuple[str, str]:
    """Return name and value of NAME=VALUE."""
    name, equals, value = text.partition("=")
    if not name or not equals or not value:
        raise argparse.ArgumentTypeError(f"expected NAME=VALUE such as EgoSpeed=12, got {text!r}")
    return name, value


def _import(arguments: argparse.Namespace) -> int:
    """Import a scenario of OpenSCENARIO or CommonRoad; return the exit code, 0."""
    from vve_sumo.bridges.openscenario.entities import slug

    file = arguments.file
    name = slug(file.stem, "scenario") if arguments.out is None else arguments.out
    if name != slug(name):
        raise ConfigError(f"--out {name}: expected a letter, then letters, digits, - and _")
    written = _imported(arguments, file, name)
    for line in written.warnings:
        notify(f"netconvert: {line}")
    for line in written.notes:
        notify(f"note: {line}")
    for line in written.left_out:
        notify(f"left out: {line}")
    first, more = written.scenarios[0], len(written.scenarios) - 1
    print(f"{file} written to scenarios/{first}.toml" + (f" and {more} more" if more else ""))
    print(f"drive it: vve-sumo drive {first}")
    return 0


def _imported(arguments: argparse.Namespace, file: Path, name: str) -> Written:
    """Import a file by what its root element says it is."""
    from vve_sumo.bridges.commonroad import importer as commonroad
    from vve_sumo.bridges.openscenario import write as openscenario

    more = {"ego": arguments.ego, "partial": arguments.partial, "origin": arguments.origin}
    if not commonroad.is_commonroad(file):
        return openscenario.import_file(file, Path.cwd(), name, given=values_of(arguments.set), **more)
    if arguments.set:
        raise ConfigError("--set: a file of CommonRoad declares no parameters")
    return commonroad.import_file(file, Path.cwd(), name, **more)


def run(arguments: argparse.Namespace) -> int:
    """Print every scenario with its title, network, other road users and pass criteria."""
    if arguments.fit_lot is not None:
        return _fit_lot(arguments.fit_lot, arguments.scenario, as_json=arguments.json)
    if arguments.scenario:
        raise ConfigError("--scenario: goes with --fit-lot RIG; scenarios show NAME describes one")
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    from vve_sumo.scenario.listing import COLUMNS, listing

    rows, errors = listing(Path.cwd())
    if arguments.json:
        print(json.dumps([dict(zip(KEYS, row, strict=True)) for row in rows], ensure_ascii=False))
        return _print_errors(errors)
    console = Console() if sys.stdout.isatty() else Console(width=UNLIMITED)
    columns = COLUMNS if console.width >= WIDE_ENOUGH else COLUMNS[:2]
    table = Table(*columns, box=None, pad_edge=False)
    for column in table.columns:
        column.no_wrap, column.overflow = True, "ellipsis"
    table.columns[0].min_width = max((len(row[0]) for row in rows), default=0)  # users copy the name
    for row in rows:
        table.add_row(*(Text(cell) for cell in row[: len(columns)]))
    console.print(table)
    if len(columns) < len(COLUMNS):
        console.print(f"a terminal of {WIDE_ENOUGH} columns also shows network, other road users and pass criteria")
    return _print_errors(errors)


def _fit_lot(rig: str, names: list[str] | None, *, as_json: bool) -> int:
    """Print which scenarios, all or those of some names, fit into a rig's lot; return the exit code."""
    from vve_sumo import workspace
    from vve_sumo.commissioning.lot_fits import lot_fits

    for name in names or ():
        workspace.find("scenario", name, Path.cwd())
    fits = []
    for one in lot_fits(rig, Path.cwd(), names):
        fits.append(one)
        notify(f"{one.scenario}: {'fits' if one.speed_mps is not None else one.why_not}")
    if as_json:
        print(json.dumps([one.to_dict() for one in fits], ensure_ascii=False))
        return 0
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    console = Console() if sys.stdout.isatty() else Console(width=UNLIMITED)
    table = Table(
        "name", "event", "own speed", "fits at", "metres of path", "clearance", "left out", box=None, pad_edge=False
    )
    for one in fits:
        table.add_row(*(Text(cell) for cell in one.cells()))
    console.print(table)
    return 0


def _print_errors(errors: Sequence[str]) -> int:
    """Print the errors of faulty scenario files; return the exit code."""
    for line in errors:
        notify(f"vve-sumo scenarios: {line}")
    return ConfigError.exit_code if errors else 0


def _show(arguments: argparse.Namespace) -> int:
    """Draw one scenario into a PNG file, or each one into a folder; raises ConfigError for wrong arguments."""
    from vve_sumo import workspace

    name, out, all_folder = arguments.scenario, arguments.out, arguments.all_folder
    if (name is None) == (all_folder is None):
        raise ConfigError("scenarios show: expected either a scenario's name or --all DIR")
    if all_folder is None:
        _draw(name, out if out is not None else Path(f"{Path(name).name.removesuffix('.toml')}.png"), text=True)
        return 0
    if out is not None:
        raise ConfigError("scenarios show: expected either --out with one scenario or --all DIR")
    if all_folder.exists() and not all_folder.is_dir():
        raise ConfigError(f"--all: {all_folder} is a file, expected a folder for the pictures")
    all_folder.mkdir(parents=True, exist_ok=True)
    for one in workspace.known("scenario", Path.cwd()):
        _draw(one, all_folder / f"{one}.png", text=False)
    return 0


def _draw(name: str, file: Path, *, text: bool) -> None:
    """Draw a scenario into a PNG file; with `text` also print its description."""
    from vve_sumo.drive.run import resolve_by_name

    if not file.parent.is_dir():
        raise ConfigError(f"--out: expected an existing folder, got {file.parent}")
    if file.suffix.lower() != ".png":
        raise ConfigError(f"--out: expected the name of a PNG file, got {file}")
    resolved = resolve_by_name(name, Path.cwd())
    # Only now: matplotlib leaves folders of its own behind, also where the name is wrong.
    from vve_sumo.drive.scenario_text import lines, special_conditions
    from vve_sumo.plotting.scenario import draw

    draw(resolved, file, special_conditions(resolved, Path.cwd()))
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
