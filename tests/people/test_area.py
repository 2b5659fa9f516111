"""The circle that is shown: it holds the estimated one, and moves no faster than a person."""

from __future__ import annotations

import math

from hypothesis import given
from hypothesis import strategies as st

from vve_sumo.people.area import SHRINK_RATE, ShownArea
from vve_sumo.people.track import Estimate

ESTIMATES = st.tuples(st.floats(0.001, 2.0), st.floats(-50.0, 50.0), st.floats(-50.0, 50.0), st.floats(0.0, 20.0))


@given(st.lists(ESTIMATES, min_size=1, max_size=40))
def test_it_holds_the_estimate_and_never_jumps(steps: list[tuple[float, float, float, float]]) -> None:
    area, now, before = ShownArea(3.0), 0.0, None
    for step, x, y, radius in steps:
        now += step
        shown = area.step(now, Estimate(x, y, 1.0, x, radius, 0.0))
        assert math.hypot(shown.x - x, shown.y - y) + radius <= shown.radius + 1e-9
        if before is not None:
            assert math.hypot(shown.x - before.x, shown.y - before.y) <= 3.0 * step + 1e-9
            assert shown.radius >= before.radius - SHRINK_RATE * step - 1e-9
        before = shown


def test_it_comes_to_the_estimate_that_stays() -> None:
    area = ShownArea(3.0)
    area.step(0.0, Estimate(10.0, 0.0, 0.0, 0.0, 8.0, 0.0))
    shown = [area.step(0.02 * k, Estimate(0.0, 0.0, 0.0, 0.0, 4.0, 0.0)) for k in range(1, 4000)][-1]
    assert shown == (0.0, 0.0, 4.0)


def test_somebody_who_was_forgotten_begins_anew() -> None:
    area = ShownArea(3.0)
    area.step(0.0, Estimate(0.0, 0.0, 0.0, 0.0, 4.0, 0.0))
    area.forget()
    assert area.step(0.02, Estimate(500.0, 0.0, 0.0, 0.5, 2.0, 0.0)) == (500.0, 0.0, 2.0)
