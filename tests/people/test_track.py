"""The estimate of a person's place: against a filter in matrices, and how often its circle holds the truth."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vve_sumo.people.report_gate import Place
from vve_sumo.people.track import CIRCLE_95, EXTRAPOLATION, MIN_SPEED, WANDERING, Track

STEPS = st.lists(
    st.tuples(st.floats(0.05, 1.9), st.floats(-3.0, 3.0), st.floats(-3.0, 3.0), st.floats(0.5, 12.0)),
    min_size=1,
    max_size=15,
)
FAST = 1e9  # nobody is limited by it


def in_matrices(places: Sequence[Place], time: float) -> tuple[np.ndarray, np.ndarray]:
    """State (x, y, vx, vy) and its covariance by the textbook's matrices, predicted to a time."""
    first = places[0]
    state = np.array([first.x, first.y, 0.0, 0.0])
    sigma = (first.accuracy / CIRCLE_95) ** 2
    cov = np.diag([sigma, sigma, (0.5 * FAST) ** 2, (0.5 * FAST) ** 2])
    measured = np.eye(2, 4)

    def predict(step: float) -> None:
        nonlocal state, cov
        move = np.eye(4)
        move[0, 2] = move[1, 3] = step
        block = np.array([[step**3 / 3, step**2 / 2], [step**2 / 2, step]])
        state, cov = move @ state, move @ cov @ move.T + WANDERING["pedestrian"] * np.kron(block, np.eye(2))

    last = first.time
    for place in places[1:]:
        predict(place.time - last)
        noise = np.eye(2) * (place.accuracy / CIRCLE_95) ** 2
        gain = cov @ measured.T @ np.linalg.inv(measured @ cov @ measured.T + noise)
        state = state + gain @ (np.array([place.x, place.y]) - measured @ state)
        cov = (np.eye(4) - gain @ measured) @ cov
        last = place.time
    predict(time - last)
    return state, cov


@given(STEPS, st.floats(0.0, EXTRAPOLATION - 1e-6))
def test_it_is_the_textbooks_filter(steps: list[tuple[float, float, float, float]], later: float) -> None:
    places, time, x, y = [Place(0.0, 0.0, 0.0, 4.0)], 0.0, 0.0, 0.0
    track = Track("pedestrian", FAST, places[0])
    # A prior that says nothing of the velocity makes the arithmetic lose digits: the second position settles it.
    for step, along, across, accuracy in [(1.0, 0.0, 0.0, 4.0), *steps]:
        time, x, y = time + step, x + along, y + across
        places.append(Place(time, x, y, accuracy))
        track.update(places[-1], math.nan)
    estimate = track.at(time + later)
    state, cov = in_matrices(places, time + later)
    assert (estimate.x, estimate.y) == pytest.approx(state[:2], abs=1e-3)
    speed = math.hypot(state[2], state[3])
    assert estimate.speed == pytest.approx(speed, abs=1e-3) or (estimate.speed == 0.0 and speed < MIN_SPEED + 1e-3)
    assert estimate.radius == pytest.approx(
        max(CIRCLE_95 * math.sqrt(cov[0, 0]), places[-1].accuracy), rel=1e-3, abs=1e-3
    )


def test_the_factor_of_the_circle_is_that_of_95_percent() -> None:
    rng = np.random.default_rng(1)
    inside = np.hypot(*rng.standard_normal((2, 200_000))) <= CIRCLE_95
    assert inside.mean() == pytest.approx(0.95, abs=0.002)


def test_the_circle_is_never_smaller_than_the_newest_positions() -> None:
    track = Track("pedestrian", 3.0, Place(0.0, 0.0, 0.0, 6.0))
    for k in range(1, 300):
        track.update(Place(float(k), 0.0, 0.0, 6.0), math.nan)
    assert track.at(299.0).radius == 6.0


def test_without_positions_the_circle_grows_and_the_person_stands_after_a_while() -> None:
    track = Track("pedestrian", 3.0, Place(0.0, 0.0, 0.0, 1.0))
    for k in range(1, 30):
        track.update(Place(float(k), 1.4 * k, 0.0, 1.0), math.nan)
    ages = [0.0, 1.0, 2.0, 3.0, 5.0]
    estimates = [track.at(29.0 + age) for age in ages]
    assert [one.age for one in estimates] == ages
    radii = [one.radius for one in estimates]
    assert radii == sorted(radii)
    assert radii[-1] > radii[0] + 3.0
    assert estimates[1].x == pytest.approx(1.4 * 30, abs=0.05)
    assert estimates[2].x == pytest.approx(1.4 * 31, abs=0.1)
    assert estimates[4].x == estimates[2].x
    assert [one.speed > 0.0 for one in estimates] == [True, True, True, False, False]


def test_nobody_is_faster_than_their_kind() -> None:
    track = Track("pedestrian", 3.0, Place(0.0, 0.0, 0.0, 0.5))
    for k in range(1, 20):
        track.update(Place(float(k), 9.0 * k, 0.0, 0.5), math.nan)
        assert track.at(float(k)).speed <= 3.0 + 1e-12


def test_who_walks_faces_the_way_and_who_stands_faces_where_they_say() -> None:
    track = Track("pedestrian", 3.0, Place(0.0, 0.0, 0.0, 0.5))
    for k in range(1, 10):
        track.update(Place(float(k), 0.0, 1.4 * k, 0.5), 0.3)
    assert track.at(9.0).heading == pytest.approx(math.pi / 2, abs=1e-6)
    for k in range(10, 40):
        track.update(Place(float(k), 0.0, 12.6, 0.5), -1.0)
    assert track.at(39.0).heading == -1.0
    track.update(Place(40.0, 0.0, 12.6, 0.5), math.nan)
    assert track.at(40.0).heading == -1.0
