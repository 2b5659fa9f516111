"""`vve-sumo vehicle`: checks of drive-by-wire interfaces."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING

from vve_sumo.cli.parser import Parser, add_command, add_json, add_subcommands, setting
from vve_sumo.errors import RigError

if TYPE_CHECKING:
    from vve_sumo.commissioning.findings import Check

EXIT_CODES = """exit codes:
  0  every check is good
  2  wrong use or configuration, such as a mapping that does not fit its DBC file
  3  a check speaks against the interface
  70  a defect of vve_sumo; its traceback says where
  130  interrupted from the keyboard
"""

SUMMARY = "check a drive-by-wire interface"
CHECK_TEXT = """\
Run an interface against its simulated other end: reports in time, enabling, gears, values out of range, counters,
time-outs, the driver's override, damaged and missing reports, fault bits, and a drive with the gateway. No bus is
opened. NAME is an interface (dataspeed_dbw1, pacmod3, file.py:make ...), a mapping of your own (.toml), or a vehicle's
or a rig's file (.toml), whose interface is taken.

examples:
  vve-sumo vehicle check dataspeed_dbw1 --set variant=dbw1_2024
  vve-sumo vehicle check my_car.toml             a mapping, docs/own_car.md
"""


def arguments(parser: Parser) -> None:
    """Add the command's arguments."""
    check = add_command(add_subcommands(parser), "check", "run one against its simulated end", CHECK_TEXT, EXIT_CODES)
    check.add_argument("name", metavar="NAME", help="an interface, a mapping, or a vehicle's or a rig's file")
    check.add_argument(
        "--set", type=setting, action="append", default=[], metavar="KEY=VALUE", help="a setting of the interface"
    )
    check.add_argument(
        "--vehicle", default="ford_fusion", metavar="NAME", help="the simulated vehicle (default: ford_fusion)"
    )
    add_json(check, "every check")
    check.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Print every check as it is made; return the exit code."""
    from vve_sumo.commissioning import interface_checks, interface_under_check
    from vve_sumo.commissioning.findings import CheckReport

    model = interface_under_check.model(arguments.name, dict(arguments.set), arguments.vehicle, Path.cwd())
    report = CheckReport(_silent if arguments.json else _show)
    report.add(interface_checks.checks(model))
    against = report.against
    if arguments.json:
        rows = [
            {"name": one.name, "finding": one.finding, "found": one.observed, "advice": one.advice}
            for one in report.checks
        ]
        print(json.dumps({"good": not against, "checks": rows}))
    else:
        counts = f"{len(report.checks)} checks, {len(against)} against it"
        print(f"{'NO-GO' if against else 'GOOD'}: {model.interface.name}, {counts}")
    return RigError.exit_code if against else 0


def _silent(_check: Check) -> None:
    """Print nothing."""


def _show(check: Check) -> None:
    print(*check.lines(), sep="\n", flush=True)
