"""Finds what stands on the road in the data packets of a Velodyne VLP-16 (user manual 63-9243, chapter 9)."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
from driving import BUMPER, Scan

from vve_sumo.values import Fix, Floats
from vve_sumo.wire.vlp16 import ELEVATIONS_DEG, FIRINGS, HOUR, PACKET_SIZE, past_the_hour

FORWARD, HEIGHT = 1.4, 1.9  # of the lidar, from the rear axle [m], above the ground [m]
TURN, STALE = 0.1, 0.3  # a turn, and for how long it counts [s]
LOWEST, HIGHEST = 0.4, 2.5  # of what counts as an obstacle [m]
SECTOR = math.radians(2.0)  # of which the nearest return counts
NEAR = 2.5  # a return moved no farther than this in a turn [m]

_ELEVATIONS = np.radians(ELEVATIONS_DEG)
_BLOCK = np.dtype([("flag", "<u2"), ("azimuth", "<u2"), ("points", [("range", "<u2"), ("reflectivity", "u1")], (32,))])


class Lidar:
    """The nearest returns of the newest turn, each with the speed that the turn before tells of it."""

    def __init__(self) -> None:
        self._packets: list[tuple[float, Floats]] = []  # time past the hour [s], places from the lidar
        self._turn, self._before = _NONE, _NONE
        self._measured = -math.inf
        self._moved: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def take(self, packet: bytes) -> None:
        """Take a data packet; what has another length is left out."""
        if len(packet) == PACKET_SIZE:
            self._packets.append((int.from_bytes(packet[1200:1204], "little") * 1e-6, _places(packet)))

    def scan(self, fix: Fix, speed: float) -> Scan | None:
        """Return what the lidar sees at a fix; None where its newest turn is too old."""
        if self._packets:
            self._end_turn(fix, speed)
        if fix.time - self._measured > STALE:
            return None
        return Scan(fix.time, self._measured, speed, self._targets(speed))

    def _end_turn(self, fix: Fix, speed: float) -> None:
        past = (past_the_hour(fix.time) * 1e-6 - self._packets[-1][0]) % HOUR
        packets, self._packets = self._packets, []
        measured = fix.time - (past if past < HOUR / 2 else past - HOUR)
        if measured <= self._measured:
            return  # the same turn again
        step = measured - self._measured
        self._measured, self._moved = measured, (speed * step, fix.yaw_rate * step, step)
        self._before = self._turn if step < 2.0 * TURN else _NONE
        self._turn = _nearest(np.concatenate([places for _time, places in packets]))

    def _targets(self, speed: float) -> list[Any]:
        """Return the returns that the turn before has too: how far one is from there tells its speed."""
        driven, turned, step = self._moved
        found = []
        if not len(self._before):
            return found
        # Where those of the turn before would be if they stood.
        cos, sin = math.cos(turned), math.sin(turned)
        x, y = self._before[:, 0] + FORWARD - driven, self._before[:, 1]
        standing = np.stack([cos * x + sin * y - FORWARD, cos * y - sin * x], axis=1)
        for point in self._turn:
            away = point - standing
            nearest = int(np.argmin(np.hypot(away[:, 0], away[:, 1])))
            if math.hypot(*away[nearest]) > NEAR:
                continue
            ahead, aside = float(point[0]) + FORWARD - BUMPER, float(point[1])
            azimuth = math.atan2(aside, ahead)
            over_ground = (math.cos(azimuth) * away[nearest, 0] + math.sin(azimuth) * away[nearest, 1]) / step
            rate = float(over_ground) - speed * math.cos(azimuth)
            found.append(SimpleNamespace(range=math.hypot(ahead, aside), azimuth=azimuth, range_rate=rate))
        return found


_NONE: Floats = np.zeros((0, 2))


def _places(packet: bytes) -> Floats:
    """Return x ahead, y left, z up [m] from the lidar of a packet's returns."""
    blocks = np.frombuffer(packet, _BLOCK, FIRINGS // 2)
    azimuth = -np.radians(0.01 * blocks["azimuth"].astype(np.float64))
    step = np.diff(azimuth, append=2.0 * azimuth[-1:] - azimuth[-2:-1])
    step = np.where(np.abs(step) > math.pi, np.median(step), step)
    firings = np.stack([azimuth, azimuth + 0.5 * step], axis=1).ravel()[:, None]
    far = 0.002 * blocks["points"]["range"].reshape(FIRINGS, -1)
    level = far * np.cos(_ELEVATIONS)
    places = np.stack([level * np.cos(firings), level * np.sin(firings), far * np.sin(_ELEVATIONS)], axis=-1)
    return places[far > 0.0]


def _nearest(places: Floats) -> Floats:
    """Return x and y of the nearest return of every sector ahead, of what is neither road nor above the car."""
    height = places[:, 2] + HEIGHT
    ahead = places[(height > LOWEST) & (height < HIGHEST) & (places[:, 0] > 2.5)][:, :2]
    if not len(ahead):
        return _NONE
    sectors = np.floor(np.arctan2(ahead[:, 1], ahead[:, 0]) / SECTOR)
    order = np.lexsort((np.hypot(ahead[:, 0], ahead[:, 1]), sectors))
    first = np.unique(sectors[order], return_index=True)[1]
    return ahead[order][first]
