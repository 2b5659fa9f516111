"""Signals that would end or freeze a process, and processes that none of them may end.

Only SIGKILL and SIGSTOP cannot be ignored. A fault of the processor or an abort ends a process all the same: the kernel
and the C library see to that whether the signal is ignored or not.
"""

from __future__ import annotations

import signal
from typing import Final

#: what nobody can catch, and what does nothing by default or lets a process go on
_OTHERS: Final = {signal.SIGKILL, signal.SIGSTOP, signal.SIGCONT, signal.SIGCHLD, signal.SIGURG, signal.SIGWINCH}
#: what the processor or the C library raises: a handler that returns would raise it again, for ever
_FAULTS: Final = {
    signal.SIGABRT,
    signal.SIGBUS,
    signal.SIGFPE,
    signal.SIGILL,
    signal.SIGSEGV,
    signal.SIGSYS,
    signal.SIGTRAP,
}
#: what a write that fails raises; Python ignores both, and the write says so itself
_WRITES: Final = {signal.SIGPIPE, signal.SIGXFSZ}

#: every signal that would end or freeze a process and can be ignored
TERMINATING: Final = frozenset(signal.valid_signals() - _OTHERS)
#: those of them that somebody sends to have the process end
STOP_REQUESTS: Final = TERMINATING - _FAULTS - _WRITES


def ignore() -> None:
    """Ignore them for good: this process ends by itself, when its part in the drive is over."""
    for number in TERMINATING:
        signal.signal(number, signal.SIG_IGN)
