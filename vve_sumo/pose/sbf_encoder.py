"""Encoder of Septentrio SBF: a fix as PVTGeodetic, AttEuler and their covariances; `pose.sbf` decodes them.

Knows blocks; it must not know where they go. The undulation of the geoid is 0: sea level is the ellipsoid.
"""

from __future__ import annotations

import math
import struct
from typing import Final

from vve_sumo.pose import sbf
from vve_sumo.pose.gnss_time import WEEK
from vve_sumo.pose.stream import to_compass
from vve_sumo.values import Fix, FixQuality

MODES: Final = {
    FixQuality.SINGLE: 1,
    FixQuality.DIFFERENTIAL: 2,
    FixQuality.RTK_FIXED: 4,
    FixQuality.RTK_FLOAT: 5,
    FixQuality.PPP: 10,
}
PVT_REVISION: Final = 2
NO_SOLUTION: Final = 5  #: PVTGeodetic's error: the solution did not converge
NOT_ENOUGH: Final = 1  #: AttEuler's error: not enough measurements
#: of HAccuracy [cm] for 1 sigma [m], the same north and east: twice the root of the sum of both squares
DRMS_TWICE: Final = 200.0 * math.sqrt(2.0)


class Encoder:
    """Writes fixes as a receiver with two antennas would, in the order in which receivers send blocks."""

    def encode(self, fix: Fix) -> bytes:
        """Return the five blocks of a fix; raises ValueError for a time that is not finite."""
        clock = round(1000.0 * fix.time)
        time = sbf.TIME.pack(clock % WEEK, clock // WEEK)
        known = math.isfinite(fix.latitude) and math.isfinite(fix.longitude) and fix.locked
        mode, error = (MODES.get(fix.quality, 0), 0) if known else (0, NO_SOLUTION)
        return b"".join(
            (
                framed(sbf.PVT | PVT_REVISION << sbf.REVISION, time + _pvt(fix, mode, error)),
                framed(sbf.POSITION_COVARIANCE, time + _covariance(fix.position_sigma, mode, error)),
                framed(sbf.VELOCITY_COVARIANCE, time + _covariance(fix.velocity_sigma, mode, error)),
                framed(sbf.ATTITUDE, time + _attitude(fix)),
                framed(sbf.ATTITUDE_COVARIANCE, time + _attitude_covariance(fix)),
            )
        )


def framed(kind: int, content: bytes) -> bytes:
    """Return the block of a content: header and checksum before it, and behind it what makes its length whole."""
    content += bytes(-len(content) % sbf.ALIGNMENT)
    protected = struct.pack("<HH", kind, sbf.HEADER.size + len(content)) + content
    return sbf.SYNC + struct.pack("<H", sbf.checksum(protected)) + protected


def _pvt(fix: Fix, mode: int, error: int) -> bytes:
    north, east, down = (
        _number(one if mode else math.nan) for one in (fix.velocity_north, fix.velocity_east, fix.velocity_down)
    )
    latitude, longitude, height = (
        _number(one if mode else math.nan) for one in (fix.latitude, fix.longitude, fix.altitude)
    )
    pvt = sbf.Pvt(
        mode=mode, error=error, latitude=latitude, longitude=longitude, height=height, undulation=0.0,
        velocity_north=north, velocity_east=east, velocity_up=down if down == sbf.NO_NUMBER else -down,
        course=sbf.NO_NUMBER, clock_bias=0.0, clock_drift=0.0, time_system=0, datum=0, satellites=12 if mode else 0,
        corrections=0, reference=0, correction_age=_hundredths(fix.differential_age), signals=0, alerts=0,
    )  # fmt: skip
    accuracy = _horizontal(fix.position_sigma)
    return sbf.PVT_BLOCK.pack(*pvt) + sbf.ACCURACY_BLOCK.pack(1, 0, 0, accuracy, accuracy, 0)


def _covariance(sigma: float, mode: int, error: int) -> bytes:
    variance = _number(sigma * sigma if mode else math.nan)
    return sbf.COVARIANCE_BLOCK.pack(mode, error, *[variance] * 3, *[sbf.NO_NUMBER] * 7)


def _attitude(fix: Fix) -> bytes:
    known = math.isfinite(fix.heading)
    heading = to_compass(fix.heading) if known else sbf.NO_NUMBER
    pitch, roll = (_number(math.degrees(one)) if known else sbf.NO_NUMBER for one in (fix.pitch, fix.roll))
    attitude = sbf.Attitude(
        satellites=12, error=0 if known else NOT_ENOUGH, mode=sbf.WITH_ROLL if known else 0, information=0,
        heading=heading, pitch=pitch, roll=roll, pitch_rate=sbf.NO_NUMBER, roll_rate=sbf.NO_NUMBER,
        heading_rate=_number(-math.degrees(fix.yaw_rate)),
    )  # fmt: skip
    return sbf.ATTITUDE_BLOCK.pack(*attitude)


def _attitude_covariance(fix: Fix) -> bytes:
    variance = _number(math.degrees(fix.heading_sigma) ** 2)
    return sbf.ATTITUDE_COVARIANCE_BLOCK.pack(0, 0, *[variance] * 3, *[sbf.NO_NUMBER] * 3)


def _horizontal(sigma: float) -> int:
    return min(math.ceil(DRMS_TWICE * sigma), sbf.NO_AGE - 1) if math.isfinite(sigma) else sbf.NO_AGE


def _number(value: float) -> float:
    return value if math.isfinite(value) else sbf.NO_NUMBER


def _hundredths(age: float) -> int:
    return min(round(100.0 * age), sbf.NO_AGE - 1) if math.isfinite(age) else sbf.NO_AGE
