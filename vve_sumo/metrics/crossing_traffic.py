"""The least post-encroachment time of a drive, over all actors whose way crosses the ego's.

Knows a drive's boxes; neither who has the right of way nor where junctions are.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from vve_sumo.geometry import Boxes
from vve_sumo.metrics.crossing import encroachment
from vve_sumo.metrics.drive_columns import ActorRows
from vve_sumo.values import Floats

#: a body whose middle comes so near to the line of the ego's middle is on it [m]
ON_LINE: Final = 2.5
#: who is on that line at a smaller angle goes along with the ego, or joins its way, or leaves it [rad]
CROSSES: Final = math.radians(30.0)
#: instants between two that are looked at: what is between is taken as steady
EVERY: Final = 5


def min_crossing_pet(time: Floats, ego: Boxes, actors: ActorRows) -> float:
    """Return the least post-encroachment time [s] with an actor that crosses the ego's way; NaN where nobody does.

    `time` is of the boxes of the ego [s]. Who goes along with it anywhere on its line is left out: a leader, for
    one, and who joins. Negative where both were in their conflict area at a time. Either may be the first.
    """
    known = np.flatnonzero(np.isfinite(ego.x) & np.isfinite(ego.y))[::EVERY]
    looked_at = np.flatnonzero(np.isfinite(actors.boxes.x) & np.isfinite(actors.boxes.y) & (actors.at % EVERY == 0))
    if not len(known):
        return math.nan
    line, least = _thinned(ego.select(known)), math.nan
    for code in np.unique(actors.code[looked_at]).tolist():
        own = looked_at[actors.code[looked_at] == code]
        if _crosses(line, actors.boxes.select(own)):
            met = encroachment(time[known], ego.select(known), time[actors.at[own]], actors.boxes.select(own))
            least = float(np.fmin(least, met.time))
    return least


def _thinned(ego: Boxes) -> Boxes:
    """Return a box of each metre that the ego has gone."""
    gone = np.cumsum(np.hypot(np.diff(ego.x, prepend=ego.x[0]), np.diff(ego.y, prepend=ego.y[0])))
    return ego.select(np.unique(np.floor(gone), return_index=True)[1])


def _crosses(line: Boxes, other: Boxes) -> bool:
    """Tell whether somebody crosses the ego's line, and nowhere goes along it."""
    near = np.ones(len(other.x), np.bool_)
    for mine, theirs in ((line.x, other.x), (line.y, other.y)):
        near &= (theirs > mine.min() - ON_LINE) & (theirs < mine.max() + ON_LINE)
    other = other.select(np.flatnonzero(near))
    away = np.hypot(other.x[:, None] - line.x, other.y[:, None] - line.y)
    nearest = np.argmin(away, axis=1)
    on = np.flatnonzero(away[np.arange(len(nearest)), nearest] <= ON_LINE)
    cosine = np.cos(other.heading[on] - line.heading[nearest[on]])
    along, against = cosine > math.cos(CROSSES), cosine < -math.cos(CROSSES)
    return not bool(along.any()) and bool((~along & ~against).any())
