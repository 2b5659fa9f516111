"""`vve-sumo doctor`: go or no-go before a drive."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING

from vve_sumo.cli.console import complain
from vve_sumo.cli.parser import Parser, add_json
from vve_sumo.errors import ConfigError, RigError

if TYPE_CHECKING:
    from vve_sumo.commissioning.findings import Check, CheckReport

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

With --laptop, it reads how this computer is set up for live drives (power, sleep, lid, governor, turbo, isolated
cores, real-time limits, clock, CAN links) and changes nothing. --commands prints what mends it, for root:
  vve-sumo doctor --laptop --commands | sudo sh
"""

DEFAULT_SCENARIO = "parked_car"


def arguments(parser: Parser) -> None:
    """Add the command's arguments."""
    parser.add_argument("scenario", nargs="?", help=f"name or .toml file (default: {DEFAULT_SCENARIO})")
    parser.add_argument("--rig", metavar="NAME", help="a name under rigs/ or a .toml file")
    parser.add_argument("--laptop", action="store_true", help="check how this computer is set up, and nothing else")
    parser.add_argument(
        "--commands",
        action="store_true",
        help="with --laptop: print the commands that mend it, for a shell run by root",
    )
    add_json(parser, "the verdict and every check")


def run(arguments: argparse.Namespace) -> int:
    """Print every check as it is made; return the exit code, 0 for go, 3 for no-go."""
    if arguments.laptop:
        return _laptop(arguments)
    if arguments.commands:
        raise ConfigError("--commands: expected --laptop beside it")
    from vve_sumo.commissioning import doctor

    scenario, rig, working = arguments.scenario or DEFAULT_SCENARIO, arguments.rig, Path.cwd()
    report = doctor.examine(scenario, rig, working, _silent if arguments.json else _show)
    if rig is not None:
        try:
            doctor.keep(report, scenario, rig, working)
        except OSError as error:
            complain(f"the verdict could not be stored for the record of the next drive: {error}")
    return _verdict(report, as_json=arguments.json)


def _laptop(arguments: argparse.Namespace) -> int:
    """Check how this computer is set up; print the checks, or the commands that mend it."""
    if arguments.scenario is not None or arguments.rig is not None:
        raise ConfigError("--laptop: looks at this computer alone, expected neither a scenario nor --rig")
    if arguments.commands and arguments.json:
        raise ConfigError("--commands: prints a script, expected no --json beside it")
    from vve_sumo.commissioning import laptop_checks
    from vve_sumo.commissioning.findings import CheckReport

    settings = list(laptop_checks.this_computer())
    if arguments.commands:
        print(laptop_checks.script(settings))
        return 0
    report = CheckReport(_silent if arguments.json else _show)
    report.add(setting.check for setting in settings)
    if not arguments.json and any(setting.command for setting in settings):
        print("vve-sumo doctor --laptop --commands prints what mends it; root runs it")
    return _verdict(report, as_json=arguments.json)


def _verdict(report: CheckReport, *, as_json: bool) -> int:
    """Print the verdict, or all as JSON; return the exit code."""
    against = [check.name for check in report.against]
    if as_json:
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
