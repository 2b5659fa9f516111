"""This project's own datagrams of one sensor's measurements: scans, turns of a lidar, lists, tables of rows.

They are for the ROS 2 bridge and may change with any version. A lidar's turn is longer than a datagram and goes out in
parts. Knows values and bytes; it must not know sockets.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from vve_sumo.messages import MalformedMessage, MessageCodec, MessageKind
from vve_sumo.values import CameraObjects, Detections, Stations, StopLines
from vve_sumo.wire.sample import MAX_LIST_AGE, MAX_SCAN_AGE, LidarTurn, Sample

#: rays in a part of a turn: three bytes each, so that a part stays under a datagram's 65 507 bytes
PART_RAYS: Final = 16_000
#: how old what a sample has of a sensor may be to be shown [s]; a turn goes out when it is complete
_MAX_AGES: Final = {
    "objects": MAX_LIST_AGE,
    "stations": MAX_LIST_AGE,
    "stop_lines": MAX_LIST_AGE,
    "scan": MAX_SCAN_AGE,
}


@dataclass(frozen=True, slots=True)
class SenseDatagram:
    """A measurement of one sensor, or a part of one; one of the last five is there."""

    sequence: int  #: `sequence_of` the tick with which it went out
    time: float  #: GNSS time of the measurement [s since 1980-01-06, no leap seconds]; of a turn its last firing's
    part: int = 0  #: counts from 0
    parts: int = 1  #: of this measurement
    scan: Detections | None = None
    turn: LidarTurn | None = None  #: the firings of this part; its time is that of the whole turn
    objects: CameraObjects | None = None
    stations: Stations | None = None
    stop_lines: StopLines | None = None


_CODEC: Final = MessageCodec[SenseDatagram](MessageKind.SENSE, SenseDatagram)


def encode_sense(datagram: SenseDatagram) -> bytes:
    """Return the bytes of a datagram."""
    return _CODEC.encode(datagram)


def decode_sense(data: bytes) -> SenseDatagram | MalformedMessage:
    """Return the datagram in bytes, or why they are none."""
    return _CODEC.decode(data)


def parts_of(turn: LidarTurn) -> Iterator[LidarTurn]:
    """Give the parts of a turn, in order, of PART_RAYS at most."""
    channels = max(len(turn.elevation), 1)
    firings = max(PART_RAYS // channels, 1)
    for first in range(0, len(turn.azimuth), firings):
        rays = slice(first * channels, (first + firings) * channels)
        yield replace(
            turn,
            azimuth=turn.azimuth[first : first + firings],
            range=turn.range[rays],
            reflectivity=turn.reflectivity[rays],
        )


class SenseOutput:
    """What one sensor measured, each measurement once, in this project's own datagrams; nothing while invalid."""

    def __init__(self) -> None:
        self._measured = -math.inf  # of the newest scan, list or table that was sent

    def step(self, sample: Sample) -> Sequence[bytes]:
        """Return the datagrams of a sample that brings a measurement which is not too old."""
        measured = sample.measured
        if measured is None:
            return ()
        sequence, epoch = sample.sequence, sample.time - sample.drive_time
        if measured.turn is not None:
            parts = list(parts_of(measured.turn))
            return [
                encode_sense(SenseDatagram(sequence, epoch + measured.turn.time, number, len(parts), turn=part))
                for number, part in enumerate(parts)
            ]
        for name, max_age in _MAX_AGES.items():
            one = getattr(measured, name)
            if one is not None and one.time > self._measured and sample.drive_time - one.time <= max_age:
                self._measured = one.time
                return [encode_sense(SenseDatagram(sequence, epoch + one.time, **{name: one}))]
        return ()


class TurnAssembler:
    """Puts the parts of turns together again; a turn of which a part is missing never comes out."""

    def __init__(self) -> None:
        self._parts: list[SenseDatagram] = []

    def take(self, part: SenseDatagram) -> SenseDatagram | None:
        """Return the datagram with the whole turn once its last part has come; None before that."""
        if part.part == 0:
            self._parts = []
        same = not self._parts or (self._parts[0].sequence, self._parts[0].parts) == (part.sequence, part.parts)
        if part.part != len(self._parts) or not same:
            self._parts = []
            return None
        self._parts.append(part)
        if len(self._parts) < part.parts:
            return None
        turns = [one.turn for one in self._parts if one.turn is not None]
        self._parts = []
        whole = replace(
            turns[0],
            azimuth=np.concatenate([turn.azimuth for turn in turns]),
            range=np.concatenate([turn.range for turn in turns]),
            reflectivity=np.concatenate([turn.reflectivity for turn in turns]),
        )
        return replace(part, part=0, parts=1, turn=whole)
