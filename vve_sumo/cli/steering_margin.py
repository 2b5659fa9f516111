"""`vve-sumo steering-margin`: the margins of a scenario's steering loop."""

from __future__ import annotations

import argparse
from pathlib import Path

from vve_sumo.cli.parser import Parser
from vve_sumo.errors import ConfigError

EXIT_CODES = """exit codes:
  0  the steering bears the stated latency at every speed
  2  it does not, or nothing is known of its margins; wrong use
  70  a defect of vve_sumo; its traceback says where
  130  interrupted from the keyboard
"""

SUMMARY = "margins of the steering loop over speed; refuses what the latency would eat"
TEXT = """\
Print gain, phase and delay margin of a scenario's preview steering over the speed range, by python-control.
Refuses (exit 2) a design whose delay margin is below the stated latency, and a controller that does not say
that it steers by the preview law: nothing is known of its margins.
"""


def arguments(parser: Parser) -> None:
    """Add what the command takes."""
    parser.add_argument("scenario", nargs="?", default="parked_car", help="whose tuning (default: parked_car)")
    parser.add_argument("--latency-ms", type=float, default=100.0, metavar="MS", help="end to end (default: 100)")


def run(arguments: argparse.Namespace) -> int:
    """Print the margins of a scenario's preview steering; refuse what the stated latency would make unstable."""
    from vve_sumo.drive.run import resolve_by_name
    from vve_sumo.drive.steering_margins import steering_margins

    latency_ms, working = arguments.latency_ms, Path.cwd()
    if not latency_ms >= 0.0:
        raise ConfigError(f"--latency-ms: expected 0 or more, got {latency_ms:g}")
    margins = steering_margins(resolve_by_name(arguments.scenario, working), working)
    print(margins.table)
    margins.check(latency_ms / 1000.0)
    print(f"bears the stated {latency_ms:.0f} ms at every speed; the least margin is {1000.0 * margins.delay:.0f} ms")
    return 0
