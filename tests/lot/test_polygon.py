"""The lot: what lies inside, against distances by hand; and outlines that are none."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vve_sumo.errors import ConfigError
from vve_sumo.lot.polygon import Lot

SQUARE = [(0.0, 0.0), (40.0, 0.0), (40.0, 40.0), (0.0, 40.0)]
POLE = [(20.0, 20.0), (21.0, 20.0), (21.0, 21.0), (20.0, 21.0)]


def box(x: float, y: float, half: float = 0.5) -> np.ndarray:
    return np.array([[[x - half, y - half], [x + half, y - half], [x + half, y + half], [x - half, y + half]]])


@pytest.mark.parametrize("corners", [SQUARE, SQUARE[::-1]], ids=["left_round", "right_round"])
def test_a_box_is_held_up_to_the_margin(corners: list[tuple[float, float]]) -> None:
    lot = Lot(corners, [POLE], margin=2.0)
    assert lot.holds(box(2.505, 10.0))
    assert not lot.holds(box(2.495, 10.0))
    assert not lot.holds(box(20.5, 17.505))
    assert lot.holds(box(20.5, 17.495))


@given(x=st.floats(-5.0, 45.0), y=st.floats(-5.0, 45.0), radius=st.floats(0.01, 15.0))
def test_discs_agree_with_distances_by_hand(x: float, y: float, radius: float) -> None:
    def to_pole(corner: float) -> float:
        return max(corner - 21.0, 20.0 - corner, 0.0)

    room = min(x, y, 40.0 - x, 40.0 - y, math.hypot(to_pole(x), to_pole(y))) - 1.0
    held = Lot(SQUARE, [POLE], margin=1.0).holds_disc(x, y, radius)
    # Round corners of the margin are chords, by up to two millimetres on the safe side.
    if held:
        assert room >= radius - 1e-9
    elif room > 0.0:
        assert room <= radius + 2e-3


WALKS = st.lists(st.tuples(st.floats(-6.0, 6.0), st.floats(-6.0, 6.0), st.floats(0.0, 8.0)), min_size=2, max_size=12)


@settings(deadline=None)
@given(begin=st.tuples(st.floats(1.0, 39.0), st.floats(1.0, 39.0)), walk=WALKS)
def test_a_lot_answers_for_each_disc_as_one_that_was_asked_for_no_other(
    begin: tuple[float, float], walk: list[tuple[float, float, float]]
) -> None:
    (x, y), lot = begin, Lot(SQUARE, [POLE], margin=1.0)
    for dx, dy, radius in [(0.0, 0.0, 0.0), *walk]:
        x, y = x + dx, y + dy
        assert lot.holds_disc(x, y, radius) == Lot(SQUARE, [POLE], margin=1.0).holds_disc(x, y, radius)


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_what_is_not_finite_lies_nowhere(bad: float) -> None:
    lot = Lot(SQUARE)
    assert lot.holds_disc(10.0, 10.0, 1.0)
    assert not lot.holds(np.concatenate((box(10.0, 10.0), box(bad, 10.0))))
    assert not lot.holds_disc(bad, 10.0, 1.0)
    assert not any(lot.holds_disc(10.0, 10.0, radius) for radius in (bad, -bad, -1.0))
    assert lot.clearance(box(bad, 10.0)) == -math.inf


def test_clearance_is_the_distance_to_the_nearest_edge() -> None:
    lot = Lot(SQUARE, [POLE], margin=1.0)
    assert lot.clearance(box(5.0, 12.0)) == pytest.approx(3.5, abs=2e-3)
    assert lot.clearance(box(41.0, 12.0)) == -math.inf


def test_the_table_agrees_with_the_geometry_to_a_cell() -> None:
    lot = Lot(SQUARE, [POLE], margin=1.0)
    table = lot.raster(200)
    places = np.random.default_rng(1).uniform(-5.0, 45.0, (400, 2))
    exact = []
    for x, y in places:
        inside = min(x, y, 40.0 - x, 40.0 - y)
        if inside >= 0.0:
            beside = math.hypot(max(x - 21.0, 20.0 - x, 0.0), max(y - 21.0, 20.0 - y, 0.0))
            depth_in_pole = min(x - 20.0, 21.0 - x, y - 20.0, 21.0 - y)
            exact.append(min(inside, beside if beside > 0.0 else -depth_in_pole) - 1.0)
        else:
            exact.append(math.nan)
    seen = table.at(places[:, 0], places[:, 1])
    held = np.isfinite(exact)
    assert np.abs(seen[held] - np.array(exact)[held]).max() < 1.5 * table.cell
    assert (seen[~held] < -0.9).all()


@pytest.mark.parametrize(
    ("outline", "holes", "margin", "words"),
    [
        (SQUARE[:2], [], 1.0, r"outline: expected three corners"),
        ([(0, 0), (40, 40), (40, 0), (0, 40)], [], 1.0, r"outline: crosses .*after corner 0 .*after corner 2"),
        ([(0, 0), (40, 0), (20, 0), (20, 40)], [], 1.0, r"outline: crosses"),
        ([(0, 0), (40, 0), (80, 0)], [], 1.0, r"outline: "),
        ([(0, 0), (math.nan, 0), (40, 40)], [], 1.0, r"outline: a corner is not finite"),
        ([(0, 0), (10, 0), (10, 10), (0, 10)], [], 1.0, r"outline: encloses 100\.0 m2"),
        ([(0, 0), (1e5, 0), (1e5, 1e5)], [], 1.0, r"outline: encloses"),
        (SQUARE, [[(50, 50), (51, 50), (51, 51)]], 1.0, r"holes\[0\]: does not lie inside"),
        (SQUARE, [POLE, [(39, 5), (41, 5), (41, 6)]], 1.0, r"holes\[1\]: does not lie inside"),
        (SQUARE, [], 21.0, r"margin: 21 m leaves nothing"),
        (SQUARE, [], math.nan, r"margin: "),
    ],
)
def test_outlines_that_are_none_are_refused(outline: list, holes: list, margin: float, words: str) -> None:
    with pytest.raises(ConfigError, match=words) as caught:
        Lot(outline, holes, margin)
    assert "\n" not in str(caught.value)


def test_holes_may_overlap() -> None:
    lot = Lot(SQUARE, [POLE, [(20.5, 20.5), (25.0, 20.5), (25.0, 25.0)]])
    assert not lot.holds(box(24.0, 21.5))
