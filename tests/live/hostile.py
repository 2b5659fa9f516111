"""Live drives with controllers that mean no good: they block, fork, hoard memory, print a lot, alter what they see.

`python -m tests.live.hostile [NAME ...]`; each is judged as a row of the fault matrix is. No test runs them: they show
what a careless author does to a drive, and take half a minute each.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path
from typing import Final

from tests.live.matrix import EXPIRY, GATEWAY, PERIOD, STEP, Right, Row
from tests.live.test_matrix import attempt


def _ridden(name: str, fault: str) -> Row:
    return Row(name, fault, Right.RIDDEN, ("stop_asked",), ending="interrupted", controller=name)


HOSTILE: Final = (
    Row(
        "blocking", "the controller sleeps for 1 s, again and again", Right.REST, ("setpoint_expired",), GATEWAY,
        EXPIRY, controller="blocking",
    ),
    _ridden("forking", "the controller leaves a process behind that has all open that the drive had"),
    Row(
        "hoarding", "the controller takes memory until there is none", Right.REST, ("controller_raised",), GATEWAY,
        0.020 * 40 + 0.3 + STEP, first=("setpoint_expired", "overrun", "latency_budget"), controller="hoarding",
    ),
    _ridden("printing", "the controller prints 5 MB a second"),
    Row(
        "mutating", "the controller moves the pose that it was shown by 5 m", Right.REST, ("position_mismatch",),
        GATEWAY, PERIOD + STEP, controller="mutating",
    ),
)  # fmt: skip


def main(names: list[str]) -> int:
    """Drive with each; returns 1 if any was not right."""
    wrong = 0
    for row in HOSTILE:
        if names and row.name not in names:
            continue
        with tempfile.TemporaryDirectory() as folder:
            try:
                print(attempt((row,), Path(folder)), flush=True)
            except AssertionError as error:
                wrong += 1
                print(f"{row.name}: {str(error).splitlines()[0] if str(error) else error!r}", flush=True)
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
