"""Encoder of u-blox UBX: a fix as NAV-PVT and NAV-RELPOSNED of a moving baseline; `pose.ubx` decodes them.

Knows messages; it must not know where they go. The baseline is one metre long, level, and along the car;
sea level is the ellipsoid.
"""

from __future__ import annotations

import datetime
import math
from bisect import bisect_left
from typing import Final

from vve_sumo.pose import ubx
from vve_sumo.pose.gnss_time import GPS_EPOCH, GPS_MINUS_UTC, WEEK
from vve_sumo.pose.stream import to_compass
from vve_sumo.values import Fix, FixQuality

MIDNIGHT: Final = datetime.datetime.combine(GPS_EPOCH, datetime.time())
UNKNOWN: Final = 0xFFFF_FFFF  #: an accuracy that is worse than any
BASELINE_LENGTH: Final = 100  #: [cm]
TURN: Final = 36_000_000  #: [1e-5 deg]
VALID: Final = 0b111  #: date, time of day, and that known to the second
#: flags of each quality: carrier solution, and that corrections were applied
FLAGS: Final = {
    FixQuality.DIFFERENTIAL: ubx.DIFFERENTIAL,
    FixQuality.RTK_FLOAT: ubx.DIFFERENTIAL | 1 << ubx.CARRIER,
    FixQuality.RTK_FIXED: ubx.DIFFERENTIAL | ubx.CARRIER_FIXED << ubx.CARRIER,
}


def framed(kind: int, payload: bytes) -> bytes:
    """Return the message of a payload: sync, header and checksum around it."""
    content = ubx.HEADER.pack(ubx.SYNC, kind, len(payload))[len(ubx.SYNC) :] + payload
    return ubx.SYNC + content + ubx.checksum(content)


class Encoder:
    """Writes fixes as a receiver with a moving baseline would."""

    def encode(self, fix: Fix) -> bytes:
        """Return the two messages of a fix; raises ValueError for a time that is not finite."""
        clock = round(1000.0 * fix.time)
        return framed(ubx.PVT, _pvt(fix, clock)) + framed(ubx.RELPOSNED, _relposned(fix, clock % WEEK))


def _pvt(fix: Fix, clock: int) -> bytes:
    utc = MIDNIGHT + datetime.timedelta(milliseconds=clock - GPS_MINUS_UTC)
    placed = math.isfinite(fix.latitude) and math.isfinite(fix.longitude)
    moving = math.isfinite(fix.velocity_north) and math.isfinite(fix.velocity_east)
    kind = ubx.THREE_DIMENSIONAL if placed and fix.quality is not FixQuality.NONE else 0
    flags = FLAGS.get(fix.quality, 0) | (ubx.FIX_OK if fix.locked and kind else 0)
    flags3 = _age(fix.differential_age) << ubx.AGE | (0 if placed else ubx.INVALID_PLACE)
    height = _whole(fix.altitude, 1e-3)
    north, east = (_whole(one, 1e-3) for one in (fix.velocity_north, fix.velocity_east))
    course = math.degrees(math.atan2(east, north)) % 360.0
    pvt = ubx.Pvt(
        time_of_week=clock % WEEK, year=utc.year, month=utc.month, day=utc.day, hour=utc.hour, minute=utc.minute,
        second=utc.second, valid=VALID, time_accuracy=30, nanosecond=1000 * utc.microsecond, kind=kind, flags=flags,
        flags2=0, satellites=12 if kind else 0, longitude=_whole(fix.longitude, ubx.PLACE),
        latitude=_whole(fix.latitude, ubx.PLACE), height=height, altitude=height,
        horizontal_accuracy=_accuracy(fix.position_sigma, 1e-3), vertical_accuracy=_accuracy(fix.position_sigma, 1e-3),
        velocity_north=north, velocity_east=east, velocity_down=_whole(fix.velocity_down, 1e-3),
        speed=round(math.hypot(north, east)), course=round(1e5 * course) % TURN,
        speed_accuracy=_accuracy(fix.velocity_sigma if moving else math.nan, 1e-3), heading_accuracy=UNKNOWN,
        position_dop=150, flags3=flags3, vehicle_heading=0, declination=0, declination_accuracy=0,
    )  # fmt: skip
    return ubx.PVT_PAYLOAD.pack(*pvt)


def _relposned(fix: Fix, time_of_week: int) -> bytes:
    known = math.isfinite(fix.heading)
    heading = to_compass(fix.heading) if known else 0.0
    north, east = (round(BASELINE_LENGTH * of(math.radians(heading))) for of in (math.cos, math.sin))
    flags = ubx.FIX_OK | ubx.DIFFERENTIAL | (ubx.BASELINE if known else ubx.MOVING)
    baseline = ubx.RelPosNed(
        version=ubx.RELPOSNED_VERSION, station=0, time_of_week=time_of_week, north=north, east=east, down=0,
        length=BASELINE_LENGTH, heading=round(1e5 * heading) % TURN, more_north=0, more_east=0, more_down=0,
        more_length=0, north_accuracy=50, east_accuracy=50, down_accuracy=100, length_accuracy=50,
        heading_accuracy=_accuracy(fix.heading_sigma, ubx.ANGLE), flags=flags,
    )  # fmt: skip
    return ubx.RELPOSNED_PAYLOAD.pack(*baseline)


def _age(age: float) -> int:
    """Return the code of the class that an age of corrections [s] is in."""
    return 0 if math.isnan(age) else min(bisect_left(ubx.AGES, age, lo=1), len(ubx.AGES))


def _whole(value: float, step: float) -> int:
    """Return a number in whole steps; 0 of one that is not known."""
    return round(value / step) if math.isfinite(value) else 0


def _accuracy(sigma: float, step: float) -> int:
    return min(round(sigma / step), UNKNOWN) if math.isfinite(sigma) else UNKNOWN
