"""`vve-sumo replay`: feeds a record to the same pipeline and gateway again."""

from __future__ import annotations

import argparse
from pathlib import Path

from vve_sumo.cli.console import notify
from vve_sumo.cli.parser import Parser

EXIT_CODES = """exit codes:
  0  every setpoint and every frame is the same
  1  one differs, or the record was altered
  2  wrong use, or no record
  70  a defect of vve_sumo; its traceback says where
  130  interrupted from the keyboard
"""

SUMMARY = "run a record through the pipeline again and find the first difference"
TEXT = """\
Feed a record's pose bytes, car reports and actors to the same pipeline and the same gateway, without SUMO and
without a car, and compare every setpoint and every CAN frame, bit for bit. The record is verified first:
an altered record is not replayed, nor one whose controller, sensor, receiver or interface has changed. With exit
code 1, the output names what was altered, or the first tick of the drive or step of the gateway that differs.
"""


def arguments(parser: Parser) -> None:
    """Add the command's arguments."""
    parser.add_argument("record", type=Path, metavar="DIR", help="folder of a drive, in lockstep or live, or cut off")


def run(arguments: argparse.Namespace) -> int:
    """Verify a record, then replay it and print where it first differs; return the exit code.

    No code of the recorded controller or of another part runs before every hash of the record and of the parts' files
    was verified.
    """
    from vve_sumo.live import review

    folder, working = arguments.record, Path.cwd()
    inspected = review.inspect(folder, working)
    if inspected.altered:
        print(*inspected.altered, sep="\n")
        print("not replayed: expected a record that is unchanged since its drive")
        return 1
    for line in inspected.notes:
        notify(f"note: {line}")
    if inspected.changed:
        print(*inspected.changed, sep="\n")
        redrive = f": vve-sumo redrive {folder} --controller NAME runs a controller in its present state"
        print(f"not replayed{redrive if all(line.startswith('controller') for line in inspected.changed) else ''}")
        return 1
    replayed = review.replay(inspected, working)
    for line in replayed.notes:
        notify(f"note: {line}")
    for line in replayed.differences:
        print(line)
    if not replayed.differences:
        print(f"{replayed.scope} of {folder} replayed: every setpoint and every frame is the same")
    return 1 if replayed.differences else 0
