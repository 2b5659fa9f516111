"""What the test engineer sees and hears: a few lines rewritten in place, and a line and a bell for every transition.

Turns a status into text; decides nothing. It never blocks: what a terminal does not take is dropped and drawn anew.
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

from vve_sumo.drive.reasons import in_words
from vve_sumo.values import ArmingState

#: between two pictures, and between two rings of one bell [s]
PICTURE_PERIOD: Final = 0.1
RING_PERIOD: Final = 0.3
#: a drive that has told nothing for so long is said to be silent [s]
SILENCE: Final = 0.5
#: reasons that are written out
MOST_REASONS: Final = 8
#: what a pipe takes in one piece [bytes]; transitions that wait for a terminal
PIECE: Final = 4096
MOST_LINES: Final = 100

CONTROL: Final = "driver has control"
_PHASES: Final = {
    ArmingState.DISARMED: "not ready",
    ArmingState.READY: "ready: e engages",
    ArmingState.ENGAGED: "driving: any key stops",
    ArmingState.STOPPING: "stopping",
    ArmingState.STOPPED: "at rest",
    ArmingState.FAULT: "fault",
}
_ENGAGED_PHASES: Final = {
    "engaging": "engaging: the kit is being enabled",
    "shifting": "engaging: the car shifts to drive",
    "waiting_for_go": "engaged and held: g goes, any other key stops",
}


def phase(status: Mapping[str, Any]) -> str:
    """Return where the drive stands, in words; a change of it is a transition."""
    if "state" not in status:
        return "starting"
    state, reasons = ArmingState(status["state"]), status.get("reasons", ())
    if state is ArmingState.FAULT and "driver_override" in reasons:
        return CONTROL
    if state is ArmingState.ENGAGED:
        for code, words in _ENGAGED_PHASES.items():
            if code in reasons:
                return words
    return _PHASES[state]


def rings(status: Mapping[str, Any]) -> int:
    """Return how often the bell rings when the drive comes to this status: twice is stopping, three times trouble."""
    return {"stopping": 2, "fault": 3}.get(status.get("state", ""), 1)


def transition(status: Mapping[str, Any]) -> str:
    """Return the line that tells of a transition, with its reasons."""
    time_s, reasons = status.get("time_s"), _reasons(status)
    words = f"{_number(time_s, '8.2f')} s  {phase(status).upper()}"
    return f"{words}: {'; '.join(in_words(code) for code in reasons)}" if reasons else words


def picture(status: Mapping[str, Any], silent: float = 0.0) -> list[str]:
    """Return the lines of the picture; `silent` is how long the drive has told nothing [s]."""
    lines = [_motion(status), _health(status)]
    if not silent < SILENCE:
        lines.append(f"  ! the drive's process has told nothing for {_number(silent, '.1f')} s")
    words = [in_words(code) for code in _reasons(status)]
    words += [f"fix: {in_words(code)}" for code in status.get("pose_reasons", ())]
    lines += [f"  - {one}" for one in words[:MOST_REASONS]]
    if len(words) > MOST_REASONS:
        lines.append(f"  - and {len(words) - MOST_REASONS} more")
    return lines


def _motion(status: Mapping[str, Any]) -> str:
    speed = status.get("speed_mps")
    parts = [phase(status).upper(), f"{_number(None if speed is None else 3.6 * speed, '.1f')} km/h"]
    parts.append(f"{_number(status.get('to_go_m'), '.0f')} m to go")
    parts.append(f"ahead {_number(status.get('range_m'), '.1f')} m")
    if status.get("note"):
        parts.append(str(status["note"]))
    return "  ".join(parts)


def _health(status: Mapping[str, Any]) -> str:
    latency, clock = status.get("latency", {}), status.get("clock", {})
    fix = "no pose yet" if status.get("speed_mps") is None else "fix good"
    if status.get("pose_reasons"):
        fix = "FIX REFUSED"
    broken = any(code.startswith("record_") for code in _reasons(status))
    times = f"latency {_milliseconds(latency.get('p50'))}, p99 {_milliseconds(latency.get('p99'))} ms"
    parts = [fix, times, f"missed {status.get('missed', 0)}", "RECORD BROKEN" if broken else "recording"]
    if clock:
        parts.append(f"clock {clock.get('age')}, drift {_number(clock.get('drift_ppm'), '.1f')} ppm")
    return "  ".join(parts)


def _reasons(status: Mapping[str, Any]) -> list[str]:
    """All codes once, the gateway's first; what a phase says already is left out."""
    codes = dict.fromkeys([*status.get("reasons", ()), *status.get("faults", ())])
    return [code for code in codes if code not in _ENGAGED_PHASES]


def _number(value: Any, form: str) -> str:
    return f"{value:{form}}" if isinstance(value, (int, float)) and math.isfinite(value) else "-"


def _milliseconds(seconds: Any) -> str:
    return _number(None if seconds is None else 1000.0 * seconds, ".1f")


class Screen:
    """A terminal, or anything else that is written to."""

    def __init__(self, stream: TextIO) -> None:
        """Write to where `stream` goes, without ever waiting for it."""
        self._number, self._own = stream.fileno(), False
        self._terminal = stream.isatty()
        if self._terminal:
            # The stream's description is shared with the shell, so it stays blocking; this one is ours alone.
            with contextlib.suppress(OSError):
                self._number = os.open(os.ttyname(stream.fileno()), os.O_WRONLY | os.O_NONBLOCK | os.O_NOCTTY)
                self._own = True
        self._phase = ""
        self._lines: deque[str] = deque(maxlen=MOST_LINES)
        self._rest = b""  # what the terminal has not taken yet
        self._painted = 0  # lines of the picture that stand on the terminal
        self._drawn_at = self._rung_at = -math.inf
        self._rings = 0
        self._tick, self._told_at = None, time.monotonic()

    def show(self, status: Mapping[str, Any]) -> None:
        """Show a status; to be called often, draws at most ten times a second."""
        now = time.monotonic()
        if (tick := status.get("tick")) != self._tick:
            self._tick, self._told_at = tick, now
        if (now_in := phase(status)) != self._phase:
            self._phase, self._rings, self._drawn_at = now_in, rings(status), -math.inf
            self._lines.append(transition(status))
        if not self._flush():
            return
        if not self._terminal:
            self._write("".join(f"{line}\n" for line in self._taken()))
        elif now - self._drawn_at >= PICTURE_PERIOD:
            self._drawn_at = now
            self._write(self._bell(now) + self._frame(picture(status, now - self._told_at)))

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
        """Terminals make one of rings that come together, so each has its time."""
        if self._rings == 0 or now - self._rung_at < RING_PERIOD:
            return ""
        self._rings, self._rung_at = self._rings - 1, now
        return "\a"

    def _frame(self, lines: list[str]) -> str:
        """Return what wipes the last picture, writes the transitions above it and draws the next."""
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
        """Write what is left of the last piece; whether nothing is left now."""
        while self._rest:
            ready = select.select([], [self._number], [], 0.0)[1]
            if not ready:
                return False
            try:
                self._rest = self._rest[os.write(self._number, self._rest[:PIECE]) :]
            except BlockingIOError:
                return False
            except OSError:
                # The terminal is gone; the drive does not end for want of an audience.
                self._rest = b""
        return True
