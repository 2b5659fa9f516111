"""A connection's parts: the first that ends ends all; how often something may come."""

from __future__ import annotations

import asyncio
from collections import deque

import pytest
from hypothesis import given
from hypothesis import strategies as st

from vve_sumo.view import connection
from vve_sumo.view.connection import DroppedError, Rate


@pytest.mark.parametrize(("raised", "dropped"), [(None, False), (DroppedError(), True), (KeyError("gone"), False)])
def test_the_first_part_that_ends_ends_the_others(raised: Exception | None, dropped: bool) -> None:
    ended: list[str] = []

    async def stays() -> None:
        try:
            await asyncio.sleep(60.0)
        finally:
            ended.append("stays")

    async def leaves() -> None:
        await asyncio.sleep(0.0)
        ended.append("leaves")
        if raised is not None:
            raise raised

    assert asyncio.run(connection.run(stays(), leaves())) is dropped
    assert ended == ["leaves", "stays"]


def test_who_takes_nothing_is_dropped(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(connection, "ANSWER_TIMEOUT", 0.01)
    with pytest.raises(DroppedError):
        asyncio.run(connection.send(asyncio.sleep(60.0)))


@given(st.lists(st.floats(0.0, 0.5), min_size=1, max_size=200), st.integers(1, 20))
def test_the_rate_lets_through_what_is_allowed_and_never_twice_as_much(gaps: list[float], most: int) -> None:
    rate, time, taken = Rate(most), 0.0, deque[float]()
    for gap in gaps:
        time += gap
        while taken and taken[0] <= time - 1.0:
            taken.popleft()
        exceeded = rate.exceeded(time)
        if len(taken) < most:  # in any second that ends here
            assert not exceeded
        if exceeded:
            return
        taken.append(time)
        assert len(taken) <= 2 * most
