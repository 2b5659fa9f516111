"""Asks the kernel for what a real-time process needs: priority, and memory that is never paged out.

When memory runs out, the kernel kills a process. Each but the gateway may be killed: the gateway then stops the car.

The gateway has priority over the simulated vehicle, and that over the drive: the process that stops the car never
waits. Only the first two, which need little processor time, have priority over all ordinary processes. A process that
needs much must not: Linux takes the processor back from real-time processes that starve all others, and then the
gateway waits too (measured: two busy loops below the gateway's priority delayed its steps by 0.1 to 2 s, the same loops
at a high ordinary priority not at all).
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

# Added to a process's badness when memory runs out, in thousandths of the machine's memory; the kernel kills the worst.
# Drive and recorder are killed before the gateway even where the user may not protect it. The gateway stops the car
# along the drive's setpoints if the recorder is gone, along the last setpoint's fallback path if the drive is gone.
NEVER_KILLED: Final = -1000  #: never killed: the gateway
KILLED_SECOND: Final = 100  #: the drive
KILLED_FIRST: Final = 200  #: the recorder

BACKGROUND_NICE: Final = 5  #: nice value of the recorder and the console, which can wait

MCL_CURRENT, MCL_FUTURE = 1, 2  # Linux, asm-generic/mman.h


def lower_priority() -> None:
    """Let this process wait for more urgent ones: raise its nice value to BACKGROUND_NICE."""
    with contextlib.suppress(OSError):
        os.setpriority(os.PRIO_PROCESS, 0, max(os.getpriority(os.PRIO_PROCESS, 0), BACKGROUND_NICE))


def set_oom_score(badness: int) -> str:
    """Tell the kernel how soon to kill this process when memory runs out; return what was granted, in words."""
    try:
        FilePath("/proc/self/oom_score_adj").write_text(f"{badness}\n", encoding="ascii")
    except OSError:
        return f"may be killed when memory ends: the system does not allow oom_score_adj {badness}"
    return f"oom_score_adj {badness}"


def raise_priority(priority: int) -> str:
    """Run this process with a SCHED_FIFO `priority`, or a nice value where negative, and keep its pages in memory.

    Returns what was granted, in words. Reading a page of code that was paged out takes longer than a tick.
    """
    try:
        if priority > 0:
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
        else:
            os.setpriority(os.PRIO_PROCESS, 0, priority)
        granted = f"real-time priority {priority}" if priority > 0 else f"nice value {priority}"
    except OSError:
        granted = "no priority: the system does not allow it"
    # Under a finite limit, MCL_FUTURE would make later allocations fail instead of leaving them unlocked.
    endless = os.geteuid() == 0 or resource.getrlimit(resource.RLIMIT_MEMLOCK)[0] == resource.RLIM_INFINITY
    locked = ctypes.CDLL(None).mlockall(MCL_CURRENT | MCL_FUTURE if endless else MCL_CURRENT) == 0
    return granted + (", memory locked" if locked else ", memory not locked: the system does not allow it")
