"""`vve-sumo export`: a drive or a sweep in the formats of other programs."""

from __future__ import annotations

import argparse
from pathlib import Path

from vve_sumo.cli.parser import Parser
from vve_sumo.export.formats import FORMATS

EXIT_CODES = """exit codes:
  0  exported, also of a drive that failed
  2  wrong use, neither a record nor a sweep, a file that exists already, or a missing extra;
     nothing was written
"""

#: the formats, a line each
LIST = "\n".join(
    f"  {form.name:<13} {form.summary}" + (f" (pip install 'vve-sumo[{form.needs}]')" if form.needs else "")
    for form in FORMATS.values()
)
SUMMARY = "write a drive or a sweep for pandas, SUMO, CommonRoad, OpenSCENARIO, Foxglove, OSI, CAN tools"
TEXT = f"""\
Write a drive's record in the format of another program, or a sweep's rows as CSV. The record is
not changed. A killed drive is exported up to its last complete tick. docs/exports.md says what each format
holds.

examples:
  vve-sumo export runs/mine csv                      mine.csv, mine.actors.csv, mine.columns.csv here
  vve-sumo export runs/mine fcd --out crash.fcd.xml
  vve-sumo export runs/mine mcap blf --out files     two formats, into the folder files
  vve-sumo export speeds csv --out tables            rows of a sweep, into the folder tables

formats:
{LIST}
"""


def arguments(parser: Parser) -> None:
    """Add the command's arguments."""
    parser.add_argument("folder", type=Path, metavar="DIR", help="folder of the record; for csv also of a sweep")
    parser.add_argument(
        "formats", nargs="+", choices=tuple(FORMATS), metavar="FORMAT", help="one or more formats of the list below"
    )
    parser.add_argument(
        "--out",
        type=Path,
        metavar="FILE",
        help="file to write, for one format, or an existing folder (default: the working folder, named after "
        "DIR); no file is replaced",
    )


def run(arguments: argparse.Namespace) -> int:
    """Export a record or a sweep and print the files; return the exit code, 0."""
    from vve_sumo.analysis.load import load
    from vve_sumo.analysis.run import Run
    from vve_sumo.export.write import export_all

    loaded = load(arguments.folder)
    written = export_all(loaded, tuple(dict.fromkeys(arguments.formats)), arguments.out)
    if isinstance(loaded, Run) and not loaded.complete:
        print(f"the record has no end of the drive: exported up to its last complete tick, at {loaded.time[-1]:.2f} s")
    for name, files in written.items():
        for file in files:
            print(f"{name}: {file}")
    return 0
