"""The assignment of detections to tracks against all there are."""

from __future__ import annotations

from itertools import product

import pytest
from hypothesis import given
from hypothesis import strategies as st

from controllers.assignment import ALONE, assign

ROWS = st.lists(st.dictionaries(st.integers(0, 4), st.floats(-8.0, 40.0), max_size=5), max_size=4)


def total(costs: list[dict[int, float]], columns: dict[int, int]) -> float:
    """What an assignment costs; a row without a column costs more than any other."""
    return sum(row[columns[number]] if number in columns else ALONE for number, row in enumerate(costs))


@given(ROWS)
def test_none_is_cheaper(costs: list[dict[int, float]]) -> None:
    found = assign(costs)
    assert len(set(found.values())) == len(found)
    assert all(column in costs[row] for row, column in found.items())
    choices = product(*[[None, *row] for row in costs])
    every = [{row: column for row, column in enumerate(choice) if column is not None} for choice in choices]
    least = min(total(costs, columns) for columns in every if len(set(columns.values())) == len(columns))
    assert total(costs, found) == pytest.approx(least, abs=1e-6)


def test_the_nearest_pair_is_not_taken_where_that_costs_the_others_more() -> None:
    assert assign([{0: 2.0, 1: 1.7}, {1: 2.0}]) == {0: 0, 1: 1}
    assert assign([{0: 1.0, 1: 2.0}, {0: 1.5, 1: 9.0}]) == {0: 1, 1: 0}
    assert assign([{0: 1.0}, {0: 2.0}]) == {0: 0}
    assert assign([]) == {}
