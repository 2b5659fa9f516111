"""A declared corridor: the ground that it needs by brute force, the lot that takes it, a drive that uses it."""

from __future__ import annotations

import math
import re
import tomllib
from functools import partial

import numpy as np
import pytest
import shapely
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st

from tests.conftest import REPOSITORY
from tests.drive.swerve import Swerver, over_and_back
from tests.lot.test_fit import GATEWAY, STRAIGHT, VEHICLE, WATCHDOG, bend, best_clearance, geofence, proven, turned
from tests.lot.test_geofence import BODY
from tests.vehicle.closed_loop import ClosedLoop, straight
from vve_sumo.drive.pipeline import Pipeline
from vve_sumo.frames import Alignment
from vve_sumo.lot.corridor import CorridorStretch, half_widths, line_offsets
from vve_sumo.lot.fit import corridor_excess, fit, measured, shortened
from vve_sumo.lot.geofence import DrivenPlace, Geofence
from vve_sumo.lot.polygon import Lot
from vve_sumo.path import ReferencePath
from vve_sumo.scenario.schema import DeclaredStretch

ANYWHERE = Lot([(-900.0, -900.0), (900.0, -900.0), (900.0, 900.0), (-900.0, 900.0)])
SPEED = 6.0  #: [m/s]


def needed(path: ReferencePath, corridor: tuple[CorridorStretch, ...], speed: float = SPEED) -> shapely.Geometry:
    """The ground that a drive of a path needs with a corridor, in the path's map."""
    return covered(geofence(ANYWHERE).driven(path, speed, corridor))


def covered(places: list[DrivenPlace]) -> shapely.Geometry:
    """What the geofence looks at from some places."""
    fence = geofence(ANYWHERE)
    swept = [fence.sweep(place.pose, place.steering, place.fallback_path) for place in places]
    return shapely.union_all(shapely.polygons(np.concatenate(swept)), grid_size=1e-4)


def in_corridor(path: ReferencePath, corridor: tuple[CorridorStretch, ...]) -> list[DrivenPlace]:
    """The places of a drive where its corridor is."""
    places = geofence(ANYWHERE).driven(path, SPEED, corridor)
    at_lines = {place.s for place in places if place.d}
    return [place for place in places if place.s in at_lines]


def body_at(path: ReferencePath, s: float, d: float) -> shapely.Polygon:
    """The car's outline with its rear axle at a distance d from the path, left positive, by arithmetic of our own."""
    x, y, heading, _ = path.at(s)
    x, y = x - d * math.sin(heading), y + d * math.cos(heading)
    c, s_ = math.cos(heading), math.sin(heading)
    return shapely.Polygon([(x + c * a - s_ * b, y + s_ * a + c * b) for a, b in BODY])


def winding(first: float, second: float, radius: float) -> ReferencePath:
    """A path of two bends, in rad and left positive, of a radius [m], with straight lines before, between and after."""
    curvature = [0.0, math.copysign(1.0 / radius, first), 0.0, math.copysign(1.0 / radius, second), 0.0]
    lengths = [25.0, abs(first) * radius, 15.0, abs(second) * radius, 25.0]
    bends = np.concatenate([np.full(round(2.0 * length), k) for length, k in zip(lengths, curvature, strict=True)])
    heading = np.concatenate(([0.0], np.cumsum(0.5 * bends)))
    middle = heading[:-1] + 0.25 * bends
    x, y = np.cumsum(0.5 * np.cos(middle)), np.cumsum(0.5 * np.sin(middle))
    return ReferencePath.from_points(x[::2], y[::2])


def test_the_widest_stretch_counts_and_what_lies_between_two_samples_at_both() -> None:
    corridor = (CorridorStretch(10.0, 20.0, 1.0, 0.0), CorridorStretch(15.4, 15.6, 0.5, 2.5))
    assert [half_widths(corridor, s) for s in (9.0, 10.0, 14.0, 15.0, 16.0, 17.0, 20.0, 21.0)] == [
        (0.0, 0.0), (1.0, 0.0), (1.0, 0.0), (1.0, 2.5), (1.0, 2.5), (1.0, 0.0), (1.0, 0.0), (0.0, 0.0),
    ]  # fmt: skip
    assert half_widths((CorridorStretch(0.0, math.inf, 0.0, 3.0),), 1e4) == (0.0, 3.0)
    assert line_offsets(corridor, 15.0) == [1.0, *(pytest.approx(-2.5 * n / 3.0) for n in (1, 2, 3))]
    assert line_offsets(corridor, 30.0) == []


@pytest.mark.thorough
def test_on_a_straight_line_the_ground_is_a_rectangle_more() -> None:
    """Closed form: half a body beyond both edges, from its rear overhang to the longest stop and its front."""
    ground = needed(STRAIGHT, (CorridorStretch(30.0, 40.0, 3.5, 1.2),))
    left, right = shapely.box(-99.0, 0.93, 999.0, 99.0), shapely.box(-99.0, -99.0, 999.0, -0.93)
    stop = max(GATEWAY.distance(SPEED), WATCHDOG.distance(SPEED)) + 3.84
    for side, least_y, greatest_y in ((left, 0.93, 3.5 + 0.926), (right, -1.2 - 0.926, -0.93)):
        bounds = shapely.intersection(ground, side).bounds
        assert bounds[:2] == pytest.approx((30.0 - 1.032, least_y), abs=0.02)
        assert bounds[3] == pytest.approx(greatest_y, abs=0.02)
        assert 40.0 + stop <= bounds[2] < 41.0 + stop  # the way of the gateway's stop is swept by whole metres


def test_without_a_corridor_the_drive_is_the_same() -> None:
    path, fence = bend(12.0, 12, 8), geofence(ANYWHERE)
    with_one = fence.driven(path, SPEED, (CorridorStretch(5.0, 9.0, 2.0, 2.0),))
    assert [place for place in with_one if place.d == 0.0] == fence.driven(path, SPEED)
    assert {place.s for place in with_one if place.d != 0.0} == {5.0, 6.0, 7.0, 8.0, 9.0}


ANGLES = st.sampled_from([-2.0, -1.2, -0.4, 0.4, 1.2, 2.0])
RADII = st.floats(7.0, 40.0)
#: in cm, because shapely's own lines are not good at distances of next to nothing
WIDTHS = st.integers(10, 500).map(lambda number: 0.01 * number)


@pytest.mark.thorough
@settings(deadline=None, max_examples=8)
@given(
    first=ANGLES,
    second=ANGLES,
    radius=RADII,
    left=WIDTHS,
    right=WIDTHS,
    begin=st.floats(0.0, 60.0),
    length=st.floats(0.5, 20.0),
    data=st.data(),
)
def test_the_ground_holds_the_car_wherever_it_may_be(
    first: float,
    second: float,
    radius: float,
    left: float,
    right: float,
    begin: float,
    length: float,
    data: st.DataObject,
) -> None:
    path = winding(first, second, radius)
    begin = min(begin, path.length - length)
    corridor = (CorridorStretch(begin, begin + length, left, right),)
    ground = covered(in_corridor(path, corridor)).buffer(0.02)
    # As a band of shapely's own, and with the body at places of chance.
    line = shapely.LineString([path.at(s)[:2] for s in np.linspace(begin, begin + length, 200)])
    for reach in (left, -right):
        assert ground.covers(shapely.buffer(line, reach, single_sided=True).buffer(-0.01))
    for s in np.linspace(begin, begin + length, 12):
        d = data.draw(st.floats(-right, left))
        assert ground.covers(body_at(path, float(s), d)), (s, d)


@pytest.mark.thorough
@settings(deadline=None, max_examples=20)
@example(first=-0.4, second=-2.0, radius=7.0, d=0.38, side=1.0, begin=22.0)  # 5 cm beside the ground
@example(first=-0.388, second=-1.186, radius=10.41, d=3.026, side=-1.0, begin=20.422)  # 25 cm
@given(first=ANGLES, second=ANGLES, radius=RADII, d=WIDTHS, side=st.sampled_from([-1.0, 1.0]), begin=st.floats(5, 60))
def test_the_ground_holds_a_stop_along_the_parallel_line(
    first: float, second: float, radius: float, d: float, side: float, begin: float
) -> None:
    """The car rolls along shapely's parallel line until it has gone as far as the gateway's stop takes."""
    assume(radius - d > 1.15 / VEHICLE.tightest_curvature)  # no car follows a tighter line
    path = winding(first, second, radius)
    corridor = (CorridorStretch(begin, begin, max(side * d, 0.0), max(-side * d, 0.0)),)
    place = next(p for p in in_corridor(path, corridor) if p.d == pytest.approx(side * d))
    # The ground is that of the fallback path, which the gateway follows: where the bend changes it runs beside the
    # parallel line, by a quarter of a metre at most of 237 paths drawn by chance. A lot's margin is four times that.
    ground = covered([place]).buffer(0.3)
    dense = np.linspace(place.s, place.s + 60.0, 4000)
    line = shapely.offset_curve(shapely.LineString([path.at(one)[:2] for one in dense]), side * d)
    for gone in np.linspace(0.0, GATEWAY.distance(place.pose.speed), 12):
        here, there = (shapely.line_interpolate_point(line, gone + step) for step in (0.0, 0.02))
        heading = math.atan2(there.y - here.y, there.x - here.x)
        c, s = math.cos(heading), math.sin(heading)
        body = shapely.Polygon([(here.x + c * a - s * b, here.y + s * a + c * b) for a, b in BODY])
        assert ground.covers(body), gone


@pytest.mark.thorough
def test_beyond_the_centre_of_a_bend_the_car_is_on_its_tightest_circle() -> None:
    path = bend(9.0, 20, 20)
    corridor = (CorridorStretch(20.0, 34.0, 12.0, 0.0),)
    places = [place for place in geofence(ANYWHERE).driven(path, SPEED, corridor) if place.d > 3.0]
    bends = np.array([place.fallback_path.curvature[0] for place in places])
    assert np.isfinite(bends).all()
    assert bends.max() == pytest.approx(VEHICLE.tightest_curvature, rel=1e-9)
    ground = covered(places).buffer(0.02)
    for s in np.linspace(20.0, 34.0, 30):
        assert ground.covers(body_at(path, float(s), 12.0))


@pytest.mark.thorough
def test_a_straight_path_lies_beside_the_middle_of_a_runway() -> None:
    """The corridor, not the path, lies in the middle."""
    lot = Lot(turned([(0, 0), (140, 0), (140, 20), (0, 20)], 0.5), margin=1.0)
    corridor = (CorridorStretch(0.0, math.inf, 4.0, 1.0),)
    found = fit(STRAIGHT, geofence(lot), 8.0, corridor)
    proven(found, lot, STRAIGHT, 8.0)
    assert found.whole
    assert found.clearance == pytest.approx(0.5 * (20.0 - 5.0 - VEHICLE.width) - 1.0, abs=0.05)
    there = found.alignment.inverse()
    x, y, heading = found.start
    across = -(x - 300.0) * math.sin(0.5) + (y + 200.0) * math.cos(0.5)
    left = math.cos(heading - 0.5)  # 1 where the path goes up the runway, -1 down
    assert across == pytest.approx(10.0 - 1.5 * left, abs=0.06)
    assert there.inverse().rotation == pytest.approx(found.alignment.rotation)
    assert corridor_excess(STRAIGHT, geofence(lot), 8.0, found.alignment, corridor) is None


@pytest.mark.thorough
def test_a_search_is_as_good_as_brute_force() -> None:
    path, corners = bend(12.0, 12, 8), [(0, 0), (52, -4), (60, 30), (38, 48), (4, 40)]
    lot, corridor, speed = Lot(corners, margin=0.5), (CorridorStretch(4.0, 16.0, 2.0, 3.0),), 4.0
    found = fit(path, geofence(lot), speed, corridor)
    assert found.whole
    swept = needed(path, corridor, speed)
    allowed = shapely.Polygon(corners).buffer(-0.5)
    best = best_clearance(swept, allowed)
    assert best > 0.0
    assert found.clearance >= best - 0.05
    # What the fit says of its own place is so: all of the ground lies inside, by so much.
    a = found.alignment.inverse()
    c, s = math.cos(a.rotation), math.sin(a.rotation)
    placed = shapely.affinity.affine_transform(swept, (c, -s, s, c, a.x, a.y))
    assert allowed.contains(placed)
    assert allowed.boundary.distance(placed) == pytest.approx(found.clearance, abs=0.02)


#: 5 m to both sides of the path
STRIP = Lot([(-30.0, -6.0), (120.0, -6.0), (120.0, 6.0), (-30.0, 6.0)])


@pytest.mark.thorough(witnesses=1)
@pytest.mark.parametrize(("left", "right", "over"), [(4.5, 0.0, 0.426), (1.0, 5.0, 0.926), (0.0, 4.07, 0.0)])
def test_what_sticks_out_is_told_by_place_side_and_distance(left: float, right: float, over: float) -> None:
    corridor = (CorridorStretch(25.0, 30.0, 1.0, 1.0), CorridorStretch(40.0, 50.0, left, right))
    excess = corridor_excess(STRAIGHT, geofence(STRIP), SPEED, Alignment(), corridor)
    found = measured(STRAIGHT, geofence(STRIP), SPEED, Alignment(), corridor)
    assert found is not None
    if not over:
        assert excess is None
        assert found.whole
        return
    assert excess is not None
    assert excess.begin == 40.0
    assert 40.0 <= excess.s <= 50.0
    assert excess.d == pytest.approx(left if left > right else -right)
    assert excess.distance == pytest.approx(over, abs=0.01)
    side = f"{left:.1f} m left" if left > right else f"{right:.1f} m right"
    assert "from 40 m on, the corridor leaves the lot" in excess.text()
    assert f"from {side} of the path, a stop reaches {over:.1f} m over the margin" in excess.text()
    assert not found.whole
    assert found.last_s == 39.0


@pytest.mark.thorough
def test_a_pole_inside_the_corridor_is_told_too() -> None:
    pole = [(45.0, 3.0), (45.4, 3.0), (45.4, 3.4), (45.0, 3.4)]
    lot = Lot([(-30.0, -20.0), (500.0, -20.0), (500.0, 20.0), (-30.0, 20.0)], [pole], margin=0.5)
    path = ReferencePath.from_points(np.arange(0.0, 61.0), np.zeros(61))
    assert corridor_excess(path, geofence(lot), SPEED, Alignment(), (CorridorStretch(0.0, 60.0, 1.4, 9.0),)) is None
    excess = corridor_excess(path, geofence(lot), SPEED, Alignment(), (CorridorStretch(0.0, 60.0, 5.0, 0.0),))
    assert excess is not None
    assert excess.distance == pytest.approx(0.7, abs=0.05)  # from the middle of the pole to its edge, and the margin


def test_where_the_path_itself_leaves_the_lot_the_corridor_is_not_blamed() -> None:
    long = ReferencePath.from_points(np.arange(0.0, 115.0), np.zeros(115))
    corridor = (CorridorStretch(0.0, math.inf, 1.0, 0.0),)
    assert corridor_excess(long, geofence(STRIP), SPEED, Alignment(), corridor) is None
    cut = shortened(long, geofence(STRIP), SPEED, 115.0, corridor)
    assert geofence(STRIP).along(cut, SPEED, corridor) is None
    wide = (CorridorStretch(70.0, math.inf, 5.0, 0.0),)
    assert shortened(long, geofence(STRIP), SPEED, 115.0, wide).length == pytest.approx(69.0, abs=1.5)


@pytest.mark.thorough
def test_a_lot_that_takes_the_corridor_takes_the_drive_that_leaves_the_path() -> None:
    """Closed loop: the car goes around something 2.5 m to the left.

    Where the path lies in the middle of the lot the geofence stops the car, where the corridor does it does not.
    """
    around = over_and_back((20.0, 55.0, 56.0, 91.0), 2.5)
    path = straight(100.0)
    # On its way over it heads out of the corridor, and a stop straight on leads so far out as docs/live.md says.
    stop = max(GATEWAY.distance(SPEED), WATCHDOG.distance(SPEED)) + VEHICLE.rear_axle_to_bumper
    u = np.linspace(0.0, 1.0, 1000)
    step, slope = u**3 * (10.0 - 15.0 * u + 6.0 * u * u), 30.0 * (u * (1.0 - u)) ** 2
    out = 2.5 * (float((step + stop / 35.0 * slope).max()) - 1.0)
    assert out == pytest.approx(1.02, abs=0.02)
    corridor = (CorridorStretch(20.0, 91.0, 2.5 + out, out),)
    lot = Lot([(-5.0, -5.3), (130.0, -5.3), (130.0, 2.5), (-5.0, 2.5)], margin=0.5)

    def driven(y: float) -> tuple[float, bool]:
        fence = Geofence(lot, VEHICLE, Alignment(0.0, 0.0, -y), gateway=GATEWAY, watchdog=WATCHDOG)
        controller = Swerver(VEHICLE, around, SPEED)
        loop = ClosedLoop(path, SPEED, controller=controller, pipeline=partial(Pipeline, geofence=fence))
        stopped = False
        for ticked in loop.ticks():
            stopped |= "geofence_breach" in ticked.found
            if ticked.truth.x > 100.0 or (ticked.truth.x > 5.0 and ticked.truth.speed < 0.01):
                return ticked.truth.x, stopped
            assert ticked.now < 60.0
        raise AssertionError("ticks never end by themselves")

    fence, middle = geofence(lot), -1.4
    beside = middle - 1.25  # of the path, so that the corridor is in the middle
    for y, fits in ((middle, False), (beside, True)):
        alignment = Alignment(0.0, 0.0, -y)
        alone, found = (measured(path, fence, SPEED, alignment, one) for one in ((), corridor))
        assert alone is not None
        assert alone.whole
        assert found is not None
        assert found.whole is fits
        assert (corridor_excess(path, fence, SPEED, alignment, corridor) is None) is fits
    assert driven(beside) == (pytest.approx(100.0, abs=0.5), False)
    x, stopped = driven(middle)
    assert stopped
    assert x < 60.0


def test_the_page_says_how_much_room_the_way_over_takes() -> None:
    text = (REPOSITORY / "docs" / "live.md").read_text(encoding="utf-8")
    section = text.partition("### Room beside the path: the corridor")[2].partition("\n## ")[0]
    rows = [[cell.strip() for cell in line.strip("| ").split("|")] for line in section.splitlines() if line[:1] == "|"]
    ratios, _line, shares = rows
    u = np.linspace(0.0, 1.0, 10_001)
    step, slope = u**3 * (10.0 - 15.0 * u + 6.0 * u * u), 30.0 * (u * (1.0 - u)) ** 2
    for ratio, share in zip(ratios[1:], shares[1:], strict=True):
        assert float(share) == pytest.approx(float((step + float(ratio) * slope).max()) - 1.0, abs=0.006)
    (block,) = re.findall(r"```toml\n(.*?)```", section, re.DOTALL)
    (stretch,) = tomllib.loads(block)["ego"]["corridor"]
    assert DeclaredStretch.model_validate(stretch) == DeclaredStretch(from_m=600.0, to_m=680.0, left_m=4.5, right_m=1.0)
