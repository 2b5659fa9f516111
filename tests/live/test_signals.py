"""Signals: none but the two that nobody can catch ends a process whose part in a drive is not over."""

from __future__ import annotations

import os
import resource
import signal
from pathlib import Path

import pytest

from tests.live.patience import until
from tests.record.declared import RESOLVED
from vve_sumo.live import signals
from vve_sumo.live.channel import pair
from vve_sumo.live.spawn import start


@pytest.mark.thorough
def test_what_ends_or_freezes_a_process_by_default_is_known() -> None:
    """Against the kernel: a child with default handlers, one signal each."""
    for number in sorted(signal.valid_signals()):
        child = os.fork()
        if child == 0:
            os.setpgid(0, 0)  # a group without a parent in its session would not be stopped from the terminal
            resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
            signal.signal(number, signal.SIG_DFL) if number not in (signal.SIGKILL, signal.SIGSTOP) else None
            os.kill(os.getpid(), number)
            os._exit(0)
        _pid, status = os.waitpid(child, os.WUNTRACED)
        if os.WIFSTOPPED(status):
            os.kill(child, signal.SIGKILL)
            os.waitpid(child, 0)
        ended = os.WIFSIGNALED(status) or os.WIFSTOPPED(status)
        assert ended is (number in signals.TERMINATING | {signal.SIGKILL, signal.SIGSTOP}), number


def test_no_signal_ends_the_recorder(tmp_path: Path) -> None:
    ours, theirs = pair()
    config = {"folder": str(tmp_path / "r"), "resolved": RESOLVED, "epoch": 0.0, "provenance": "{}", "log": None}
    process = start("recorder", config, {"drive": theirs})
    until(lambda: (tmp_path / "r" / "scenario.json").exists())
    for number in signals.TERMINATING:
        process.send_signal(number)
    ours.close()
    assert process.wait(30.0) == 0
    assert (tmp_path / "r" / "summary.json").exists()
