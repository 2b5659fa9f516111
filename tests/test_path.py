"""The cubic path against circles, clothoids, brute force and Shapely."""

from __future__ import annotations

import math
import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely.geometry import Polygon
from shapely.ops import unary_union

from vve_sumo.path import Corridor, ReferencePath, swept_half_widths

FRONT, REAR, WIDTH = 3.84, 1.032, 1.852


def circle(radius: float, angle: float, spacing: float = 1.5) -> ReferencePath:
    turns = np.linspace(0.0, angle, max(4, round(radius * angle / spacing)))
    return ReferencePath.from_points(radius * np.sin(turns), radius * (1.0 - np.cos(turns)))


def winding() -> ReferencePath:
    """Straight, a left and a right bend of 12 m radius with 6 m of clothoid on each side, straight."""
    spacing = 0.05
    ramp, hold, straight = np.linspace(0.0, 1.0 / 12.0, 120), np.full(300, 1.0 / 12.0), np.zeros(400)
    bend = np.concatenate((ramp, hold, ramp[::-1]))
    heading = np.cumsum(np.concatenate((straight, bend, -bend, straight))) * spacing
    return ReferencePath.from_points(
        np.cumsum(np.cos(heading))[::20] * spacing, np.cumsum(np.sin(heading))[::20] * spacing
    )


def test_a_circle_has_its_length_radius_and_heading():
    path = circle(25.0, 3.0)
    assert path.length == pytest.approx(75.0, abs=1e-4)
    for s in np.linspace(0.0, 74.99, 301):
        point = path.at(float(s))
        assert math.hypot(point.x, point.y - 25.0) == pytest.approx(25.0, abs=1e-4)
        assert point.curvature == pytest.approx(1.0 / 25.0, rel=5e-3)
        assert point.heading == pytest.approx(s / 25.0, abs=1e-4)


def test_two_points_make_a_straight_line_that_goes_on():
    path = ReferencePath.from_points([1.0, 4.0], [2.0, 6.0])
    assert path.length == pytest.approx(5.0)
    assert path.at(-5.0)[:2] == pytest.approx((-2.0, -2.0))
    assert path.at(10.0)[:2] == pytest.approx((7.0, 10.0))
    projection = path.project(7.0 - 0.8, 10.0 + 0.6, 5.0)
    assert (projection.s, projection.d, projection.curvature) == pytest.approx((10.0, 1.0, 0.0))


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10_000))
def test_slope_and_curvature_are_continuous_and_the_speed_is_one(seed: int):
    random = np.random.default_rng(seed)
    heading = np.cumsum(random.uniform(-0.08, 0.08, 60))
    steps = random.uniform(1.0, 2.0, 60)
    path = ReferencePath.from_points(np.cumsum(steps * np.cos(heading)), np.cumsum(steps * np.sin(heading)))
    for piece in path.segments[1:]:
        before, after = path.at(piece.start - 1e-9), path.at(piece.start + 1e-9)
        assert before == pytest.approx(after, abs=1e-7)
        assert math.hypot(piece.x1, piece.y1) == pytest.approx(1.0, abs=2e-3)


@settings(max_examples=100, deadline=None)
@given(st.floats(0.0, 1.0), st.floats(-4.0, 4.0), st.floats(-3.0, 3.0))
def test_projection_is_the_nearest_point_by_brute_force(share: float, d: float, wrong: float):
    path = winding()
    s = share * path.length
    point = path.at(s)
    x, y = point.x - d * math.sin(point.heading), point.y + d * math.cos(point.heading)
    found = path.project(x, y, s + wrong)
    assert (found.s, found.d) == pytest.approx((s, d), abs=1e-5)
    dense = np.array([path.at(float(t))[:2] for t in np.linspace(s - 8.0, s + 8.0, 1601)])
    nearest = np.hypot(dense[:, 0] - x, dense[:, 1] - y).min()
    assert abs(found.d) == pytest.approx(nearest, abs=1e-4)
    assert (found.heading, found.curvature) == pytest.approx((path.at(s).heading, path.at(s).curvature), abs=1e-5)


def test_near_tells_the_branches_of_a_crossing_apart():
    t = np.linspace(-1.5, 4.6, 150)  # most of a figure of eight: it crosses itself at the origin, at t = 0 and pi
    path = ReferencePath.from_points(30.0 * np.sin(t), 30.0 * np.sin(2.0 * t))
    first, second = path.project(0.0, 0.0, 0.25 * path.length), path.project(0.0, 0.0, 0.75 * path.length)
    assert second.s - first.s > 0.4 * path.length
    assert (first.d, second.d) == pytest.approx((0.0, 0.0), abs=1e-3)
    assert math.cos(first.heading - second.heading) == pytest.approx(0.6, abs=1e-3)  # (1, 2) and (-1, 2)


def test_without_a_hint_a_round_course_begins_at_its_start():
    path = circle(30.0, 2.0 * math.pi)
    assert path.project(0.05, -0.02).s == pytest.approx(0.05, abs=0.01)
    assert path.project(30.0, 30.0).s == pytest.approx(15.0 * math.pi, abs=0.01)


def test_locate_agrees_with_projection_and_refuses_what_is_outside():
    path, random = winding(), np.random.default_rng(4)
    at_s, at_d = random.uniform(-20.0, path.length + 60.0, 300), random.uniform(-5.0, 5.0, 300)
    points = [path.at(float(s)) for s in at_s]
    x = np.array([p.x - o * math.sin(p.heading) for p, o in zip(points, at_d, strict=True)])
    y = np.array([p.y + o * math.cos(p.heading) for p, o in zip(points, at_d, strict=True)])
    found_s, found_d = path.locate(x, y, -25.0, path.length + 70.0)
    np.testing.assert_allclose(found_s, at_s, atol=0.02)
    np.testing.assert_allclose(found_d, at_d, atol=0.01)
    only_s, only_d = path.locate(x, y, 20.0, 40.0)
    inside = (at_s > 20.1) & (at_s < 39.9)
    far = (at_s < 10.0) | (at_s > 50.0)
    assert inside.sum() > 30
    np.testing.assert_allclose(only_s[inside], at_s[inside], atol=0.02)
    assert np.isnan(only_s[far]).all()
    assert np.isnan(only_d[far]).all()


def test_many_points_are_projected_each_near_its_own_place():
    """Against the single projection: on a winding path, and on a figure that crosses itself."""
    random, angles = np.random.default_rng(5), np.linspace(0.0, 2.0 * math.pi, 200)[:-1]
    crossing = ReferencePath.from_points(40.0 * np.sin(angles), 20.0 * np.sin(2.0 * angles))
    for path in (winding(), crossing):
        at_s, at_d = random.uniform(-20.0, path.length + 20.0, 300), random.uniform(-3.0, 3.0, 300)
        points = [path.at(float(s)) for s in at_s]
        x = np.array([p.x - o * math.sin(p.heading) for p, o in zip(points, at_d, strict=True)])
        y = np.array([p.y + o * math.cos(p.heading) for p, o in zip(points, at_d, strict=True)])
        s, d, heading = path.project_many(x, y, at_s + random.uniform(-4.0, 4.0, 300), 10.0)
        single = [path.project(*place) for place in zip(x.tolist(), y.tolist(), at_s.tolist(), strict=True)]
        np.testing.assert_allclose(s, [one.s for one in single], atol=0.02)
        np.testing.assert_allclose(d, [one.d for one in single], atol=0.01)
        turned = heading - np.array([one.heading for one in single])
        np.testing.assert_allclose(np.remainder(turned + math.pi, math.tau), math.pi, atol=0.01)


def test_swept_half_widths_are_those_of_a_turning_rectangle():
    for radius in (8.0, 25.0, 400.0):
        left, right = swept_half_widths(1.0 / radius, FRONT, WIDTH)
        assert float(left) == pytest.approx(WIDTH / 2.0)
        assert float(right) == pytest.approx(math.hypot(radius + WIDTH / 2.0, FRONT) - radius)
        assert swept_half_widths(-1.0 / radius, FRONT, WIDTH) == (right, left)
    assert swept_half_widths(0.0, FRONT, WIDTH) == (WIDTH / 2.0, WIDTH / 2.0)


def test_the_corridor_covers_what_the_body_sweeps_and_little_more():
    path = winding()
    corridor = Corridor(path, FRONT, REAR, WIDTH, margin=0.0)
    bodies = []
    for s in np.arange(0.0, path.length, 0.25):
        point = path.at(float(s))
        cos, sin = math.cos(point.heading), math.sin(point.heading)
        corners = [(-REAR, -WIDTH / 2), (FRONT, -WIDTH / 2), (FRONT, WIDTH / 2), (-REAR, WIDTH / 2)]
        bodies.append(Polygon([(point.x + a * cos - b * sin, point.y + a * sin + b * cos) for a, b in corners]))
    swept = np.array(unary_union(bodies).exterior.segmentize(0.5).coords)
    s, d = path.locate(swept[:, 0], swept[:, 1], 4.0, path.length - 4.0)
    for at_s, at_d in zip(s[~np.isnan(s)], d[~np.isnan(s)], strict=True):
        left, right = corridor.half_widths(float(at_s))
        assert -right - 0.03 <= at_d <= left + 0.03
    # On the steady part of a bend the band is exact.
    bend = 20.0 + 6.0 + 12.0
    on_bend = np.abs(s - bend) < 2.0
    assert d[on_bend].min() == pytest.approx(-corridor.half_widths(bend)[1], abs=0.03)
    assert d[on_bend].max() == pytest.approx(corridor.half_widths(bend)[0], abs=0.03)


def test_the_corridor_has_no_room_for_nan():
    corridor = Corridor(winding(), FRONT, REAR, WIDTH, margin=0.3)
    assert corridor.contains(10.0, WIDTH / 2 + 0.29)
    assert not corridor.contains(10.0, WIDTH / 2 + 0.31)
    assert not corridor.contains(math.nan, 0.0)
    assert not corridor.contains(10.0, math.nan)


def test_noise_is_smoothed_away():
    random = np.random.default_rng(7)
    turns = np.linspace(0.0, 2.0, 100)
    x, y = 50.0 * np.sin(turns), 50.0 * (1.0 - np.cos(turns))
    noisy = x + random.normal(0.0, 0.02, 100), y + random.normal(0.0, 0.02, 100)
    places_s = np.linspace(5.0, 95.0, 91)
    rough, smooth = ReferencePath.from_points(*noisy), ReferencePath.from_points(*noisy, noise=0.02)
    error = [max(abs(path.at(float(s)).curvature - 0.02) for s in places_s) for path in (rough, smooth)]
    assert error[0] > 0.03
    assert error[1] < 0.006
    assert max(abs(math.hypot(p.x, p.y - 50.0) - 50.0) for p in map(smooth.at, places_s.tolist())) < 0.04


def test_a_path_travels_to_another_process_unchanged():
    path = winding()
    again = pickle.loads(pickle.dumps(path))
    assert again.project(20.0, 1.0) == path.project(20.0, 1.0)


@pytest.mark.parametrize(
    ("x", "y", "says"),
    [
        ([], [], "at least 2 points are needed, got 0"),
        ([1.0], [1.0], "at least 2 points are needed, got 1"),
        ([0.0, 1.0, 2.0], [0.0, 1.0], r"same length, got shapes \(3,\) and \(2,\)"),
        ([0.0, math.nan, 2.0], [0.0, 0.0, 0.0], "point 1 is not finite"),
        ([0.0, 1.0, math.inf], [0.0, 0.0, 0.0], "point 2 is not finite"),
        ([0.0, 1.0, 1.0], [0.0, 2.0, 2.001], "points 1 and 2 are the same place"),
    ],
)
def test_bad_points_are_refused_in_one_line(x: list[float], y: list[float], says: str):
    with pytest.raises(ValueError, match=says) as refused:
        ReferencePath.from_points(x, y)
    assert "\n" not in str(refused.value)
