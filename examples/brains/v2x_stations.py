"""Knows the vehicles nearby by their CAMs, as a V2X receiver hands them on over UDP."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

from driving import AHEAD, BUMPER, EARTH, LEFT, Scan

from vve_sumo.v2x import cam, geonetworking, its_time
from vve_sumo.v2x.decode_error import MessageDecodeError
from vve_sumo.values import Fix

SLOW = 0.5  # a station that says that it is slower stands: what it says is a little wrong [m/s]
STANDING_LIFETIME = 60.0  # of a station that stands: nothing says that it has left [s]
MOVING_LIFETIME = 2.0  # of a station that moves [s]


class V2xStations:
    """The last CAM of every station."""

    def __init__(self) -> None:
        self._said: dict[int, cam.Cam] = {}

    def take(self, packet: bytes, now: float) -> None:
        """Take a GeoNetworking packet that came at a GNSS time [s]; what is no CAM is left out."""
        try:
            said = cam.decode(geonetworking.decode(packet).payload, its_time.from_gnss(now))
        except MessageDecodeError:
            return
        known = self._said.get(said.station)
        if known is None or said.time_ms > known.time_ms:
            self._said[said.station] = said

    def scan(self, fix: Fix, speed: float) -> Scan:
        """Return where the stations are at a fix, seen from the front bumper of a car with a speed [m/s]."""
        now, found = its_time.from_gnss(fix.time), []
        for station, said in list(self._said.items()):
            age = 0.001 * (now - said.time_ms)
            # Who does not say how it moves may stand; a car at rest often knows no heading.
            own_speed, heading = said.speed or 0.0, fix.heading if said.heading is None else said.heading
            if age > (MOVING_LIFETIME if own_speed > SLOW else STANDING_LIFETIME):
                del self._said[station]
            else:
                found.append(_target(said, age, heading, own_speed, fix, speed))
        return Scan(fix.time, fix.time, speed, found)


def _target(said: cam.Cam, age: float, heading: float, own_speed: float, fix: Fix, speed: float) -> Any:
    """Return the nearer of the middles of a station's front and rear."""
    north = EARTH * (math.radians(said.latitude_deg) - fix.latitude)
    east = EARTH * math.cos(fix.latitude) * (math.radians(said.longitude_deg) - fix.longitude)
    gone, ends = own_speed * age, []
    for back in (0.0, said.length or 4.5):
        dx, dy = east + (gone - back) * math.cos(heading), north + (gone - back) * math.sin(heading)
        cos, sin = math.cos(fix.heading), math.sin(fix.heading)
        ends.append((AHEAD - BUMPER + cos * dx + sin * dy, LEFT + cos * dy - sin * dx))
    x, y = min(ends, key=lambda end: math.hypot(*end))
    azimuth = math.atan2(y, x)
    rate = own_speed * math.cos(heading - fix.heading - azimuth) - speed * math.cos(azimuth)
    return SimpleNamespace(range=math.hypot(x, y), azimuth=azimuth, range_rate=rate)
