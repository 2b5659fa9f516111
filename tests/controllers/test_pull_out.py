"""The way out from close behind what stands in the path: against polygons (shapely), a turning circle, a mirror."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from shapely.affinity import rotate, translate
from shapely.geometry import Polygon, box

from controllers.outlines import Body
from controllers.pull_out import CRAWLS, STEP, SWINGS, Start, WayOut, way_out
from tests.controllers.bench import CAR, ROAD
from vve_sumo.path import ReferencePath

CLEARANCE, ASIDE = 1.1, 3.4
SHAPE = box(-CAR.rear_overhang, -0.5 * CAR.width, CAR.rear_axle_to_bumper, 0.5 * CAR.width)
FRONT = CAR.rear_axle_to_bumper


def arc(bend: float) -> ReferencePath:
    if bend == 0.0:
        return ROAD
    angle = bend * np.arange(0.0, 120.0)
    return ReferencePath.from_points((np.sin(angle) / bend).tolist(), ((1.0 - np.cos(angle)) / bend).tolist())


def rear_of(gap: float, d: float, width: float = 1.8, begins: float = FRONT) -> Body:
    """What is seen of a standing car from behind it."""
    side = np.linspace(d - 0.5 * width, d + 0.5 * width, 10)
    return Body(np.full(10, begins + gap), side, 0.0, 0.0, 0.0)


def found(
    bodies: Sequence[Body], start: Start, *, left: bool = True, speed: float = 1.5, aside: float = ASIDE
) -> WayOut | None:
    return way_out(CAR, start, bodies[:1], bodies, left=left, speed=speed, clearance=CLEARANCE, aside=aside)


def polygon(path: ReferencePath, body: Body) -> Polygon:
    """The whole of a car whose rear is seen: 4.5 m of it."""
    s, d = float(body.s[0]) + np.linspace(0.0, 4.5, 10), (float(body.d.min()), float(body.d.max()))
    ring = [(at, d[0]) for at in s] + [(at, d[1]) for at in s[::-1]]
    corners = []
    for at_s, at_d in ring:
        at = path.at(at_s)
        corners.append((at.x - at_d * math.sin(at.heading), at.y + at_d * math.cos(at.heading)))
    return Polygon(corners)


@settings(deadline=None, max_examples=60)
@given(
    st.floats(2.0, 14.0), st.floats(-1.0, 0.3), st.floats(-0.3, 1.0), st.floats(-0.2, 0.3), st.floats(-0.025, 0.025),
    st.sampled_from(CRAWLS),
)  # fmt: skip
@example(5.0, 0.0, 0.0, 0.0, 0.0, 1.5)
@example(7.1, 0.35, 0.34, -0.085, 0.0, 3.0)
@example(6.0, 0.0, 0.0, 0.0, -0.025, 1.5)
@example(6.0, 0.0, 0.0, 0.0, 0.025, 1.5)
def test_the_car_can_drive_it_and_keeps_clear(
    gap: float, offset: float, d: float, heading_error: float, bend: float, speed: float
) -> None:
    path, start, body = arc(bend), Start(0.0, d, heading_error, bend), rear_of(gap, offset)
    way = found([body], start, speed=speed)
    if way is None:
        return
    world = []
    for s, beside in zip(way.s.tolist(), way.d.tolist(), strict=True):
        at = path.at(s)
        world.append((at.x - beside * math.sin(at.heading), at.y + beside * math.cos(at.heading)))
    x, y = np.array(world).T
    steps = np.hypot(np.diff(x), np.diff(y))
    assert steps == pytest.approx(STEP, rel=0.02)
    heading = np.unwrap(np.arctan2(np.diff(y), np.diff(x)))
    curvature = np.diff(heading) / STEP
    assert np.abs(curvature).max() < CAR.tightest_curvature
    assert np.abs(np.diff(curvature)).max() < 1.2 * CAR.steering_rate_limit / CAR.wheelbase / speed * STEP
    assert heading[-1] == pytest.approx(path.at(float(way.s[-1])).heading, abs=0.03)
    assert abs(way.d[-1]) < ASIDE + 0.02
    other = polygon(path, body)
    middle = zip(0.5 * (x[1:] + x[:-1]), 0.5 * (y[1:] + y[:-1]), heading, strict=True)
    own = [translate(rotate(SHAPE, at, (0, 0), use_radians=True), x, y) for x, y, at in middle]
    least = min(CLEARANCE, own[0].distance(other) - SWINGS)
    assert min(body.distance(other) for body in own) > least - 0.06


@pytest.mark.parametrize("speed", CRAWLS)
def test_how_near_it_can_stand_is_told_by_its_turning_circle(speed: float) -> None:
    """The front corner on the tightest circle from the first metre on: nothing gets out of less room.

    It sweeps a circle around the centre of the turn; the other car's corner must lie outside it by the clearance.
    """
    radius = 1.0 / CAR.tightest_curvature
    sweeps = math.hypot(FRONT, radius + 0.5 * CAR.width)
    least = math.sqrt((sweeps + CLEARANCE) ** 2 - (radius - 0.9) ** 2) - FRONT
    gaps = np.arange(2.0, 14.0, 0.1)
    ways = [found([rear_of(gap, 0.0)], Start(0.0, 0.0, 0.0, 0.0), speed=speed) for gap in gaps.tolist()]
    out = [gap for gap, way in zip(gaps.tolist(), ways, strict=True) if way is not None]
    assert least < min(out) < least + {3.0: 4.0, 2.0: 2.5, 1.5: 1.7}[speed]
    # A car that stands farther behind has a way out as well.
    assert len(out) > 0.97 * (14.0 - min(out)) / 0.1


def test_to_the_right_it_is_the_mirror_image() -> None:
    left = found([rear_of(6.0, -0.2)], Start(0.0, 0.1, 0.05, 0.01))
    right = found([rear_of(6.0, 0.2)], Start(0.0, -0.1, -0.05, -0.01), left=False)
    assert left is not None
    assert right is not None
    assert right.d == pytest.approx(-left.d)
    assert right.s == pytest.approx(left.s)
    assert right.ends == pytest.approx(left.ends)


def test_it_leads_no_farther_aside_than_it_must() -> None:
    """The side of the other car, half the own width, the clearance."""
    way = found([rear_of(8.0, -0.3)], Start(0.0, 0.0, 0.0, 0.0))
    assert way is not None
    assert way.d[-1] == pytest.approx(-0.3 + 0.9 + 0.5 * CAR.width + CLEARANCE, abs=0.05)
    after = way.s >= way.ends
    assert way.d[after] == pytest.approx(way.d[-1], abs=0.05)


@pytest.mark.parametrize(
    ("start", "aside"),
    [
        (Start(0.0, 0.0, 0.0, 0.0), 2.8),  # the other car's side, half a width and the clearance are more
        (Start(0.0, 3.38, 0.0, 0.0), 3.4),  # it is there already: no turn is left
        (Start(0.0, 0.0, -0.9, 0.0), 3.4),  # turned away from that side
        (Start(0.0, 0.0, math.nan, 0.0), 3.4),
        (Start(0.0, math.nan, 0.0, 0.0), 3.4),
        (Start(math.nan, 0.0, 0.0, 0.0), 3.4),
        (Start(0.0, 0.0, 0.0, math.nan), 3.4),
    ],
)
def test_where_there_is_none_it_says_so(start: Start, aside: float) -> None:
    assert found([rear_of(5.0, 0.0)], start, aside=aside) is None


def test_who_stands_on_the_other_side_is_kept_clear_of() -> None:
    start, ahead = Start(0.0, 0.0, 0.0, 0.0), rear_of(6.0, -0.3)
    assert found([ahead], start) is not None
    assert found([ahead, rear_of(6.0, 6.5)], start) is not None
    assert found([ahead, rear_of(6.0, 4.7)], start) is None


def test_who_stands_beside_it_as_near_as_it_may_swing_does_not_hold_it() -> None:
    """The rear swings out to the right by some centimetres; from 1 m beside a row of parked cars one pulls out."""
    beside = [rear_of(gap, -2.9, begins=FRONT) for gap in (-9.0, -3.0, 3.0)]
    way = found([rear_of(8.0, -0.3), *beside], Start(0.0, 0.0, 0.0, 0.0))
    assert way is not None


def test_behind_the_car_it_is_the_line_that_the_car_stands_on() -> None:
    way = found([rear_of(6.0, 0.0)], Start(10.0, 0.2, 0.1, 0.0)) or found(
        [rear_of(6.0, 0.0, begins=10.0 + FRONT)], Start(10.0, 0.2, 0.1, 0.0)
    )
    assert way is not None
    assert way.d_at(9.0) == pytest.approx(0.2 - math.tan(0.1))
    assert way.d_at(10.0) == pytest.approx(0.2)
    assert way.d_at(60.0) == pytest.approx(way.d[-1])


def test_one_that_is_not_done_within_its_reach_is_none() -> None:
    for gap in np.arange(10.0, 40.0, 0.5).tolist():
        way = found([rear_of(gap, 0.0)], Start(0.0, 0.0, 0.0, 0.0))
        assert way is None or way.d[-1] == pytest.approx(way.d[-4], abs=0.01)


def test_what_is_behind_or_far_aside_is_no_matter() -> None:
    start, ahead = Start(0.0, 0.0, 0.0, 0.0), rear_of(8.0, -0.3)
    alone, among = found([ahead], start), found([ahead, rear_of(-20.0, 0.0), rear_of(8.0, 12.0)], start)
    assert alone is not None
    assert among is not None
    assert (alone.d == among.d).all()


def test_who_touches_it_holds_it() -> None:
    assert found([rear_of(8.0, -0.3), rear_of(-1.0, -1.5)], Start(0.0, 0.0, 0.0, 0.0)) is None
