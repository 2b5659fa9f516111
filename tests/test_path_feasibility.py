"""Bends and reversals that no car can follow, against closed forms, and never in a path that a car can follow."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vve_sumo.errors import ConfigError
from vve_sumo.path import ReferencePath
from vve_sumo.path_feasibility import MAX_DEPARTURE, find_reversal, find_tight_bend, refuse_tight_bend

CIRCLE = 5.0  #: radius of the car's tightest circle [m]


def arc(radius: float, turn: float, spacing: float = 0.25) -> np.ndarray:
    """Points on an arc from the origin along +x; `turn` left positive [rad]."""
    angle = np.linspace(0.0, abs(turn), max(round(radius * abs(turn) / spacing), 4) + 1)
    x, y = radius * np.sin(angle), radius * (1.0 - np.cos(angle))
    return np.stack([x, math.copysign(1.0, turn) * y], axis=1)


def corner(turn: float, spacing: float = 0.5, length: float = 20.0) -> np.ndarray:
    """Points of a straight line that turns at one point."""
    along = spacing * np.arange(1, round(length / spacing) + 1)
    before = np.stack([-along[::-1], 0.0 * along], axis=1)
    after = np.stack([along * math.cos(turn), along * math.sin(turn)], axis=1)
    return np.vstack([before, [[0.0, 0.0]], after])


def laid(points: np.ndarray) -> ReferencePath:
    return ReferencePath.from_points(points[:, 0], points[:, 1])


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize(("radius", "turn"), [(3.0, 2.0), (4.0, math.pi), (2.0, 2.0)])
def test_the_departure_in_an_arc_is_that_of_its_closed_form(radius: float, turn: float, side: float) -> None:
    bend = find_tight_bend(laid(arc(radius, side * turn)), 1.0 / CIRCLE)
    assert bend is not None
    excess = 1.0 / radius - 1.0 / CIRCLE
    assert bend.departure == pytest.approx((1.0 - math.cos(excess * radius * turn)) / excess, rel=0.05)
    assert bend.radius == pytest.approx(radius, rel=0.05)
    assert bend.s == pytest.approx(0.0, abs=0.5)


def test_a_corner_is_refused_with_its_place_and_the_circle() -> None:
    path = laid(corner(0.5 * math.pi))
    bend = find_tight_bend(path, 1.0 / CIRCLE)
    assert bend is not None
    assert 19.0 < bend.s < 20.0
    assert bend.radius == pytest.approx(0.18, abs=0.02)
    # Who leaves the way at the corner and turns through a right angle comes out a radius beside it.
    assert bend.departure == pytest.approx(CIRCLE, rel=0.1)
    with pytest.raises(ConfigError, match=r"^mine\.csv: at 19\.\d m along the path, \(-0\.\d, -?0\.0\) m .* 5\.00 m: "):
        refuse_tight_bend(path, 1.0 / CIRCLE, "mine.csv")


@pytest.mark.parametrize("turn", [0.2, 0.4])
def test_a_kink_that_the_car_cuts_closely_is_none(turn: float) -> None:
    assert CIRCLE * (1.0 / math.cos(0.5 * turn) - 1.0) < 0.2  # the least that a car is off such a corner [m]
    refuse_tight_bend(laid(corner(turn)), 1.0 / CIRCLE, "mine.csv")


@settings(deadline=None)
@given(
    st.lists(st.tuples(st.floats(-1.0, 1.0), st.floats(1.0, 30.0)), min_size=1, max_size=6),
    st.floats(-math.pi, math.pi),
)
def test_what_the_car_has_driven_is_never_refused(steps: list[tuple[float, float]], heading: float) -> None:
    """A car drives with any steering at any time, laid as points that it passed every half metre."""
    x, y, points = 0.0, 0.0, [(0.0, 0.0)]
    for bend, length in steps:
        for _ in range(round(length / 0.01)):
            x, y, heading = x + 0.01 * math.cos(heading), y + 0.01 * math.sin(heading), heading + 0.01 * bend / CIRCLE
            points.append((x, y))
    kept = np.array(points[::50])
    refuse_tight_bend(laid(kept), 1.0 / CIRCLE, "driven")
    assert find_reversal(kept) is None


@settings(deadline=None)
@given(st.floats(0.1, 3.0), st.floats(-math.pi, math.pi), st.floats(-1e4, 1e4))
def test_where_a_path_lies_changes_nothing(turn: float, rotation: float, shift: float) -> None:
    plain = corner(turn)
    c, s = math.cos(rotation), math.sin(rotation)
    moved = plain @ np.array([[c, s], [-s, c]]) + shift
    mirrored = plain * (1.0, -1.0)
    bends = [find_tight_bend(laid(points), 1.0 / CIRCLE) for points in (plain, moved, mirrored)]
    departures = [0.0 if bend is None else bend.departure for bend in bends]
    clear = abs(max(departures) - MAX_DEPARTURE) > 0.01
    assert not clear or departures == pytest.approx([departures[0]] * 3, abs=1e-3)


@pytest.mark.parametrize("count", [3, 10, 40])
def test_points_that_go_back_are_found(count: int) -> None:
    there = np.stack([np.arange(count, dtype=float), np.zeros(count)], axis=1)
    assert find_reversal(there) is None
    assert find_reversal(np.vstack([there, there[-2::-1]])) == count - 1
    aside = there[-2::-1] + np.array([0.0, 0.4])
    assert find_reversal(np.vstack([there, aside])) == count - 1


def test_two_points_turn_nowhere() -> None:
    straight = np.array([[0.0, 0.0], [200.0, 3.0]])
    assert find_reversal(straight) is None
    assert find_tight_bend(laid(straight), 1.0 / CIRCLE) is None
