"""TimestampIts against the standard's own example, and the completion of remainders by brute force."""

from __future__ import annotations

from datetime import UTC, datetime

import pytest
from hypothesis import given
from hypothesis import strategies as st

from vve_sumo.v2x.its_time import MAX_TIME_MS, from_gnss, require_time, unfold

GNSS_EPOCH = datetime(1980, 1, 6, tzinfo=UTC)


def gnss(moment: datetime, leap_seconds: int) -> float:
    """GNSS time [s] of a moment in UTC, by which so many leap seconds had been inserted since 1980."""
    return (moment - GNSS_EPOCH).total_seconds() + leap_seconds


def test_the_standards_example() -> None:
    """TS 102 894-2, TimestampIts; the leap seconds are IERS's: 13 until 2004, 14 until 2007, 18 since 2017."""
    assert from_gnss(gnss(datetime(2004, 1, 1, tzinfo=UTC), 13)) == 0
    assert from_gnss(gnss(datetime(2007, 1, 1, tzinfo=UTC), 14)) == 94_694_401_000
    since_2004 = datetime(2022, 1, 1, tzinfo=UTC) - datetime(2004, 1, 1, tzinfo=UTC)
    assert from_gnss(gnss(datetime(2022, 1, 1, tzinfo=UTC), 18)) == (since_2004.total_seconds() + 5) * 1000


@given(st.integers(0, 99), st.integers(0, 1000))
def test_the_nearest_time_with_a_remainder(remainder: int, now: int) -> None:
    times = [time for time in range(2000) if time % 100 == remainder]
    assert unfold(remainder, 100, now) == min(times, key=lambda time: (abs(time - now), time))


@pytest.mark.parametrize("time", [-1, MAX_TIME_MS + 1])
def test_a_time_that_no_message_carries_is_refused(time: int) -> None:
    with pytest.raises(ValueError, match="TimestampIts"):
        require_time(time)
