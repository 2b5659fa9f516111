"""The toy's tests; pytest collects them only where they are named."""

from __future__ import annotations

import math

import pytest

from tests.mutation.toy import LIMIT, level


def test_levels():
    assert (level(1.0, 2.0), level(3.0, 2.0), level(2.0, 2.0)) == (1.0, 2.0, 2.0)


def test_what_is_not_a_number_is_the_bound():
    assert level(math.nan, 2.0) == 2.0


@pytest.mark.parametrize("bound", [LIMIT])
def test_the_limit_is_two(bound: float) -> None:
    """Its own name holds the constant."""
    assert bound == 2.0
