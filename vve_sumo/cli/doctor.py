"""`vve-sumo doctor`: go or no-go before a drive."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING

from vve_sumo.cli.console import complain
from vve_sumo.cli.parser import Parser, add_json
from vve_sumo.errors import RigError

if TYPE_CHECKING:
    from vve_sumo.commissioning.findings import Check

EXIT_CODES = """exit codes:
  0  GO
  2  wrong use or configuration
  3  NO-GO
  70  a defect of vve_sumo; its traceback says where
  130  interrupted from the keyboard
"""

SUMMARY = "go or no-go before a drive: machine, scenario, and with --rig the rig"
TEXT = """\
Check everything that a drive needs; report each result, and for a failed check what to do.
With --rig, the doctor listens to the receiver and to the car's bus for some seconds; it sends nothing to a real car.
Ends with GO (exit code 0) or NO-GO (3).
"""


def arguments(parser: Parser) -> None:
    """Add the command's arguments."""
    parser.add_argument("scenario", nargs="?", default="parked_car", help="name or .toml file (default: parked_car)")
    parser.add_argument("--rig", metavar="NAME", help="a name under rigs/ or a .toml file")
    add_json(parser, "the verdict and every check")


def run(arguments: argparse.Namespace) -> int:
    """Print every check as it is made; return the exit code, 0 for go, 3 for no-go."""
    from vve_sumo.commissioning import doctor

    scenario, rig, working = arguments.scenario, arguments.rig, Path.cwd()
    report = doctor.examine(scenario, rig, working, _silent if arguments.json else _show)
    if rig is not None:
        try:
            doctor.keep(report, scenario, rig, working)
        except OSError as error:
            complain(f"the verdict could not be stored for the record of the next drive: {error}")
    against = [check.name for check in report.against]
    if arguments.json:
        checks = [
            {"name": check.name, "finding": check.finding, "found": check.observed, "advice": check.advice}
            for check in report.checks
        ]
        print(json.dumps({"verdict": "NO-GO" if against else "GO", "checks": checks}))
    else:
        print(f"NO-GO: {', '.join(against)}" if against else "GO")
    return RigError.exit_code if against else 0


def _silent(_check: Check) -> None:
    """Print nothing."""


def _show(check: Check) -> None:
    print(*check.lines(), sep="\n", flush=True)
