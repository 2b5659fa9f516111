"""The approach of a drive's last stop: from the first braking for what the car stopped for until rest, and hunting.

Knows braking episodes, speed, acceleration and what stood ahead; not who asks, nor what a good approach is.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from vve_sumo.metrics.stopping import PRESSED, BrakingEpisode, Stop, onset_of, sign_changes
from vve_sumo.values import Floats

#: as many sign changes of the acceleration on the way to rest are hunting: the car braked, gained speed, braked, gained
#: speed and braked again. Two may have a reason, such as a target that drove on once; a regulated stop has none
HUNTING: Final = 4


@dataclass(frozen=True, slots=True)
class StopApproach:
    """The way to the last stop."""

    onset: int  #: index of the tick that first commanded braking for it
    rest: int  #: index of the first tick at rest
    duration: float  #: [s]
    distance: float  #: [m]
    reversals: int  #: sign changes of the acceleration, counted from the first braking on

    @property
    def hunting(self) -> bool:
        """Whether the car gained speed and braked again, time after time."""
        return self.reversals >= HUNTING


def approach_of(
    stop: Stop, brakings: list[int], time: Floats, speed: Floats, acceleration: Floats, standing: NDArray[np.bool_]
) -> StopApproach:
    """Return the approach of a stop: since the first of the `brakings` from which on its target stood ahead.

    `brakings` are the onsets of the drive's braking episodes, in order. `standing` says of every tick whether what the
    car stopped for was ahead, and stood; a braking for a target that still moves is following, and begins no approach.
    Time [s], speed [m/s] and acceleration [m/s2] are the rear axle's, an entry a tick.
    """
    away = np.flatnonzero(~standing[: stop.onset])
    since = int(away[-1]) + 1 if len(away) else 0
    onset = next((one for one in brakings if since <= one < stop.onset), stop.onset)
    before = slice(onset, stop.onset + 1)
    earlier = float(np.sum(0.5 * (speed[before][:-1] + speed[before][1:]) * np.diff(time[before])))
    reversals = sign_changes(acceleration[onset : stop.rest])
    duration = float(time[stop.rest] - time[onset])
    return StopApproach(onset, stop.rest, duration, earlier + stop.distance, reversals)


def brakings(time: Floats, course: Floats, episodes: list[BrakingEpisode]) -> list[int]:
    """Return the onsets of those episodes of a course of decelerations that are more than trim."""
    return [onset_of(time, course, episode) for episode in episodes if pressed(course, episode)]


def pressed(course: Floats, episode: BrakingEpisode) -> bool:
    """Whether an episode of a course of decelerations is more than trim."""
    return bool(course[episode.start : episode.end].max() >= PRESSED)
