"""The door to the CAN bus and to its logs: the only place that knows python-can.

Opens, sends, receives, reads and formats; what a frame means is nobody's business here. Nothing is ever handed to a
periodic sender: a frozen program must fall silent, not go on commanding a car.
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator
from pathlib import Path
from types import TracebackType
from typing import Self

import can

from vve_sumo.errors import ConfigError, RigError
from vve_sumo.values import Frame


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
            self._bus = can.Bus(interface=interface, channel=channel, bitrate=bitrate)
        except Exception as error:  # a driver without its vendor's library raises anything, even NameError
            raise self._rig_error("cannot be opened", error) from error

    def send(self, frame: Frame) -> None:
        """Put one frame on the bus."""
        try:
            self._bus.send(can.Message(arbitration_id=frame.id, data=frame.data, is_extended_id=False))
        except (OSError, can.CanError) as error:
            raise self._rig_error("cannot send", error) from error

    def receive(self, timeout: float) -> tuple[float, Frame] | None:
        """Driver's timestamp [s] and frame of the next classic 11-bit data frame, or None after `timeout` [s].

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
        """Let go of the bus."""
        self._bus.shutdown()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.close()

    def _rig_error(self, what: str, error: Exception) -> RigError:
        text = " ".join(str(error).split()) or type(error).__name__
        return RigError(f"CAN bus {self.name} {what}: {text}")


def read_log(path: Path) -> Iterator[tuple[float, str, Frame]]:
    """Time [s], channel and frame of every line of a candump log.

    Leaves out what a `Frame` cannot hold: extended, remote, error and FD frames. Raises ConfigError for a file that is
    not there or a line that is not candump's.
    """
    frames = 0
    try:
        with can.CanutilsLogReader(path) as reader:
            for message in reader:
                frames += 1
                frame = _as_frame(message)
                if frame is not None:
                    yield message.timestamp, str(message.channel), frame
    except OSError as error:
        raise ConfigError(f"{path}: {error.strerror}") from error
    except ValueError as error:
        raise ConfigError(f"{path}: not a candump log after {frames} frames ({error})") from error


def candump_line(timestamp: float, channel: str, frame: Frame) -> str:
    """One line of a candump log, with its line end; `timestamp` [s] is kept to the microsecond."""
    return candump_lines(timestamp, channel, (frame,))


def candump_lines(timestamp: float, channel: str, frames: Iterable[Frame]) -> str:
    """A line for each frame of one moment, as `candump_line` writes it."""
    head = f"({timestamp:017.6f}) {channel}"
    return "".join([f"{head} {identifier:03X}#{data.hex().upper()}\n" for identifier, data in frames])


def _as_frame(message: can.Message) -> Frame | None:
    if message.is_extended_id or message.is_remote_frame or message.is_error_frame or message.is_fd:
        return None
    return Frame(message.arbitration_id, bytes(message.data))
