"""What another vehicle perceives: against lines of sight that another library draws, and in closed form."""

from __future__ import annotations

import math
from dataclasses import fields, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely.affinity import rotate, translate
from shapely.geometry import LineString, Polygon, box

from tests.sensors.scenes import BUMPER, FUSION, actors, car, rear_axle
from vve_sumo.sensors.perception import Perceiver, Sector, Surroundings
from vve_sumo.sensors.street import Building, walls_of
from vve_sumo.values import Actors

FAR_AWAY = rear_axle(5000.0, 5000.0)
NO_WALLS = walls_of(())
ALL_ROUND = Sector(range=100.0, view=math.tau)


def both(one: Actors, other: Actors) -> Actors:
    columns = {
        field.name: np.concatenate([getattr(one, field.name), getattr(other, field.name)])
        for field in fields(Actors)
        if field.name not in ("time", "ids")
    }
    return Actors(0.0, one.ids + other.ids, **columns)


def child(x: float, y: float) -> Actors:
    return actors([(x, y, 0.0, 1.4, 0.5, 0.35, 1.0)], ["child"], kind="child")


def seen(scene: Actors, sector: Sector = ALL_ROUND, own: int = 0, walls: object = NO_WALLS) -> set[str]:
    rows = Surroundings(scene, FAR_AWAY, FUSION, walls).visible_rows(sector, own)  # type: ignore[arg-type]
    return {scene.ids[row] for row in rows}


def outline(scene: Actors, row: int) -> Polygon:
    half_length, half_width = 0.5 * float(scene.length[row]), 0.5 * float(scene.width[row])
    flat = rotate(box(-half_length, -half_width, half_length, half_width), scene.heading[row], (0, 0), use_radians=True)
    return translate(flat, scene.x[row], scene.y[row])


@settings(max_examples=150)
@given(
    st.lists(st.tuples(st.floats(-60.0, 60.0), st.floats(-60.0, 60.0), st.floats(-4.0, 4.0)), min_size=2, max_size=14),
    st.lists(st.tuples(st.floats(-50.0, 50.0), st.floats(-50.0, 50.0)), max_size=3),
)
def test_who_is_seen_is_who_no_car_and_no_wall_hides(
    rows: list[tuple[float, float, float]], blocks: list[tuple[float, float]]
) -> None:
    """By shapely; what touches an edge within a millimetre may be either."""
    scene = actors([car(x, y, heading) for x, y, heading in rows])
    buildings = [Building(((x, y), (x + 9.0, y), (x + 9.0, y + 7.0), (x, y + 7.0)), 6.0) for x, y in blocks]
    found = seen(scene, walls=walls_of(buildings))
    heading = rows[0][2]
    eye = (rows[0][0] + 2.25 * math.cos(heading), rows[0][1] + 2.25 * math.sin(heading))
    for row in range(1, len(rows)):
        line = LineString([eye, rows[row][:2]])
        hiding = [outline(scene, other) for other in range(1, len(rows)) if other != row]
        edges = [Polygon(building.outline).exterior for building in buildings]
        surely = any(line.intersection(one).length > 1e-3 for one in hiding) or any(
            line.crosses(edge.buffer(-1e-3)) or line.intersects(edge) for edge in edges
        )
        perhaps = any(line.distance(one) < 1e-3 for one in [*hiding, *edges]) or abs(line.length - 100.0) < 1e-3
        name = scene.ids[row]
        if surely or line.length > 100.0:
            assert name not in found or perhaps
        else:
            assert name in found or perhaps


@pytest.mark.parametrize(
    ("x", "y", "there"),
    [
        (2.25 + 79.9, 0.0, True),
        (2.25 + 80.1, 0.0, False),
        (2.25 + 20.0 * math.cos(math.radians(59.5)), 20.0 * math.sin(math.radians(59.5)), True),
        (2.25 + 20.0 * math.cos(math.radians(60.5)), 20.0 * math.sin(math.radians(60.5)), False),
        (2.25 + 20.0 * math.cos(math.radians(60.5)), -20.0 * math.sin(math.radians(60.5)), False),
        (-30.0, 0.0, False),
    ],
)
def test_the_sector_is_80_m_and_120_degrees_from_the_middle_of_the_front(x: float, y: float, there: bool) -> None:
    scene = both(actors([car(0.0, 0.0)], ["own"]), child(x, y))
    assert (seen(scene, Sector()) == {"child"}) == there


def test_a_low_body_hides_nobody_and_a_high_one_does() -> None:
    """A child of 1.2 m, whom the other looks at from 1.2 m, behind a body of each height."""
    for height, there in ((1.1, True), (1.2, False), (1.5, False)):
        between = replace(actors([car(20.0, 0.0)], ["between"]), height=np.array([height]))
        scene = both(both(actors([car(0.0, 0.0)], ["own"]), between), child(40.0, 0.0))
        assert ("child" in seen(scene)) == there


def test_the_ego_hides_whom_it_stands_before() -> None:
    scene = both(actors([car(0.0, 0.0)], ["own"]), child(40.0, 0.0))
    standing = rear_axle(20.0, 0.0)
    assert Surroundings(scene, standing, FUSION, NO_WALLS).visible_rows(ALL_ROUND, 0) == []
    beside = rear_axle(20.0, 3.0)
    assert Surroundings(scene, beside, FUSION, NO_WALLS).visible_rows(ALL_ROUND, 0) == [1]
    # It reaches from its rear overhang to its front bumper.
    behind = rear_axle(40.3 + FUSION.rear_overhang, 0.0)
    assert Surroundings(scene, behind, FUSION, NO_WALLS).visible_rows(ALL_ROUND, 0) == [1]
    before = rear_axle(39.7 - BUMPER, 0.0)
    assert Surroundings(scene, before, FUSION, NO_WALLS).visible_rows(ALL_ROUND, 0) == []


def test_a_place_errs_by_its_sigma_and_a_number_stays() -> None:
    perceiver = Perceiver(Sector(sigma=0.5), np.random.default_rng(3))
    places, numbers = [], set()
    for check in range(400):
        scene = both(actors([car(0.0, 0.0)], ["own"]), child(30.0, 2.0))
        bodies, total = perceiver.due(500_000 * check, Surroundings(scene, FAR_AWAY, FUSION, NO_WALLS), 0)
        for body in bodies:
            places.append((body.off_x, body.off_y))
            numbers.add(body.number)
        assert total == 1
    assert len(places) == 400  # a person is told of twice a second
    assert np.mean(places, axis=0) == pytest.approx([27.75, 2.0], abs=0.1)
    assert np.std(places, axis=0) == pytest.approx([0.5, 0.5], rel=0.15)
    assert len(numbers) == 1


def test_of_very_many_the_nearest_are_told_of() -> None:
    """Around the vehicle, each one half a metre farther away than the one before."""
    circle = [(40.0 + 0.5 * n, math.radians(12.0 * (7 * n % 30))) for n in range(30)]
    rows = [car(0.0, 0.0), *(car(2.25 + far * math.cos(at), far * math.sin(at), at) for far, at in circle)]
    perceiver = Perceiver(ALL_ROUND, np.random.default_rng(3))
    bodies, total = perceiver.due(0, Surroundings(actors(rows), FAR_AWAY, FUSION, NO_WALLS), 0)
    assert [body.row for body in bodies] == list(range(1, 17))
    assert total == 30
