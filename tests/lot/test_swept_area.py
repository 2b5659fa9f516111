"""Swept ground against brute force: nothing that a body can cover is left out, and little is added."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from tests import vehicles
from vve_sumo.lot.geofence import GROWN_CORNER
from vve_sumo.lot.swept_area import Body, as_pairs, fan, relaxing, trail

BODY = Body.of(vehicles.FUSION.vehicle)
EDGE = np.concatenate(
    [a + np.linspace(0.0, 1.0, 12) * (b - a) for a, b in zip(BODY.corners, np.roll(BODY.corners, -1), strict=True)]
)


def union(shapes: np.ndarray) -> shapely.Geometry:
    return shapely.union_all(shapely.polygons(as_pairs(shapes, 0.0, 0.0, 0.0)))


def outside(ground: shapely.Geometry, places: np.ndarray) -> float:
    """Largest distance of complex places from a ground [m]."""
    return float(shapely.distance(ground, shapely.points(places.real, places.imag)).max())


@given(st.floats(0.5, 6.0), st.floats(0.0, 3.0), st.floats(0.2, 2.0), st.floats(0.0, 100.0))
def test_no_corner_of_a_grown_body_is_farther_out_than_the_geofence_takes_it_to_be(
    front: float, rear: float, half: float, by: float
) -> None:
    corners = np.array([front + 1j * half, -rear + 1j * half, -rear - 1j * half, front - 1j * half])
    body = Body(corners, float(np.abs(corners).max()))
    assert body.grown(by).reach <= body.reach + GROWN_CORNER * by


def driven(curvature: np.ndarray, step: float) -> np.ndarray:
    """Every tenth body along a way whose curvature is given in the middle of each short step."""
    heading = np.concatenate(([0.0], np.cumsum(curvature * step)))
    places = np.concatenate(([0.0], np.cumsum(np.exp(1j * (heading[:-1] + 0.5 * curvature * step)) * step)))
    some = np.unique(np.concatenate((np.arange(0, len(places), 10), [len(places) - 1])))
    return (places[some, None] + np.exp(1j * heading[some, None]) * EDGE).ravel()


@pytest.mark.thorough
@settings(max_examples=60, deadline=None)
@given(
    speed=st.floats(0.5, 17.0),
    sideways=st.floats(-4.0, 4.0),
    deceleration=st.floats(1.5, 6.0),
    seed=st.integers(0, 2**31),
)
def test_any_steering_between_held_and_straight_stays_on_the_swept_ground(
    speed: float, sideways: float, deceleration: float, seed: int
) -> None:
    held = float(np.clip(sideways / speed**2, -0.22, 0.22))
    distance = 0.3 * speed + speed**2 / (2.0 * deceleration)
    ground = union(relaxing(BODY, min(held, 0.0), max(held, 0.0), distance))
    random = np.random.default_rng(seed)
    s = (np.arange(400) + 0.5) * distance / 400
    let_go = s < distance * np.array([[0.25], [0.4], [0.5], [0.6], [0.75], [random.uniform()]])
    histories = [
        np.full(400, held),
        np.zeros(400),
        np.full(400, held * random.uniform()),
        *np.where(let_go, held, 0.0),
        *np.where(let_go, 0.0, held),
        held * np.exp(-s / random.uniform(0.1, 20.0)),
        np.interp(s, np.linspace(0.0, distance, 6), held * random.uniform(0.0, 1.0, 6)),
    ]
    for history in histories:
        assert outside(ground, driven(history, distance / 400)) < 1e-9


@pytest.mark.thorough
@settings(max_examples=60, deadline=None)
@given(
    knots=st.lists(st.floats(-0.2, 0.2), min_size=2, max_size=32),
    spacing=st.floats(0.05, 1.5),
)
def test_the_body_stays_on_the_trail_of_any_curvature(knots: list[float], spacing: float) -> None:
    curvature = np.array(knots)
    ground = union(trail(BODY, curvature, spacing))
    fine = 100
    middles = (np.arange((len(knots) - 1) * fine) + 0.5) / fine
    # The trail's own integration is good to a part in a million of the way.
    assert outside(ground, driven(np.interp(middles, np.arange(len(knots)), curvature), spacing / fine)) < 2e-4


def test_a_straight_way_sweeps_a_rectangle_and_no_more() -> None:
    vehicle = vehicles.FUSION.vehicle
    for ground in (union(fan(BODY, 0.0, 0.0, 20.0)), union(trail(BODY, np.zeros(21), 1.0))):
        assert ground.area == pytest.approx((vehicle.length + 20.0) * vehicle.width, rel=1e-9)
        assert ground.bounds == pytest.approx(
            (-vehicle.rear_overhang, -0.926, 20.0 + vehicle.rear_axle_to_bumper, 0.926)
        )


def test_backwards_is_the_mirror_image() -> None:
    back = union(fan(BODY, -0.05, 0.05, -5.0))
    mirrored = Body(-BODY.corners, BODY.reach)
    assert (
        shapely.hausdorff_distance(
            back, shapely.affinity.scale(union(fan(mirrored, -0.05, 0.05, 5.0)), -1.0, -1.0, origin=(0, 0))
        )
        < 1e-9
    )


@pytest.mark.parametrize(("curvature", "distance"), [(0.1, 9.0), (0.02, 32.0), (0.2, 3.5)])
def test_little_is_added_to_a_circle(curvature: float, distance: float) -> None:
    ground = union(fan(BODY, curvature, curvature, distance))
    hulls = []
    for s in np.linspace(0.0, distance, 800):
        place = (np.exp(1j * curvature * s) - 1.0) / (1j * curvature)
        corners = place + np.exp(1j * curvature * s) * BODY.corners
        hulls.append(np.column_stack((corners.real, corners.imag)))
    true = shapely.union_all(shapely.polygons(np.array(hulls)))
    assert ground.buffer(1e-6).contains(true)
    assert shapely.hausdorff_distance(ground, true) < 0.15


def test_shapes_are_laid_into_the_map() -> None:
    shapes = np.array([[0.0, 2.0, 2.0 + 1.0j, 1.0j]])
    placed = as_pairs(shapes, 10.0, 20.0, math.pi / 2.0)
    assert placed == pytest.approx(np.array([[[10.0, 20.0], [10.0, 22.0], [9.0, 22.0], [9.0, 20.0]]]))
