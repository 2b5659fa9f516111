"""A pytest plugin: a live test that failed while the machine itself was seen to stand still is tried again.

Such a run says nothing of the program: its processes were not let run, although they come before all others. A test
that fails on a machine that ran all the time is a failure, and so is one that fails `ATTEMPTS` times. The rows of the
fault matrix and the drives of the replay tests are repeated by their own tests, in the same way.
"""

from __future__ import annotations

import contextlib
import tempfile
import time
from pathlib import Path

import pytest
from _pytest.runner import runtestprotocol

from tests.live.witness import stalls, witness

ATTEMPTS = 3
STALLS = pytest.StashKey[Path]()  #: file of the witness
OPEN = pytest.StashKey[contextlib.ExitStack]()  #: what ends with the session


class MachineStoodStillWarning(UserWarning):
    """A test was tried again, for the machine had not run all the time."""


def pytest_unconfigure(config: pytest.Config) -> None:
    """End the witness."""
    if OPEN in config.stash:
        config.stash[OPEN].close()


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_protocol(item: pytest.Item, nextitem: pytest.Item | None) -> bool | None:
    """Run a live test, up to `ATTEMPTS` times; pytest itself runs all others."""
    if item.get_closest_marker("live") is None:
        return None
    seen = _watched(item.config)
    item.ihook.pytest_runtest_logstart(nodeid=item.nodeid, location=item.location)
    for attempt in range(1, ATTEMPTS + 1):
        begun = time.monotonic()
        reports = runtestprotocol(item, log=False, nextitem=nextitem)
        stood = stalls(seen, begun, time.monotonic())
        failed = [report for report in reports if report.failed]
        if not failed or not stood or attempt == ATTEMPTS:
            break
        # What the module's tests share may have suffered as well.
        item.session._setupstate.teardown_exact(item.session)
        longest = max(end - begin for begin, end in stood)
        item.warn(
            MachineStoodStillWarning(
                f"{item.nodeid}: tried again: the machine stood still {len(stood)} times, up to {longest:.3f} s, in a "
                f"run that failed:\n{failed[0].longreprtext[-2000:]}"
            )
        )
    for report in reports:
        item.ihook.pytest_runtest_logreport(report=report)
    item.ihook.pytest_runtest_logfinish(nodeid=item.nodeid, location=item.location)
    return True


def _watched(config: pytest.Config) -> Path:
    """Return the file of the session's witness, who watches from the first live test on."""
    if OPEN not in config.stash:
        stack = config.stash[OPEN] = contextlib.ExitStack()
        config.stash[STALLS] = Path(stack.enter_context(tempfile.TemporaryDirectory())) / "stalls.txt"
        stack.enter_context(witness(config.stash[STALLS]))
    return config.stash[STALLS]
