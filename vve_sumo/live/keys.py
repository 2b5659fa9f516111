"""Reads the operator's commands: single keys on a terminal, words on a pipe, and signals, which all mean stop.

What a command leads to is decided by the console.
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
    GONE = "gone"  #: nobody is left who could give a command
    NOTHING = "nothing"  #: a key without effect before the car is engaged, and a stop afterwards


#: keys of a terminal; every other key but Enter means stop
KEYS: Final = {"e": KeyCommand.ENGAGE, "g": KeyCommand.GO, "r": KeyCommand.RESET}
#: Enter: no command before the car is engaged, for it may be left over from the command line; a stop afterwards
ENTER: Final = frozenset("\r\n")


class OperatorInput:
    """Standard input and signals as operator commands; a context manager that restores the terminal at its end.

    `listen=False`, for an automatic rig, reads standard input only if it is a terminal. While standard input is not
    read, the program that started this one looks after it: when that ends, the command is `KeyCommand.GONE`.
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
        """Return the file descriptors to wait on."""
        return [self._wake, sys.stdin.fileno()] if self._open else [self._wake]

    def commands(self) -> list[KeyCommand]:
        """Return the commands since the last call, in order; never blocks."""
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
            # The end of the input: the operator could not stop the car any more.
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
