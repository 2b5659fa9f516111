"""Where the commands print: lines on standard error, tables on standard output."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.console import Console

#: exit code of a command that was interrupted from the keyboard: 128 and the number of SIGINT, as shells count
INTERRUPTED = 130
PIPE_CLOSED = 141  #: whoever read the output has gone, as a shell says of a signal: 128 + SIGPIPE
DEFECT = 70  #: an exception of ours that nothing foresaw: EX_SOFTWARE of sysexits.h
#: characters of a line where there is no terminal to say
WIDTH = 160


def notify(line: str) -> None:
    """Print a line that is no result: what is waited for, or looks wrong."""
    print(line, file=sys.stderr)


def note(line: str) -> None:
    """Print a line that whoever drives should know before."""
    notify(f"note: {line}")


def complain(line: str) -> None:
    """Print a line of what went wrong, as a program that is one of several on a terminal does."""
    notify(f"vve-sumo: {line}")


def plain_console(width: int = WIDTH) -> Console:
    """Return a console that prints text as it is, `width` wide where there is no terminal."""
    from rich.console import Console

    return Console(soft_wrap=True, highlight=False, markup=False, width=None if sys.stdout.isatty() else width)
