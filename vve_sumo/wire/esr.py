"""Codec of the Delphi ESR's CAN frames: its 64 tracks, its status frames, and the host's motion that it is told.

It knows frames and tracks; it must not know which bus they travel on, nor how a track was found. `esr.dbc` is the
layout: that of comma.ai's opendbc (opendbc/dbc/ESR.dbc); the sign of the angle as in its Ford radar interface, to the
right positive. A 2018 Ford Fusion's own radar sends the same tracks under the same identifiers, with the angle's sign
turned round.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import IntEnum
from pathlib import Path
from typing import Final

from vve_sumo import dbc
from vve_sumo.values import Frame

_LAYOUTS: Final = dbc.read(Path(__file__).with_name("esr.dbc"))
_STATUS_1, _STATUS_2, _TRACK = _LAYOUTS["Status1"], _LAYOUTS["Status2"], _LAYOUTS["Track"]
_PATH_TARGETS, _TRACK_SENSOR = _LAYOUTS["PathTargets"], _LAYOUTS["TrackSensor"]
_VEHICLE_DATA, _SENSOR_INPUT = _LAYOUTS["VehicleData"], _LAYOUTS["SensorInput"]

TRACKS: Final = 64  #: of a cycle; each has an identifier of its own
FIRST_TRACK: Final = _TRACK.id
LAST_TRACK: Final = FIRST_TRACK + TRACKS - 1  #: readers take a cycle as complete with this one
STATUS_1, STATUS_2, VERSIONS, PATH_TARGETS = _STATUS_1.id, _STATUS_2.id, _LAYOUTS["Versions"].id, _PATH_TARGETS.id
TRACK_SENSOR: Final = _TRACK_SENSOR.id
VEHICLE_DATA, SENSOR_INPUT = _VEHICLE_DATA.id, _SENSOR_INPUT.id  #: what the host sends

PERIOD: Final = 0.05  #: of a cycle [s]
SCANS: Final = 0x10000  #: after which the scan index begins again
STAMPS: Final = 128  #: counts after which the time stamp begins again


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
    return (
        Frame(STATUS_1, _status_1(cycle, rolling)),
        Frame(STATUS_2, _status_2(cycle, rolling)),
        Frame(VERSIONS, bytes(8)),
        Frame(PATH_TARGETS, _PATH_TARGETS.encode(ROLLING_COUNT_3=rolling)),
        Frame(TRACK_SENSOR, _TRACK_SENSOR.encode(TRACK_ROLLING_COUNT_2=rolling & 1)),
        *(
            Frame(FIRST_TRACK + number, _track(tracks[number], rolling & 1) if number in tracks else bytes(8))
            for number in range(TRACKS)
        ),
    )


def _status_1(cycle: Cycle, rolling: int) -> bytes:
    step = _STATUS_1.signals["DSP_TIMESTAMP"].scale
    return _STATUS_1.encode(
        SCAN_INDEX=cycle.scan_index % SCANS,
        DSP_TIMESTAMP=round(1000.0 * cycle.time_stamp / step) % STAMPS * step,
        VEHICLE_SPEED_CALC=abs(cycle.host.speed),
        YAW_RATE_CALC=math.degrees(cycle.host.yaw_rate),
        COMM_ERROR=not (cycle.valid and cycle.host_known),
        ROLLING_COUNT_1=rolling,
    )


def _status_2(cycle: Cycle, rolling: int) -> bytes:
    return _STATUS_2.encode(
        MAXIMUM_TRACKS_ACK=TRACKS,
        XCVR_OPERATIONAL=cycle.radiating,
        INTERNAL_ERROR=not cycle.valid,
        VEH_SPD_COMP_FACTOR=1.0,
        ROLLING_COUNT_2=rolling,
    )


def _track(track: Track, rolling: int) -> bytes:
    return _TRACK.encode(
        TRACK_RANGE=track.range,
        TRACK_ANGLE=-math.degrees(track.angle),
        TRACK_RANGE_RATE=track.range_rate,
        TRACK_RANGE_ACCEL=track.range_acceleration,
        TRACK_LAT_RATE=track.lateral_rate,
        TRACK_WIDTH=track.width,
        TRACK_STATUS=track.status,
        TRACK_MED_RANGE_MODE=track.mode,
        TRACK_ONCOMING=track.oncoming,
        TRACK_ROLLING_COUNT=rolling,
    )


def with_internal_error(frame: Frame) -> Frame:
    """Return a frame in which the radar reports an internal error, all else in it as it was; others as they are."""
    if frame.id != STATUS_2:
        return frame
    return frame._replace(data=_STATUS_2.altered(frame.data, INTERNAL_ERROR=1))


def decode_track(frame: Frame) -> Track | None:
    """Return the track of a frame; None for an empty one, which has no status or no range, and for another frame."""
    number = frame.id - FIRST_TRACK
    if not 0 <= number < TRACKS or len(frame.data) != 8:
        return None
    if not _TRACK.value(frame.data, "TRACK_STATUS"):
        return None
    read = _TRACK.decode(frame.data)
    if read["TRACK_RANGE"] <= 0.0:
        return None
    return Track(
        number,
        read["TRACK_RANGE"],
        math.radians(-read["TRACK_ANGLE"]),
        read["TRACK_RANGE_RATE"],
        read["TRACK_RANGE_ACCEL"],
        read["TRACK_LAT_RATE"],
        read["TRACK_WIDTH"],
        TrackStatus(int(read["TRACK_STATUS"])),
        Mode(int(read["TRACK_MED_RANGE_MODE"])),
        bool(read["TRACK_ONCOMING"]),
    )


class Decoder:
    """Gathers the frames of a cycle; a cycle is complete with the frame of the last track.

    A cycle counts only where every frame of it came, in order: a track that is missing is not an empty one.
    """

    def __init__(self) -> None:
        self._status: tuple[bytes, bytes] | None = None  # data of the two status frames
        self._first: bytes | None = None
        self._tracks: list[Track] = []
        self._next = -1  # number of the track that is due; negative before the first

    def feed(self, frames: Iterable[Frame]) -> list[Cycle]:
        """Return the cycles that these frames complete."""
        return [cycle for frame in frames if (cycle := self._take(frame)) is not None]

    def _take(self, frame: Frame) -> Cycle | None:
        if frame.id == STATUS_1:
            self._first, self._status, self._tracks, self._next = frame.data, None, [], -1
        elif frame.id == STATUS_2:
            self._status = None if self._first is None else (self._first, frame.data)
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

    def _cycle(self, first: bytes, second: bytes) -> Cycle:
        self._next = -1
        one, two = _STATUS_1.decode(first), _STATUS_2.decode(second)
        host_known, radiating = not one["COMM_ERROR"], bool(two["XCVR_OPERATIONAL"])
        valid = host_known and radiating and not two["INTERNAL_ERROR"]
        return Cycle(
            int(one["SCAN_INDEX"]),
            one["DSP_TIMESTAMP"] / 1000.0,
            HostMotion(one["VEHICLE_SPEED_CALC"], math.radians(one["YAW_RATE_CALC"])),
            tuple(self._tracks),
            valid,
            host_known,
            radiating,
        )


def encode_host(motion: HostMotion) -> tuple[Frame, Frame]:
    """Return the frames that a host sends: its motion, and the order to radiate."""
    data = _VEHICLE_DATA.encode(
        VEHICLE_SPEED=abs(motion.speed),
        VEHICLE_SPEED_DIRECTION=motion.speed < 0.0,
        YAW_RATE=math.degrees(motion.yaw_rate),
        YAW_RATE_VALIDITY=1,
    )
    order = _SENSOR_INPUT.encode(RADAR_CMD_RADIATE=1, VEHICLE_SPEED_VALIDITY=1)
    return Frame(VEHICLE_DATA, data), Frame(SENSOR_INPUT, order)


def decode_host(frame: Frame) -> HostMotion | None:
    """Return the motion that a host's frame carries; None for another frame, and where its yaw rate is not valid."""
    if frame.id != VEHICLE_DATA or len(frame.data) != 8:
        return None
    read = _VEHICLE_DATA.decode(frame.data)
    if not read["YAW_RATE_VALIDITY"]:
        return None
    speed = read["VEHICLE_SPEED"]
    return HostMotion(-speed if read["VEHICLE_SPEED_DIRECTION"] else speed, math.radians(read["YAW_RATE"]))


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
                read = _SENSOR_INPUT.decode(frame.data)
                ordered = read["RADAR_CMD_RADIATE"] and read["VEHICLE_SPEED_VALIDITY"]
                self._radiate_at = now if ordered else -math.inf

    def motion(self, now: float) -> HostMotion | None:
        """Return how the car moves, as the host says; None where it has not said so for longer than the lifetime."""
        return self._motion if now - self._motion_at <= self._lifetime else None

    def radiates(self, now: float) -> bool:
        """Whether the host's newest message orders the radar to radiate, and is not older than the lifetime."""
        return now - self._radiate_at <= self._lifetime
