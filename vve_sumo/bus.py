"""The door to the CAN bus and to its logs: the only place that knows python-can.

Opens, sends, receives, reads and formats; what a frame means is nobody's business here. Nothing is ever handed to a
periodic sender: a frozen program must fall silent, not go on commanding a car.
"""

from __future__ import annotations

import contextlib
import io
import math
import os
import re
import select
import sys
import tempfile
import threading
import time
from collections import deque
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, Final, Literal, NamedTuple, Self

from vve_sumo.errors import ConfigError, RigError
from vve_sumo.values import EXTENDED, Frame


@contextlib.contextmanager
def _absent(package: str) -> Iterator[None]:
    """Let a package that is not imported yet seem to be not installed; None is Python's own mark of that."""
    modules: dict[str, Any] = sys.modules
    kept = modules.setdefault(package, None)
    try:
        yield
    finally:
        if kept is None:
            del modules[package]


# python-can imports asammdf where that is installed. It brings pandas, and numexpr with a thread for each processor:
# half a second and threads that no process that drives a car needs.
with _absent("asammdf"):
    import can
    from can.interfaces.slcan import slcanBus

#: for one frame to be taken by a driver that is busy [s]; a serial adapter that nobody reads would wait for ever
SEND_TIMEOUT: Final = 0.005
#: frames taken in at once, so that a flooded bus can't keep its listener from everything else
MAX_FRAMES: Final = 1000
#: of a serial adapter: bytes read at once, and the longest line that can still become a frame
SERIAL_CHUNK: Final = 4096
MAX_LINE_LENGTH: Final = 32
#: of a classic frame: greatest identifiers of 11 and of 29 bits, most bytes
MAX_IDENTIFIER, MAX_EXTENDED, MAX_LENGTH = 0x7FF, 0x1FFF_FFFF, 8

#: a classic data frame on a serial adapter's wire, of 11 or 29 bits: LAWICEL, CANUSB manual, commands t and T; most
#: hold eight bytes
_SERIAL_FRAME: Final = re.compile(
    rb"(?:t[0-7][0-9A-Fa-f]{2}|T[01][0-9A-Fa-f]{7})(?:"
    + b"|".join(b"%d[0-9A-Fa-f]{%d}" % (size, 2 * size) for size in range(8, -1, -1))
    + rb")"
)


#: event at the begin of an ASC file
_BEGIN: Final = "Start of measurement"


class LoggedFrame(NamedTuple):
    """A frame of a log."""

    time: float  #: [s since 1970-01-01 UTC]
    channel: int  #: number of the bus, from 0
    frame: Frame
    sent: bool  #: by the writer of the log; else it heard it


class Bus:
    """An open CAN bus; closed by `close` or at the end of a with block.

    `interface`, `channel` and `bitrate` [bit/s] are python-can's ("socketcan", "can0"; "virtual", "any name"). Raises
    ConfigError for an interface that python-can does not have, RigError where the bus cannot be opened or used.
    """

    def __init__(self, interface: str, channel: str, bitrate: int = 500_000) -> None:
        if interface not in can.VALID_INTERFACES:
            known = ", ".join(sorted(can.VALID_INTERFACES))
            raise ConfigError(f"bus interface: expected one of {known}; got {interface!r}")
        self.name = f"{interface}:{channel}"
        try:
            if interface == "slcan":
                self._bus: can.BusABC = _SerialBus(channel, bitrate)
            else:
                self._bus = can.Bus(interface=interface, channel=channel, bitrate=bitrate)
        except Exception as error:  # a driver without its vendor's library raises anything, even NameError
            raise self._rig_error("cannot be opened", error) from error

    def send(self, frame: Frame) -> None:
        """Put one frame on the bus."""
        try:
            if isinstance(self._bus, _SerialBus):
                self._bus.send_frame(frame)
                return
            self._bus.send(_as_message(frame), SEND_TIMEOUT)
        except (OSError, can.CanError) as error:
            raise self._rig_error("cannot send", error) from error

    def drain(self) -> list[Frame]:
        """Return all classic data frames that wait now, without waiting; what we sent is not among them.

        At most MAX_FRAMES of them; the rest waits for the next call.
        """
        frames: list[Frame] = []
        for _ in range(MAX_FRAMES):
            try:
                if isinstance(self._bus, _SerialBus):
                    return self._bus.frames()
                message = self._bus.recv(0.0)
            except (OSError, can.CanError) as error:
                raise self._rig_error("cannot receive", error) from error
            if message is None:
                break
            frame = _as_frame(message)
            if frame is not None:
                frames.append(frame)
        return frames

    def fileno(self) -> int | None:
        """Return the file descriptor that becomes readable with a frame, or None where the driver has none."""
        try:
            return int(self._bus.fileno())
        except (NotImplementedError, can.CanError):
            return None

    def receive(self, timeout: float) -> tuple[float, Frame] | None:
        """Driver's timestamp [s] and frame of the next classic data frame, or None after `timeout` [s].

        An interface that goes down may look like a silent one: judge silence by age, not by errors.
        """
        deadline = time.monotonic() + timeout
        while True:
            try:
                message = self._bus.recv(max(deadline - time.monotonic(), 0.0))
            except (OSError, can.CanError) as error:
                raise self._rig_error("cannot receive", error) from error
            if message is None:
                return None
            frame = _as_frame(message)
            if frame is not None:
                return message.timestamp, frame

    def close(self) -> None:
        """Let go of the bus; one that is gone already lets go of itself."""
        with contextlib.suppress(OSError, can.CanError):
            self._bus.shutdown()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _rig_error(self, what: str, error: Exception) -> RigError:
        text = " ".join(str(error).split()) or type(error).__name__
        return RigError(f"CAN bus {self.name} {what}: {text}")


def interfaces() -> list[str]:
    """Return the names of python-can's interfaces; whether the driver of one is installed shows when it is opened."""
    return sorted(can.VALID_INTERFACES)


def read_log(path: Path) -> Iterator[tuple[float, str, Frame]]:
    """Time [s], channel and frame of every line of a candump log; a last line without its end is a torn one.

    Leaves out what a `Frame` cannot hold: remote, error and FD frames. Raises ConfigError for a file that is
    not there or a line that is not candump's.
    """
    frames = 0
    try:
        text = path.read_text(encoding="ascii", errors="replace")
        with can.CanutilsLogReader(io.StringIO(text[: text.rfind("\n") + 1])) as reader:
            for message in reader:
                frames += 1
                frame = _as_frame(message)
                if frame is not None:
                    yield message.timestamp, str(message.channel), frame
    except OSError as error:
        raise ConfigError(f"{path}: {error.strerror}") from error
    except ValueError as error:
        raise ConfigError(f"{path}: not a candump log after {frames} frames ({error})") from error


def candump_lines(timestamp: float, channel: str, frames: Iterable[Frame]) -> str:
    """Return a line of a candump log for each frame of one moment; `timestamp` [s] is kept to the microsecond."""
    head = f"({timestamp:017.6f}) {channel}"
    return "".join([f"{head} {frame_text(frame)}\n" for frame in frames])


def frame_text(frame: Frame) -> str:
    """Return a frame as candump writes it: an identifier of three digits, or of eight with 29 bits, and the bytes."""
    identifier, data = frame
    if identifier & EXTENDED:
        return f"{identifier ^ EXTENDED:08X}#{data.hex().upper()}"
    return f"{identifier:03X}#{data.hex().upper()}"


def written_log(frames: Iterable[LoggedFrame], form: Literal["asc", "blf"]) -> bytes:
    """Return the content of a log of Vector's tools with these frames, in their order.

    An ASC file has its date in the machine's local time, and counts from the whole second before its first frame.
    """
    with tempfile.TemporaryDirectory(prefix="vve_sumo_") as folder:
        file, frames = Path(folder) / f"log.{form}", list(frames)
        with can.Logger(file) as log:
            if frames and form == "asc":
                # python-can writes the date's milliseconds without their leading zeros, and reads them otherwise.
                log.log_event(_BEGIN, float(math.floor(frames[0].time)))
            for one in frames:
                log.on_message_received(_as_logged(one))
        content = file.read_bytes()
    return content if form == "blf" else _dated_by_its_trigger(content)


def _as_message(frame: Frame) -> can.Message:
    identifier, data = frame
    extended = bool(identifier & EXTENDED)
    return can.Message(arbitration_id=identifier & ~EXTENDED, data=data, is_extended_id=extended)


def _as_logged(one: LoggedFrame) -> can.Message:
    message = _as_message(one.frame)
    message.timestamp, message.channel, message.is_rx = one.time, one.channel, not one.sent
    return message


def _dated_by_its_trigger(content: bytes) -> bytes:
    """Return an ASC file whose head has the date of its trigger block; python-can writes the moment of writing."""
    begin = f" 0.000000 {_BEGIN}\n".encode()
    date = re.search(rb"^Begin Triggerblock (.*)$", content, re.MULTILINE)
    if date is None:
        return re.sub(rb"^date .*\n", b"", content, count=1)
    dated = re.sub(rb"^date .*$", b"date " + date[1], content, count=1, flags=re.MULTILINE)
    return dated.replace(2 * begin, begin, 1)  # python-can writes this event by itself, too


class _SerialBus(slcanBus):  # type: ignore[misc]  # python-can has no types that mypy is shown
    """python-can's serial adapter, reading what is there at once: byte by byte, ten frames take a millisecond.

    Lines that are no classic data frame are passed over: the adapter's answers, and noise on the wire, over
    which python-can would stumble.

    Linux hands over a serial port's bytes by an ordinary kernel worker, and whoever looks at the port waits for that
    one, whatever its own priority. So a thread does the looking, and passes the bytes on through a pipe.

    Frames go in and out without python-can's messages, which take several times as long to make.
    """

    def __init__(self, port: str, bitrate: int) -> None:
        self._lines: deque[str] = deque()
        self._torn = b""
        self._wake_pipe: tuple[int, int] | None = None
        super().__init__(port, bitrate=bitrate, sleep_after_open=0.0, timeout=0.0)
        self._wake_pipe = os.pipe2(os.O_CLOEXEC)
        self._quit = os.pipe2(os.O_CLOEXEC)
        self._listener = threading.Thread(target=self._listen, daemon=True)
        self._listener.start()

    def fileno(self) -> int:
        """Return what becomes readable with the adapter's bytes, and where the adapter is gone."""
        if self._wake_pipe is None:
            raise can.CanOperationError("the port is closed")
        return self._wake_pipe[0]

    def shutdown(self) -> None:
        """Close everything; the thread of a port that hangs ends with the process."""
        pipe, self._wake_pipe = self._wake_pipe, None
        if pipe is not None:
            os.close(self._quit[1])
            self._listener.join(SEND_TIMEOUT)
            os.close(pipe[0])
        super().shutdown()

    def send_frame(self, frame: Frame) -> None:
        """Write a frame, or raise where it is no classic one or there is no room for it."""
        identifier, data = frame
        if 0 <= identifier <= MAX_IDENTIFIER and len(data) <= MAX_LENGTH:
            self._write(f"t{identifier:03X}{len(data)}{data.hex().upper()}")
        elif EXTENDED <= identifier <= EXTENDED + MAX_EXTENDED and len(data) <= MAX_LENGTH:
            self._write(f"T{identifier ^ EXTENDED:08X}{len(data)}{data.hex().upper()}")
        else:
            raise can.CanOperationError(f"no classic frame: {identifier:#x} with {len(data)} bytes")

    def frames(self) -> list[Frame]:
        """Return the frames that wait, at most MAX_FRAMES, without waiting."""
        taken: list[Frame] = []
        while len(taken) < MAX_FRAMES and (line := self._read(0.0)) is not None:
            if line[0] == "t":
                taken.append(Frame(int(line[1:4], 16), bytes.fromhex(line[5:])))
            else:
                taken.append(Frame(int(line[1:9], 16) | EXTENDED, bytes.fromhex(line[10:])))
        return taken

    def _listen(self) -> None:
        """Pass on what the adapter says, until it is gone or nobody wants to hear it."""
        assert self._wake_pipe is not None
        port, ear, stop = self.serialPortOrig.fileno(), self._wake_pipe[1], self._quit[0]
        with contextlib.suppress(OSError):
            while stop not in select.select([port, stop], [], [])[0] and (data := os.read(port, SERIAL_CHUNK)):
                os.write(ear, data)
        os.close(ear)
        os.close(stop)

    def _read(self, timeout: float | None) -> str | None:
        """Return the line of the next frame, or None after `timeout` [s]."""
        deadline = math.inf if timeout is None else time.monotonic() + timeout
        while not self._lines:
            left = max(deadline - time.monotonic(), 0.0)
            ready, _, _ = select.select([self.fileno()], [], [], None if timeout is None else left)
            if not ready:
                return None
            self._fill()
        return self._lines.popleft()

    def _write(self, string: str) -> None:
        """Write a line, or raise where there is no room for it; pyserial fails one that it took long over writing."""
        line, port = string.encode() + self.LINE_TERMINATOR, self.serialPortOrig.fileno()
        try:
            written = os.write(port, line)
        except BlockingIOError:
            _, ready, _ = select.select([], [port], [], SEND_TIMEOUT)
            written = os.write(port, line) if ready else 0
        if written < len(line):
            raise can.CanOperationError("the adapter takes nothing")

    def _fill(self) -> None:
        data = os.read(self.fileno(), SERIAL_CHUNK)
        if not data:
            raise can.CanOperationError("the adapter is gone")
        *lines, torn = (self._torn + data).replace(b"\a", b"\r").split(b"\r")
        self._torn = torn[-MAX_LINE_LENGTH:]
        self._lines.extend(line.decode("ascii") for line in lines if _SERIAL_FRAME.fullmatch(line))


def _as_frame(message: can.Message) -> Frame | None:
    if message.is_remote_frame or message.is_error_frame or message.is_fd:
        return None
    mark = EXTENDED if message.is_extended_id else 0
    return Frame(message.arbitration_id | mark, bytes(message.data))
