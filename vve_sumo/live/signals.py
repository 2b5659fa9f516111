"""Lists the signals that would end or freeze a process, and makes a process ignore them.

Only SIGKILL and SIGSTOP cannot be ignored. A processor fault or an abort ends a process even if the signal is ignored:
the kernel and the C library enforce it.
"""

from __future__ import annotations

import signal
from typing import Final

#: signals that cannot be caught, and those that do nothing by default or let a process continue
_OTHERS: Final = {signal.SIGKILL, signal.SIGSTOP, signal.SIGCONT, signal.SIGCHLD, signal.SIGURG, signal.SIGWINCH}
#: signals that the processor or the C library raises: after a handler that returns they come again, for ever
_FAULTS: Final = {
    signal.SIGABRT,
    signal.SIGBUS,
    signal.SIGFPE,
    signal.SIGILL,
    signal.SIGSEGV,
    signal.SIGSYS,
    signal.SIGTRAP,
}
#: signals of a write that fails; Python ignores both, and the write itself raises an error
_WRITES: Final = {signal.SIGPIPE, signal.SIGXFSZ}

#: every signal that would end or freeze a process and can be ignored
TERMINATING: Final = frozenset(signal.valid_signals() - _OTHERS)
#: those of them that are sent to make a process end
STOP_REQUESTS: Final = TERMINATING - _FAULTS - _WRITES


def ignore() -> None:
    """Ignore all `TERMINATING` signals for good: this process ends by itself, when its part in the drive is over."""
    for number in TERMINATING:
        signal.signal(number, signal.SIG_IGN)
