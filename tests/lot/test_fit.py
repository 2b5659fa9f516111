"""Laying a path into a lot: known best places, brute force, and paths that must be cut."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely

from tests import vehicles
from vve_sumo.errors import ConfigError
from vve_sumo.frames import Alignment
from vve_sumo.lot.fit import Fit, fit, shortened
from vve_sumo.lot.geofence import Geofence, StopModel
from vve_sumo.lot.polygon import Lot
from vve_sumo.path import ReferencePath

VEHICLE = vehicles.FUSION.vehicle
GATEWAY, WATCHDOG = StopModel(2.4, 0.16, 0.48, 0.25), StopModel(2.5, 0.22, 0.0, 0.25)
STRAIGHT = ReferencePath.from_points(np.arange(0.0, 61.0), np.zeros(61))


def turned(points: list[tuple[float, float]], angle: float) -> list[tuple[float, float]]:
    c, s = math.cos(angle), math.sin(angle)
    return [(c * x - s * y + 300.0, s * x + c * y - 200.0) for x, y in points]


def geofence(lot: Lot) -> Geofence:
    return Geofence(lot, VEHICLE, Alignment(), gateway=GATEWAY, watchdog=WATCHDOG)


def bend(radius: float, before: int, after: int) -> ReferencePath:
    angle = np.linspace(0.0, math.pi / 2.0, 24)[1:]
    x = np.concatenate(
        (np.arange(float(before) + 1.0), before + radius * np.sin(angle), np.full(after, before + radius))
    )
    y = np.concatenate((np.zeros(before + 1), radius - radius * np.cos(angle), radius + np.arange(1.0, after + 1.0)))
    return ReferencePath.from_points(x, y)


def proven(found: Fit, lot: Lot, path: ReferencePath, speed: float) -> None:
    """What a fit says is so under its own alignment."""
    first = geofence(lot).aligned(found.alignment).along(path, speed)
    assert (first is None) == found.whole
    if first is not None:
        assert first > found.last_s
    x, y, heading = found.start
    back = found.alignment
    street = back.rotation + heading
    assert math.remainder(street - path.at(0.0).heading, math.tau) == pytest.approx(0.0, abs=1e-9)
    placed_x = math.cos(back.rotation) * x - math.sin(back.rotation) * y + back.x
    placed_y = math.sin(back.rotation) * x + math.cos(back.rotation) * y + back.y
    assert (placed_x, placed_y) == pytest.approx((path.at(0.0).x, path.at(0.0).y), abs=1e-6)


@pytest.mark.thorough
@pytest.mark.parametrize("width", [20.0, 4.0])
def test_a_straight_path_lies_in_the_middle_of_a_runway(width: float) -> None:
    """Also where the car has 15 cm."""
    lot = Lot(turned([(0, 0), (140, 0), (140, width), (0, width)], 0.5), margin=1.0)
    found = fit(STRAIGHT, geofence(lot), 8.0)
    proven(found, lot, STRAIGHT, 8.0)
    assert found.whole
    assert found.last_s >= STRAIGHT.length
    assert found.clearance == pytest.approx(0.5 * (width - VEHICLE.width) - 1.0, abs=0.05)
    assert math.remainder(found.start[2] - 0.5, math.pi) == pytest.approx(0.0, abs=0.02)


@pytest.mark.thorough
def test_of_two_arms_the_wider_one_is_taken() -> None:
    """A lot like a U, whose middle is no part of it."""
    corners = [(0, 0), (140, 0), (140, 8), (14, 8), (14, 40), (140, 40), (140, 52), (0, 52)]
    lot = Lot(turned(corners, 0.9), margin=1.0)
    found = fit(STRAIGHT, geofence(lot), 8.0)
    proven(found, lot, STRAIGHT, 8.0)
    assert found.whole
    assert found.clearance == pytest.approx(0.5 * (12.0 - VEHICLE.width) - 1.0, abs=0.05)


@pytest.mark.thorough
def test_a_pole_in_the_middle_is_kept_clear_of() -> None:
    corners, pole = [(0, 0), (140, 0), (140, 20), (0, 20)], [(70, 9.5), (71, 9.5), (71, 10.5), (70, 10.5)]
    lot = Lot(turned(corners, 1.0), [turned(pole, 1.0)], margin=0.5)
    found = fit(STRAIGHT, geofence(lot), 8.0)
    proven(found, lot, STRAIGHT, 8.0)
    assert found.whole
    # Beside the pole there are 9.5 m, and 8.5 m less a car's width are shared by both sides.
    assert found.clearance > 0.5 * (9.5 - 1.0 - VEHICLE.width) - 0.1


@pytest.mark.thorough
def test_a_lot_in_the_shape_of_the_path_leaves_one_place() -> None:
    path = bend(15.0, 40, 30)
    corners = [(0, 0), (80, 0), (80, 75), (64, 75), (64, 16), (0, 16)]
    lot = Lot(turned(corners, -2.0), margin=0.2)
    found = fit(path, geofence(lot), 4.0)
    proven(found, lot, path, 4.0)
    assert found.whole
    assert math.remainder(found.start[2] + 2.0, math.tau) == pytest.approx(0.0, abs=0.1)


def best_clearance(swept: shapely.Geometry, allowed: shapely.Polygon) -> float:
    """Distance from the edge [m] of the best placement of the ground on a grid of turns and shifts; -inf for none."""
    middle, best = swept.centroid.coords[0], -math.inf
    for angle in np.arange(0.0, math.tau, math.radians(6.0)):
        c, s = math.cos(angle), math.sin(angle)
        for x in np.arange(10.0, 50.0, 1.5):
            for y in np.arange(8.0, 40.0, 1.5):
                move = (c, -s, s, c, x - c * middle[0] + s * middle[1], y - s * middle[0] - c * middle[1])
                aligned = shapely.affinity.affine_transform(swept, move)
                if allowed.contains(aligned):
                    best = max(best, allowed.boundary.distance(aligned))
    return best


@pytest.mark.thorough
def test_it_is_as_good_as_brute_force() -> None:
    path, corners = bend(12.0, 12, 8), [(0, 0), (52, -4), (60, 30), (38, 48), (4, 40)]
    pole = [(20, 14), (21, 14), (21, 15), (20, 15)]
    lot, speed = Lot(corners, [pole], margin=0.5), 4.0
    found = fit(path, geofence(lot), speed)
    proven(found, lot, path, speed)
    assert found.whole
    places = geofence(lot).driven(path, speed)
    swept = shapely.union_all(
        np.concatenate([shapely.polygons(geofence(lot).sweep(p.pose, p.steering, p.fallback_path)) for p in places])
    )
    best = best_clearance(swept, shapely.Polygon(corners, [pole]).buffer(-0.5))
    assert best > 0.0
    assert found.clearance >= best - 0.05


@pytest.mark.thorough
def test_a_path_too_long_is_cut_where_the_lot_ends() -> None:
    # A lane 8 m wide leaves no way but along it.
    lot = Lot(turned([(0, 0), (70, 0), (70, 8), (0, 8)], 0.3), margin=1.0)
    found = fit(STRAIGHT, geofence(lot), 6.0)
    proven(found, lot, STRAIGHT, 6.0)
    assert not found.whole
    reserve = max(GATEWAY.distance(6.0), WATCHDOG.distance(6.0))
    known = 70.0 - 2.0 - VEHICLE.length - reserve
    assert found.last_s == pytest.approx(known, abs=3.0)
    assert found.last_s <= known + 0.3


@pytest.mark.thorough
def test_a_lot_without_room_for_a_start_says_so() -> None:
    lot = Lot([(0, 0), (200, 0), (200, 3.0), (0, 3.0)], margin=1.0)
    with pytest.raises(ConfigError, match="no place for the start"):
        fit(STRAIGHT, geofence(lot), 6.0)


@pytest.mark.thorough(witnesses=1)
@pytest.mark.parametrize("rounding", [1.0 - 1e-6, 1.0 + 1e-6])
def test_what_is_cut_still_fits_when_a_file_has_rounded_it(rounding: float) -> None:
    lot = Lot([(-10.0, -10.0), (100.0, -10.0), (100.0, 10.0), (-10.0, 10.0)], margin=1.0)
    fence = Geofence(lot, VEHICLE, Alignment(), gateway=GATEWAY, watchdog=WATCHDOG)
    whole = ReferencePath.from_points(np.arange(0.0, 95.0), np.zeros(95))
    leaves = fence.along(whole, 8.0)
    assert leaves is not None
    short = shortened(whole, fence, 8.0, leaves)
    assert leaves - 2.0 < short.length < leaves
    x = np.linspace(0.0, short.length, 60) * rounding
    assert fence.along(ReferencePath.from_points(x, np.zeros(60)), 8.0) is None
