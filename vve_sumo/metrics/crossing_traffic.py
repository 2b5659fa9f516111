"""The least post-encroachment time of a drive, over all actors whose way crosses the ego's.

Knows a drive's boxes; neither who has the right of way nor where junctions are.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from scipy.spatial import cKDTree

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
    if not len(known) or not len(actors.rows):
        return math.nan
    line = cKDTree(np.column_stack((ego.x[known], ego.y[known])))
    finite = np.flatnonzero(np.isfinite(actors.boxes.x) & np.isfinite(actors.boxes.y))
    away, nearest = line.query(
        np.column_stack((actors.boxes.x[finite], actors.boxes.y[finite])), distance_upper_bound=ON_LINE
    )
    on, place = np.flatnonzero(np.isfinite(away)), np.asarray(nearest)
    rows, angle = finite[on], actors.boxes.heading[finite[on]] - ego.heading[known[place[on]]]
    along = np.cos(angle) > math.cos(CROSSES)
    against = np.cos(angle) < -math.cos(CROSSES)
    joins = set(actors.code[rows[along]].tolist())
    crossing = set(actors.code[rows[~along & ~against]].tolist()) - joins
    least = math.nan
    for code in sorted(crossing):
        own = np.flatnonzero(actors.code == code)[::EVERY]
        met = encroachment(time[known], ego.select(known), time[actors.at[own]], actors.boxes.select(own))
        least = float(np.fmin(least, met.time))
    return least
