"""Kills any process of a live drive at any moment under way, again and again, and holds the fallback path to its bound.

`python -m tests.live.kills [--times N] [--seed S]`; prints a line for each kill, and fails if a bound was broken where
the machine itself did not stand still. It takes half a minute a kill, so no test runs it.
"""

from __future__ import annotations

import argparse
import math
import random
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Final

from tests.live.matrix import MATRIX, TOLERANCE, Row, bound
from tests.live.stage import Evidence, Stage
from tests.live.test_matrix import assert_inside, speed_at, way_to_rest

#: rows of the matrix that kill a process, the one of the car aside, which is no part of a real rig
KILLS: Final = tuple(row for row in MATRIX if row.name in ("drive_killed", "gateway_killed", "recorder_killed",
                                                           "console_killed"))  # fmt: skip
LATEST: Final = 8.0  # after the car is under way [s]
LEAST_SPEED: Final = 0.5  # at which it is under way [m/s]


class Killed(Stage):
    """A row whose signal comes at a moment of its own."""

    def __init__(self, row: Row, folder: Path, wait: float) -> None:
        super().__init__(row, folder)
        self._wait = wait

    def _under_way(self, console: subprocess.Popen[bytes]) -> bool:
        if not self.moving(console, LEAST_SPEED):
            return False
        time.sleep(self._wait)
        return True


def most(row: Row, speed: float, acceleration: float) -> float:
    """The bound of the matrix, also of a car that comes to rest before its brakes have risen [m]."""
    layer = row.stops
    assert layer is not None
    gained = max(acceleration, 0.0)
    if speed + gained * (row.notice + layer.lag) > layer.deceleration * layer.rise / 2.0:
        return bound(row, speed, acceleration)
    whole = row.notice + layer.lag + layer.rise
    return (speed + gained * whole) * (whole + TOLERANCE)


def wrong_with(row: Row, evidence: Evidence) -> str:
    """What a kill broke that it must not; empty for nothing."""
    if evidence.alive:
        return f"{', '.join(evidence.alive)} did not end"
    if evidence.truth["speed_mps"][-1] != 0.0:
        return "the car moves"
    driven, allowed = way_to_rest(evidence, evidence.moment), most(row, *speed_at(evidence, evidence.moment))
    if driven > allowed:
        return f"{driven:.2f} m to rest, at most {allowed:.2f} m are right"
    assert_inside(evidence)
    return ""


def main() -> int:
    """Kill; returns 1 if anything went wrong."""
    parser = argparse.ArgumentParser(description="kill processes of live drives at random moments")
    parser.add_argument("--times", type=int, default=30)
    parser.add_argument("--seed", type=int, default=1)
    wanted = parser.parse_args()
    chance, failed, shares = random.Random(wanted.seed), 0, []
    for number in range(1, wanted.times + 1):
        row, wait = chance.choice(KILLS), chance.uniform(0.0, LATEST)
        with tempfile.TemporaryDirectory() as folder:
            evidence = Killed(row, Path(folder) / "run", wait).run()
            if math.isnan(evidence.moment):
                print(f"{number:3d} {row.name}: never under way: {evidence.said[-200:]}", flush=True)
                failed += 1
                continue
            wrong = wrong_with(row, evidence)
            speed, acceleration = speed_at(evidence, evidence.moment)
            if not speed:
                print(f"{number:3d} {row.name}: the drive had stopped the car before", flush=True)
                continue
            driven, allowed = way_to_rest(evidence, evidence.moment), most(row, speed, acceleration)
        stood = f", the machine stood still {len(evidence.stalls)} times" if evidence.stalls else ""
        failed += bool(wrong) and not evidence.stalls
        shares.append(driven / allowed)
        words = f"{driven:.2f} m to rest from {speed:.2f} m/s, at most {allowed:.2f} m"
        print(f"{number:3d} {row.name} after {wait:.2f} s: {words}{stood}{': ' + wrong if wrong else ''}", flush=True)
    if shares:
        print(f"{len(shares)} kills, {failed} wrong, at most {max(shares):.2f} of the bound")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
