"""Encoder of NMEA 0183 sentences: a fix as GGA, RMC, VTG, HDT or THS, GST, ZDA; `pose.nmea` decodes them.

Knows sentences; it must not know where they go. The speed along the ground has no sign in NMEA: a car that reverses
has a course opposite to its heading.
"""

from __future__ import annotations

import datetime
import math
from typing import Final

from vve_sumo.values import Fix, FixQuality

#: GPS time began here; it knows no leap seconds
EPOCH: Final = datetime.datetime(1980, 1, 6)
LEAP_SECONDS: Final = 18  #: GPS minus UTC since 2017-01-01 [s]
KNOT: Final = 0.514444  #: [m/s]
#: GGA's quality of each quality; 0 is no position
QUALITIES: Final = {
    FixQuality.SINGLE: 1,
    FixQuality.DIFFERENTIAL: 2,
    FixQuality.PPP: 2,
    FixQuality.RTK_FIXED: 4,
    FixQuality.RTK_FLOAT: 5,
}
TALKER: Final = "GP"


def encode(fix: Fix, *, dated: bool = False, heading_status: bool = False) -> bytes:
    """Return the sentences of a fix, each with its checksum, in the order in which receivers send them.

    `dated` adds ZDA; `heading_status` puts THS in the place of HDT. A fix that is not `locked`, or has no position, is
    sent with quality 0 and status V. Raises ValueError for a time that is not finite.
    """
    utc = EPOCH + datetime.timedelta(milliseconds=round(1000.0 * fix.time) - 1000 * LEAP_SECONDS)
    quality = QUALITIES.get(fix.quality, 0) if fix.locked and _placed(fix) else 0
    sentences = [
        _gga(fix, utc, quality),
        _rmc(fix, utc, quality),
        _vtg(fix, quality),
        _ths(fix, quality) if heading_status else _hdt(fix, quality),
        _gst(fix, utc),
    ]
    if dated:
        sentences.append(f"ZDA,{_time(utc)},{utc:%d,%m,%Y},00,00")
    return b"".join(_framed(sentence) for sentence in sentences)


def _framed(body: str) -> bytes:
    content = (TALKER + body).encode("ascii")
    checksum = 0
    for byte in content:
        checksum ^= byte
    return b"$%b*%02X\r\n" % (content, checksum)


def _placed(fix: Fix) -> bool:
    return math.isfinite(fix.latitude) and math.isfinite(fix.longitude)


def _gga(fix: Fix, utc: datetime.datetime, quality: int) -> str:
    age = "" if math.isnan(fix.differential_age) else f"{fix.differential_age:.1f}"
    place = _place(fix) if quality else ",,,"
    altitude = f"{fix.altitude:.3f}" if quality and math.isfinite(fix.altitude) else ""
    return f"GGA,{_time(utc)},{place},{quality},{12 if quality else 0:02d},0.7,{altitude},M,0.0,M,{age},0000"


def _rmc(fix: Fix, utc: datetime.datetime, quality: int) -> str:
    speed, course = _over_ground(fix)
    place = _place(fix) if quality else ",,,"
    status, mode = ("A", _mode(quality)) if quality else ("V", "N")
    return f"RMC,{_time(utc)},{status},{place},{_knots(speed)},{course},{utc:%d%m%y},,,{mode}"


def _vtg(fix: Fix, quality: int) -> str:
    speed, course = _over_ground(fix)
    kilometres = "" if math.isnan(speed) else f"{3.6 * speed:.3f}"
    return f"VTG,{course},T,,M,{_knots(speed)},N,{kilometres},K,{_mode(quality)}"


def _hdt(fix: Fix, quality: int) -> str:
    heading = f"{_compass(fix.heading):.3f}" if quality and math.isfinite(fix.heading) else ""
    return f"HDT,{heading},T"


def _ths(fix: Fix, quality: int) -> str:
    known = quality and math.isfinite(fix.heading)
    return f"THS,{_compass(fix.heading):.3f},A" if known else "THS,,V"


def _gst(fix: Fix, utc: datetime.datetime) -> str:
    sigma = "" if math.isnan(fix.position_sigma) else f"{fix.position_sigma:.3f}"
    return f"GST,{_time(utc)},{sigma},{sigma},{sigma},0.0,{sigma},{sigma},{sigma}"


def _mode(quality: int) -> str:
    """Return NMEA's mode indicator of a GGA quality."""
    return {0: "N", 1: "A", 2: "D", 4: "R", 5: "F"}[quality]


def _time(utc: datetime.datetime) -> str:
    return f"{utc:%H%M%S}.{utc.microsecond // 1000:03d}"


def _place(fix: Fix) -> str:
    """Return latitude, its hemisphere, longitude, its hemisphere: degrees and minutes of eight decimals."""
    return (
        f"{_degrees(abs(fix.latitude), 2)},{'N' if fix.latitude >= 0.0 else 'S'},"
        f"{_degrees(abs(fix.longitude), 3)},{'E' if fix.longitude >= 0.0 else 'W'}"
    )


def _degrees(angle: float, digits: int) -> str:
    # Counted in the last decimal of the minutes, so that 59.999999999 minutes never become 60.
    degrees, minutes = divmod(round(math.degrees(angle) * 60.0e8), 60 * 10**8)
    return f"{degrees:0{digits}d}{minutes // 10**8:02d}.{minutes % 10**8:08d}"


def _over_ground(fix: Fix) -> tuple[float, str]:
    """Return speed [m/s] and course [deg] over the ground; NaN and empty where they are not known."""
    if not (math.isfinite(fix.velocity_north) and math.isfinite(fix.velocity_east)):
        return math.nan, ""
    course = math.degrees(math.atan2(fix.velocity_east, fix.velocity_north)) % 360.0
    return math.hypot(fix.velocity_north, fix.velocity_east), f"{course:.3f}"


def _knots(speed: float) -> str:
    return "" if math.isnan(speed) else f"{speed / KNOT:.4f}"


def _compass(heading: float) -> float:
    """Return a heading [rad], counter-clockwise from east, in degrees clockwise from north."""
    return (90.0 - math.degrees(heading)) % 360.0


class Encoder:
    """Writes fixes as a receiver would: the sentences of each, whose RMC holds the date."""

    def __init__(self, *, heading_status: bool = False) -> None:
        """Begin; `heading_status` puts THS in the place of HDT."""
        self._heading_status = heading_status

    def encode(self, fix: Fix) -> bytes:
        """Return the sentences of a fix."""
        return encode(fix, heading_status=self._heading_status)
