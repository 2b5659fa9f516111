"""The fence: fallback paths against closed forms and against brute force over steering, time and body."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from tests import vehicles
from vve_sumo.frames import Alignment
from vve_sumo.lot.geofence import GEOFENCE_BREACH, JERK, Geofence, StopModel
from vve_sumo.lot.polygon import Lot
from vve_sumo.lot.turning import Turning
from vve_sumo.path import ReferencePath
from vve_sumo.physical_constants import GRAVITY
from vve_sumo.values import DeferredFallbackPath, FallbackPath, Point, Pose

VEHICLE = vehicles.FUSION.vehicle
GATEWAY, WATCHDOG = StopModel(2.4, 0.16, 0.48, 0.25), StopModel(2.5, 0.22, 0.0, 0.25)
LANE = [(-20.0, -30.0), (100.0, -30.0), (100.0, 30.0), (-20.0, 30.0)]
BODY = np.array([[3.84, 0.926], [-1.032, 0.926], [-1.032, -0.926], [3.84, -0.926]])


def pose(x: float = 0.0, y: float = 0.0, heading: float = 0.0, speed: float = 8.0, gaining: float = 0.0) -> Pose:
    return Pose(0.0, Point.REAR_AXLE, x, y, heading, speed, 0.0, 0.0, gaining, 0.0)


def geofence(lot: Lot, alignment: Alignment = Alignment(), downhill: float = 0.0) -> Geofence:  # noqa: B008
    return Geofence(lot, VEHICLE, alignment, gateway=GATEWAY, watchdog=WATCHDOG, downhill=downhill)


@pytest.mark.parametrize(
    ("kmh", "delay", "deceleration", "jerk", "metres"),
    [
        *((v, 0.1, 9.0, 30.0, d) for v, d in ((20, 3.07), (40, 9.60), (60, 19.57), (80, 32.96))),
        *((v, 0.3, 6.0, 12.0, d) for v, d in ((20, 5.57), (40, 16.34), (60, 32.25), (80, 53.31))),
    ],
)
def test_distances_on_the_level_are_the_textbooks(
    kmh: float, delay: float, deceleration: float, jerk: float, metres: float
) -> None:
    stop = StopModel(deceleration, delay, deceleration / jerk)
    gained = 0.5 * JERK * delay**2
    assert stop.distance(kmh / 3.6 - gained) == pytest.approx(metres, abs=0.006)


@settings(deadline=None)
@given(
    speed=st.floats(0.0, 17.0),
    gaining=st.floats(-3.0, 2.0),
    downhill=st.floats(0.0, 0.1),
    deceleration=st.floats(2.0, 8.0),
    delay=st.floats(0.0, 0.5),
    rise=st.floats(0.0, 0.6),
    jerk=st.floats(0.5, 100.0),
    asked=st.floats(0.5, 5.0),
)
def test_no_car_that_does_what_is_declared_goes_farther(
    speed: float,
    gaining: float,
    downhill: float,
    deceleration: float,
    delay: float,
    rise: float,
    jerk: float,
    asked: float,
) -> None:
    stop = StopModel(deceleration, delay, rise, 0.25, jerk, asked)
    v, s, t, step = speed, 0.0, 0.0, 2e-3
    drive = max(gaining, 0.0)
    while v > 0.0 or t == 0.0:
        since = t + 0.5 * step - delay
        # The drive force grows as a setpoint may ask until the brakes set in, then fades; the brakes rise.
        pressed = max(drive, min(drive + jerk * min(t, delay), asked))
        force = pressed if since < 0.0 else pressed * math.exp(-since / 0.25)
        brake = 0.0 if since < 0.0 else deceleration * (min(since / rise, 1.0) if rise else 1.0)
        a = force - brake + GRAVITY * downhill
        s, v, t = s + max(v + 0.5 * a * step, 0.0) * step, v + a * step, t + step
    # The brakes set in between two steps of this integration.
    assert stop.distance(speed, gaining, downhill) >= s * (1.0 - 1e-4) - 0.005 - speed * step


def test_a_throttle_that_may_jump_costs_the_way_that_it_adds() -> None:
    """Closed form: 2 m/s2 from the start on but for a rise of 0.1 s, then fading with 0.25 s."""
    jumping = replace(GATEWAY, jerk=20.0)
    gained = 2.0 * (0.16 - 0.05 + 0.25)
    still = replace(GATEWAY, acceleration=1e-9)
    assert jumping.distance(5.0) == pytest.approx(still.distance(5.0 + gained), abs=1e-6)
    assert jumping.distance(5.0) > GATEWAY.distance(5.0) + 0.5


def test_brakes_weaker_than_the_slope_never_stop() -> None:
    assert StopModel(1.0, 0.1).distance(5.0, downhill=0.12) == math.inf
    assert geofence(Lot(LANE), downhill=0.3).check(pose(speed=1.0), 0.0, None) == GEOFENCE_BREACH


def test_a_wall_ahead_is_told_at_the_metre_where_the_car_could_just_stop() -> None:
    lot = Lot(LANE, margin=1.0)
    farthest = max(GATEWAY.distance(8.0), WATCHDOG.distance(8.0)) + VEHICLE.rear_axle_to_bumper
    last = 100.0 - 1.0 - farthest
    assert geofence(lot).check(pose(last - 0.01), 0.0, None) == ()
    assert geofence(lot).check(pose(last + 0.01), 0.0, None) == GEOFENCE_BREACH
    assert geofence(lot).check(pose(last - 0.01, gaining=1.0), 0.0, None) == GEOFENCE_BREACH
    assert geofence(lot, downhill=0.02).check(pose(last - 0.01), 0.0, None) == GEOFENCE_BREACH


def test_the_lot_lies_where_the_alignment_lays_it() -> None:
    lot, alignment = Lot(LANE), Alignment(2.0, 500.0, -300.0)
    here = alignment.apply(pose(60.0))
    assert geofence(lot, alignment).check(here, 0.0, None) == geofence(lot).check(pose(60.0), 0.0, None) == ()
    assert geofence(lot, alignment).check(pose(60.0), 0.0, None) == GEOFENCE_BREACH
    assert geofence(lot).aligned(alignment).check(here, 0.0, None) == ()


def test_each_way_to_rest_counts() -> None:
    # A pillar ahead to the left, which only a turned wheel meets; one ahead, from which turning away saves nobody.
    turned = math.atan(VEHICLE.wheelbase * 0.05)
    away, into = FallbackPath(1.0, (0.0,) + (-0.05,) * 30), FallbackPath(1.0, (0.0,) + (0.05,) * 30)

    def with_pillar(x: float, y: float) -> Geofence:
        return geofence(Lot(LANE, [[(x, y), (x + 0.5, y), (x + 0.5, y + 0.5), (x, y + 0.5)]], margin=0.2))

    left = with_pillar(15.0, 6.0)
    assert left.check(pose(), 0.0, None) == ()
    assert left.check(pose(), 0.0, into) == GEOFENCE_BREACH
    assert left.check(pose(), 0.0, away) == ()
    assert left.check(pose(), turned, away) == GEOFENCE_BREACH
    ahead = with_pillar(15.0, -0.2)
    assert ahead.check(pose(), turned, into) == GEOFENCE_BREACH
    assert ahead.check(pose(y=10.0), turned, into) == ()


def test_a_profile_that_is_too_short_goes_on_as_it_ends() -> None:
    lot = Lot(LANE, [[(15.0, 5.5), (15.5, 5.5), (15.5, 6.0), (15.0, 6.0)]], margin=0.2)
    assert geofence(lot).check(pose(), 0.0, FallbackPath(1.0, (0.0, 0.05))) == GEOFENCE_BREACH
    assert geofence(lot).check(pose(), 0.0, FallbackPath(1.0, (0.05, 0.0))) == ()


@pytest.mark.parametrize("field", ["x", "y", "heading", "speed", "acceleration"])
@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_a_pose_that_is_not_finite_is_outside(field: str, bad: float) -> None:
    here = replace(pose(), **{field: bad})
    if (field, bad) != ("acceleration", -math.inf):
        assert geofence(Lot(LANE)).check(here, 0.0, None) == GEOFENCE_BREACH


@pytest.mark.parametrize("asked", [(math.nan, 0.0), (0.0, math.nan), (-math.inf, 0.0), (-math.inf, math.inf)])
def test_requests_that_are_not_finite_are_a_breach(asked: tuple[float, float]) -> None:
    assert geofence(Lot(LANE)).check(pose(), 0.0, None, requested=(0.0, 0.0)) == ()
    assert geofence(Lot(LANE)).check(pose(), 0.0, None, requested=asked) == GEOFENCE_BREACH


def test_a_car_that_rolls_backwards_may_be_turned_as_one_that_nobody_leads() -> None:
    """No profile leads backwards: ground that only a wheel turned by the last setpoints reaches is checked with one."""
    fence = Geofence(
        Lot(LANE), VEHICLE, Alignment(), gateway=GATEWAY, watchdog=WATCHDOG, turning=Turning.of(VEHICLE, 5.0, 0.13, 2.0)
    )
    ahead = FallbackPath(0.5, (0.0,) * 60)
    places = [(40.0, y) for y in np.arange(24.0, 30.0, 0.05)]
    led = [fence.check(pose(x, y, speed=-5.0), 0.0, ahead) for x, y in places]
    alone = [fence.check(pose(x, y, speed=-5.0), 0.0, None) for x, y in places]
    assert led == alone
    assert {(), GEOFENCE_BREACH} == set(alone)
    held = geofence(Lot(LANE))
    assert [held.check(pose(x, y, speed=-5.0), 0.0, None) for x, y in places].count(()) > alone.count(())


@pytest.mark.parametrize(
    ("steering", "fallback_path"),
    [
        (math.nan, None),
        (0.0, FallbackPath(math.nan, (0.0, 0.0))),
        (0.0, FallbackPath(0.0, (0.0, 0.0))),
        (0.0, FallbackPath(1e-9, (0.0, 0.0))),
        (0.0, FallbackPath(1.0, ())),
        (0.0, FallbackPath(1.0, (0.0, math.nan))),
    ],
)
def test_a_way_that_is_none_is_refused_near_an_edge(steering: float, fallback_path: FallbackPath | None) -> None:
    assert geofence(Lot(LANE)).check(pose(60.0, 20.0), steering, fallback_path) == GEOFENCE_BREACH


def swept(start: Pose, curvature: np.ndarray, distance: float) -> np.ndarray:
    """Corners of the body at many places along a way, each (4, 2): an integration of its own."""
    step = distance / len(curvature)
    x, y, heading, bodies = start.x, start.y, start.heading, []
    for bend in [*curvature, 0.0]:
        turn = np.array([[math.cos(heading), math.sin(heading)], [-math.sin(heading), math.cos(heading)]])
        bodies.append(BODY @ turn + (x, y))
        x, y = x + step * math.cos(heading + 0.5 * bend * step), y + step * math.sin(heading + 0.5 * bend * step)
        heading += bend * step
    return np.array(bodies)


@pytest.mark.thorough
@settings(max_examples=120, deadline=None)
@given(
    x=st.floats(5.0, 75.0),
    y=st.floats(5.0, 45.0),
    heading=st.floats(-math.pi, math.pi),
    speed=st.floats(0.0, 9.0),
    sideways=st.floats(-2.5, 2.5),
    seed=st.integers(0, 2**31),
)
def test_dense_brute_force_finds_no_way_out_that_the_fence_missed(
    x: float, y: float, heading: float, speed: float, sideways: float, seed: int
) -> None:
    outline = [(0.0, 0.0), (80.0, 0.0), (80.0, 30.0), (45.0, 34.0), (50.0, 50.0), (0.0, 50.0)]
    pole = [(30.0, 22.0), (30.4, 22.0), (30.4, 22.4), (30.0, 22.4)]
    lot = Lot(outline, [pole], margin=0.5)
    random = np.random.default_rng(seed)
    start = pose(x, y, heading, speed)
    bend = float(np.clip(sideways / max(speed, 1.0) ** 2, -0.2, 0.2))
    steering = math.atan(VEHICLE.wheelbase * bend) + VEHICLE.understeer_gradient * bend * speed**2
    knots = np.interp(np.arange(32), np.arange(0, 36, 5), random.uniform(-0.1, 0.1, 8) / (1.0 + speed))
    fallback_path = FallbackPath(0.7, tuple(knots.tolist()))
    gateway, watchdog = GATEWAY.distance(speed), WATCHDOG.distance(speed)
    s = (np.arange(150) + 0.5) / 150
    relaxing = [bend * share * np.ones(150) for share in np.linspace(0.0, 1.0, 7)]
    relaxing += [np.where(s < part, bend, 0.0) for part in (0.2, 0.5, 0.8)]
    ways = [swept(start, history, watchdog) for history in relaxing]
    ways.append(swept(start, np.full(150, bend), gateway))
    ways.append(swept(start, np.interp(s * gateway / 0.7, np.arange(32), knots), gateway))
    bodies = shapely.polygons(np.concatenate(ways))
    ground = shapely.Polygon(outline, [pole])
    allowed = geofence(lot).check(start, steering, fallback_path) == ()
    if not shapely.covers(ground.buffer(-0.5), bodies).all():
        assert not allowed
    elif shapely.covers(ground.buffer(-1.3), bodies).all():
        assert allowed


def test_a_path_is_checked_as_a_whole() -> None:
    lot = Lot([(-10.0, -10.0), (100.0, -10.0), (100.0, 10.0), (-10.0, 10.0)], margin=1.0)
    into_the_wall = ReferencePath.from_points(np.arange(0.0, 95.0), np.zeros(95))
    reserve = max(GATEWAY.distance(8.0), WATCHDOG.distance(8.0)) + VEHICLE.rear_axle_to_bumper
    leaves = geofence(lot).along(into_the_wall, 8.0)
    assert leaves == math.ceil(99.0 - reserve)
    assert geofence(lot).along(ReferencePath.from_points(np.arange(0.0, 60.0), np.zeros(60)), 8.0) is None
    assert geofence(lot).along(ReferencePath.from_points(np.arange(-9.0, 60.0), np.zeros(69)), 8.0) == 0.0


def test_a_bend_is_checked_at_the_speed_that_it_allows() -> None:
    angle = np.linspace(0.0, math.pi / 2.0, 16)
    x = np.concatenate((np.arange(0.0, 40.0), 40.0 + 10.0 * np.sin(angle), np.full(20, 50.0)))
    y = np.concatenate((np.zeros(40), 10.0 - 10.0 * np.cos(angle), np.arange(11.0, 31.0)))
    path = ReferencePath.from_points(x, y)
    places = geofence(Lot(LANE)).driven(path, 15.0)
    fastest = max(place.pose.speed for place in places)
    in_bend = [place.pose.speed for place in places if 42.0 < place.s < 54.0]
    assert max(in_bend) <= math.sqrt(3.0 * 10.0) + 0.5
    assert 6.0 < fastest < 15.0
    assert places[0].pose.speed == 0.0


def test_a_deferred_fallback_path_is_computed_only_near_an_edge_and_judged_there_like_any_other() -> None:
    astray, straight = FallbackPath(1.0, (0.15,) * 32), FallbackPath(1.0, (0.0,) * 32)
    fence, computed = geofence(Lot(LANE)), []

    def deferred(path: FallbackPath) -> DeferredFallbackPath:
        return DeferredFallbackPath(lambda: computed.append(path) or path)

    assert fence.check(pose(40.0), 0.0, deferred(astray)) == ()
    assert not computed
    for path in (astray, straight):
        near = pose(40.0, 24.0)
        assert fence.check(near, 0.0, deferred(path)) == fence.check(near, 0.0, path)
        assert computed.pop() is path
    assert fence.check(near, 0.0, astray) != fence.check(near, 0.0, straight)
