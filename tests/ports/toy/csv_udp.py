"""A receiver of an invented make, in one file: a line of comma-separated numbers in each datagram.

`[pose] kind = "csv_udp.py:make"` in a rig file is all that it takes to drive with it.
"""

from __future__ import annotations

import math
from typing import ClassVar, Final

from pydantic import Field

from vve_sumo.config_file import Positive
from vve_sumo.pose.receivers.port import Receiver
from vve_sumo.pose.receivers.udp import UdpReceiver
from vve_sumo.pose.trust import DRIVE, TrustProfile
from vve_sumo.values import Fix, FixQuality

#: of a line: GNSS time [s]; latitude, longitude [deg]; altitude [m]; heading clockwise from north, pitch [deg];
#: velocity north, east, down [m/s]; yaw rate clockwise [deg/s]; acceleration [m/s2]; quality; 1 sigma of position [m]
#: and velocity [m/s]; age of the corrections [s]
FIELDS: Final = 15
LONGEST: Final = 300  # line [bytes]
QUALITIES: Final = {1: FixQuality.SINGLE, 2: FixQuality.RTK_FLOAT, 3: FixQuality.RTK_FIXED}


class CsvUdp(UdpReceiver):
    """Lines of comma-separated numbers in UDP datagrams."""

    profile: ClassVar[TrustProfile] = DRIVE
    not_fixed_hint: ClassVar[str] = "see the green light on the receiver"

    heading_sigma_deg: Positive = Field(description="1 sigma of the heading, which the lines do not say")

    def decoder(self) -> LineDecoder:
        """Return a fresh decoder."""
        return LineDecoder(math.radians(self.heading_sigma_deg))

    def encoder(self) -> LineEncoder:
        """Return a fresh encoder, by which the simulated vehicle speaks as this receiver."""
        return LineEncoder()


class LineDecoder:
    """Lines to fixes."""

    def __init__(self, heading_sigma: float) -> None:
        self._heading_sigma = heading_sigma
        self._torn = b""

    def feed(self, data: bytes, time_received: float) -> list[Fix]:
        """Return the fixes of the lines that `data` ends; what is no line of numbers is left out."""
        *lines, torn = (self._torn + data).split(b"\n")
        self._torn = torn[-LONGEST:]
        return [fix for line in lines if (fix := self._read(line, time_received)) is not None]

    def _read(self, line: bytes, time_received: float) -> Fix | None:
        try:
            said = [float(word) for word in line.split(b",")]
        except ValueError:
            return None
        if len(said) != FIELDS or not all(map(math.isfinite, said)) or abs(said[1]) > 90.0 or abs(said[2]) > 180.0:
            return None
        return Fix(
            time=said[0],
            time_received=time_received,
            latitude=math.radians(said[1]),
            longitude=math.radians(said[2]),
            altitude=said[3],
            heading=math.remainder(math.radians(90.0 - said[4]), math.tau),
            pitch=math.radians(said[5]),
            roll=math.nan,
            velocity_north=said[6],
            velocity_east=said[7],
            velocity_down=said[8],
            yaw_rate=-math.radians(said[9]),
            acceleration=said[10],
            locked=True,
            quality=QUALITIES.get(round(said[11]), FixQuality.UNKNOWN),
            position_sigma=said[12],
            velocity_sigma=said[13],
            heading_sigma=self._heading_sigma,
            differential_age=said[14],
        )


class LineEncoder:
    """Fixes to lines."""

    def encode(self, fix: Fix) -> bytes:
        """Return the line of a fix; a number that is not known, and so is no number, makes it one that is left out."""
        quality = next((said for said, known in QUALITIES.items() if known is fix.quality), 0) if fix.locked else 0
        compass = 90.0 - math.degrees(fix.heading)
        numbers = (
            fix.time, math.degrees(fix.latitude), math.degrees(fix.longitude), fix.altitude, compass,
            math.degrees(fix.pitch), fix.velocity_north, fix.velocity_east, fix.velocity_down,
            -math.degrees(fix.yaw_rate), fix.acceleration, quality, fix.position_sigma, fix.velocity_sigma,
            fix.differential_age,
        )  # fmt: skip
        return (",".join(map(repr, numbers)) + "\n").encode()


def make() -> type[Receiver]:
    """Return the kind's class."""
    return CsvUdp
