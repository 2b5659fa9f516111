"""The ways of both planners against brute force: limits along the curve, clearance by polygons (shapely)."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st
from shapely.affinity import rotate, translate
from shapely.geometry import Point as Place
from shapely.geometry import Polygon, box

from controllers.elastic_band import ElasticBand, Springs, balance
from controllers.free_space import LEFT, RIGHT, Margins, Nodes, Room, clearances, room
from controllers.frenet_sampling import FrenetSampling, Quintics, quartic_speeds
from controllers.lateral_plan import (
    CHANGE_EXCESS,
    EXCESS,
    INTRUSION,
    LateralLimits,
    LateralPlan,
    Planner,
    Task,
    all_within_limits,
    planned,
    times_at,
    within_limits,
)
from controllers.outlines import Body
from tests.controllers.bench import CAR
from vve_sumo.commanded_path import curve, flaw
from vve_sumo.geometry import Box
from vve_sumo.laws import swerve_time
from vve_sumo.path import ReferencePath
from vve_sumo.values import CommandedPath, Point, Pose

SPACING, COUNT = 1.5, 64
PLANNERS = [ElasticBand(), FrenetSampling()]
KEEPS = Margins(clearance=1.0, lengthwise=0.5, slack=0.0)
COMFORT, URGENT = LateralLimits.of(CAR, 1.8, 2.0), LateralLimits.of(CAR, 2.8, 4.6)
names = pytest.mark.parametrize("planner", PLANNERS, ids=lambda planner: type(planner).__name__)


def laid(planner: Planner, task: Task) -> LateralPlan | None:
    """The way that a planner lays."""
    return planned(planner.planning(task))


def road(bend: float) -> ReferencePath:
    """A path that is straight, then turns with a curvature [1/m] from 20 m on, gently."""
    s, heading, x, y, points = 0.0, 0.0, 0.0, 0.0, []
    while s < 160.0:
        points.append((x, y))
        heading += bend * min(max((s - 20.0) / 20.0, 0.0), 1.0) * 2.0
        x, y, s = x + 2.0 * math.cos(heading), y + 2.0 * math.sin(heading), s + 2.0
    return ReferencePath.from_points(*zip(*points, strict=True))


def outline(polygon: Polygon, path: ReferencePath) -> Body:
    """A standing body whose every side is seen."""
    ring = polygon.exterior
    points = np.array([ring.interpolate(at).coords[0] for at in np.arange(0.0, ring.length, 0.1)])
    s, d = path.locate(points[:, 0], points[:, 1], -20.0, 200.0)
    return Body(s, d, 0.0, 0.0, 0.0)


def swept(path: ReferencePath, plan: LateralPlan, nodes: Nodes) -> tuple[ReferencePath, list[Polygon]]:
    """The curve that the gateway would follow, and the car's body all along it."""
    x, y = [], []
    for s, d in zip(nodes.s.tolist(), plan.d, strict=True):
        at = path.at(s)
        x.append(at.x - d * math.sin(at.heading))
        y.append(at.y + d * math.cos(at.heading))
    commanded = CommandedPath(tuple(x), tuple(y), tuple(plan.speeds))
    first = path.at(float(nodes.s[0]))
    assert not flaw(commanded, Pose(0.0, Point.REAR_AXLE, x[0], y[0], first.heading, 5.0, 0.0, 0.0, 0.0, 0.0))
    way, bodies = curve(commanded), []
    shape = box(-CAR.rear_overhang, -0.5 * CAR.width, CAR.rear_axle_to_bumper, 0.5 * CAR.width)
    for at_s in np.arange(0.0, way.length, 0.25):
        at = way.at(float(at_s))
        bodies.append(translate(rotate(shape, at.heading, (0, 0), use_radians=True), at.x, at.y))
    return way, bodies


def nodes_of(path: ReferencePath) -> Nodes:
    s = SPACING * np.arange(COUNT)
    return Nodes.of(CAR, s, np.array([path.at(at_s).curvature for at_s in s.tolist()]))


def task(
    nodes: Nodes,
    bodies: Sequence[Body],
    sides: Sequence[int],
    speed: float,
    limits: LateralLimits,
    head: Sequence[float],
) -> Task:
    def free(times: Sequence[float]) -> Room:
        return room(nodes, times, bodies, sides, KEEPS).within(3.4, 3.4)

    return Task(tuple(head), SPACING, nodes.curvature.tolist(), (speed,) * COUNT, free, limits)


@names
@settings(deadline=None, max_examples=25)
@given(
    st.floats(4.0, 12.0), st.floats(45.0, 60.0), st.floats(-1.4, 1.4), st.floats(-math.pi, math.pi),
    st.floats(0.5, 9.0), st.floats(0.4, 1.9), st.floats(-0.006, 0.006), st.sampled_from([LEFT, RIGHT]),
    st.floats(-0.2, 0.2),
)  # fmt: skip
@example(4.0, 58.0, 0.0, 0.75, 2.25, 1.5, 0.0, LEFT, 0.0)  # neighbours' offsets would go to and fro
def test_the_body_keeps_clear_of_long_and_oblique_bodies_in_bends(
    planner: Planner, speed: float, at: float, aside: float, turn: float, length: float, width: float, bend: float,
    side: int, starts: float,
) -> None:  # fmt: skip
    path = road(bend)
    nodes, place = nodes_of(path), path.at(at)
    x, y = place.x - aside * math.sin(place.heading), place.y + aside * math.cos(place.heading)
    polygon = Polygon(Box(x, y, place.heading + turn, length, width).corners())
    plan = laid(planner, task(nodes, [outline(polygon, path)], [side], speed, COMFORT, [starts] * 4))
    assume(plan is not None)
    assert plan is not None
    way, bodies = swept(path, plan, nodes)
    assert min(polygon.distance(body) for body in bodies) > KEEPS.clearance - INTRUSION - 0.05
    assert plan.d[:4] == (starts,) * 4
    # Along the curve itself: what the car would feel at the speed that was planned.
    speed = min(plan.speeds)
    dense = [way.at(float(s)).curvature for s in np.arange(3.0 * SPACING, way.length - 3.0 * SPACING, 0.3)]
    assert max(map(abs, dense)) <= EXCESS * max(COMFORT.bend(speed), abs(bend)) + 0.004
    if isinstance(planner, ElasticBand):
        steps = np.abs(np.array(dense[5:]) - np.array(dense[:-5])) / SPACING
        assert steps.max() <= CHANGE_EXCESS * COMFORT.change(speed) + abs(bend) / 20.0 + 0.001


@names
def test_several_bodies_on_both_sides(planner: Planner) -> None:
    """Past one on the left, past the next on the right of it: a slalom with as much room as it takes."""
    path = road(0.0)
    nodes = nodes_of(path)
    shapes = [Polygon(Box(32.0, -1.0, 0.2, 4.0, 1.8).corners()), Polygon(Box(72.0, 1.2, -0.3, 4.0, 1.8).corners())]
    plan = laid(planner, task(nodes, [outline(one, path) for one in shapes], [LEFT, RIGHT], 6.0, URGENT, [0.0] * 4))
    if isinstance(planner, FrenetSampling) and plan is None:
        pytest.skip("one way out and back is all that it draws")
    assert plan is not None
    _way, bodies = swept(path, plan, nodes)
    assert min(shape.distance(body) for shape in shapes for body in bodies) > KEEPS.clearance - INTRUSION - 0.05


@names
@pytest.mark.parametrize("speed", [8.0, 11.0, 15.0])
def test_the_least_distance_to_come_aside_is_near_the_closed_form(planner: Planner, speed: float) -> None:
    """A wall 1.5 m into the way: the nearest that a way leads around, against the least time to swerve."""
    nodes = nodes_of(road(0.0))

    def wall(node: int) -> Task:
        low = [-math.inf] * COUNT
        low[node : node + 4] = [1.5] * 4
        return Task(
            (0.0,) * 4, SPACING, [0.0] * COUNT, (speed,) * COUNT, lambda _times: Room(low, [3.4] * COUNT), URGENT
        )

    first = next(node for node in range(4, COUNT) if laid(planner, wall(node)) is not None)
    least = speed * swerve_time(1.5, URGENT.acceleration, URGENT.jerk)
    assert len(nodes.s) == COUNT
    share = {ElasticBand: 1.1, FrenetSampling: 1.25}[type(planner)]
    assert 0.85 * least - SPACING <= SPACING * (first - 3) <= share * least + SPACING


@names
def test_it_returns_to_the_path(planner: Planner) -> None:
    nodes = nodes_of(road(0.0))
    plan = laid(planner, task(nodes, [], [], 8.0, COMFORT, [1.5] * 4))
    assert plan is not None
    assert abs(plan.d[-1]) < 0.05
    assert min(plan.d) > -0.15


def test_no_way_is_better_than_one_through_a_body() -> None:
    path = road(0.0)
    nodes = nodes_of(path)
    wall = outline(Polygon(Box(30.0, 0.0, 0.0, 2.0, 12.0).corners()), path)
    for planner in PLANNERS:
        for side in (LEFT, RIGHT):
            assert laid(planner, task(nodes, [wall], [side], 8.0, URGENT, [0.0] * 4)) is None


@given(st.integers(1, 20), st.integers(1, 4), st.integers(0, 2**32 - 1))
def test_springs_balance_where_the_matrix_says(count: int, reach: int, seed: int) -> None:
    """Against numpy's least squares of the same springs; one that draws each coefficient to 0 makes them regular."""
    draw = np.random.default_rng(seed)
    stencils, many = draw.normal(size=(3, reach)), count + reach - 1
    weights, aims = draw.uniform(0.1, 5.0, (3, count)), draw.normal(size=(3, count))
    rows, wanted = [np.eye(many)], [np.zeros(many)]
    for kind in range(3):
        for number in range(count):
            row = np.zeros((1, many))
            row[0, number : number + reach] = math.sqrt(weights[kind, number]) * stencils[kind]
            rows.append(row)
            wanted.append(np.array([math.sqrt(weights[kind, number]) * aims[kind, number]]))
    expected = np.linalg.lstsq(np.concatenate(rows), np.concatenate(wanted), rcond=None)[0]
    springs = Springs(stencils, count)
    diagonals = springs.matrix(weights)
    diagonals[0] += 1.0
    np.testing.assert_allclose(balance(diagonals, springs.right(weights * aims)), expected, rtol=1e-6, atol=1e-8)


@given(st.integers(0, 2**32 - 1), st.floats(1.0, 14.0))
def test_the_limits_of_many_ways_are_those_of_each(seed: int, speed: float) -> None:
    """All ways at once against one after the other, whose curve is that of `ReferencePath`."""
    draw = np.random.default_rng(seed)
    size = 10.0 ** draw.uniform(-3.0, 0.5, 12)
    ways = np.cumsum(np.cumsum(draw.normal(size=(COUNT, 12)), axis=0), axis=0) * size / COUNT**1.5
    asked = task(nodes_of(road(0.0)), [], [], speed, COMFORT, [0.0] * 4)
    free = Room([-3.0] * COUNT, [3.0] * COUNT)
    one_by_one = [within_limits(asked, LateralPlan(tuple(way), asked.speeds), free) for way in ways.T.tolist()]
    assert all_within_limits(asked, ways, asked.speeds, free).tolist() == one_by_one


@given(
    st.tuples(st.floats(-3.0, 3.0), st.floats(-0.3, 0.3), st.floats(-0.1, 0.1)),
    st.floats(-3.0, 3.0),
    st.floats(5.0, 60.0),
)
def test_a_quintic_meets_its_six_conditions(start: tuple[float, float, float], end: float, length: float) -> None:
    quintics = Quintics.to_rest(start, end, np.array([3.0, length]))
    poly = np.polynomial.Polynomial([float(coefficient[1]) for coefficient in quintics.coefficients])
    got = [poly(0.0), poly.deriv()(0.0), poly.deriv(2)(0.0), poly(length), poly.deriv()(length), poly.deriv(2)(length)]
    np.testing.assert_allclose(got, [*start, end, 0.0, 0.0], atol=1e-8)


def test_quartic_speeds_over_the_way() -> None:
    """From 10 to 5 m/s within 4 s takes 30 m; half the way in time is at 7.5 m/s."""
    places = [0.0, 10.0 * 2.0 - 5.0 * 4.0 * (0.125 - 0.03125), 30.0, 50.0]
    np.testing.assert_allclose(quartic_speeds(10.0, 5.0, 4.0, places), [10.0, 7.5, 5.0, 5.0], atol=0.05)


@names
def test_no_planner_is_faster_than_it_is_told(planner: Planner) -> None:
    """A car that creeps behind a body, and speeds up once it is beside it."""
    path, speeds = road(0.0), [2.1, *[1.5] * 20, *(min(1.5 + 0.4 * node, 8.0) for node in range(COUNT - 21))]
    body = outline(translate(box(0.0, -0.9, 4.5, 0.9), 34.0, -0.8), path)
    asked = task(nodes_of(path), [body], [LEFT], 1.0, COMFORT, (0.0, 0.0, 0.0))._replace(speeds=tuple(speeds))
    plan = laid(planner, asked)
    assert plan is not None
    assert (np.array(plan.speeds) <= np.array(speeds) + 1e-9).all()


def test_times_along_the_nodes() -> None:
    assert times_at([2.0, 4.0, 4.0], 3.0) == pytest.approx([0.0, 1.0, 1.75])


@given(
    slope=st.floats(-0.35, 0.35),
    place=st.floats(20.0, 40.0),
    away=st.floats(-0.5, 3.0),
    left=st.booleans(),
)
def test_a_car_that_leaves_its_path_obliquely_is_as_near_as_its_polygon(
    slope: float, place: float, away: float, left: bool
) -> None:
    """At each node at which a post that stands beside the way is beside the car's flank."""
    nodes, side, turn = nodes_of(road(0.0)), 1.0 if left else -1.0, math.atan(slope)
    way_d = slope * (nodes.s - 30.0)
    post = Place(place, slope * (place - 30.0) + side * (0.5 * CAR.width + away) / math.cos(turn))
    body = Body(np.array([post.x]), np.array([post.y]), 0.0, 0.0, 0.0)
    found = clearances(nodes, times_at((5.0,) * COUNT, SPACING), way_d.tolist(), body, KEEPS)
    middle = CAR.rear_axle_to_bumper - 0.5 * CAR.length
    for s, d, clear in zip(nodes.s.tolist(), way_d.tolist(), found, strict=True):
        along = (post.x - s) * math.cos(turn) + (post.y - d) * math.sin(turn)
        if all(-CAR.rear_overhang < ahead < CAR.rear_axle_to_bumper for ahead in (place - s, along)):
            x, y = s + middle * math.cos(turn), d + middle * math.sin(turn)
            nearest = Polygon(Box(x, y, turn, CAR.length, CAR.width).corners()).distance(post)
            assert max(clear, 0.0) == pytest.approx(nearest, abs=0.06 + 0.07 * nearest)


def test_room_beside_one_who_crosses_is_where_he_will_be() -> None:
    """The car is at node 20 after 3 s; he walks left at 1 m/s from 3 m right: he is in the middle then."""
    nodes = nodes_of(road(0.0))
    walker = Body(np.array([31.0, 31.4]), np.array([-3.2, -2.8]), 0.0, 1.0, 0.0)
    times = times_at((10.0,) * COUNT, SPACING)
    clear = clearances(nodes, times, [0.0] * COUNT, walker, KEEPS)
    node = int(np.argmin(clear))
    assert nodes.s[node] / 10.0 == pytest.approx(3.0, abs=0.5)
    assert clear[node] < 0.0
    free = room(nodes, times, [walker], [RIGHT], KEEPS)
    assert min(free.high) == pytest.approx(-2.8 + 2.6 - 0.5 * CAR.width - KEEPS.clearance, abs=0.6)
