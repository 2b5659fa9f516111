"""The states of a person: worse at once, better only after a while, and never better than the limits say."""

from __future__ import annotations

import math
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.people.persons import LIMITS
from vve_sumo.people.presence import BETTER_SHARE, RECOVERY_TIME, Presence, PresenceMachine, classify

AGES = st.one_of(st.floats(0.0, 8.0), st.sampled_from([math.inf, math.nan, 0.0, 3.0, 5.0]))
RADII = st.one_of(st.floats(0.0, 20.0), st.sampled_from([math.inf, math.nan, 0.0, 1.0, 12.0, 20.0]))
WALKS = st.lists(st.tuples(st.floats(0.001, 0.7), AGES, RADII), max_size=60)


@pytest.mark.parametrize(
    ("age", "radius", "state"),
    [
        (0.0, 0.0, Presence.EXACT),
        (3.0, 1.0, Presence.EXACT),
        (3.0, 1.001, Presence.AREA),
        (3.0, 12.0, Presence.AREA),
        (3.001, 0.1, Presence.WARNING),
        (0.1, 12.001, Presence.WARNING),
        (5.0, 20.0, Presence.WARNING),
        (5.001, 0.1, Presence.GONE),
        (0.1, 20.001, Presence.GONE),
        (math.nan, 0.1, Presence.GONE),
        (0.1, math.nan, Presence.GONE),
        (math.inf, math.inf, Presence.GONE),
    ],
)
def test_the_limits(age: float, radius: float, state: Presence) -> None:
    assert classify(LIMITS, age, radius) is state


@given(WALKS)
def test_a_state_is_never_better_than_the_limits_say(walk: list[tuple[float, float, float]]) -> None:
    machine, now = PresenceMachine(LIMITS), 0.0
    for step, age, radius in walk:
        now += step
        assert machine.step(now, age, radius) >= classify(LIMITS, age, radius)


@given(WALKS)
def test_a_state_gets_better_only_after_all_of_a_second_was_better(walk: list[tuple[float, float, float]]) -> None:
    """By brute force: of each improvement, every sample of the time before it is looked at again."""
    machine, now = PresenceMachine(LIMITS), 0.0
    past: list[tuple[float, Presence]] = []
    state = machine.state
    for step, age, radius in walk:
        now += step
        past.append((now, classify(LIMITS, age, radius, BETTER_SHARE)))
        before, state = state, machine.step(now, age, radius)
        if state < before:
            since = max((time for time, _ in past if time <= now - RECOVERY_TIME), default=math.inf)
            window = [strict for time, strict in past if time >= since]
            assert window, "no sample is a second old"
            assert all(strict <= state for strict in window)


@given(st.sampled_from([(0.1, 0.1), (0.1, 5.0), (2.0, 5.0), (3.5, 5.0), (0.1, 13.0)]), st.floats(0.02, 0.5))
def test_what_lasts_is_reached(held: tuple[float, float], step: float) -> None:
    machine, now = PresenceMachine(LIMITS), 0.0
    while now <= 3.0 * (RECOVERY_TIME + step):
        state = machine.step(now, *held)
        now += step
    assert state is classify(LIMITS, *held)


def test_a_radius_that_swings_about_a_limit_changes_the_state_once() -> None:
    machine = PresenceMachine(LIMITS)
    states = [machine.step(0.02 * k, 0.2, 11.0 + 2.0 * math.sin(0.1 * k)) for k in range(2000)]
    changes = [(a, b) for a, b in pairwise(states) if a is not b]
    assert changes == [(Presence.GONE, Presence.WARNING)]
