"""Encoder of NovAtel OEM7 logs: a fix as binary BESTPOS and INSPVAX; `pose.novatel` decodes them.

Knows logs; it must not know where they go. The undulation of the geoid is 0: sea level is the ellipsoid.
"""

from __future__ import annotations

import math
from typing import Final

from vve_sumo.pose import novatel
from vve_sumo.pose.gnss_time import WEEK
from vve_sumo.pose.stream import to_compass
from vve_sumo.values import Fix, FixQuality

FINESTEERING: Final = 180
ALIGNING: Final = 1  #: status of the INS
INSUFFICIENT: Final = 1  #: status of BESTPOS: not enough observations
WGS84: Final = 61  #: datum
UNKNOWN: Final = 1e4  #: a standard deviation that is worse than any
POSITION_TYPES: Final = {
    FixQuality.SINGLE: 53,
    FixQuality.DIFFERENTIAL: 54,
    FixQuality.RTK_FLOAT: 55,
    FixQuality.RTK_FIXED: 56,
    FixQuality.PPP: 74,
}


class Encoder:
    """Writes fixes as a receiver with an inertial unit would."""

    def encode(self, fix: Fix) -> bytes:
        """Return the two logs of a fix; raises ValueError for a time that is not finite."""
        clock = round(1000.0 * fix.time)
        placed = math.isfinite(fix.latitude) and math.isfinite(fix.longitude)
        kind = POSITION_TYPES.get(fix.quality, 0) if placed else 0
        return framed(novatel.BESTPOS, _bestpos(fix, kind), clock) + framed(novatel.INSPVAX, _inspvax(fix, kind), clock)


def framed(number: int, content: bytes, clock: int, *, time_status: int = FINESTEERING) -> bytes:
    """Return the binary log of a content at a time [ms GPS]: header before it, checksum behind it."""
    header = novatel.HEADER.pack(
        novatel.SYNC, novatel.HEADER.size, number, 0, 0x20, len(content), 0, 0, time_status, clock // WEEK,
        clock % WEEK, 0, 0, 0,
    )  # fmt: skip
    return header + content + novatel.CHECKSUM.pack(novatel.checksum(header + content))


def _bestpos(fix: Fix, kind: int) -> bytes:
    known = kind and math.isfinite(fix.differential_age)
    return novatel.BESTPOS_CONTENT.pack(
        novatel.SOLUTION_COMPUTED if known else INSUFFICIENT, kind, *_place(fix, kind), 0.0, WGS84,
        *[_sigma(fix.position_sigma)] * 3, b"", fix.differential_age if known else 0.0, 0.0,
        *[12 if kind else 0] * 4, 0, 0, 0, 0,
    )  # fmt: skip


def _inspvax(fix: Fix, kind: int) -> bytes:
    known = math.isfinite(fix.heading)
    moving = math.isfinite(fix.velocity_north) and math.isfinite(fix.velocity_east)
    good = fix.locked and known and moving
    latitude, longitude, height = _place(fix, kind)
    position, speed, angle = _sigma(fix.position_sigma), _sigma(fix.velocity_sigma), math.degrees(fix.heading_sigma)
    ins = novatel.Inspvax(
        status=novatel.SOLUTION_GOOD if good else ALIGNING, kind=kind, latitude=latitude, longitude=longitude,
        height=height, undulation=0.0, velocity_north=_number(fix.velocity_north),
        velocity_east=_number(fix.velocity_east), velocity_up=_number(-fix.velocity_down),
        roll=_number(math.degrees(fix.roll)), pitch=_number(math.degrees(fix.pitch)),
        azimuth=to_compass(fix.heading) if known else 0.0, latitude_sigma=position, longitude_sigma=position,
        height_sigma=position, velocity_north_sigma=speed, velocity_east_sigma=speed, velocity_up_sigma=speed,
        roll_sigma=_sigma(angle), pitch_sigma=_sigma(angle), azimuth_sigma=_sigma(angle), extended_status=0,
        since_update=0,
    )  # fmt: skip
    return novatel.INSPVAX_CONTENT.pack(*ins)


def _place(fix: Fix, kind: int) -> tuple[float, float, float]:
    if not kind:
        return 0.0, 0.0, 0.0
    return math.degrees(fix.latitude), math.degrees(fix.longitude), _number(fix.altitude)


def _number(value: float) -> float:
    return value if math.isfinite(value) else 0.0


def _sigma(value: float) -> float:
    return value if math.isfinite(value) else UNKNOWN
