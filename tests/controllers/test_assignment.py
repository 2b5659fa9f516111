"""The assignment of detections to tracks against all there are."""

from __future__ import annotations

import math
from itertools import product

import pytest
from hypothesis import given
from hypothesis import strategies as st

from controllers.assignment import ALONE, assign

NEVER = math.inf
COST = st.one_of(st.sampled_from([NEVER, math.nan]), st.floats(-8.0, 40.0))
ROWS = st.integers(0, 5).flatmap(
    lambda columns: st.lists(st.lists(COST, min_size=columns, max_size=columns), max_size=4)
)


def total(costs: list[list[float]], columns: dict[int, int]) -> float:
    """What an assignment costs; a row without a column costs more than any other."""
    return sum(row[columns[number]] if number in columns else ALONE for number, row in enumerate(costs))


@given(ROWS)
def test_none_is_cheaper(costs: list[list[float]]) -> None:
    found = assign(costs)
    assert len(set(found.values())) == len(found)
    assert all(costs[row][column] < NEVER for row, column in found.items())
    choices = product(*[[None, *(column for column, cost in enumerate(row) if cost < NEVER)] for row in costs])
    every = [{row: column for row, column in enumerate(choice) if column is not None} for choice in choices]
    least = min(total(costs, columns) for columns in every if len(set(columns.values())) == len(columns))
    assert total(costs, found) == pytest.approx(least, abs=1e-6)


def test_the_nearest_pair_is_not_taken_where_that_costs_the_others_more() -> None:
    assert assign([[2.0, 1.7], [NEVER, 2.0]]) == {0: 0, 1: 1}
    assert assign([[1.0, 2.0], [1.5, 9.0]]) == {0: 1, 1: 0}
    assert assign([[1.0], [2.0]]) == {0: 0}
    assert assign([[], []]) == {}
    assert assign([]) == {}
