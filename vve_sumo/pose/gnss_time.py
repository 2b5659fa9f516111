"""GNSS time: days, weeks and leap seconds, in milliseconds since 1980-01-06 of GPS time."""

from __future__ import annotations

import datetime
from typing import Final

GPS_EPOCH: Final = datetime.date(1980, 1, 6)
DAY: Final = 86_400_000  #: [ms]
WEEK: Final = 7 * DAY  #: [ms]
GPS_MINUS_UTC: Final = 18_000  #: leap seconds since 2017-01-01 (IERS Bulletin C 52 and all since) [ms]


def clock_of_week(week: int, time_of_week: int) -> int:
    """Return the GNSS time [ms] of a GPS week, counted on beyond 1023, and a time of week [ms]."""
    return week * WEEK + time_of_week


def clock_by_date(utc: int, time_of_week: int) -> int:
    """Return the GNSS time [ms] of a time of week [ms], in the week that puts it nearest to a UTC time [ms].

    The number of leap seconds only helps to choose the week: a wrong one changes nothing.
    """
    near = utc + GPS_MINUS_UTC
    return near + (time_of_week - near + WEEK // 2) % WEEK - WEEK // 2
