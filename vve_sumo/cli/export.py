"""`vve-sumo export`: a drive or a sweep in the formats of other programs."""

from __future__ import annotations

import argparse
from pathlib import Path

from vve_sumo.cli.parser import Parser
from vve_sumo.export.formats import FORMATS

EXIT_CODES = """exit codes:
  0  exported, also of a drive that failed
  2  wrong use, no record and no sweep, a file that is there already, or an extra that is missing;
     nothing was written
"""

SUMMARY = "write a drive or a sweep for pandas, SUMO, CommonRoad, OpenSCENARIO, Foxglove, OSI, CAN tools"
TEXT = """\
Write a drive's record in the format of another program, or a sweep's rows as CSV. The record stays as it
is. A drive that was killed is exported up to its last whole tick. docs/exports.md says what each format
holds.

examples:
  vve-sumo export runs/mine --csv                    mine.csv, mine.actors.csv, mine.columns.csv here
  vve-sumo export runs/mine --fcd --out crash.fcd.xml
  vve-sumo export runs/mine --mcap                   mine.mcap, to be opened in Foxglove or Lichtblick
  vve-sumo export speeds --csv --out tables          rows of a sweep, into the folder tables
"""


def arguments(parser: Parser) -> None:
    """Add what the command takes."""
    parser.add_argument("folder", type=Path, metavar="DIR", help="folder of the record; for --csv also of a sweep")
    formats = parser.add_mutually_exclusive_group(required=True)
    for form in FORMATS.values():
        needs = f" (pip install 'vve-sumo[{form.needs}]')" if form.needs else ""
        formats.add_argument(
            f"--{form.name}", dest="form", action="store_const", const=form.name, help=f"{form.summary}{needs}"
        )
    parser.add_argument(
        "--out",
        type=Path,
        metavar="FILE",
        help="file to write, or a folder that is there for it (default: the working folder, named after DIR); no file "
        "is replaced",
    )


def run(arguments: argparse.Namespace) -> int:
    """Export a record or a sweep and print the files; return the exit code, 0."""
    from vve_sumo.analysis.load import load
    from vve_sumo.analysis.run import Run
    from vve_sumo.export.write import export

    held = load(arguments.folder)
    files = export(held, arguments.form, arguments.out)
    if isinstance(held, Run) and not held.complete:
        print(f"the drive came to no end: exported up to its last whole tick, at {held.time[-1]:.2f} s")
    for file in files:
        print(f"{arguments.form}: {file}")
    return 0
