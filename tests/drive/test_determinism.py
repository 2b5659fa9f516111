"""Same scenario, seed and versions: the same record, in another process and on another processor's instructions."""

from __future__ import annotations

import os
import subprocess
import sys

import numpy as np
import pytest

from tests.drive.street import REPOSITORY

SCRIPT = """
from tests.drive.street import drive_once
print(drive_once({"duration_s": 15.0, "seed": %d})["record_sha256"])
"""


def record_hash(seed: int, **environment: str) -> str:
    """Return the record's hash of a drive in a fresh process with some environment variables set."""
    run = subprocess.run(
        [sys.executable, "-c", SCRIPT % seed],
        cwd=REPOSITORY,
        env=os.environ | environment,
        capture_output=True,
        text=True,
        check=True,
        timeout=300,
    )
    return run.stdout.split()[-1]


def dispatched() -> str:
    """Return numpy's optional processor features that this machine has and that may be switched off."""
    from numpy._core._multiarray_umath import __cpu_dispatch__, __cpu_features__

    return " ".join(name for name in __cpu_dispatch__ if __cpu_features__.get(name))


@pytest.fixture(scope="module")
def first() -> str:
    """The record's hash of a drive that the others are compared with."""
    return record_hash(5)


def test_two_processes_give_the_same_hash_and_another_seed_another(first: str) -> None:
    assert first == record_hash(5)
    assert first != record_hash(6)


@pytest.mark.thorough
def test_numpy_without_its_optional_instructions_gives_the_same_hash(first: str) -> None:
    features = dispatched()
    if not features:
        pytest.skip("this processor has none of numpy's optional instruction sets: there is only one level to test")
    probe = np.linspace(0.1, 3.0, 1000)
    assert np.isfinite(np.sin(probe)).all()
    assert first == record_hash(5, NPY_DISABLE_CPU_FEATURES=features)
