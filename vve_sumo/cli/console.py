"""Where the commands print: lines on standard error, tables on standard output."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.console import Console

#: exit code of a command that was interrupted from the keyboard: 128 and the number of SIGINT, as shells count
INTERRUPTED = 130
PIPE_CLOSED = 141  #: the reader of the output has closed the pipe: 128 + SIGPIPE, as shells report a signal
DEFECT = 70  #: an unexpected exception in vve_sumo: EX_SOFTWARE of sysexits.h
#: line width where there is no terminal [characters]
WIDTH = 160


def notify(line: str) -> None:
    """Print a line that is no result, such as progress or a warning."""
    print(line, file=sys.stderr)


def note(line: str) -> None:
    """Print a note for the operator before a drive."""
    notify(f"note: {line}")


def complain(line: str) -> None:
    """Print an error, prefixed with the program's name."""
    notify(f"vve-sumo: {line}")


def plain_console(width: int = WIDTH) -> Console:
    """Return a console that prints text as it is, `width` wide where there is no terminal."""
    from rich.console import Console

    return Console(soft_wrap=True, highlight=False, markup=False, width=None if sys.stdout.isatty() else width)
