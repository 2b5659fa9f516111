"""Asks the kernel for what a real-time process needs: priority, and memory that is never paged out.

When memory runs out, the kernel kills a process. Each but the gateway may be killed: the gateway then stops the car.

The gateway has priority over the simulated vehicle, and that over the drive: the process that stops the car never
waits. A process that computes much must not have priority over all ordinary ones: Linux takes the processor back from
real-time processes that starve all others, and then the gateway waits too (measured: two busy loops below the gateway's
priority delayed its steps by 0.1 to 2 s, the same loops at a high ordinary priority not at all). So the drive has it
from a fix to its setpoint only, a millisecond a tick, and not while SUMO steps.
"""

from __future__ import annotations

import contextlib
import ctypes
import os
import platform
import resource
import struct
import time
from pathlib import Path
from typing import Final, NamedTuple

GATEWAY_PRIORITY: Final = 30  #: SCHED_FIFO priority
VEHICLE_PRIORITY: Final = 20  #: SCHED_FIFO priority
DRIVE_PRIORITY: Final = 10  #: SCHED_FIFO priority, from a fix to its setpoint
DRIVE_NICE: Final = -15  #: nice value of an ordinary process

# Added to a process's badness when memory runs out, in thousandths of the machine's memory; the kernel kills the worst.
# Drive and recorder are killed before the gateway even where the user may not protect it. The gateway stops the car
# along the drive's setpoints if the recorder is gone, along the last setpoint's fallback path if the drive is gone.
OOM_NEVER: Final = -1000  #: never killed: the gateway
OOM_DRIVE: Final = 100  #: the drive
OOM_RECORDER: Final = 200  #: the recorder
OOM_PICTURES: Final = 800  #: what draws pictures of a drive that goes on

BACKGROUND_NICE: Final = 5  #: nice value of the recorder and the console, which can wait
PICTURES_NICE: Final = (
    19  #: nice value of what draws pictures of a drive that goes on: no part of the drive waits for it
)

#: longest time that a real-time process may compute without waiting [us]; then the kernel kills it. No step of a drive
#: takes a tenth of it, after a fifth of it the gateway stops the car, and after twice of it Linux would hold up the
#: gateway too
MAX_REAL_TIME: Final = 500_000
#: sleep that ends the kernel's count of it [s]
PAUSE: Final = 1e-4
#: turn on the processor that a process without the right asks for [ns]: about what a step of the drive computes between
#: a fix and its frames
TIME_SLICE: Final = 500_000

MCL_CURRENT, MCL_FUTURE = 1, 2  # Linux, asm-generic/mman.h
CAP_IPC_LOCK: Final = 14  # Linux, linux/capability.h
CAP_SYS_NICE: Final = 23  # Linux, linux/capability.h
_PR_CAPBSET_DROP: Final = 24  # Linux, linux/prctl.h
_SCHED_SETATTR: Final = {"x86_64": 314, "aarch64": 274}  # Linux's numbers of the system call
_SCHED_ATTR_SIZE: Final = 48  # SCHED_ATTR_SIZE_VER0, linux/sched/types.h


def lower_priority(nice: int = BACKGROUND_NICE) -> None:
    """Let this process, and those that it starts, wait for more urgent ones: raise its nice value to `nice`."""
    with contextlib.suppress(OSError):
        os.setpriority(os.PRIO_PROCESS, 0, max(os.getpriority(os.PRIO_PROCESS, 0), nice))


def keep_low(nice: int) -> None:
    """Lower this process as `lower_priority` does, and take the right to rise from the programs that it starts.

    Chromium gives its own processes and threads nice values of down to -8 wherever it may: root's always, and those of
    a user whose limits were raised for live drives.
    """
    lower_priority(nice)
    # The kernel counts nice values from 20 downwards; a limit is never raised.
    limits = (limit for limit in resource.getrlimit(resource.RLIMIT_NICE) if limit != resource.RLIM_INFINITY)
    lowest = min(20 - nice, *limits)
    resource.setrlimit(resource.RLIMIT_NICE, (lowest, lowest))
    resource.setrlimit(resource.RLIMIT_RTPRIO, (0, 0))
    # Refused to those who have no such right to give up.
    ctypes.CDLL(None).prctl(_PR_CAPBSET_DROP, CAP_SYS_NICE, 0, 0, 0)


def set_oom_score(badness: int) -> str:
    """Tell the kernel how soon to kill this process when memory runs out; return what was granted, in words."""
    try:
        Path("/proc/self/oom_score_adj").write_text(f"{badness}\n", encoding="ascii")
    except OSError:
        return f"may be killed when memory ends: the system does not allow oom_score_adj {badness}"
    return f"oom_score_adj {badness}"


class Rights(NamedTuple):
    """What the kernel lets this user's processes do for a live drive."""

    real_time: bool  #: run with the gateway's SCHED_FIFO priority
    memory: bool  #: lock all their memory, present and future

    def lacking(self) -> str:
        """Return a line that says which rights are missing, what is lost and how to get them; empty with all."""
        kinds = (("real-time", self.real_time), ("locked-memory", self.memory))
        missing = [words for words, there in kinds if not there]
        if not missing:
            return ""
        limits = f"rtprio {GATEWAY_PRIORITY}, nice {DRIVE_NICE} and memlock unlimited"
        return (
            f"no {' and no '.join(missing)} rights: other programs may hold up the drive, and the gateway then stops "
            f"the car; raise this user's limits to {limits} in /etc/security/limits.d and log in again"
        )


def rights() -> Rights:
    """Return what the kernel permits; tried with this thread, then undone."""
    real_time = True
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(GATEWAY_PRIORITY))
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    except OSError:
        real_time = False
    return Rights(real_time, _may_lock_future_memory())


def raise_priority(priority: int) -> str:
    """Run this process with a SCHED_FIFO `priority`, or a nice value where negative, and keep its pages in memory.

    Returns what was granted, in words. Reading a page of code that was paged out takes longer than a tick. Without the
    right, the process asks for short turns, which every user may.
    """
    try:
        if priority > 0:
            _limit_real_time()
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
        else:
            os.setpriority(os.PRIO_PROCESS, 0, priority)
        granted = f"real-time priority {priority}" if priority > 0 else f"nice value {priority}"
    except OSError:
        short = ", but short turns" if request_short_time_slice() else ""
        granted = f"no priority: the system does not allow it{short}"
    # Under a finite limit, MCL_FUTURE would make later allocations fail instead of leaving them unlocked.
    flags = MCL_CURRENT | MCL_FUTURE if _may_lock_future_memory() else MCL_CURRENT
    locked = ctypes.CDLL(None).mlockall(flags) == 0
    return granted + (", memory locked" if locked else ", memory not locked: the system does not allow it")


class RealTimeSection:
    """The part of an ordinary process's loop that is run with real-time priority; without the right, like the rest."""

    def __init__(self, priority: int) -> None:
        """Ask for a SCHED_FIFO `priority`; the process is ordinary until `begin`."""
        self._urgent, self._ordinary = os.sched_param(priority), os.sched_param(0)
        self.granted = True
        try:
            _limit_real_time()
            self.begin()
            self.end()
        except OSError:
            self.granted = False

    def begin(self) -> None:
        """Run what follows with real-time priority."""
        if self.granted:
            os.sched_setscheduler(0, os.SCHED_FIFO, self._urgent)

    def end(self) -> None:
        """Run what follows like an ordinary process."""
        if self.granted:
            os.sched_setscheduler(0, os.SCHED_OTHER, self._ordinary)

    def pause(self) -> None:
        """Sleep for PAUSE with real-time priority, from which the kernel counts anew; what follows is ordinary."""
        self.begin()
        time.sleep(PAUSE)
        self.end()


def request_short_time_slice() -> bool:
    """Ask for short turns on the processor, for which a thread that wakes up waits less; return whether it was granted.

    Linux grants it to every user from release 6.12 on; an older one leaves the turns as they are.
    """
    number = _SCHED_SETATTR.get(platform.machine())
    if number is None:
        return False
    nice = os.getpriority(os.PRIO_PROCESS, 0)
    # struct sched_attr: size, policy, flags, nice, priority, then the turn [ns] in the place of a runtime.
    attributes = struct.pack("=IIQiIQQQ", _SCHED_ATTR_SIZE, os.SCHED_OTHER, 0, nice, 0, TIME_SLICE, 0, 0)
    return bool(ctypes.CDLL(None).syscall(number, 0, attributes, 0) == 0)


def _limit_real_time() -> None:
    """Let the kernel end this process if it computes for MAX_REAL_TIME without ever waiting.

    An endless loop would else hold a processor for good: nothing ordinary preempts a real-time process.
    """
    _soft, hard = resource.getrlimit(resource.RLIMIT_RTTIME)
    limit = MAX_REAL_TIME if hard == resource.RLIM_INFINITY else min(MAX_REAL_TIME, hard)
    resource.setrlimit(resource.RLIMIT_RTTIME, (limit, limit))


def _may_lock_future_memory() -> bool:
    """Whether all later allocations may be locked: without a limit, or with CAP_IPC_LOCK, to which none applies."""
    if resource.getrlimit(resource.RLIMIT_MEMLOCK)[0] == resource.RLIM_INFINITY:
        return True
    try:
        status = Path("/proc/self/status").read_text(encoding="ascii")
        effective = next(line for line in status.splitlines() if line.startswith("CapEff:"))
    except (OSError, StopIteration):
        return False
    return bool(int(effective.split()[1], 16) >> CAP_IPC_LOCK & 1)
