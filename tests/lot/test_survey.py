"""A walk along a known lot gives that lot back, and a walk that bounds none is refused."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely.geometry import Point, Polygon

from vve_sumo.errors import ConfigError
from vve_sumo.lot.survey import CUT_REACH, MIN_TOLERANCE, survey

YARD = [(0.0, 0.0), (150.0, 0.0), (150.0, 80.0), (0.0, 80.0)]
ELL = [(0.0, 0.0), (100.0, 0.0), (100.0, 40.0), (60.0, 40.0), (60.0, 90.0), (0.0, 90.0)]


def walk(corners: list[tuple[float, float]], begin: float = 0.0, step: float = 0.4, closed: bool = True) -> np.ndarray:
    """Places every `step` along a closed line, from `begin` on and once around [m]."""
    line = np.array([*corners, corners[0]])
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))])
    whole = along[-1] if closed else 0.7 * along[-1]
    s = (begin + np.arange(0.0, whole, step)) % along[-1]
    return np.stack([np.interp(s, along, line[:, axis]) for axis in (0, 1)], axis=1)


def found(places: np.ndarray, sigma: float = 0.02):
    return survey(places[:, 0], places[:, 1], np.full(len(places), sigma))


def farthest(corners: np.ndarray, true: list[tuple[float, float]]) -> float:
    """Greatest distance from a true corner to the nearest one that was found."""
    return max(min(math.dist(corner, one) for one in corners.tolist()) for corner in true)


@settings(max_examples=15, deadline=None)
@given(
    corners=st.sampled_from([YARD, ELL]),
    begin=st.floats(0.0, 300.0),
    turn=st.floats(0.0, 6.28),
    seed=st.integers(0, 1000),
)
def test_a_walk_gives_the_lot_back(corners: list[tuple[float, float]], begin: float, turn: float, seed: int) -> None:
    rotation = np.array([[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]])
    noise = np.random.default_rng(seed).normal(0.0, 0.02, (4000, 2))
    places = walk(corners, begin)
    outline = found(places @ rotation.T + noise[: len(places)])
    true = [(float(x), float(y)) for x, y in np.array(corners) @ rotation.T]
    # Where the walk begins within some metres of a corner, that corner may be cut, and a short side be one more.
    assert farthest(outline.corners, true) < CUT_REACH + 3.0 * MIN_TOLERANCE
    assert outline.radius == pytest.approx(0.049, abs=0.001)
    assert outline.margin >= 1.0 + outline.radius + outline.beyond
    assert outline.beyond < 2.0 * MIN_TOLERANCE
    # What the margin is for: nothing of the outline less it lies nearer to the lot's true edge than a car's margin.
    lot = Polygon(true)
    assert max(lot.distance(Point(corner)) for corner in outline.corners.tolist()) <= outline.margin - 1.0


@pytest.mark.parametrize("corners", [YARD, ELL])
def test_corners_are_those_of_sides_that_average_a_hundred_places(corners: list[tuple[float, float]]) -> None:
    noise = np.random.default_rng(1).normal(0.0, 0.02, (4000, 2))
    places = walk(corners, 20.0)
    outline = found(places + noise[: len(places)])
    assert len(outline.corners) == len(corners)
    assert farthest(outline.corners, corners) < 0.03
    assert outline.rms == pytest.approx(0.02, rel=0.15)


def test_places_taken_standing_and_an_overlap_change_nothing() -> None:
    once = walk(YARD, 20.0)
    long = np.vstack([np.repeat(once[:1], 50, axis=0), once, once[:10]])
    assert farthest(found(long).corners, YARD) < 1e-6
    assert found(long).overlap < 0.4


def test_a_corner_that_was_walked_round_is_in_the_margin() -> None:
    """A quarter circle of radius 3 m lies 3 (sqrt 2 - 1) m inside its corner."""
    arc = [(147.0 + 3.0 * math.sin(a), 3.0 - 3.0 * math.cos(a)) for a in np.linspace(0.0, 0.5 * math.pi, 12)]
    outline = found(walk([(0.0, 0.0), *arc, (150.0, 80.0), (0.0, 80.0)]))
    assert outline.beyond < 0.2
    assert outline.area < 150.0 * 80.0


@pytest.mark.parametrize(
    ("places", "words"),
    [
        (walk(YARD, closed=False), "the outline is open: after .* m its end is .* m from its begin"),
        (walk([YARD[0], YARD[2], YARD[1], YARD[3]]), "crosses or touches itself"),
        (np.delete(walk(YARD), slice(100, 120), axis=0), "m without a place after"),
        (walk([(0.0, 0.0), (5.0, 0.0), (5.0, 5.0), (0.0, 5.0)]), "encloses"),
        (np.zeros((100, 2)), "expected a line along the lot's edge"),
        (np.zeros((0, 2)), "standard deviation of nan"),
    ],
    ids=["open", "crossing", "gap", "small", "standing", "none"],
)
def test_what_bounds_no_lot_is_refused(places: np.ndarray, words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        found(places)


def test_places_that_are_not_accurate_are_refused() -> None:
    with pytest.raises(ConfigError, match=r"standard deviation of 0\.80 m"):
        found(walk(YARD), 0.8)
