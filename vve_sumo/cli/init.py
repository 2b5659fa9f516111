"""`vve-sumo init`: a workspace of your own."""

from __future__ import annotations

import argparse
from pathlib import Path

from vve_sumo.cli.parser import OF_FILES, Parser

EXIT_CODES = OF_FILES

SUMMARY = "create a workspace of your own"
TEXT = """\
Copy the shipped controllers, networks, notebooks, rigs, routes, scenarios, sweeps and vehicles into a
folder, with examples of external controllers (examples/brains) and of a car by its DBC file
(examples/own_car), and the suites that a receiver, a sensor, a drive-by-wire interface and metrics of your
own must pass (tests/ports). Run vve-sumo from there: your files take precedence over shipped ones of the same
name.
"""


def arguments(parser: Parser) -> None:
    """Add the command's arguments."""
    parser.add_argument("folder", type=Path, metavar="DIR", help="folder to create; existing files are never replaced")


def run(arguments: argparse.Namespace) -> int:
    """Copy the shipped workspace into a folder; return the exit code, 0."""
    from vve_sumo.workspace import lay_out

    written = lay_out(arguments.folder)
    print(f"{len(written)} files laid out in {arguments.folder}; next: cd {arguments.folder} && vve-sumo drive")
    return 0
