"""`vve-sumo dossier`: the page of a test day."""

from __future__ import annotations

import argparse
import datetime
from pathlib import Path

from vve_sumo.cli.parser import Parser

EXIT_CODES = """exit codes:
  0  the page was written, also for a rig that may not be driven
  2  wrong use, a rig that is refused, or evidence that is none; nothing was written
"""

SUMMARY = "write the page of a test day from a rig"
TEXT = """\
Write one page on a test day: the rig with its limits and stops, the lot with fence and path, the watchdog test, the
doctor's last result, what was tried before, roles and checklists with room for signatures, the hazards and what remains
of them, versions and hashes. The page is one file that opens offline and prints.
It opens no bus and no receiver, starts no process and moves nothing: what it says stands in files.

examples:
  vve-sumo dossier ours                        before the day
  vve-sumo dossier ours parked_car --hunt night --matrix matrix.xml --certificate cert
  vve-sumo dossier ours --record runs/one --record runs/two    after it, with the day's drives
"""


def arguments(parser: Parser) -> None:
    """Add the command's arguments."""
    parser.add_argument("rig", metavar="RIG", help="a name under rigs/ or a .toml file")
    parser.add_argument(
        "scenario", nargs="?", default="parked_car", help="whose path the picture shows (default: parked_car)"
    )
    parser.add_argument(
        "--record", type=Path, action="append", default=[], metavar="DIR", help="a drive of the day; may be given again"
    )
    parser.add_argument(
        "--matrix", type=Path, metavar="FILE", help="what pytest --junitxml wrote of tests/live/test_matrix.py"
    )
    parser.add_argument("--hunt", type=Path, metavar="DIR", help="folder of a hunt with this rig")
    parser.add_argument(
        "--certificate", type=Path, metavar="DIR", help="folder of the external controller's certificate"
    )
    parser.add_argument(
        "--out", type=Path, metavar="FILE", help="the page, which is replaced (default: runs/dossier/RIG.html)"
    )


def run(arguments: argparse.Namespace) -> int:
    """Write the page, print its verdict and its path; return the exit code, 0."""
    from vve_sumo.report.write import replace_file
    from vve_sumo.safety.dossier import DossierInput, dossier

    wanted = DossierInput(
        rig=arguments.rig,
        scenario=arguments.scenario,
        working=Path.cwd(),
        now=datetime.datetime.now(datetime.UTC),
        records=tuple(arguments.record),
        matrix=arguments.matrix,
        hunt=arguments.hunt,
        certificate=arguments.certificate,
    )
    report = dossier(wanted)
    out: Path = arguments.out or Path("runs") / "dossier" / f"{wanted.rig_file.stem}.html"
    out.parent.mkdir(parents=True, exist_ok=True)
    replace_file(out, report.page().encode())
    print(report.verdict.line)
    print(f"dossier: {out}")
    return 0
