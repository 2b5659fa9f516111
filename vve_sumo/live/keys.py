"""What the operator wants: single keys on a terminal, words on a pipe, and the signals that all mean stop.

Reads commands and names them; what follows from one is the console's business.
"""

from __future__ import annotations

import contextlib
import enum
import os
import signal
import sys
import termios
import tty
from typing import Any, Final, Self

from vve_sumo.live.signals import STOP_REQUESTS


class KeyCommand(enum.StrEnum):
    """What an operator asks for."""

    ENGAGE = "engage"
    GO = "go"
    RESET = "reset"  #: of a fault, before anything moved
    STOP = "stop"
    GONE = "gone"  #: nobody is there any more who could ask for anything
    NOTHING = "nothing"  #: a key that is no act while the car stands, and a stop once it is engaged


#: keys of a terminal; everything else that is pressed in a hurry means stop
KEYS: Final = {"e": KeyCommand.ENGAGE, "g": KeyCommand.GO, "r": KeyCommand.RESET}
#: Enter: of the command line before anything moves, a hand that hits the keyboard after
ENTER: Final = frozenset("\r\n")


class OperatorInput:
    """Standard input and the signals as operator commands; a with block, at whose end the terminal is as it was.

    `listen=False` takes no commands from standard input but on a terminal: a rig that drives by itself. Where
    nothing can be asked for by standard input, whoever started this program is who looks after it.
    """

    def __init__(self, listen: bool) -> None:
        self._terminal = sys.stdin.isatty()
        self._open = listen or self._terminal
        self._text = ""
        self._saved: list[Any] | None = None
        self._handlers: dict[int, Any] = {}
        self._signalled = False
        self._parent = os.getppid()
        self._wake, self._woken = os.pipe2(os.O_NONBLOCK | os.O_CLOEXEC)

    def __enter__(self) -> Self:
        for number in STOP_REQUESTS:
            self._handlers[number] = signal.signal(number, self._note)
        if self._terminal:
            with contextlib.suppress(termios.error):
                self._saved = termios.tcgetattr(sys.stdin)
                tty.setcbreak(sys.stdin)
                modes = termios.tcgetattr(sys.stdin)
                modes[0] &= ~termios.IXON  # else Ctrl-S would freeze the screen instead of stopping the car
                termios.tcsetattr(sys.stdin, termios.TCSANOW, modes)
        if self._open:
            os.set_blocking(sys.stdin.fileno(), False)
        return self

    def __exit__(self, *_: object) -> None:
        for number, handler in self._handlers.items():
            signal.signal(number, handler)
        if self._open:
            with contextlib.suppress(OSError):
                os.set_blocking(sys.stdin.fileno(), True)
        if self._saved is not None:
            with contextlib.suppress(termios.error):
                termios.tcsetattr(sys.stdin, termios.TCSADRAIN, self._saved)
        os.close(self._wake)
        os.close(self._woken)

    def filenos(self) -> list[int]:
        """What to wait on."""
        return [self._wake, sys.stdin.fileno()] if self._open else [self._wake]

    def commands(self) -> list[KeyCommand]:
        """Return what was asked for since the last call, in order; never blocks."""
        found: list[KeyCommand] = []
        with contextlib.suppress(BlockingIOError):
            os.read(self._wake, 4096)
        if self._signalled:
            self._signalled = False
            found.append(KeyCommand.STOP)
        if self._open:
            found += self._read()
        elif os.getppid() != self._parent:
            found.append(KeyCommand.GONE)
        return found

    def _note(self, number: int, frame: object) -> None:
        self._signalled = True
        with contextlib.suppress(OSError):
            os.write(self._woken, b"!")

    def _read(self) -> list[KeyCommand]:
        try:
            data = os.read(sys.stdin.fileno(), 4096)
        except BlockingIOError:
            return []
        except OSError:  # the terminal is gone
            data = b""
        if not data:
            # The end of what an operator can say: nobody could stop the car any more.
            self._open = False
            return [KeyCommand.STOP]
        text = data.decode(errors="replace")
        return _of_keys(text) if self._terminal else self._of_words(text)

    def _of_words(self, text: str) -> list[KeyCommand]:
        *lines, self._text = (self._text + text).split("\n")
        words = [line.strip().lower() for line in lines if line.strip()]
        return [KeyCommand(word) if word in list(KeyCommand) else KeyCommand.STOP for word in words]


def _of_keys(text: str) -> list[KeyCommand]:
    return [KeyCommand.NOTHING if key in ENTER else KEYS.get(key.lower(), KeyCommand.STOP) for key in text]
