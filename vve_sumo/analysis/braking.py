"""How a drive came to rest, and how that felt.

Reads a run and nothing else; it must not judge whether the stop was as short as it should have been.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Final, NamedTuple

import numpy as np

from vve_sumo.analysis.run import Run
from vve_sumo.metrics import stopping
from vve_sumo.metrics.slope import SLOPE_REACH, slope

#: over so long ISO 15622 averages the deceleration of adaptive cruise control [s]
AVERAGED: Final = 2.0


@dataclass(frozen=True, slots=True)
class Stop(stopping.Stop):
    """The braking that ended at rest, in drive time, and what was ahead then."""

    onset_s: float  #: when it was first commanded [s]
    rest_s: float  #: when the car was at rest [s]
    gap: float  #: front bumper to what was ahead at rest [m]; negative is overlap, NaN where nothing was

    def margin(self, target_gap: float = 0.0) -> float:
        """Return the gap at rest beyond a target gap [m]; negative is too close, NaN where nothing was ahead."""
        return self.gap - target_gap


class Comfort(NamedTuple):
    """How a stop felt, from its onset until the jolt of coming to rest is over."""

    max_jerk_mps3: float  #: greatest size of the acceleration's rate of change
    rms_jerk_mps3: float  #: its root mean square
    rms_acceleration_mps2: float  #: root mean square of the acceleration
    max_deceleration_mps2: float  #: greatest at any tick
    mean_deceleration_mps2: float  #: the greatest mean over any AVERAGED seconds that hold a part of the stop


def stop_of(run: Run) -> Stop | None:
    """Return the last stop that was commanded; None where the drive holds none, as one that ends before its rest.

    By the truth where there is one, else by the estimate, whose own delay then counts as the car's.
    """
    found = run.data.stop
    if found is None:
        return None
    known = {field.name: getattr(found, field.name) for field in fields(found)}
    onset, rest = float(run.time[found.onset]), float(run.time[found.rest])
    return Stop(**known, onset_s=onset, rest_s=rest, gap=float(run.lead.gap[found.rest]))


def comfort(run: Run, stop: Stop) -> Comfort:
    """Return how a stop of a run felt.

    Jerk is the slope of the line that fits the acceleration best from SLOPE_REACH before to SLOPE_REACH after, as in
    `over_time`; it counts until its window has left the last tick under way, for the jolt comes with the rest.
    """
    time, speed, acceleration = run.motion.time, run.motion.speed, run.motion.acceleration
    felt = slice(stop.onset, stop.rest + round(SLOPE_REACH / run.period) + 1)
    jerk, deceleration = slope(time, acceleration, run.period)[felt], -acceleration[felt]
    begins = time[(time > stop.onset_s - AVERAGED) & (time < stop.rest_s)]
    lost = np.interp(begins, time, speed) - np.interp(begins + AVERAGED, time, speed)
    return Comfort(
        float(np.nanmax(np.abs(jerk))),
        float(np.sqrt(np.nanmean(jerk**2))),
        float(np.sqrt(np.nanmean(deceleration**2))),
        float(np.nanmax(deceleration)),
        float(np.max(lost)) / AVERAGED,
    )
