"""Two real cars on one street need two lots: where their grounds come near each other, nothing begins."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pyproj import Geod

from tests.rig.test_load import real
from vve_sumo.rig.load import parse
from vve_sumo.rig.resolve import distance_between_lots
from vve_sumo.rig.schema import Rig
from vve_sumo.rig.validation import common_ground

GEOD = Geod(ellps="WGS84")
CORNER = (40.004, -83.02)
WIDE, DEEP = 150.0, 80.0  #: of every lot, to the east and to the north [m]


def walked(corner: tuple[float, float], *legs: tuple[float, float]) -> tuple[float, float]:
    """The place that geodesics (azimuth [deg], length [m]) lead to."""
    latitude, longitude = corner
    for azimuth, length in legs:
        longitude, latitude, _back = GEOD.fwd(longitude, latitude, azimuth, length)
    return latitude, longitude


def lot(east: float, north: float, wide: float = WIDE, deep: float = DEEP) -> list[list[float]]:
    corner = walked(CORNER, (90.0, east), (0.0, north))
    across = walked(corner, (90.0, wide))
    return [list(one) for one in (corner, across, walked(across, (0.0, deep)), walked(corner, (0.0, deep)))]


def rig(outline: list[list[float]]) -> Rig:
    table = real()
    table["lot"] = table["lot"] | {"outline": outline}
    table["lot"].pop("holes", None)
    for key in ("alignment", "alignments", "car_start"):
        table.pop(key, None)
    return parse(table, Path("mine.toml"))


@pytest.mark.parametrize(
    ("east", "north", "apart"),
    [(WIDE + 12.0, 0.0, 12.0), (WIDE + 8.0, 5.0, 8.0), (0.0, DEEP + 11.0, 11.0), (60.0, 30.0, 0.0), (0.0, 0.0, 0.0)],
)
def test_two_real_cars_need_lots_that_are_apart(east: float, north: float, apart: float) -> None:
    first, second = rig(lot(0.0, 0.0)), rig(lot(east, north))
    assert distance_between_lots(first, second) == pytest.approx(apart, abs=0.01)
    reason = common_ground({Path("a.toml"): first, Path("b.toml"): second})
    if apart >= 10.0:
        assert reason is None
    else:
        assert reason is not None
        assert reason.startswith(f"b.toml: lot.outline: it comes within {apart:.1f} m of that of a.toml, expected 10 m")
        assert "\n" not in reason


def test_lots_that_cross_without_a_corner_in_each_other_overlap() -> None:
    lying, standing = rig(lot(0.0, 0.0, 200.0, 40.0)), rig(lot(80.0, -80.0, 40.0, 200.0))
    assert distance_between_lots(lying, standing) == 0.0


@settings(max_examples=40, deadline=None)
@given(st.floats(-400.0, 400.0), st.floats(-300.0, 300.0))
def test_the_distance_is_that_of_rectangles_and_the_same_from_either(east: float, north: float) -> None:
    first, second = rig(lot(0.0, 0.0)), rig(lot(east, north))
    aside, ahead = max(abs(east) - WIDE, 0.0), max(abs(north) - DEEP, 0.0)
    assert distance_between_lots(first, second) == pytest.approx((aside**2 + ahead**2) ** 0.5, abs=0.05)
    assert distance_between_lots(second, first) == pytest.approx(distance_between_lots(first, second), abs=0.01)


def test_a_simulated_car_is_in_no_lot_and_every_pair_counts() -> None:
    here, far = rig(lot(0.0, 0.0)), rig(lot(900.0, 0.0))
    simulated = here.model_copy(update={"car": "simulated"})
    assert common_ground({Path("a.toml"): here, Path("b.toml"): simulated}) is None
    three = {Path("a.toml"): here, Path("b.toml"): far, Path("c.toml"): rig(lot(905.0, 0.0))}
    assert (common_ground(three) or "").startswith("c.toml: lot.outline: it comes within 0.0 m of that of b.toml")
