"""Codec of the messages between the gateway's process and the other processes of a drive.

It has no socket and no clock, and does not judge content. Decoding any bytes gives a message or the reason why they are
none; encoding cuts texts and lists that are too long.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable
from operator import attrgetter
from typing import Any, Final, NamedTuple, TypeVar

from vve_sumo.values import ArmingState, FallbackPath, GatewayStatus, Setpoint, resolve_fallback_path
from vve_sumo.vehicle.arming_machine import OperatorCommand
from vve_sumo.vehicle.fallback import MAX_KNOTS

VERSION: Final = 2
MAX_TEXT: Final = 255  # bytes of a string
MAX_CODES: Final = 64  # strings in a list

# Little endian throughout: magic, version, kind; then the body; then the CRC-32 (zlib's) of all bytes before it.
_MAGIC: Final = b"VV"
_HEAD: Final = struct.Struct("<2sBB")
_CRC: Final = struct.Struct("<I")
_SETPOINT: Final = struct.Struct("<ddqdddddddd")
_numbers: Final = attrgetter("time", "expires", "x", "y", "heading", "speed", "yaw_rate", "grade")
_PROFILE: Final = struct.Struct("<dB")
_FEEDBACK: Final = struct.Struct("<dqdddq")
_STATUS: Final = struct.Struct("<dddd")
_KIND_SETPOINT, _KIND_ACT, _KIND_FEEDBACK = 1, 2, 3
# One knot more than a fallback path may have is sent, so that the gateway rejects a path that was too long.
_KNOTS_SENT: Final = MAX_KNOTS + 1
#: of a fallback path's knots, by their number
_KNOTS: Final = tuple(struct.Struct(f"<{number}d") for number in range(_KNOTS_SENT + 1))
_MAX_INTEGER: Final = (1 << 63) - 1

_Message = TypeVar("_Message")


class MalformedMessage(NamedTuple):
    """Bytes that are no message."""

    reason: str  #: too_short, wrong_crc, wrong_magic, wrong_version, wrong_kind or wrong_content


class Feedback(NamedTuple):
    """The gateway process's message after each of its steps."""

    time: float  #: drive time of the step [s]
    sequence: int  #: of the newest setpoint accepted; -1 for none
    sent: float  #: drive time at which the send of the last command frame returned [s]; NaN for none
    status: GatewayStatus  #: of the step
    measured_steering: float  #: road-wheel angle that the car reports [rad], left positive; NaN not reported
    wheel_speed: float  #: rear axle's speed from the wheels [m/s], forward positive; NaN not reported
    gear: str  #: that the car reports
    steps: int  #: steps so far


def encode_setpoint(setpoint: Setpoint) -> bytes:
    """Return the datagram of a setpoint; the note and the faults are cut at 255 bytes each and 64 faults."""
    s, profile = setpoint, resolve_fallback_path(setpoint.fallback_path)
    body = [
        _SETPOINT.pack(s.steering, s.acceleration, _whole(s.sequence), *_numbers(s)),
        b"\1" if s.emergency else b"\0",
        _text(s.note),
        _texts(s.faults),
        b"\0" if profile is None else b"\1" + _profile(profile),
    ]
    return _sealed(_KIND_SETPOINT, b"".join(body))


def decode_setpoint(data: bytes) -> Setpoint | MalformedMessage:
    """Return the setpoint in a datagram, bit for bit as it was sent."""
    return _decoded(_KIND_SETPOINT, data, _setpoint)


def _setpoint(reader: _Reader) -> Setpoint:
    steering, acceleration, sequence, time, expires, x, y, heading, speed, yaw_rate, grade = reader.take(_SETPOINT)
    return Setpoint(
        steering=steering,
        acceleration=acceleration,
        emergency=reader.flag(),
        note=reader.text(),
        sequence=sequence,
        time=time,
        expires=expires,
        x=x,
        y=y,
        heading=heading,
        speed=speed,
        yaw_rate=yaw_rate,
        grade=grade,
        faults=reader.texts(),
        fallback_path=reader.profile() if reader.flag() else None,
    )


def encode_operator_command(act: OperatorCommand) -> bytes:
    """Return the datagram of an operator command."""
    return _sealed(_KIND_ACT, _text(act))


def decode_operator_command(data: bytes) -> OperatorCommand | MalformedMessage:
    """Return the operator command in a datagram."""
    return _decoded(_KIND_ACT, data, lambda reader: OperatorCommand(reader.text()))


def encode_feedback(feedback: Feedback) -> bytes:
    """Return the datagram of a feedback; lists of codes are cut at 64, each at 255 bytes."""
    f, status = feedback, feedback.status
    body = [
        _FEEDBACK.pack(f.time, _whole(f.sequence), f.sent, f.measured_steering, f.wheel_speed, _whole(f.steps)),
        _STATUS.pack(status.steering, status.acceleration, status.brake_torque, status.throttle),
        _text(status.state),
        _text(f.gear),
        _texts(status.reasons),
        _texts(status.limited),
    ]
    return _sealed(_KIND_FEEDBACK, b"".join(body))


def decode_feedback(data: bytes) -> Feedback | MalformedMessage:
    """Return the feedback in a datagram, bit for bit as it was sent."""
    return _decoded(_KIND_FEEDBACK, data, _feedback)


def _feedback(reader: _Reader) -> Feedback:
    time, sequence, sent, measured_steering, wheel_speed, steps = reader.take(_FEEDBACK)
    steering, acceleration, brake_torque, throttle = reader.take(_STATUS)
    state, gear, reasons, limited = ArmingState(reader.text()), reader.text(), reader.texts(), reader.texts()
    status = GatewayStatus(state, reasons, steering, acceleration, limited, brake_torque, throttle)
    return Feedback(time, sequence, sent, status, measured_steering, wheel_speed, gear, steps)


def _sealed(kind: int, body: bytes) -> bytes:
    message = _HEAD.pack(_MAGIC, VERSION, kind) + body
    return message + _CRC.pack(zlib.crc32(message))


def _opened(kind: int, data: bytes) -> bytes | MalformedMessage:
    """Return the body of a message of that kind."""
    if len(data) < _HEAD.size + _CRC.size:
        return MalformedMessage("too_short")
    if _CRC.unpack(data[-_CRC.size :]) != (zlib.crc32(data[: -_CRC.size]),):
        return MalformedMessage("wrong_crc")
    magic, version, said = _HEAD.unpack_from(data)
    if magic != _MAGIC:
        return MalformedMessage("wrong_magic")
    if version != VERSION:
        return MalformedMessage("wrong_version")
    return data[_HEAD.size : -_CRC.size] if said == kind else MalformedMessage("wrong_kind")


def _decoded(kind: int, data: bytes, read: Callable[[_Reader], _Message]) -> _Message | MalformedMessage:
    body = _opened(kind, data)
    if isinstance(body, MalformedMessage):
        return body
    reader = _Reader(body)
    try:
        return reader.finished(read(reader))
    except (struct.error, ValueError, IndexError):
        return MalformedMessage("wrong_content")


def _whole(number: int) -> int:
    return min(max(number, -_MAX_INTEGER), _MAX_INTEGER)


def _text(text: str) -> bytes:
    # A controller's note may hold lone surrogates, which strict UTF-8 cannot encode; they are sent all the same.
    data = text.encode("utf-8", "surrogatepass")
    if len(data) > MAX_TEXT:
        data = data[:MAX_TEXT].decode("utf-8", "ignore").encode()
    return bytes((len(data),)) + data


def _texts(texts: tuple[str, ...]) -> bytes:
    kept = texts[:MAX_CODES]
    return bytes((len(kept),)) + b"".join(map(_text, kept))


def _profile(profile: FallbackPath) -> bytes:
    knots = profile.curvature[:_KNOTS_SENT]
    return _PROFILE.pack(profile.spacing, len(knots)) + _KNOTS[len(knots)].pack(*knots)


class _Reader:
    """Reads a body field by field; raises struct.error, ValueError or IndexError for a malformed field."""

    def __init__(self, data: bytes) -> None:
        self._data = data
        self._at = 0

    def take(self, layout: struct.Struct) -> tuple[Any, ...]:
        values = layout.unpack_from(self._data, self._at)
        self._at += layout.size
        return values

    def byte(self) -> int:
        self._at += 1
        return self._data[self._at - 1]

    def flag(self) -> bool:
        value = self.byte()
        if value > 1:
            raise ValueError("neither yes nor no")
        return value == 1

    def text(self) -> str:
        length = self.byte()
        data = self._data[self._at : self._at + length]
        if len(data) < length:
            raise ValueError("text is cut short")
        self._at += length
        return data.decode("utf-8", "surrogatepass")

    def texts(self) -> tuple[str, ...]:
        number = self.byte()
        if number > MAX_CODES:
            raise ValueError("too many texts")
        return tuple(self.text() for _ in range(number))

    def profile(self) -> FallbackPath:
        spacing, number = self.take(_PROFILE)
        if number > _KNOTS_SENT:
            raise ValueError("too many knots")
        return FallbackPath(spacing, self.take(_KNOTS[number]))

    def finished(self, message: _Message) -> _Message:
        """Return `message`; raises ValueError if bytes are left over."""
        if self._at != len(self._data):
            raise ValueError("something is left over")
        return message
