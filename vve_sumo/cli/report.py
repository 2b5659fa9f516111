"""`vve-sumo report`: writes a one-page report on a drive or a sweep."""

from __future__ import annotations

import argparse
import gc
from pathlib import Path

from vve_sumo.cli.parser import Parser

EXIT_CODES = """exit codes:
  0  the report was written, also of a drive that failed
  2  wrong use, or neither a record nor a sweep; nothing was written
"""

SUMMARY = "write a one-page report on a drive or a sweep"
TEXT = """\
Write report.html into a record's or a sweep's folder: the settings, the results, passed or failed,
plots, versions, hashes, how to reproduce it. The page is one file that opens offline; its plots lie in
report/ too. An earlier report is replaced. A killed drive and a running sweep are reported up to
their last complete tick or run. Each ego of a drive of several gets a report in its own record.

examples:
  vve-sumo report runs/mine      of a drive's record
  vve-sumo report speeds         of a sweep's, a search's, a study's or a suite's folder
"""


def arguments(parser: Parser) -> None:
    """Add the command's arguments."""
    parser.add_argument("folder", type=Path, metavar="DIR", help="folder of the record or of the sweep")


def run(arguments: argparse.Namespace) -> int:
    """Write the report of a folder, print its path and the verdict; return the exit code, 0."""
    gc.disable()  # the collector took a tenth of the time and finds hardly anything to collect
    try:
        from vve_sumo.record.layout import ego_folder, further_egos
        from vve_sumo.report.write import report_of, save

        folders = [arguments.folder]
        folders += [ego_folder(arguments.folder, ego) for ego in further_egos(arguments.folder)]
        reports = [(folder, report_of(folder)) for folder in folders]
        pages = [(report.verdict.line, save(report, folder)) for folder, report in reports]
    finally:
        gc.enable()
    for line, page in pages:
        print(line)
        print(f"report: {page}")
    return 0
