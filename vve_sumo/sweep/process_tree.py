"""The processes of a sweep: the descendants of a process, their memory, and how all of them end with it.

Linux alone: psutil reads /proc, and system calls provide what psutil lacks. Knows nothing of
drives. Nothing here starts a thread or a process.
"""

from __future__ import annotations

import contextlib
import ctypes
import os
import signal
import time
from collections.abc import Iterable

import psutil

PR_SET_PDEATHSIG, PR_SET_CHILD_SUBREAPER = 1, 36  #: of <linux/prctl.h>
KILL_TIMEOUT = 5.0  #: time after which processes that survive SIGKILL are given up [s]
POLL_INTERVAL = 0.002  #: between two checks whether they have ended [s]


def _control(option: int, value: int) -> None:
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.prctl(option, value, 0, 0, 0) != 0:
        raise OSError(ctypes.get_errno(), "prctl")


def adopt_orphans() -> None:
    """Become the parent of every descendant that loses its own."""
    _control(PR_SET_CHILD_SUBREAPER, 1)


def die_with(parent: int) -> None:
    """Have this process killed as soon as its parent `parent` is gone, or now if it is already."""
    _control(PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != parent:
        os.kill(os.getpid(), signal.SIGKILL)


def descendants(of: int) -> list[int]:
    """Return the processes that descend from `of`, zombies included, without itself; none where it is gone."""
    try:
        return sorted(child.pid for child in psutil.Process(of).children(recursive=True))
    except psutil.Error:
        return []


def resident(process: int) -> int:
    """Return the resident memory of a process [bytes], shared pages included; 0 for an ended process."""
    try:
        return int(psutil.Process(process).memory_info().rss)
    except psutil.Error:
        return 0


def kill(processes: Iterable[int]) -> None:
    """Kill processes; ended ones are ignored."""
    for process in processes:
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.kill(process, signal.SIGKILL)


def end_descendants() -> None:
    """Kill and reap everything that descends from this process, which has adopted its orphans."""
    deadline = time.monotonic() + KILL_TIMEOUT
    while time.monotonic() < deadline:
        try:
            gone, _status = os.waitpid(-1, os.WNOHANG)
        except ChildProcessError:
            return
        if not gone:
            kill(descendants(os.getpid()))
            time.sleep(POLL_INTERVAL)


def end_session(session: int) -> None:
    """Kill every process of a session, whose leader is gone."""
    deadline = time.monotonic() + KILL_TIMEOUT
    while time.monotonic() < deadline:
        left = [process for process in psutil.pids() if _session_of(process) == session]
        if not left:
            return
        kill(left)
        time.sleep(POLL_INTERVAL)


def _session_of(process: int) -> int | None:
    """Return the session of a process; None for an ended process."""
    with contextlib.suppress(ProcessLookupError):
        return os.getsid(process)
    return None
