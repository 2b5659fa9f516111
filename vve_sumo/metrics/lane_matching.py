"""Which lanes vehicles went along, each way as a whole: the most likely sequence of lanes that lead into each other.

Lanes lie upon each other in a junction, and the nearest one at a place says little. So the sequence is found whose
lanes are near all along and follow on each other (P. Newson and J. Krumm, "Hidden Markov map matching", ACM SIGSPATIAL
2009), with the algorithm of Viterbi. Knows numbers of lanes and costs; neither geometry nor roads.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vve_sumo.values import Floats

Indices = NDArray[np.int64]

#: of a sample in no lane; a lane costs 2 at most, so that a vehicle that is in one belongs to one
NO_LANE: Final = 2.5
#: of a change to the lane beside
CHANGE: Final = 1.0
#: of going over to a lane that does not follow, or to no lane and back: some samples' worth of a bad fit
JUMP: Final = 10.0


class Candidates(NamedTuple):
    """Lanes that a vehicle may be in at samples of ways: a row a sample, a column a candidate."""

    lane: Indices  #: -1 for none
    cost: Floats  #: 0 of a vehicle in the middle of the lane, that goes along it; inf for none


def links(edges: Sequence[str], successors: Sequence[Sequence[int]]) -> Floats:
    """Return the cost of going from each lane to each other one in the length of a sample; the last lane is none."""
    count = len(edges)
    _, edge = np.unique(np.array(edges), return_inverse=True)
    cost = np.full((count + 1, count + 1), JUMP)
    cost[:count, :count][edge[:, None] == edge] = CHANGE
    for lane, after in enumerate(successors):
        # A lane may be shorter than the way from one sample to the next.
        for follower in after:
            cost[lane, [follower, *successors[follower]]] = 0.0
    np.fill_diagonal(cost, 0.0)
    return cost


def most_likely(candidates: Candidates, first: Indices, count: Indices, cost: Floats) -> Indices:
    """Return the lane of every sample, -1 for none.

    first, count: of the samples of each way. cost: see `links`. All ways are gone along at the same time, step by step.
    """
    none = len(cost) - 1
    lane = np.column_stack((np.where(candidates.lane < 0, none, candidates.lane), np.full(len(candidates.lane), none)))
    fit = np.column_stack((candidates.cost, np.full(len(lane), NO_LANE)))
    chosen, before = np.full(len(lane), -1), np.zeros(lane.shape, np.int64)
    longest = np.argsort(-count, kind="stable")
    first, count = first[longest], count[longest]
    total = fit[first]
    for step in range(1, int(count.max(initial=0))):
        rows = first[count > step] + step
        reached = total[: len(rows), :, None] + cost[lane[rows - 1][:, :, None], lane[rows][:, None, :]]
        before[rows] = np.argmin(reached, axis=1)
        total[: len(rows)] = np.min(reached, axis=1) + fit[rows]
    state = np.argmin(total, axis=1)
    for step in range(int(count.max(initial=0)) - 1, -1, -1):
        rows = first[count > step] + step
        chosen[rows] = lane[rows, state[: len(rows)]]
        state[: len(rows)] = before[rows, state[: len(rows)]]
    return np.where(chosen == none, -1, chosen)
