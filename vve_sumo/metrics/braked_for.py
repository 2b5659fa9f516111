"""Names the actor that the car braked for: over its last stop, and over the hardest braking of the drive.

Reads columns of ticks and what was ahead; it must not know the controller, which alone knows its reasons. So the name
is what the motion shows: the actor that called for the most deceleration while the car slowed down.
"""

from __future__ import annotations

from typing import Final, Protocol

import numpy as np

from vve_sumo.geometry import Boxes, time_to_collision_2d
from vve_sumo.metrics.drive_columns import ActorRows, Motion
from vve_sumo.metrics.lead_vehicle import LeadVehicle
from vve_sumo.metrics.stopping import Stop
from vve_sumo.path import ReferencePath
from vve_sumo.values import Floats

#: a car that slows down by more than this is braked; drag and an idling engine do less [m/s2]
BRAKED: Final = 0.5
#: a controller brakes for what it saw so long before the braking shows [s]
SEEN_BEFORE: Final = 1.0
#: what calls for less than this share of the deceleration that was braked with is not what was braked for
LEAST_SHARE: Final = 0.2


class BrakedDrive(Protocol):
    """What is looked at of a drive."""

    path: ReferencePath  #: where the ego was to drive

    @property
    def s(self) -> Floats:
        """Where the ego's rear axle was along the path, an entry a tick [m]."""

    @property
    def motion(self) -> Motion:
        """How the ego moved."""

    @property
    def ego_boxes(self) -> Boxes:
        """The ego's body, an entry a tick."""

    @property
    def actor_rows(self) -> ActorRows:
        """The rows of the actors."""

    @property
    def lead(self) -> LeadVehicle:
        """What was ahead in the ego's way."""

    @property
    def stop(self) -> Stop | None:
        """The last stop that was commanded."""


def last_stop_for(drive: BrakedDrive) -> str:
    """Return the actor that the last commanded stop was for; empty for none, and where there was no such stop."""
    return _called_for(drive, drive.stop.onset, drive.stop.rest) if drive.stop else ""


def hardest_braking_for(drive: BrakedDrive) -> str:
    """Return the actor that the car braked hardest for; empty for none, and where it hardly braked at all."""
    acceleration = drive.motion.acceleration
    known = np.flatnonzero(np.isfinite(acceleration))
    if not len(known):
        return ""
    hardest = int(known[np.argmin(acceleration[known])])
    if not acceleration[hardest] < -BRAKED:
        return ""
    released = np.flatnonzero(~(acceleration[:hardest] < -BRAKED))
    return _called_for(drive, int(released[-1]) + 1 if len(released) else 0, hardest)


def _called_for(drive: BrakedDrive, begin: int, end: int) -> str:
    """Return the actor ahead in the car's strip that called for the most deceleration (DRAC) between two ticks.

    Where none called for enough, it is the actor that the car would have touched soonest at constant velocities, before
    it came to rest.
    """
    time, acceleration = drive.motion.time, drive.motion.acceleration
    seen = slice(int(np.searchsorted(time, time[begin] - SEEN_BEFORE)), end + 1)
    braked = -float(np.fmin.reduce(acceleration[begin : end + 1], initial=0.0))
    needed = np.nan_to_num(drive.lead.required_deceleration[seen])
    if needed.max(initial=0.0) > LEAST_SHARE * braked:
        return drive.lead.actor[seen.start + int(np.argmax(needed))]
    return _first_touched(drive, seen, SEEN_BEFORE + float(drive.motion.speed[begin]) / braked) if braked > 0.0 else ""


def _first_touched(drive: BrakedDrive, ticks: slice, within: float) -> str:
    """Return the actor ahead with the least time to collision of boxes at some ticks, if that is below `within` [s].

    Ahead is what has its centre before the middle of the car: nobody brakes for what comes from behind. A collision
    beyond the end of the car's path does not count either, because the car never gets there.
    """
    actors, ego, at = drive.actor_rows, drive.ego_boxes.select(drive.actor_rows.at), drive.actor_rows.at
    ahead = (actors.boxes.x - ego.x) * np.cos(ego.heading) + (actors.boxes.y - ego.y) * np.sin(ego.heading) > 0.0
    rows = np.flatnonzero(ahead & (at >= ticks.start) & (at < ticks.stop))
    times = time_to_collision_2d(ego.select(rows), actors.boxes.select(rows))
    left = drive.path.length - drive.s[at[rows]]
    meets = np.isfinite(times)
    meets[meets] = drive.motion.speed[at[rows]][meets] * times[meets] <= left[meets]
    times = np.where(meets, times, np.inf)
    if not times.min(initial=np.inf) < within:
        return ""
    return actors.names[int(actors.code[rows[int(np.argmin(times))]])]
