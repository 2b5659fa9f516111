"""Codec of the Delphi ESR's CAN frames: its 64 tracks, its status frames, and the host's motion that it is told.

It knows frames and tracks; it must not know which bus they travel on, nor how a track was found. Layout as in
comma.ai's opendbc (opendbc/dbc/ESR.dbc); the sign of the angle as in its Ford radar interface, to the right positive.
A 2018 Ford Fusion's own radar sends the same tracks under the same identifiers, with the angle's sign turned round.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Final

from vve_sumo.values import Frame
from vve_sumo.wire.signals import Signal, bits_of, data_of

TRACKS: Final = 64  #: of a cycle; each has an identifier of its own
FIRST_TRACK: Final = 0x500
LAST_TRACK: Final = FIRST_TRACK + TRACKS - 1  #: readers take a cycle as complete with this one
STATUS_1, STATUS_2, VERSIONS, PATH_TARGETS = 0x4E0, 0x4E1, 0x4E2, 0x4E3
TRACK_SENSOR: Final = 0x540
VEHICLE_DATA, SENSOR_INPUT = 0x4F0, 0x4F1  #: what the host sends

PERIOD: Final = 0.05  #: of a cycle [s]
SCANS: Final = 0x10000  #: after which the scan index begins again
STAMPS: Final = 128  #: counts after which the time stamp begins again

_RANGE = Signal(18, 11, 0.1)
_ANGLE = Signal(12, 10, 0.1, signed=True)  #: [deg] right positive
_RANGE_RATE = Signal(53, 14, 0.01, signed=True)
_RANGE_ACCELERATION = Signal(33, 10, 0.05, signed=True)
_LATERAL_RATE = Signal(7, 6, 0.25, signed=True)
_WIDTH = Signal(37, 4, 0.5)
_STATUS = Signal(15, 3)
_MODE = Signal(55, 2)
_ONCOMING = Signal(0, 1)
_ROLLING = Signal(38, 1)

_SCAN_INDEX = Signal(31, 16)
_TIMESTAMP = Signal(5, 7, 2.0)  #: [ms]
_HOST_SPEED = Signal(50, 11, 0.0625)
_HOST_YAW_RATE = Signal(47, 12, 0.0625, signed=True)  #: [deg/s]
_COMMUNICATION_ERROR = Signal(14, 1)
_ROLLING_1 = Signal(7, 2)
_ROLLING_2 = Signal(1, 2)
_MAXIMUM_TRACKS = Signal(7, 6, 1.0, 1.0)
_TRANSCEIVER = Signal(12, 1)
_INTERNAL_ERROR = Signal(13, 1)
_SPEED_FACTOR = Signal(39, 6, 0.00195, 1.0)

_VEHICLE_SPEED = Signal(7, 11, 0.0625)
_VEHICLE_REVERSE = Signal(12, 1)
_VEHICLE_YAW_RATE = Signal(11, 12, 0.0625, signed=True)  #: [deg/s]
_YAW_RATE_VALID = Signal(31, 1)
_RADIATE = Signal(55, 1)
_SPEED_VALID = Signal(61, 1)


class TrackStatus(IntEnum):
    """State of a track; the names are in general use, the description of the frames has none."""

    NONE = 0
    NEW = 1
    NEW_UPDATED = 2
    UPDATED = 3
    COASTED = 4
    MERGED = 5
    INVALID_COASTED = 6
    NEW_COASTED = 7


class Mode(IntEnum):
    """Field of view that a track was measured in."""

    NONE = 0
    MEDIUM_RANGE = 1
    LONG_RANGE = 2
    BOTH = 3


@dataclass(frozen=True, slots=True)
class Track:
    """One object that the radar follows."""

    number: int  #: 0 to 63; it keeps its number from cycle to cycle
    range: float  #: from the radar [m], 0 to 204.7
    angle: float  #: direction [rad], left positive, within 51 degrees
    range_rate: float  #: [m/s], opening positive
    range_acceleration: float = 0.0  #: [m/s2], opening faster positive
    lateral_rate: float = 0.0  #: [m/s], as the frame carries it
    width: float = 0.0  #: [m], 0 unknown
    status: TrackStatus = TrackStatus.UPDATED
    mode: Mode = Mode.LONG_RANGE
    oncoming: bool = False


@dataclass(frozen=True, slots=True)
class HostMotion:
    """How the car moves, as its host tells the radar, or as the radar repeats it."""

    speed: float  #: [m/s], forward positive
    yaw_rate: float  #: [rad/s], left positive


@dataclass(frozen=True, slots=True)
class Cycle:
    """What the radar sends in one cycle."""

    scan_index: int  #: counts scans up, modulo SCANS; it stands where no new scan came
    time_stamp: float  #: of the scan, modulo 0.256 s [s]
    host: HostMotion  #: as the radar was told
    tracks: Sequence[Track]
    valid: bool = True  #: False: both errors are reported, and no track; of a decoded one also without the next two
    host_known: bool = True  #: whether the host says how the car moves; False: a communication error, and no track
    radiating: bool = True  #: whether the host lets the radar radiate; False: the transceiver rests, and no track

    @property
    def sees(self) -> bool:
        """Whether the tracks are what the radar sees: no error, and it radiates."""
        return self.valid and self.host_known and self.radiating


def encode(cycle: Cycle) -> tuple[Frame, ...]:
    """Return the frames of a cycle in the order sent: status frames, then all 64 tracks, empty ones all zero.

    A track's value beyond what its signal carries saturates. Raises ValueError for a number that is not finite or a
    track that is not there.
    """
    rolling = cycle.scan_index & 3
    tracks = {track.number: track for track in cycle.tracks} if cycle.sees else {}
    if strange := [number for number in tracks if not 0 <= number < TRACKS]:
        raise ValueError(f"an ESR has tracks 0 to {TRACKS - 1}, got number {strange[0]}")
    frames = [
        Frame(STATUS_1, data_of(*_status_1(cycle), _ROLLING_1.put(rolling))),
        Frame(STATUS_2, data_of(*_status_2(cycle), _ROLLING_2.put(rolling))),
        Frame(VERSIONS, bytes(8)),
        Frame(PATH_TARGETS, data_of(_ROLLING_2.put(rolling))),
        Frame(TRACK_SENSOR, bytes((0x10 * (rolling & 1),))),
    ]
    return (
        *frames,
        *(
            Frame(FIRST_TRACK + number, _track(tracks[number], rolling & 1) if number in tracks else bytes(8))
            for number in range(TRACKS)
        ),
    )


def _status_1(cycle: Cycle) -> tuple[int, ...]:
    return (
        _SCAN_INDEX.put(cycle.scan_index % SCANS),
        _TIMESTAMP.put(round(1000.0 * cycle.time_stamp / _TIMESTAMP.scale) % STAMPS * _TIMESTAMP.scale),
        _HOST_SPEED.put(abs(cycle.host.speed)),
        _HOST_YAW_RATE.put(math.degrees(cycle.host.yaw_rate)),
        _COMMUNICATION_ERROR.put(not (cycle.valid and cycle.host_known)),
    )


def _status_2(cycle: Cycle) -> tuple[int, ...]:
    return (
        _MAXIMUM_TRACKS.put(TRACKS),
        _TRANSCEIVER.put(cycle.radiating),
        _INTERNAL_ERROR.put(not cycle.valid),
        _SPEED_FACTOR.put(1.0),
    )


def _track(track: Track, rolling: int) -> bytes:
    return data_of(
        _RANGE.put(track.range),
        _ANGLE.put(-math.degrees(track.angle)),
        _RANGE_RATE.put(track.range_rate),
        _RANGE_ACCELERATION.put(track.range_acceleration),
        _LATERAL_RATE.put(track.lateral_rate),
        _WIDTH.put(track.width),
        _STATUS.put(track.status),
        _MODE.put(track.mode),
        _ONCOMING.put(track.oncoming),
        _ROLLING.put(rolling),
    )


def with_internal_error(frame: Frame) -> Frame:
    """Return a frame in which the radar reports an internal error, all else in it as it was; others as they are."""
    if frame.id != STATUS_2:
        return frame
    return frame._replace(data=data_of(bits_of(frame.data), _INTERNAL_ERROR.put(1.0)))


def decode_track(frame: Frame) -> Track | None:
    """Return the track of a frame; None for an empty one, which has no status or no range, and for another frame."""
    number, bits = frame.id - FIRST_TRACK, bits_of(frame.data)
    if not 0 <= number < TRACKS or len(frame.data) != 8:
        return None
    status, distance = TrackStatus(int(_STATUS.get(bits))), _RANGE.get(bits)
    if status is TrackStatus.NONE or distance <= 0.0:
        return None
    return Track(
        number,
        distance,
        math.radians(-_ANGLE.get(bits)),
        _RANGE_RATE.get(bits),
        _RANGE_ACCELERATION.get(bits),
        _LATERAL_RATE.get(bits),
        _WIDTH.get(bits),
        status,
        Mode(int(_MODE.get(bits))),
        bool(_ONCOMING.get(bits)),
    )


class Decoder:
    """Gathers the frames of a cycle; a cycle is complete with the frame of the last track.

    A cycle counts only where every frame of it came, in order: a track that is missing is not an empty one.
    """

    def __init__(self) -> None:
        self._status: tuple[int, int] | None = None  # bits of the two status frames
        self._first: int | None = None
        self._tracks: list[Track] = []
        self._next = -1  # number of the track that is due; negative before the first

    def feed(self, frames: Iterable[Frame]) -> list[Cycle]:
        """Return the cycles that these frames complete."""
        return [cycle for frame in frames if (cycle := self._take(frame)) is not None]

    def _take(self, frame: Frame) -> Cycle | None:
        if frame.id == STATUS_1:
            self._first, self._status, self._tracks, self._next = bits_of(frame.data), None, [], -1
        elif frame.id == STATUS_2:
            self._status = None if self._first is None else (self._first, bits_of(frame.data))
            self._first, self._next = None, 0
        elif FIRST_TRACK <= frame.id <= LAST_TRACK:
            if frame.id - FIRST_TRACK != self._next or len(frame.data) != 8:
                self._next = -1
                return None
            self._next += 1
            if (track := decode_track(frame)) is not None:
                self._tracks.append(track)
            if frame.id == LAST_TRACK and self._status is not None:
                return self._cycle(*self._status)
        return None

    def _cycle(self, first: int, second: int) -> Cycle:
        self._next = -1
        host_known, radiating = not _COMMUNICATION_ERROR.get(first), bool(_TRANSCEIVER.get(second))
        valid = host_known and radiating and not _INTERNAL_ERROR.get(second)
        return Cycle(
            int(_SCAN_INDEX.get(first)),
            _TIMESTAMP.get(first) / 1000.0,
            HostMotion(_HOST_SPEED.get(first), math.radians(_HOST_YAW_RATE.get(first))),
            tuple(self._tracks),
            valid,
            host_known,
            radiating,
        )


def encode_host(motion: HostMotion) -> tuple[Frame, Frame]:
    """Return the frames that a host sends: its motion, and the order to radiate."""
    return (
        Frame(
            VEHICLE_DATA,
            data_of(
                _VEHICLE_SPEED.put(abs(motion.speed)),
                _VEHICLE_REVERSE.put(motion.speed < 0.0),
                _VEHICLE_YAW_RATE.put(math.degrees(motion.yaw_rate)),
                _YAW_RATE_VALID.put(1.0),
            ),
        ),
        Frame(SENSOR_INPUT, data_of(_RADIATE.put(1.0), _SPEED_VALID.put(1.0))),
    )


def decode_host(frame: Frame) -> HostMotion | None:
    """Return the motion that a host's frame carries; None for another frame, and where its yaw rate is not valid."""
    bits = bits_of(frame.data)
    if frame.id != VEHICLE_DATA or len(frame.data) != 8 or not _YAW_RATE_VALID.get(bits):
        return None
    speed = _VEHICLE_SPEED.get(bits)
    yaw_rate = math.radians(_VEHICLE_YAW_RATE.get(bits))
    return HostMotion(-speed if _VEHICLE_REVERSE.get(bits) else speed, yaw_rate)


class Host:
    """What a radar knows of its host: the newest vehicle messages, each for a lifetime [s].

    That a host sends speed, yaw rate and the order to radiate, and that the radar acknowledges them, is in Delphi's
    user's guide of a sister radar; the bits are those of opendbc. For how long a message counts is in neither.
    """

    def __init__(self, lifetime: float) -> None:
        self._lifetime = lifetime
        self._motion: HostMotion | None = None
        self._motion_at = self._radiate_at = -math.inf

    def take(self, now: float, frames: Iterable[Frame]) -> None:
        """Take what came on the bus by a time [s]; frames that are not the host's say nothing."""
        for frame in frames:
            if (motion := decode_host(frame)) is not None:
                self._motion, self._motion_at = motion, now
            elif frame.id == SENSOR_INPUT and len(frame.data) == 8:
                bits = bits_of(frame.data)
                ordered = _RADIATE.get(bits) and _SPEED_VALID.get(bits)
                self._radiate_at = now if ordered else -math.inf

    def motion(self, now: float) -> HostMotion | None:
        """Return how the car moves, as the host says; None where it has not said so for longer than the lifetime."""
        return self._motion if now - self._motion_at <= self._lifetime else None

    def radiates(self, now: float) -> bool:
        """Whether the host's newest message orders the radar to radiate, and is not older than the lifetime."""
        return now - self._radiate_at <= self._lifetime
