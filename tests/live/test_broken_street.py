"""A street that meets a mistake of ours under way: a reason to stop the car, and no end of the process that drives."""

from __future__ import annotations

from typing import Any

import pytest

from vve_sumo.drive.tick_scheduler import ScheduledTick
from vve_sumo.errors import ConfigError
from vve_sumo.live.drive import LiveDrive
from vve_sumo.values import Point, Pose

BEGUN = ScheduledTick(tick=3, due=0.06, catch_up=1, missed=0, woken_by="clock", faults=())


class Broken:
    """All that a drive asks when it has its street advance; the street says `error`."""

    next_due = 0.08

    def __init__(self, error: Exception) -> None:
        self.error, self.asked = error, 0

    def front_bumper_at(self, time: float) -> Pose:
        """Return where the car would be."""
        return Pose(time, Point.FRONT_BUMPER, 0.0, 0.0, 0.0, 5.0, 0.0, 0.0, 0.0, 0.0)

    def advance(self, asked: Pose | None, *, waits: bool = False) -> None:
        """Break."""
        self.asked += 1
        raise self.error


def drive_on(street: Broken) -> Any:
    drive: Any = LiveDrive.__new__(LiveDrive)
    drive._chain = drive._pacer = drive._street = street
    drive._found, drive._broken, drive._went_at = ("lot_edge",), "", 1.0
    return drive


def test_it_is_a_reason_that_stays_and_is_not_asked_again() -> None:
    street = Broken(ZeroDivisionError("of ours"))
    drive = drive_on(street)
    assert drive._advance(BEGUN)[1] is None
    assert drive._advance(BEGUN) == (None, None)
    assert (drive._found, street.asked) == (("lot_edge", "street_failed"), 1)
    assert "ZeroDivisionError: of ours" in drive._broken


def test_a_street_that_refuses_the_ego_refuses_the_drive() -> None:
    with pytest.raises(ConfigError):
        drive_on(Broken(ConfigError("obstacle parked: it stands where the ego starts")))._advance(BEGUN)
