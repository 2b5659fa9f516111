"""`vve-sumo steering-margin`: stability margins of a scenario's steering loop."""

from __future__ import annotations

import argparse
from pathlib import Path

from vve_sumo.cli.parser import Parser
from vve_sumo.errors import ConfigError

EXIT_CODES = """exit codes:
  0  the delay margin exceeds the stated latency at every speed
  2  it does not, or the margins are unknown; wrong use
  70  a defect of vve_sumo; its traceback says where
  130  interrupted from the keyboard
"""

SUMMARY = "stability margins of the steering loop over speed, checked against the stated latency"
TEXT = """\
Print gain, phase and delay margin of a scenario's preview steering over the speed range.
The exit code is 2 where the delay margin is below the stated latency, and for a controller that does not declare the
preview law, because its margins are unknown.
"""


def arguments(parser: Parser) -> None:
    """Add the command's arguments."""
    parser.add_argument(
        "scenario", nargs="?", default="parked_car", help="scenario with the tuning (default: parked_car)"
    )
    parser.add_argument(
        "--latency-ms", type=float, default=100.0, metavar="MS", help="stated latency, end to end (default: 100)"
    )


def run(arguments: argparse.Namespace) -> int:
    """Print the margins of a scenario's preview steering; refuse a margin below the stated latency."""
    from vve_sumo.drive.run import resolve_by_name
    from vve_sumo.drive.steering_margins import steering_margins

    latency_ms, working = arguments.latency_ms, Path.cwd()
    if not latency_ms >= 0.0:
        raise ConfigError(f"--latency-ms: expected 0 or more, got {latency_ms:g}")
    margins = steering_margins(resolve_by_name(arguments.scenario, working), working)
    print(margins.table)
    margins.check(latency_ms / 1000.0)
    print(
        f"the steering tolerates the stated {latency_ms:.0f} ms at every speed; "
        f"the smallest delay margin is {1000.0 * margins.delay:.0f} ms"
    )
    return 0
