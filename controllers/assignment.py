"""Decides which detection belongs to which track where several could: the cheapest assignment of all.

Taking the nearest pair first may leave the others to be swapped: of two cars side by side, far ahead, each takes now
the one's detections and now the other's, and both seem to be in the middle. It must not know what rows and columns are.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping, Sequence

ALONE = 1e6  #: cost of a row without a column, above all others: as many rows get one as can
ROUNDING = 1e-9  #: of sums of costs: a way that is shorter by less is none


def assign(costs: Sequence[Mapping[int, float]]) -> dict[int, int]:
    """Return the column of each row that gets one, at the least total cost; each column goes to one row at most.

    `costs` has a row's possible columns, numbered from 0, with what each costs. Rows come in one after the other by the
    shortest augmenting path, which may move those before to other columns (Ahuja, Magnanti, Orlin, *Network Flows*,
    1993, 12.4).
    """
    edges = [{**row, -1 - number: ALONE} for number, row in enumerate(costs)]  # each row could also stay alone
    owners: dict[int, int] = {}  # row of each column that is taken
    columns: dict[int, int] = {}  # and the other way round
    for row in range(len(edges)):
        freed: int | None
        freed, came_from = _cheapest_end(edges, owners, row)
        while freed is not None:
            column, owner = freed, came_from[freed]
            freed = columns.get(owner)
            owners[column], columns[owner] = owner, column
    return {row: column for row, column in columns.items() if column >= 0}


def _cheapest_end(
    edges: Sequence[Mapping[int, float]], owners: Mapping[int, int], row: int
) -> tuple[int, dict[int, int]]:
    """Return the free column that the cheapest way from a row ends at, and from which row each column is reached."""
    cost, came_from, waiting = {row: 0.0}, {}, deque([row])
    reached: dict[int, float] = {}
    while waiting:
        here = waiting.popleft()
        for column, price in edges[here].items():
            total = cost[here] + price
            if not total < reached.get(column, math.inf) - ROUNDING:
                continue
            reached[column], came_from[column] = total, here
            owner = owners.get(column)
            if owner is not None:
                cost[owner] = total - edges[owner][column]
                waiting.append(owner)
    free = [column for column in reached if column not in owners]
    return min(free, key=reached.__getitem__), came_from
