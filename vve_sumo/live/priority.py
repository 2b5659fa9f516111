"""Asking the kernel for what a real-time process needs: priority, and memory that is never taken away.

When the machine's memory ends, the kernel kills a process. Each but the gateway may die: the gateway stops the car.

The gateway comes before the simulated vehicle, and that before the drive: what stops a car waits for nothing.
Only the first two, which need little, come before all ordinary processes. One that needs much must not: Linux takes the
processor back from real-time processes that starve all others, and then the gateway waits too (measured: two busy loops
below the gateway's priority delayed its steps by 0.1 to 2 s, the same loops at a high ordinary priority not at all).
"""

from __future__ import annotations

import contextlib
import ctypes
import os
import resource
from pathlib import Path as FilePath
from typing import Final

GATEWAY_PRIORITY: Final = 30  #: SCHED_FIFO priority
VEHICLE_PRIORITY: Final = 20  #: SCHED_FIFO priority
DRIVE_NICE: Final = -15  #: nice value of an ordinary process

# What is added to a process's badness when memory ends, in thousandths of the machine's memory: the kernel kills the
# worst. Drive and recorder rank before a gateway of a user who may not protect it; the gateway stops the car along the
# drive's setpoints where the recorder is gone, and along the last one's fallback path where the drive is.
NEVER_KILLED: Final = -1000  #: never killed: the gateway
KILLED_SECOND: Final = 100  #: the drive
KILLED_FIRST: Final = 200  #: the recorder

BACKGROUND_NICE: Final = 5  #: nice value of the recorder and the console, which can wait

MCL_CURRENT, MCL_FUTURE = 1, 2  # Linux, asm-generic/mman.h


def lower_priority() -> None:
    """Let this process wait for those that are in a hurry."""
    with contextlib.suppress(OSError):
        os.setpriority(os.PRIO_PROCESS, 0, max(os.getpriority(os.PRIO_PROCESS, 0), BACKGROUND_NICE))


def set_oom_score(badness: int) -> str:
    """Tell the kernel how soon this process may be killed when memory ends; return what was granted, in words."""
    try:
        FilePath("/proc/self/oom_score_adj").write_text(f"{badness}\n", encoding="ascii")
    except OSError:
        return f"may be killed when memory ends: the system does not allow oom_score_adj {badness}"
    return f"oom_score_adj {badness}"


def raise_priority(priority: int) -> str:
    """Run this process with a SCHED_FIFO `priority`, or a nice value where negative, and keep its pages in memory.

    Returns what was granted, in words. A page of code that the kernel took back is read from disk when it is needed
    next, which takes longer than a tick.
    """
    try:
        if priority > 0:
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
        else:
            os.setpriority(os.PRIO_PROCESS, 0, priority)
        granted = f"real-time priority {priority}" if priority > 0 else f"nice value {priority}"
    except OSError:
        granted = "no priority: the system does not allow it"
    # Under a finite limit, memory asked for later would be refused instead of merely not locked.
    endless = os.geteuid() == 0 or resource.getrlimit(resource.RLIMIT_MEMLOCK)[0] == resource.RLIM_INFINITY
    locked = ctypes.CDLL(None).mlockall(MCL_CURRENT | MCL_FUTURE if endless else MCL_CURRENT) == 0
    return granted + (", memory locked" if locked else ", memory not locked: the system does not allow it")
