"""Draws the test engineer's screen: a few lines rewritten in place, and a line and a bell for every transition.

Knows a terminal; `live.wording` words what it shows. It never blocks: while a terminal has not taken the last picture,
none is drawn.
"""

from __future__ import annotations

import contextlib
import math
import os
import select
import time
from collections import deque
from collections.abc import Mapping
from typing import Any, Final, TextIO

from vve_sumo.live.wording import ALARMS, bell_count, phase, picture, transition

#: between two pictures, and between two rings of one bell [s]
PICTURE_PERIOD: Final = 0.1
RING_PERIOD: Final = 0.3
#: what a pipe takes in one piece [bytes]; transitions that wait for a terminal
CHUNK_SIZE: Final = 4096
MAX_LINES: Final = 100


class Screen:
    """A terminal, or anything else that is written to."""

    def __init__(self, stream: TextIO) -> None:
        """Write to where `stream` goes, without ever waiting for it."""
        self._number, self._own = stream.fileno(), False
        self._terminal = stream.isatty()
        if self._terminal:
            # The stream's file description is shared with the shell, so it must stay blocking; this one is not shared.
            with contextlib.suppress(OSError):
                self._number = os.open(os.ttyname(stream.fileno()), os.O_WRONLY | os.O_NONBLOCK | os.O_NOCTTY)
                self._own = True
        self._phases: dict[int, str] = {}  # of each car, by its place
        self._lines: deque[str] = deque(maxlen=MAX_LINES)
        self._rest = b""  # what the terminal has not taken yet
        self._painted = 0  # lines of the picture that stand on the terminal
        self._drawn_at = self._rung_at = -math.inf
        self._rings = 0
        self._tick, self._tick_time = None, time.monotonic()

    def show(self, *statuses: Mapping[str, Any]) -> None:
        """Show the status of each car; to be called often, draws at most ten times a second."""
        now = time.monotonic()
        if (tick := statuses[0].get("tick")) != self._tick:
            self._tick, self._tick_time = tick, now
        for place, status in enumerate(statuses):
            if (now_in := phase(status)) != self._phases.get(place, ""):
                self._phases[place], self._rings, self._drawn_at = now_in, bell_count(status), -math.inf
                self._lines.append(transition(status))
        if not self._flush():
            return
        if not self._terminal:
            self._write("".join(f"{line}\n" for line in self._taken()))
        elif now - self._drawn_at >= PICTURE_PERIOD:
            self._drawn_at = now
            lines = [line for status in statuses for line in picture(status, now - self._tick_time)]
            self._write(self._bell(now) + self._frame(lines))

    def say(self, line: str) -> None:
        """Print a line of its own above the picture."""
        self._lines.append(line)
        self._drawn_at = -math.inf

    def close(self) -> None:
        """Leave the last picture standing; what a terminal does not take now is lost."""
        if self._flush():
            self._write("".join(f"{line}\n" for line in self._taken()) + ("\n" if self._painted else ""))
        if self._own:
            os.close(self._number)

    def _taken(self) -> list[str]:
        lines = list(self._lines)
        self._lines.clear()
        return lines

    def _bell(self, now: float) -> str:
        """Return a bell when one is due: at every picture of an alarm, else spaced, for terminals merge close rings."""
        if not ALARMS.isdisjoint(self._phases.values()):
            return "\a"
        if self._rings == 0 or now - self._rung_at < RING_PERIOD:
            return ""
        self._rings, self._rung_at = self._rings - 1, now
        return "\a"

    def _frame(self, lines: list[str]) -> str:
        """Return the text that wipes the last picture, writes the transitions above it and draws the next."""
        try:
            width = os.get_terminal_size(self._number).columns - 1
        except OSError:
            width = 0
        width = width if width > 0 else 79  # a terminal without a size says 0
        up = f"\x1b[{self._painted - 1}A" if self._painted > 1 else ""
        above = "".join(f"{line}\n" for line in self._taken())
        self._painted = len(lines)
        return f"\r{up}\x1b[J{above}" + "\n".join(line[:width] for line in lines)

    def _write(self, text: str) -> None:
        self._rest = text.encode(errors="replace")
        self._flush()

    def _flush(self) -> bool:
        """Write what is left of the last output; return whether nothing is left now."""
        while self._rest:
            ready = select.select([], [self._number], [], 0.0)[1]
            if not ready:
                return False
            try:
                self._rest = self._rest[os.write(self._number, self._rest[:CHUNK_SIZE]) :]
            except BlockingIOError:
                return False
            except OSError:
                # The terminal is gone; the drive goes on without a screen.
                self._rest = b""
        return True
