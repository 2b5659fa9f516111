"""What is between two antennas, against shapely; and the power that comes, against the tables' arithmetic."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from shapely.geometry import LineString, Polygon

from tests.sensors.scenes import Row, actors, car
from vve_sumo.geometry import Box
from vve_sumo.sensors.radio import Antenna, Fading, Obstacles, Obstruction, antenna_of, received_power
from vve_sumo.sensors.street import Building, walls_of
from vve_sumo.v2x.propagation import Sight

EGO = Antenna(0.0, 0.0, 1.5)
NO_WALLS = walls_of(())

place = st.integers(-8000, 8000).map(lambda centimetres: centimetres / 100.0)
body = st.builds(
    lambda x, y, heading, length, width: (x, y, heading, 0.0, length, width, 10.0),
    place,
    place,
    st.floats(-math.pi, math.pi),
    st.floats(0.4, 15.0),
    st.floats(0.4, 3.0),
)


def _polygon(row: Row) -> Polygon:
    box = Box(row[0], row[1], row[2], row[4], row[5])
    return Polygon(box.corners())


#: on either side of an outline by so much, either answer is right [m]
GRAZES = 1e-6


def _crosses(line: LineString, outline: Polygon) -> bool:
    """Whether a line meets an outline; what only grazes it is left out."""
    grown, shrunk = outline.buffer(GRAZES).exterior, outline.buffer(-GRAZES).exterior
    assume(line.intersects(grown) == line.intersects(shrunk))
    return bool(line.intersects(grown))


@given(st.lists(body, min_size=1, max_size=12))
def test_bodies_between_are_those_that_the_line_crosses(rows: list[Row]) -> None:
    scene = actors(rows, [f"a{n}" for n in range(len(rows))])
    for row in range(len(rows)):
        sender = antenna_of(scene, row)
        line = LineString([(EGO.x, EGO.y), (sender.x, sender.y)])
        others = [_polygon(other) for n, other in enumerate(rows) if n != row]
        hidden = [_crosses(line, one) or one.contains(line) for one in others]
        found = Obstacles(scene, NO_WALLS).between(EGO, sender, row)
        assert found.sight is (Sight.BODY if any(hidden) else Sight.CLEAR)


@given(place, place, st.lists(st.tuples(place, place), min_size=3, max_size=3, unique=True))
def test_buildings_between_are_those_that_the_line_crosses(
    x: float, y: float, corners: list[tuple[float, float]]
) -> None:
    outline, line = Polygon(corners), LineString([(0.0, 0.0), (x, y)])
    assume(outline.area > 1.0 and outline.buffer(-0.1).area > 0.5)
    scene = actors([(x, y, 0.0, 0.0, 0.5, 0.5, 1.0)], ["child"], kind="child")
    found = Obstacles(scene, walls_of([Building(tuple(corners), 6.0)])).between(EGO, antenna_of(scene, 0), 0)
    assert found.sight is (Sight.BUILDING if _crosses(line, outline) else Sight.CLEAR)


def test_a_body_hides_by_its_height_and_the_highest_counts() -> None:
    rows = [car(40.0, 0.0), car(20.0, 0.0), car(30.0, 0.0)]
    scene = actors(rows, ["sender", "low", "high"])
    scene.height.setflags(write=True)
    scene.height[:] = (1.5, 1.4, 3.5)
    found = Obstacles(scene, NO_WALLS).between(EGO, antenna_of(scene, 0), 0)
    assert found == Obstruction(Sight.BODY, 3.5)
    scene.height[2] = 1.4
    assert Obstacles(scene, NO_WALLS).between(EGO, antenna_of(scene, 0), 0).sight is Sight.CLEAR


def test_a_person_carries_the_radio_low_and_a_car_hides_it() -> None:
    scene = actors([(20.0, 0.0, 0.0, 0.0, 0.5, 0.5, 1.0), car(10.0, 0.0)], ["child", "parked"], kind="child")
    assert antenna_of(scene, 0).z == pytest.approx(0.72)
    assert Obstacles(scene, NO_WALLS).between(EGO, antenna_of(scene, 0), 0).sight is Sight.BODY


def test_what_is_not_finite_hides_nothing_and_raises_nothing() -> None:
    scene = actors([car(40.0, 0.0), car(math.nan, 0.0), car(20.0, 30.0, math.inf)], ["sender", "nan", "inf"])
    assert Obstacles(scene, NO_WALLS).between(EGO, antenna_of(scene, 0), 0).sight is Sight.CLEAR


def test_power_falls_as_the_tables_say_and_shadowing_has_its_sigma() -> None:
    sender, clear = Antenna(100.0, 0.0, 1.5), Obstruction(Sight.CLEAR)
    powers = [received_power(23.0, EGO, sender, clear, Fading(np.random.default_rng(seed))) for seed in range(4000)]
    assert np.mean(powers) == pytest.approx(23.0 - 86.2, abs=0.2)
    assert np.std(powers) == pytest.approx(3.0, abs=0.15)


def test_shadowing_holds_on_over_the_way_of_the_antennas() -> None:
    """Correlated by exp(-way / 10 m), whatever the time between."""
    for way in (0.0, 5.0, 10.0, 40.0):
        pairs = []
        for seed in range(3000):
            fading = Fading(np.random.default_rng(seed))
            pairs.append((fading.at(0.0, 0.0, behind=False)[0], fading.at(way, 0.0, behind=False)[0]))
        assert np.corrcoef(np.array(pairs).T)[0, 1] == pytest.approx(math.exp(-way / 10.0), abs=0.06)


def test_a_body_in_between_costs_the_same_while_it_stays() -> None:
    fading = Fading(np.random.default_rng(1))
    first = fading.at(0.0, 0.0, behind=True)[1]
    assert fading.at(1.0, 0.0, behind=True)[1] == first
    fading.at(2.0, 0.0, behind=False)
    assert fading.at(3.0, 0.0, behind=True)[1] != first
