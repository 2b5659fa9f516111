"""Decides which detection belongs to which track where several could: the cheapest assignment of all.

Taking the nearest pair first may leave the others to be swapped: of two cars side by side, far ahead, each takes now
the one's detections and now the other's, and both seem to be in the middle. It must not know what rows and columns are.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import inf
from typing import Final

from scipy.optimize import linear_sum_assignment

ALONE: Final = 1e6  #: cost of a row without a column, above all others: as many rows get one as can


def assign(costs: Sequence[Sequence[float]]) -> dict[int, int]:
    """Return the column of each row that gets one, at the least total cost; each column goes to one row at most.

    `costs` has a row's cost of every column, infinite or NaN where it cannot have that one.
    """
    if not costs:
        return {}
    # Each row has the choice of as many more columns as there are rows: there it stays alone.
    alone = [ALONE] * len(costs)
    taken = linear_sum_assignment([[*(cost if cost < inf else inf for cost in row), *alone] for row in costs])
    rows, columns = (found.tolist() for found in taken)
    return {row: column for row, column in zip(rows, columns, strict=True) if column < len(costs[row])}
