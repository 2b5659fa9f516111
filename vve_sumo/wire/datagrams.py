"""Codec of this project's own datagrams: the virtual radar to a control computer, its setpoints back.

Version 1, little endian, every number at a multiple of its size, so that a C struct without padding reads it. The last
four bytes are the CRC-32 (zlib's) of all before. `docs/brains.md` defines every field; `examples/brains/vve_wire.h` is
the same for C. Knows bytes; it must not know sockets, clocks, or what a gateway does with a setpoint.
"""

from __future__ import annotations

import enum
import math
import struct
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from vve_sumo.timing import SETPOINT_LIFETIME

MAGIC: Final = b"VVES"
VERSION: Final = 1
RADAR, SETPOINT = 1, 2  #: kinds of datagrams
VALID, EMERGENCY = 1, 1  #: flag of a radar datagram; flag of a setpoint
MAX_TARGETS: Final = 64
SEQUENCES: Final = 1 << 32  #: after which a sequence begins again
MICROSECONDS: Final = 1_000_000

_HEAD = struct.Struct("<4sBBHII")
_RADAR = struct.Struct("<ddffII")
_TARGET = struct.Struct("<fffHBB")
_SETPOINT = struct.Struct("<dffII")
_CRC = struct.Struct("<I")
SETPOINT_LENGTH: Final = _HEAD.size + _SETPOINT.size + _CRC.size  #: [bytes]


class Wrong(enum.StrEnum):
    """Why a datagram is none; reason codes of a setpoint that is not obeyed."""

    LENGTH = "setpoint_length"
    MAGIC = "setpoint_magic"
    VERSION = "setpoint_version"
    KIND = "setpoint_kind"
    CRC = "setpoint_crc"
    NUMBER = "setpoint_not_finite"
    LIFETIME = "setpoint_lifetime"


@dataclass(frozen=True, slots=True)
class Target:
    """One object that the virtual radar sees."""

    number: int  #: 0 to 65535; it keeps its number from scan to scan
    range: float  #: from the middle of the front bumper [m]
    azimuth: float  #: from the middle of the front bumper [rad], left positive
    range_rate: float  #: at the antenna [m/s], opening positive
    mode: int = 0  #: 0 long range, 1 medium range


@dataclass(frozen=True, slots=True)
class RadarDatagram:
    """What the virtual radar saw last, and how the car moves, at one tick."""

    sequence: int  #: counts ticks up by one, skipped ones included, modulo SEQUENCES
    time: float  #: of validity: the tick's, GNSS time [s since 1980-01-06, no leap seconds]
    lifetime: float  #: after its time of validity it must not be acted on for longer [s]
    measured: float  #: when the scan was measured, GNSS time [s]
    speed: float  #: of the rear axle along the heading [m/s]
    yaw_rate: float  #: [rad/s], left positive
    targets: Sequence[Target]
    valid: bool = True  #: False: nothing else but sequence and time means anything, and there is no target


@dataclass(frozen=True, slots=True)
class SetpointDatagram:
    """What a control computer asks of the gateway."""

    sequence: int  #: counts setpoints up, modulo SEQUENCES
    answers: int  #: sequence of the radar datagram that it answers
    time: float  #: GNSS time of that datagram [s]
    lifetime: float  #: after its arrival it must not be acted on for longer [s], SETPOINT_LIFETIME at most
    steering: float  #: road-wheel angle [rad], left positive
    acceleration: float  #: along the heading [m/s2], braking negative
    emergency: bool = False  #: asks for the emergency envelope instead of the comfort one


def encode_radar(radar: RadarDatagram) -> bytes:
    """Return the bytes of a radar datagram; an invalid one carries no target and zeros for what it does not know.

    Raises ValueError for more than MAX_TARGETS targets and for a number that is not finite.
    """
    targets = tuple(radar.targets) if radar.valid else ()
    if len(targets) > MAX_TARGETS:
        raise ValueError(f"a radar datagram holds at most {MAX_TARGETS} targets, got {len(targets)}")
    known = (radar.measured, radar.speed, radar.yaw_rate) if radar.valid else (0.0, 0.0, 0.0)
    numbers = [radar.time, *known, *(x for each in targets for x in (each.range, each.azimuth, each.range_rate))]
    if not all(map(math.isfinite, numbers)):
        raise ValueError("a radar datagram carries finite numbers only")
    measured, speed, yaw_rate = known
    body = b"".join(
        (
            _HEAD.pack(
                MAGIC, VERSION, RADAR, VALID * radar.valid, radar.sequence % SEQUENCES, _microseconds(radar.lifetime)
            ),
            _RADAR.pack(radar.time, measured, speed, yaw_rate, len(targets), 0),
            *(_TARGET.pack(t.range, t.azimuth, t.range_rate, t.number & 0xFFFF, t.mode, 0) for t in targets),
        )
    )
    return body + _CRC.pack(zlib.crc32(body))


def decode_radar(data: bytes) -> RadarDatagram | None:
    """Return a radar datagram; None for bytes that are none of this version, or not whole."""
    least = _HEAD.size + _RADAR.size + _CRC.size
    if len(data) < least or isinstance(head := _opened(data, RADAR), Wrong):
        return None
    flags, sequence, lifetime = head
    time, measured, speed, yaw_rate, count, _ = _RADAR.unpack_from(data, _HEAD.size)
    if count > MAX_TARGETS or len(data) != least + count * _TARGET.size:
        return None
    rows = (_TARGET.unpack_from(data, least - _CRC.size + n * _TARGET.size) for n in range(count))
    targets = tuple(Target(number, far, aside, rate, mode) for far, aside, rate, number, mode, _ in rows)
    numbers = [time, measured, speed, yaw_rate, *(x for t in targets for x in (t.range, t.azimuth, t.range_rate))]
    if not all(map(math.isfinite, numbers)):
        return None
    return RadarDatagram(sequence, time, lifetime, measured, speed, yaw_rate, targets, bool(flags & VALID))


def encode_setpoint(setpoint: SetpointDatagram) -> bytes:
    """Return the bytes of a setpoint; raises ValueError for a number that is not finite."""
    if not all(map(math.isfinite, (setpoint.time, setpoint.steering, setpoint.acceleration))):
        raise ValueError("a setpoint carries finite numbers only")
    lifetime, flags = _microseconds(setpoint.lifetime), EMERGENCY * setpoint.emergency
    body = _HEAD.pack(MAGIC, VERSION, SETPOINT, flags, setpoint.sequence % SEQUENCES, lifetime)
    body += _SETPOINT.pack(setpoint.time, setpoint.steering, setpoint.acceleration, setpoint.answers % SEQUENCES, 0)
    return body + _CRC.pack(zlib.crc32(body))


def decode_setpoint(data: bytes) -> SetpointDatagram | Wrong:
    """Return a setpoint, or why the bytes are none; never raises on any bytes."""
    if len(data) != SETPOINT_LENGTH:
        return Wrong.LENGTH
    head = _opened(data, SETPOINT)
    if isinstance(head, Wrong):
        return head
    flags, sequence, lifetime = head
    time, steering, acceleration, answers, _ = _SETPOINT.unpack_from(data, _HEAD.size)
    if not all(map(math.isfinite, (time, steering, acceleration))):
        return Wrong.NUMBER
    if not 0.0 < lifetime <= SETPOINT_LIFETIME:
        return Wrong.LIFETIME
    return SetpointDatagram(sequence, answers, time, lifetime, steering, acceleration, bool(flags & EMERGENCY))


def _opened(data: bytes, expected_kind: int) -> tuple[int, int, float] | Wrong:
    """Return flags, sequence and lifetime [s] of a datagram of the wanted kind, or why it is none."""
    magic, version, kind, flags, sequence, lifetime = _HEAD.unpack_from(data)
    if magic != MAGIC:
        return Wrong.MAGIC
    if version != VERSION:
        return Wrong.VERSION
    if zlib.crc32(data[: -_CRC.size]) != _CRC.unpack(data[-_CRC.size :])[0]:
        return Wrong.CRC
    if kind != expected_kind:
        return Wrong.KIND
    return flags, sequence, lifetime / MICROSECONDS


def _microseconds(seconds: float) -> int:
    if not 0.0 <= seconds < 2**32 / MICROSECONDS:
        raise ValueError(f"a lifetime must be from 0 s to 4294 s, got {seconds}")
    return round(seconds * MICROSECONDS)
