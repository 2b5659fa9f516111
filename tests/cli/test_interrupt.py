"""An interrupt from the keyboard ends every command with 130, in one line at most, whatever it was doing."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tests.conftest import REPOSITORY

SHORT = ("sweep", "parked_car_speeds", "--out", "rows", "--workers", "1", "--quiet")


@pytest.mark.thorough(witnesses=1)
@pytest.mark.parametrize(
    ("arguments", "after"),
    [
        (("drive", "parked_car", "--out", "record", "--quiet"), "record/can.log"),
        (("drive", "parked_car", "--out", "record"), "record/can.log"),
        (SHORT, "rows/sweep.json"),
        (("suite", "pass_through", "--seeds", "50", "--out", "rows", "--workers", "1", "--quiet"), "rows/sweep.json"),
    ],
    ids=["drive", "drive with a bar", "sweep", "suite"],
)
def test_an_interrupted_command_ends_with_130(arguments: tuple[str, ...], after: str, tmp_path: Path) -> None:
    """`after` is a file that the command has written by then."""
    command = [sys.executable, "-P", "-m", "vve_sumo.cli", *arguments]
    started = subprocess.Popen(
        command,
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(REPOSITORY)},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    try:
        for _ in range(600):
            if (tmp_path / after).exists():
                break
            time.sleep(0.05)
        # As a terminal does: to every process of the group.
        os.killpg(started.pid, signal.SIGINT)
        out, err = started.communicate(timeout=60.0)
    finally:
        started.kill()
    # Python dies of the signal itself where it came in the middle of code that was being compiled; shells say 130 too.
    assert started.returncode in (130, -signal.SIGINT), out + err
    assert "Traceback" not in out + err
