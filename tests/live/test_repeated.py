"""Live tests that fail are tried again only where the machine stood still, and not for ever."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.conftest import REPOSITORY
from tests.exhaustive import with_slow

CONFTEST = """
import contextlib, time
from pathlib import Path
import tests.live.repeated as repeated

pytest_plugins = ["tests.live.repeated"]

@contextlib.contextmanager
def witness(file):
    repeated.said = file
    yield

repeated.witness = witness

def pytest_configure(config):
    config.addinivalue_line("markers", "live: in real time")
"""
TESTS = """
import time
from pathlib import Path
import pytest
import tests.live.repeated as repeated

MADE, RUNS = [], Path("runs.txt")

@pytest.fixture(scope="module")
def shared():
    MADE.append(1)
    return len(MADE)

def stand_still():
    with repeated.said.open("a") as file:
        now = time.monotonic()
        file.write(f"{now - 0.05:.4f} {now:.4f}\\n")

@pytest.mark.live
def test_it(shared):
    with RUNS.open("a") as file:
        file.write("x")
    if STALLS:
        stand_still()
    time.sleep(0.01)
    assert shared >= PASSES_AT
"""


@pytest.mark.thorough(witnesses=1)
@pytest.mark.parametrize(
    ("stands_still", "passes_at", "runs", "passes"),
    with_slow(
        [(True, 1, 1, True), (True, 3, 3, True), (True, 4, 3, False), (False, 2, 1, False)],
        lambda case: case[1] in (3, 2),
    ),
)
def test_a_failure_counts_unless_the_machine_stood_still(tmp_path: Path, stands_still, passes_at, runs, passes) -> None:
    (tmp_path / "conftest.py").write_text(CONFTEST)
    (tmp_path / "test_it.py").write_text(f"STALLS, PASSES_AT = {stands_still}, {passes_at}\n{TESTS}")
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "--rootdir", tmp_path, "test_it.py"],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": str(REPOSITORY)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode == 0) is passes, done.stdout + done.stderr
    assert (tmp_path / "runs.txt").read_text() == "x" * runs
    assert done.stdout.count("tried again: the machine stood still 1 times, up to 0.050 s") == runs - 1
