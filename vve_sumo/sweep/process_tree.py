"""Linux processes as a sweep must see them: who descends from whom, how much memory they hold, who dies with whom.

Reads /proc and asks the kernel; knows nothing of drives. Nothing here starts a thread or a process.
"""

from __future__ import annotations

import contextlib
import ctypes
import os
import signal
import time
from collections.abc import Iterable, Mapping
from typing import NamedTuple

PAGE = os.sysconf("SC_PAGE_SIZE")  #: [bytes]
PR_SET_PDEATHSIG, PR_SET_CHILD_SUBREAPER = 1, 36  #: of <linux/prctl.h>
STUBBORN = 5.0  #: processes that are still there so long after being killed are left to themselves [s]
LOOK = 0.002  #: between two looks whether they are gone [s]


class ProcessTree(NamedTuple):
    """What /proc says of a process."""

    parent: int
    session: int


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


def everyone() -> dict[int, ProcessTree]:
    """Return every process that this one may see, zombies included."""
    found = {}
    for name in os.listdir("/proc"):  # noqa: PTH208 - ten times a path object's time, and it is done often
        if name.isdigit():
            with contextlib.suppress(OSError, ValueError), open(f"/proc/{name}/stat", "rb") as file:  # noqa: PTH123
                # The name in parentheses may hold anything; what follows it is: state, parent, group, session.
                fields = file.read().rpartition(b")")[2].split()
                found[int(name)] = ProcessTree(int(fields[1]), int(fields[3]))
    return found


def descendants(of: int, known: Mapping[int, ProcessTree]) -> list[int]:
    """Return the processes of `known` that descend from `of`, without itself."""
    found, fresh = set[int](), {of}
    while fresh:
        fresh = {process for process, kin in known.items() if kin.parent in fresh} - found
        found |= fresh
    return sorted(found)


def resident(process: int) -> int:
    """Return the memory that a process holds [bytes], pages that it shares included; 0 for one that is gone."""
    try:
        with open(f"/proc/{process}/statm", "rb") as file:  # noqa: PTH123 - read twenty times a second
            return int(file.read().split()[1]) * PAGE
    except (OSError, IndexError):
        return 0


def kill(processes: Iterable[int]) -> None:
    """Kill processes; those that are gone already don't matter."""
    for process in processes:
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.kill(process, signal.SIGKILL)


def end_descendants() -> None:
    """Kill and reap everything that descends from this process, which has adopted its orphans."""
    deadline = time.monotonic() + STUBBORN
    while time.monotonic() < deadline:
        try:
            gone, _status = os.waitpid(-1, os.WNOHANG)
        except ChildProcessError:
            return
        if not gone:
            kill(descendants(os.getpid(), everyone()))
            time.sleep(LOOK)


def end_session(session: int) -> None:
    """Kill every process of a session, whose leader is gone."""
    deadline = time.monotonic() + STUBBORN
    while time.monotonic() < deadline:
        left = [process for process, kin in everyone().items() if kin.session == session]
        if not left:
            return
        kill(left)
        time.sleep(LOOK)
