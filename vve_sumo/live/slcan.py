"""A serial CAN adapter in software: the device end of the LAWICEL protocol, on a pseudo-terminal.

A host opens its `name` as the serial port of a USB adapter (python-can: interface "slcan"). It knows lines and frames,
not what a frame means. No call waits: lines that are not read in time are dropped, oldest first.
"""

from __future__ import annotations

import os
import re
import termios
import tty
from collections import deque
from collections.abc import Iterable
from typing import Final, Self

from vve_sumo.values import EXTENDED, Frame

# Commands and answers: LAWICEL, "CANUSB manual" and "CAN232 manual" (version 3), chapters on the available commands.
OK: Final = b"\r"
ERROR: Final = b"\a"
MAX_LINE_LENGTH: Final = 32  # bytes; an extended frame with eight bytes takes 27
QUEUE_SIZE: Final = 512  # lines that wait for a slow reader; about a second of a car's reports
CHUNK: Final = 4096  # bytes; what the kernel keeps for a terminal

_HEX = rb"[0-9A-Fa-f]"
_FRAME: Final = re.compile(rb"(?:[tr]([0-7]HH)|[TR]([01]H{7}))([0-8])((?:HH){0,8})".replace(b"H", _HEX))
#: Settings that mean nothing without a wire; time stamps (Z1) are not among them: they would lengthen every line.
_SETTING: Final = re.compile(rb"S[0-9]|sH{4}|Z0|[Mm]H{8}|[WXUQ][0-9]".replace(b"H", _HEX))
_REPLIES: Final = {b"": OK, b"V": b"V1013\r", b"v": b"v1013\r", b"N": b"NVVE0\r", b"F": b"F00\r"}


class SlcanProtocol:
    """An adapter's answers to a host's commands; no terminal, no time."""

    def __init__(self) -> None:
        self.open = False  #: the CAN channel: frames pass in both directions
        self.closings = 0  #: how often the host has closed the open channel
        self._line = b""

    def take(self, data: bytes) -> tuple[list[Frame], bytes]:
        """Return the classic data frames that `data` completes, and the answers to be written back, in order.

        Remote frames are acknowledged and go nowhere: a `Frame` cannot hold them.
        """
        *lines, rest = (self._line + data).split(b"\r")
        self._line = rest[: MAX_LINE_LENGTH + 1]  # a line that is too long is still an error once complete
        frames: list[Frame] = []
        answers = b"".join([self._obey(line, frames) for line in lines])
        return frames, answers

    def _obey(self, line: bytes, frames: list[Frame]) -> bytes:
        if (match := _FRAME.fullmatch(line)) is not None:
            return self._pass_on(line, match, frames)
        if line in (b"O", b"C"):
            return self._switch(line == b"O")
        if _SETTING.fullmatch(line):
            return OK
        return _REPLIES.get(line, ERROR)

    def _switch(self, on: bool) -> bytes:
        if on is self.open:
            return ERROR
        self.open = on
        self.closings += not on
        return OK

    def _pass_on(self, line: bytes, match: re.Match[bytes], frames: list[Frame]) -> bytes:
        short, long, length, digits = match.groups()
        data = bytes.fromhex(digits.decode())
        remote = line[:1] in b"rR"
        if not self.open or len(data) != (0 if remote else int(length)):
            return ERROR
        if not remote:
            frames.append(Frame(int(short, 16) if short else int(long, 16) | EXTENDED, data))
        return b"z\r" if short else b"Z\r"


def encode_frame(frame: Frame) -> bytes:
    """Return the line that carries `frame`."""
    if frame.id & EXTENDED:
        return b"T%08X%d%s\r" % (frame.id ^ EXTENDED, len(frame.data), frame.data.hex().upper().encode())
    return b"t%03X%d%s\r" % (frame.id, len(frame.data), frame.data.hex().upper().encode())


class Adapter:
    """An adapter on a pseudo-terminal of this machine; closed by `close` or at the end of a with block.

    The host's side of the terminal is kept open here too, so that a host may end and another one open it.
    """

    def __init__(self, queue: int = QUEUE_SIZE) -> None:
        """`queue` is the number of lines that wait for a slow reader."""
        self._queue = queue
        self._ours, self._theirs = os.openpty()
        tty.setraw(self._theirs)
        os.set_blocking(self._ours, False)
        self.name: Final = os.ttyname(self._theirs)  #: what a host opens as its serial port
        self.dropped = 0  #: lines that nobody read in time
        self._dialogue = SlcanProtocol()
        self._lines: deque[bytes] = deque()
        self._begun = b""  # the rest of a line that is half written and has to be finished first

    def fileno(self) -> int:
        """Return the file descriptor, for poll and select."""
        return self._ours

    def receive(self) -> list[Frame]:
        """Return all frames that the host has sent since the last call, in order; answers go out at once."""
        frames: list[Frame] = []
        while data := self._read():
            closings = self._dialogue.closings
            taken, answers = self._dialogue.take(data)
            frames += taken
            if self._dialogue.closings != closings:
                # Lines that an earlier host never read are not for the next one.
                self._lines.clear()
                self._begun = b""
                termios.tcflush(self._theirs, termios.TCIFLUSH)
            self._put(answers)
        self._write()
        return frames

    def send(self, frames: Iterable[Frame]) -> None:
        """Pass frames to the host, as soon as it reads; they go nowhere while the host has not opened the channel."""
        if self._dialogue.open:
            for frame in frames:
                self._put(encode_frame(frame))
        self._write()

    def close(self) -> None:
        """Close both sides of the terminal."""
        os.close(self._ours)
        os.close(self._theirs)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _put(self, line: bytes) -> None:
        if not line:
            return
        if len(self._lines) >= self._queue:
            self._lines.popleft()
            self.dropped += 1
        self._lines.append(line)

    def _read(self) -> bytes:
        try:
            return os.read(self._ours, CHUNK)
        except BlockingIOError:
            return b""

    def _write(self) -> None:
        while waiting := self._begun + b"".join(self._lines):
            try:
                written = os.write(self._ours, waiting[:CHUNK])
            except BlockingIOError:
                return
            left = waiting[written:]
            end = 0 if waiting[written - 1 : written] in (OK, ERROR) else left.find(OK) + 1
            self._begun = left[:end]
            self._lines = deque(left[end:].splitlines(keepends=True))
