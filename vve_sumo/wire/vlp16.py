"""Encodes the turns of a lidar as the packets of a Velodyne VLP-16 (user manual 63-9243, rev. E, chapter 9 and app. B).

A data packet is 1206 bytes, little endian: twelve blocks of a flag, an azimuth (0.01 degree, clockwise) and two firings
of sixteen channels (range in 2 mm, reflectivity), then the time of its first firing (microseconds past the hour, UTC)
and two factory bytes. A position packet is 512 bytes with the time and an RMC sentence. The module knows no socket.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from vve_sumo.pose.nmea_encoder import LEAP_SECONDS
from vve_sumo.values import PointCloud
from vve_sumo.wire.sample import LidarTurn

#: elevation of each laser [degrees], in the order in which they fire and in which a packet holds them
ELEVATIONS_DEG: Final = (-15, 1, -13, 3, -11, 5, -9, 7, -7, 9, -5, 11, -3, 13, -1, 15)
CHANNELS: Final = len(ELEVATIONS_DEG)
#: firings in a packet: two in each of twelve blocks
FIRINGS: Final = 24
PACKET_SIZE: Final = 1206
POSITION_SIZE: Final = 512
RANGE_QUANTUM: Final = 0.002  #: [m]
AZIMUTHS: Final = 36_000  #: azimuths in a turn
FLAG: Final = 0xEEFF  #: of a block: the bytes FF EE
#: factory bytes: strongest return, VLP-16
STRONGEST, PRODUCT = 0x37, 0x22
HOUR: Final = 3600
#: where the RMC sentence stands in a position packet
SENTENCE_AT: Final = 206
#: of the sentence, with its end of line
SENTENCE_SIZE: Final = 128

_BLOCK: Final = np.dtype(
    [("flag", "<u2"), ("azimuth", "<u2"), ("points", [("range", "<u2"), ("reflectivity", "u1")], (2 * CHANNELS,))]
)
_PACKET: Final = np.dtype([("blocks", _BLOCK, (FIRINGS // 2,)), ("time", "<u4"), ("mode", "u1"), ("product", "u1")])


def turn_of(cloud: PointCloud) -> LidarTurn:
    """Return a turn in the wire's own quanta; what is farther than they reach (131 m) counts as nothing."""
    quanta = np.rint(cloud.range / RANGE_QUANTUM)
    quanta[quanta > np.iinfo(np.uint16).max] = 0
    azimuth = np.rint(-np.degrees(cloud.azimuth) * (AZIMUTHS / 360.0)).astype(np.int64) % AZIMUTHS
    period = float(cloud.time_offset[-1] - cloud.time_offset[-2]) if len(cloud.time_offset) > 1 else 0.0
    return LidarTurn(
        cloud.time,
        period,
        azimuth.astype(np.uint16),
        cloud.azimuth_offset,
        cloud.elevation,
        quanta.astype(np.uint16).ravel(),
        cloud.reflectivity.astype(np.uint8).ravel(),
    )


class Vlp16Encoder:
    """Packs turns; a part of a turn that fills no packet waits for the next one."""

    def __init__(self) -> None:
        self._azimuth = np.zeros(0, np.uint16)
        self._range, self._reflectivity = np.zeros((0, CHANNELS), np.uint16), np.zeros((0, CHANNELS), np.uint8)
        self._time = np.zeros(0)

    def _forget(self) -> None:
        self._azimuth, self._time = self._azimuth[:0], self._time[:0]
        self._range, self._reflectivity = self._range[:0], self._reflectivity[:0]

    def encode(self, turn: LidarTurn, epoch: float) -> list[bytes]:
        """Return the data packets that a turn fills; `epoch` is the GNSS second of drive time 0.

        Raises ValueError for a turn that has not sixteen channels.
        """
        firings = len(turn.azimuth)
        if len(turn.range) != CHANNELS * firings:
            raise ValueError(f"a VLP-16 has {CHANNELS} channels, got {len(turn.range) / max(firings, 1):g}")
        time = epoch + turn.time + turn.firing_period * np.arange(1 - firings, 1)
        if len(self._time) and firings and not time[0] - self._time[-1] < 2.0 * turn.firing_period:
            self._forget()  # of a turn that was not the one before, such as the last one before an invalid time
        azimuth, times = np.append(self._azimuth, turn.azimuth), np.append(self._time, time)
        range_ = np.vstack((self._range, turn.range.reshape(-1, CHANNELS)))
        reflectivity = np.vstack((self._reflectivity, turn.reflectivity.reshape(-1, CHANNELS)))
        whole = len(azimuth) // FIRINGS * FIRINGS
        self._azimuth, self._time = azimuth[whole:], times[whole:]
        self._range, self._reflectivity = range_[whole:], reflectivity[whole:]
        return _packets(azimuth[:whole], times[:whole], range_[:whole], reflectivity[:whole])


def _packets(
    azimuth: NDArray[np.uint16], time: NDArray[np.float64], range_: NDArray[np.uint16], reflectivity: NDArray[np.uint8]
) -> list[bytes]:
    count = len(azimuth) // FIRINGS
    packets = np.zeros(count, _PACKET)
    blocks = packets["blocks"]
    blocks["flag"], blocks["azimuth"] = FLAG, azimuth[::2].reshape(count, -1)
    blocks["points"]["range"] = range_.reshape(count, FIRINGS // 2, -1)
    # What does not come back has no reflectivity.
    blocks["points"]["reflectivity"] = np.where(range_ > 0, reflectivity, 0).reshape(count, FIRINGS // 2, -1)
    packets["time"] = [past_the_hour(first) for first in time[::FIRINGS].tolist()]
    packets["mode"], packets["product"] = STRONGEST, PRODUCT
    return [packet.tobytes() for packet in packets]


def past_the_hour(time: float) -> int:
    """Return the microseconds past the hour, UTC, of a GNSS second."""
    return round(math.fmod(time - LEAP_SECONDS, HOUR) * 1e6) % (HOUR * 1_000_000)


def position_packet(time: float, sentences: bytes) -> bytes:
    """Return the position packet at a GNSS second, with the RMC sentence among NMEA `sentences`."""
    (sentence,) = (line for line in sentences.splitlines(keepends=True) if line[3:6] == b"RMC")
    packet = bytearray(POSITION_SIZE)
    packet[198:202] = past_the_hour(time).to_bytes(4, "little")
    packet[202] = 2  # the pulse a second is locked
    packet[SENTENCE_AT : SENTENCE_AT + len(sentence)] = sentence
    return bytes(packet)
