"""A drive's times as other programs count them: since 1970 in UTC. Records count GNSS time, without leap seconds."""

from __future__ import annotations

import datetime
from typing import Final

from vve_sumo.analysis.run import Run
from vve_sumo.pose.nmea_encoder import LEAP_SECONDS

#: of GNSS time 0, 1980-01-06, as Unix time [s]
GNSS_EPOCH: Final = 315_964_800
MICROSECONDS: Final = 1_000_000  #: in a second


def unix_of_gnss(time: float) -> int:
    """Return the Unix time [us] of a GNSS time [s]."""
    return round(time * MICROSECONDS) + (GNSS_EPOCH - LEAP_SECONDS) * MICROSECONDS


def unix_of_drive(run: Run, time: float) -> int:
    """Return the Unix time [us] of a drive time [s]."""
    return unix_of_gnss(float(run.resolved["epoch_gnss_s"])) + round(time * MICROSECONDS)


def date_of(unix: int) -> datetime.datetime:
    """Return the date of a Unix time [us]."""
    return datetime.datetime(1970, 1, 1, tzinfo=datetime.UTC) + datetime.timedelta(microseconds=unix)
