"""The days that a rig states, and how old each may be; the caller passes in which day it is.

A rig is read from its file on a day, and commands a real car on a day. A record that is read years later keeps its rig
as it was: nothing here is asked then.
"""

from __future__ import annotations

import datetime
from collections.abc import Iterator
from typing import Final, NamedTuple

from vve_sumo.rig.schema import Rig

#: by which a day may lie ahead of this computer's: somebody wrote it down east of here
TIME_ZONES: Final = datetime.timedelta(days=1)


class StatedDay(NamedTuple):
    """A day that a rig states."""

    key: str  #: in the rig file
    what: str  #: was done on that day
    day: datetime.date
    valid_days: int | None = None  #: for how long it holds for a real car; None for as long as nothing is changed

    def is_to_come(self, today: datetime.date) -> bool:
        """Whether the day cannot have been yet, wherever on Earth it was written down."""
        return self.day > today + TIME_ZONES

    def has_expired(self, today: datetime.date) -> bool:
        """Whether a real car may not be commanded on it any more."""
        return self.valid_days is not None and (today - self.day).days > self.valid_days


def stated_days(rig: Rig) -> Iterator[StatedDay]:
    """Return every day that a rig states; those of a simulated vehicle hold for ever."""
    test, real = rig.watchdog_test, rig.car == "real"
    yield StatedDay("lot.surveyed", "the survey", rig.lot.surveyed, rig.lot.valid_days if real else None)
    if test is not None:
        yield StatedDay("watchdog_test.date", "the test", test.date, test.valid_days if real else None)
    others = (
        ("calibration.date", "the calibration", rig.calibration.date),
        ("mounting.calibrated", "the calibration", rig.mounting.calibrated),
        ("alignment.date", "the alignment", rig.alignment.date),
    )
    named = ((f"alignments.{name}.date", "the alignment", one.date) for name, one in rig.alignments.items())
    yield from (StatedDay(key, what, day) for key, what, day in (*others, *named) if day is not None)


def day_to_come(rig: Rig, today: datetime.date) -> str | None:
    """Return what is wrong with the first of a rig's days that is still to come; None for none."""
    for stated in stated_days(rig):
        if stated.is_to_come(today):
            return (
                f"{stated.key}: {stated.day} is still to come, today is {today}; "
                "correct the date, or this computer's clock"
            )
    return None


def expired_day(rig: Rig, today: datetime.date) -> str | None:
    """Return which of a rig's days is too long ago for a real car to be commanded; None for none."""
    for stated in stated_days(rig):
        if stated.has_expired(today):
            table = stated.key.partition(".")[0]
            return (
                f"{stated.key}: {stated.what} of {stated.day} was {(today - stated.day).days} days ago, "
                f"{table}.valid_days allows {stated.valid_days}; repeat it"
            )
    return None
