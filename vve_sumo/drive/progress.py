"""Reports how far a drive has come; knows neither progress bars nor processes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from vve_sumo.drive.lockstep import TickCallback

#: ticks of a drive between two reports of its progress
TICKS_PER_REPORT = 25


@dataclass(frozen=True, slots=True)
class DriveProgress:
    """How far a drive has come."""

    time: float  #: of the drive [s]
    speed: float  #: of the rear axle [m/s]
    s: float  #: distance along the path [m]
    length: float  #: of the path [m]


def progress_callback(length: float, report: Callable[[DriveProgress], None]) -> TickCallback:
    """Return a callback that reports a drive's progress along a path of `length` [m] twice a second of drive time."""

    def on_tick(tick: int, now: float, speed: float, s: float) -> None:
        if tick % TICKS_PER_REPORT == 0 and s == s:  # s is NaN before the first pose
            report(DriveProgress(now, speed, s, length))

    return on_tick
