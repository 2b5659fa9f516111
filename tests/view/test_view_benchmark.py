"""The benchmark of the page runs."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys

import pytest

from tests.browser import BROWSERS
from tests.conftest import REPOSITORY


@pytest.mark.skipif(not any(map(shutil.which, BROWSERS)), reason="no browser is installed")
def test_the_benchmark_draws_and_sorts() -> None:
    command = [sys.executable, "-m", "benchmarks.view", "--smoke"]
    done = subprocess.run(command, cwd=REPOSITORY, capture_output=True, text=True, check=True)
    drawn = re.findall(r"500 vehicles, (\d+) lanes, .*: (\d+) frames/s", done.stdout)
    assert len(drawn) == 3
    assert all(int(lanes) > 5000 and int(rate) > 0 for lanes, rate in drawn)
    assert len(re.findall(r"sorted by \w+: \d+ ms", done.stdout)) == 3
