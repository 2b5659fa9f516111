"""A drive that is killed under way, for tests of what is left of it."""

from __future__ import annotations

import os
import signal
import subprocess
import time
from collections.abc import Sequence
from pathlib import Path

from tests.conftest import REPOSITORY


def killed_at(command: Sequence[str], file: Path, size: int) -> None:
    """Start a drive and kill it as soon as a file of its record is larger than `size` [bytes]."""
    child = subprocess.Popen(command, cwd=REPOSITORY)
    try:
        deadline = time.monotonic() + 120.0
        while not (file.exists() and file.stat().st_size > size):
            assert child.poll() is None, "the drive ended before it could be killed"
            assert time.monotonic() < deadline
            time.sleep(0.01)
        os.kill(child.pid, signal.SIGKILL)
    finally:
        child.kill()
        child.wait()
