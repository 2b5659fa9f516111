"""Frames against geodesics and earth-centred arithmetic that share no code with them."""

from __future__ import annotations

import math
import random
from dataclasses import replace

import numpy as np
import pyproj
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.fixes import GOOD
from vve_sumo.errors import ConfigError
from vve_sumo.frames import Alignment, MapFrame, Mounting, Placement, move_point, wrap_angle
from vve_sumo.values import Point, Pose

LINDEN = "+proj=tmerc +lat_0=40.01 +lon_0=-82.98 +k=1 +x_0=0 +y_0=0 +ellps=WGS84 +units=m +no_defs"
UTM17 = "+proj=utm +zone=17 +ellps=WGS84 +datum=WGS84 +units=m +no_defs"
UTM56S = "+proj=utm +zone=56 +south +ellps=WGS84 +datum=WGS84 +units=m +no_defs"
EPOCH = 1_300_000_000.0
MILLIMETRE = 1e-3
MILLIDEGREE = math.radians(1e-3)


def pose_at(x=0.0, y=0.0, heading=0.0, point=Point.REAR_AXLE, **rest) -> Pose:
    zero = {"speed": 0.0, "lateral_speed": 0.0, "yaw_rate": 0.0, "acceleration": 0.0, "grade": 0.0}
    return Pose(time=0.0, point=point, x=x, y=y, heading=heading, **(zero | rest))


def fix_of(latitude_deg, longitude_deg, compass_deg, north=0.0, east=0.0, yaw_rate=0.0, pitch=0.0, acceleration=0.0):
    return replace(
        GOOD,
        time=EPOCH + 12.25,
        time_received=12.3,
        latitude=math.radians(latitude_deg),
        longitude=math.radians(longitude_deg),
        heading=wrap_angle(math.radians(90.0 - compass_deg)),
        pitch=pitch,
        velocity_north=north,
        velocity_east=east,
        yaw_rate=yaw_rate,
        acceleration=acceleration,
    )


# --- projection -------------------------------------------------------------------------------------------------------


def east_north_up(latitude_deg, longitude_deg, latitude_0_deg, longitude_0_deg):
    """Tangent-plane east and north [m] on the WGS84 ellipsoid, by earth-centred coordinates."""

    def earth_centred(latitude, longitude):
        square = 6.69437999014e-3
        normal = 6_378_137.0 / math.sqrt(1.0 - square * math.sin(latitude) ** 2)
        flat = normal * math.cos(latitude)
        return np.array(
            [flat * math.cos(longitude), flat * math.sin(longitude), normal * (1 - square) * math.sin(latitude)]
        )

    lat, lon = math.radians(latitude_0_deg), math.radians(longitude_0_deg)
    away = earth_centred(math.radians(latitude_deg), math.radians(longitude_deg)) - earth_centred(lat, lon)
    east = -math.sin(lon) * away[0] + math.cos(lon) * away[1]
    north = -math.sin(lat) * (math.cos(lon) * away[0] + math.sin(lon) * away[1]) + math.cos(lat) * away[2]
    return east, north


def test_a_local_map_is_the_tangent_plane():
    frame = MapFrame(LINDEN, (1000.0, 2000.0))
    for latitude, longitude in [(40.01, -82.98), (40.012, -82.978), (40.0085, -82.9815)]:
        x, y = frame.to_map(math.radians(latitude), math.radians(longitude))
        east, north = east_north_up(latitude, longitude, 40.01, -82.98)
        assert x - 1000.0 == pytest.approx(east, abs=MILLIMETRE)
        assert y - 2000.0 == pytest.approx(north, abs=MILLIMETRE)


@pytest.mark.parametrize("projection", [LINDEN, UTM17])
def test_map_distances_and_directions_are_those_of_the_geodesic(projection):
    frame, geodesic = MapFrame(projection, (-300.0, 70.0)), pyproj.Geod(ellps="WGS84")
    scale = pyproj.Proj(projection).get_factors(-82.98, 40.01).meridional_scale
    x0, y0 = frame.to_map(math.radians(40.01), math.radians(-82.98))
    turn = frame.convergence(math.radians(40.01), math.radians(-82.98))
    for azimuth in range(-170, 190, 20):
        longitude, latitude, _ = geodesic.fwd(-82.98, 40.01, azimuth, 100.0)
        x, y = frame.to_map(math.radians(latitude), math.radians(longitude))
        assert math.hypot(x - x0, y - y0) / scale == pytest.approx(100.0, abs=MILLIMETRE)
        direction = math.radians(90.0 - azimuth) + turn
        assert abs(wrap_angle(math.atan2(y - y0, x - x0) - direction)) < MILLIDEGREE


@given(st.floats(-0.02, 0.02), st.floats(-0.02, 0.02), st.sampled_from([LINDEN, UTM17]))
def test_geodetic_and_map_are_inverse(north, east, projection):
    frame = MapFrame(projection, (12.5, -7.25))
    latitude, longitude = math.radians(40.01) + north, math.radians(-82.98) + east
    x, y = frame.to_map(latitude, longitude)
    back = frame.to_geodetic(x, y)
    assert back == pytest.approx((latitude, longitude), abs=1e-12)


@pytest.mark.parametrize(
    ("projection", "middle"), [(LINDEN, (40.01, -82.98)), (UTM17, (40.0, -81.0)), (UTM56S, (-33.9, 153.0))]
)
def test_convergence_is_proj_s(projection, middle):
    frame, proj = MapFrame(projection), pyproj.Proj(projection)
    for north in range(-30, 31, 5):
        for east in (-3.5, -3, -2, -1.98, -0.5, 0, 0.01, 1, 2, 3, 3.5):
            latitude, longitude = middle[0] + north, middle[1] + east
            expected = math.radians(proj.get_factors(longitude, latitude).meridian_convergence)
            got = frame.convergence(math.radians(latitude), math.radians(longitude))
            assert abs(got - expected) < MILLIDEGREE / 100


@pytest.mark.parametrize(
    "beside",
    [
        "+geoidgrids=egm96_15.gtx +vunits=m +no_defs ",  # as netconvert writes it of a town of CARLA's
        "+geoidgrids=egm96_15.gtx,egm08_25.gtx",
        "+geoidgrids=@egm96_15.gtx",
        "+vunits=us-ft",
        "+vto_meter=0.3048",
        "+towgs84=0,0,0",
        "+towgs84=0,0,0,0,0,0,0 +no_defs",
        "+nadgrids=@null",
    ],
)
def test_heights_and_a_datum_that_is_wgs84_s_leave_the_map_as_it_is(beside):
    plain, frame = MapFrame(LINDEN), MapFrame(LINDEN.replace("+no_defs", beside))
    place = math.radians(40.012), math.radians(-82.978)
    assert frame.to_map(*place) == plain.to_map(*place)
    assert frame.to_geodetic(100.0, -200.0) == plain.to_geodetic(100.0, -200.0)
    assert frame.convergence(*place) == plain.convergence(*place) != 0.0


def test_convergence_turns_a_true_heading_onto_the_map_by_this_sign():
    """Linden lies west of UTM zone 17's middle: there true north leans right on the map, so headings lose 1.27 deg."""
    assert math.degrees(MapFrame(UTM17).convergence(math.radians(40.0), math.radians(-82.98))) == pytest.approx(
        -1.273, abs=1e-3
    )
    assert MapFrame(LINDEN).convergence(math.radians(40.01), math.radians(-82.98)) == 0.0


@pytest.mark.parametrize(
    ("projection", "word"),
    [
        ("!", "not understood"),
        ("-", "not understood"),
        ("", "not understood"),
        ("nonsense", "not understood"),
        ("+proj=utm", "not understood"),
        ("+proj=longlat +datum=WGS84", "longlat"),
        ("EPSG:4326", "longlat"),
        ("EPSG:3857", "merc"),
        ("+proj=geocent", "geocent"),
        ("+proj=tmerc +lat_0=40 +lon_0=-83 +units=us-ft", "foot"),
        ("+proj=tmerc +lat_0=40 +lon_0=-83 +ellps=intl", "WGS84"),
        ("+proj=tmerc +lat_0=40 +lon_0=-83 +datum=WGS84 +nadgrids=absent.gsb", "not understood"),
        ("+proj=utm +zone=33 +ellps=GRS80 +towgs84=1,0,0,0,0,0,0 +units=m", "a shift of datum"),
        ("+proj=tmerc +lat_0=40 +lon_0=-83 +datum=WGS84 +pm=paris", "east of Greenwich"),
        ("+proj=tmerc +lon_0=1e9 +datum=WGS84", "east of Greenwich"),
    ],
)
def test_nonsense_projections_are_refused_with_their_name(projection, word):
    with pytest.raises(ConfigError, match=word) as caught:
        MapFrame(projection)
    assert repr(projection) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_an_offset_must_be_finite():
    with pytest.raises(ConfigError, match="offset"):
        MapFrame(LINDEN, (0.0, math.nan))


# --- body -------------------------------------------------------------------------------------------------------------

metres = st.floats(-10.0, 10.0)
turn = st.floats(-math.pi, math.pi)


@given(turn, metres, metres, metres, metres, st.floats(-2.0, 2.0))
def test_moving_a_point_there_and_back(heading, dx, dy, speed, lateral, yaw_rate):
    pose = pose_at(100.0, -50.0, heading, speed=speed, lateral_speed=lateral, yaw_rate=yaw_rate, acceleration=0.5)
    there = move_point(pose, dx, dy, Point.FRONT_BUMPER)
    back = move_point(there, -dx, -dy, Point.REAR_AXLE)
    assert there.point is Point.FRONT_BUMPER
    assert (back.x, back.y) == pytest.approx((pose.x, pose.y), abs=1e-9)
    assert (back.speed, back.lateral_speed) == pytest.approx((speed, lateral), abs=1e-9)


def test_a_moved_point_s_velocity_is_the_derivative_of_its_position():
    """The rear axle on a circle of 20 m at 5 m/s; the bumper's velocity by differences of its positions."""
    radius, speed, step = 20.0, 5.0, 1e-5
    rate = speed / radius

    def bumper(time):
        angle = rate * time
        rear = pose_at(radius * math.sin(angle), radius * (1 - math.cos(angle)), angle, speed=speed, yaw_rate=rate)
        return move_point(rear, 3.84, 0.5, Point.FRONT_BUMPER)

    before, now, after = bumper(2.0 - step), bumper(2.0), bumper(2.0 + step)
    vx, vy = (after.x - before.x) / (2 * step), (after.y - before.y) / (2 * step)
    cosine, sine = math.cos(now.heading), math.sin(now.heading)
    assert now.speed == pytest.approx(vx * cosine + vy * sine, abs=1e-6)
    assert now.lateral_speed == pytest.approx(vy * cosine - vx * sine, abs=1e-6)


# --- lot and street ---------------------------------------------------------------------------------------------------


@given(turn, st.floats(-1e4, 1e4), st.floats(-1e4, 1e4), turn, metres, metres)
def test_alignment_and_its_inverse(rotation, x, y, heading, px, py):
    alignment = Alignment(rotation, x, y)
    pose = pose_at(px, py, heading)
    back = alignment.inverse().apply(alignment.apply(pose))
    assert (back.x, back.y) == pytest.approx((px, py), abs=1e-8)
    assert abs(wrap_angle(back.heading - heading)) < 1e-12


@given(metres, metres, turn, metres, metres, turn)
def test_matched_start_lays_one_pose_onto_the_other(lot_x, lot_y, lot_heading, x, y, heading):
    lot, street = pose_at(lot_x, lot_y, lot_heading), pose_at(x, y, heading)
    got = Alignment.from_matched_start(lot, street).apply(lot)
    assert (got.x, got.y) == pytest.approx((x, y), abs=1e-9)
    assert abs(wrap_angle(got.heading - heading)) < 1e-12


def test_matched_start_of_different_points_is_refused():
    with pytest.raises(ConfigError, match="front_bumper"):
        Alignment.from_matched_start(pose_at(point=Point.FRONT_BUMPER), pose_at())
    with pytest.raises(ConfigError, match="finite"):
        Alignment.from_matched_start(pose_at(math.nan), pose_at())


LOT = [(0.0, 0.0), (80.0, 5.0), (70.0, 60.0), (-10.0, 45.0)]


def carried(points, rotation, x, y, scale=1.0, mirror=1.0):
    cosine, sine = math.cos(rotation), math.sin(rotation)
    return [
        (scale * (cosine * px - sine * mirror * py) + x, scale * (sine * px + cosine * mirror * py) + y)
        for px, py in points
    ]


@given(turn, st.floats(-5e3, 5e3), st.floats(-5e3, 5e3), st.integers(2, 4))
def test_exact_pairs_give_the_exact_alignment(rotation, x, y, count):
    got = Alignment.from_surveyed_pairs(LOT[:count], carried(LOT[:count], rotation, x, y), 0.01)
    assert abs(wrap_angle(got.rotation - rotation)) < 1e-9
    assert (got.x, got.y) == pytest.approx((x, y), abs=1e-8)
    assert max(got.residuals) < 1e-8
    assert len(got.residuals) == count


def test_noisy_pairs_give_what_the_singular_value_decomposition_gives():
    chance = random.Random(4)
    street = [(x + chance.gauss(0, 0.03), y + chance.gauss(0, 0.03)) for x, y in carried(LOT, 2.2, 900.0, -30.0)]
    got = Alignment.from_surveyed_pairs(LOT, street, 0.2)
    lot, target = np.array(LOT), np.array(street)
    u, _, vt = np.linalg.svd((lot - lot.mean(0)).T @ (target - target.mean(0)))
    matrix = vt.T @ np.diag([1.0, np.sign(np.linalg.det(vt.T @ u.T))]) @ u.T
    shift = target.mean(0) - matrix @ lot.mean(0)
    assert got.rotation == pytest.approx(math.atan2(matrix[1, 0], matrix[0, 0]), abs=1e-12)
    assert (got.x, got.y) == pytest.approx(tuple(shift), abs=1e-9)
    residuals = np.linalg.norm(lot @ matrix.T + shift - target, axis=1)
    assert got.residuals == pytest.approx(tuple(residuals), abs=1e-9)


@pytest.mark.parametrize(
    ("lot", "street", "word"),
    [
        (LOT[:1], LOT[:1], "two or more"),
        (LOT, LOT[:3], "4 lot points but 3"),
        ([(1.0, 1.0)] * 3, LOT[:3], "one spot"),
        (LOT[:3], [(1.0, 1.0)] * 3, "one spot"),
        (LOT, [*LOT[:3], (math.nan, 0.0)], "not finite"),
        (LOT, carried(LOT, 0.4, 9.0, 9.0, mirror=-1.0), "mirrored"),
        (LOT, [(y, x) for x, y in LOT], "mirrored"),
        (LOT, carried(LOT, 0.4, 9.0, 9.0, scale=1 / 0.3048), "3.2808 times"),
        (LOT[:2], carried(LOT[:2], 0.4, 9.0, 9.0, scale=1.02), "1.0200 times"),
        (LOT, [*LOT[:3], (-10.0, 46.5)], "pair 4"),
    ],
)
def test_pairs_that_cannot_be_one_place_are_refused_with_the_cause(lot, street, word):
    with pytest.raises(ConfigError, match=word):
        Alignment.from_surveyed_pairs(lot, street, 0.15)


# --- the whole placement ----------------------------------------------------------------------------------------------

LOT_MAP = "+proj=tmerc +lat_0=40.31 +lon_0=-83.55 +k=1 +x_0=0 +y_0=0 +ellps=WGS84 +units=m +no_defs"  # another town
MOUNTING = Mounting(forward=1.25, left=-0.4, heading_misalignment=math.radians(0.7))


def independent_rear_axle(projection, offset, latitude, longitude, compass, mounting):
    """Map x, y and heading of the rear axle by walking geodesics from the output point; no code of frames.py."""
    geodesic, proj = pyproj.Geod(ellps="WGS84"), pyproj.Proj(projection)
    car = compass + math.degrees(mounting.heading_misalignment)  # counter-clockwise misalignment lowers the compass
    for azimuth, distance in ((car + 180.0, mounting.forward), (car + 90.0, mounting.left)):
        longitude, latitude, _ = geodesic.fwd(longitude, latitude, azimuth, distance)
    x, y = proj(longitude, latitude)
    ahead = proj(*geodesic.fwd(longitude, latitude, car, 1.0)[:2])
    return x + offset[0], y + offset[1], math.atan2(ahead[1] - y, ahead[0] - x)


CASES = [
    (projection, offset, latitude, longitude, compass)
    for projection, offset, latitude, longitude in [
        (LINDEN, (512.0, 256.0), 40.0123, -82.9776),
        (UTM17, (-327_000.0, -4_430_000.0), 40.0123, -82.9776),
        (UTM17, (0.0, 0.0), 39.5, -78.2),
        (UTM56S, (0.0, 0.0), -33.9, 151.2),
    ]
    for compass in (0.0, 37.0, 123.0, 200.0, 350.0)
]


@pytest.mark.parametrize(("projection", "offset", "latitude", "longitude", "compass"), CASES)
def test_a_fix_on_the_true_place_agrees_with_geodesics(projection, offset, latitude, longitude, compass):
    x, y, heading = independent_rear_axle(projection, offset, latitude, longitude, compass, MOUNTING)
    placement = Placement(MapFrame(projection, offset), Alignment(), MOUNTING, EPOCH)
    pose = placement.place(fix_of(latitude, longitude, compass))
    assert pose.point is Point.REAR_AXLE
    assert pose.time == 12.25
    assert math.hypot(pose.x - x, pose.y - y) < MILLIMETRE
    assert abs(wrap_angle(pose.heading - heading)) < MILLIDEGREE


@pytest.mark.parametrize(
    "wrong",
    [
        Mounting(1.25 + 0.005, -0.4, math.radians(0.7)),
        Mounting(1.25, 0.4, math.radians(0.7)),
        Mounting(1.25, -0.4, math.radians(-0.7)),
        Mounting(1.25, -0.4, 0.0),
    ],
)
def test_a_wrong_lever_arm_or_misalignment_would_be_seen(wrong):
    case = CASES[1]
    x, y, heading = independent_rear_axle(*case, MOUNTING)
    pose = Placement(MapFrame(*case[:2]), Alignment(), wrong, EPOCH).place(fix_of(*case[2:]))
    assert math.hypot(pose.x - x, pose.y - y) > MILLIMETRE or abs(wrap_angle(pose.heading - heading)) > MILLIDEGREE


@pytest.mark.parametrize("factor", [0.0, -1.0, 0.999])
def test_a_wrong_convergence_would_be_seen(factor, monkeypatch):
    right = MapFrame.convergence
    monkeypatch.setattr(MapFrame, "convergence", lambda *arguments: factor * right(*arguments))
    case = CASES[5]
    *_, heading = independent_rear_axle(*case, MOUNTING)
    pose = Placement(MapFrame(*case[:2]), Alignment(), MOUNTING, EPOCH).place(fix_of(*case[2:]))
    assert abs(wrap_angle(pose.heading - heading)) > MILLIDEGREE


def test_a_lot_elsewhere_is_laid_onto_the_street_without_stretching():
    """Two fixes 60 m apart in another town are 60 m apart on the virtual road, in the direction the alignment says."""
    geodesic = pyproj.Geod(ellps="WGS84")
    lot = MapFrame(LOT_MAP)
    at = Placement(lot, Alignment(), MOUNTING, EPOCH).place(fix_of(40.311, -83.552, 20.0))
    street_start = pose_at(700.0, 350.0, math.radians(5.0))
    placement = Placement(lot, Alignment.from_matched_start(at, street_start), MOUNTING, EPOCH)
    first = placement.place(fix_of(40.311, -83.552, 20.0))
    assert (first.x, first.y) == pytest.approx((700.0, 350.0), abs=1e-6)
    assert first.heading == pytest.approx(math.radians(5.0), abs=1e-9)
    longitude, latitude, _ = geodesic.fwd(-83.552, 40.311, 20.0 + math.degrees(MOUNTING.heading_misalignment), 60.0)
    second = placement.place(fix_of(latitude, longitude, 20.0))
    assert second.x - first.x == pytest.approx(60.0 * math.cos(math.radians(5.0)), abs=MILLIMETRE)
    assert second.y - first.y == pytest.approx(60.0 * math.sin(math.radians(5.0)), abs=MILLIMETRE)


def test_velocity_is_taken_along_the_car_and_moved_to_the_rear_axle():
    """Turning about the rear axle at 0.5 rad/s: the output point moves, the rear axle does not."""
    mounting = Mounting(2.0, 0.5)
    # heading east; omega x r of (2, 0.5) is (-0.25, 1.0)
    fix = fix_of(40.01, -82.98, 90.0, north=1.0, east=-0.25, yaw_rate=0.5)
    pose = Placement(MapFrame(LINDEN), Alignment(0.9, 3.0, 4.0), mounting, EPOCH).place(fix)
    assert (pose.speed, pose.lateral_speed) == pytest.approx((0.0, 0.0), abs=1e-9)
    assert pose.yaw_rate == 0.5


def test_gravity_and_turning_are_taken_out_of_the_acceleration():
    standing_uphill = fix_of(40.01, -82.98, 90.0, pitch=0.05, acceleration=9.80665 * math.sin(0.05))
    placement = Placement(MapFrame(LINDEN), Alignment(), Mounting(0.0, 0.0), EPOCH)
    pose = placement.place(standing_uphill)
    assert pose.acceleration == pytest.approx(0.0, abs=1e-12)
    assert pose.grade == 0.05
    # Constant velocity (3, 1) m/s of a body that turns at 0.4 rad/s: forward speed changes by rate times lateral speed.
    turning = fix_of(40.01, -82.98, 90.0, north=1.0, east=3.0, yaw_rate=0.4, acceleration=0.0)
    assert placement.place(turning).acceleration == pytest.approx(0.4)


@given(
    speed=st.floats(-5, 30),
    acceleration=st.floats(-8, 4),
    grade=st.floats(-0.2, 0.2),
    **dict.fromkeys(("x", "y"), st.floats(-400, 400)),
    **dict.fromkeys(("heading", "rotation"), turn),
    **dict.fromkeys(("lateral", "yaw_rate"), st.floats(-1, 1)),
    projection=st.sampled_from([LINDEN, UTM17]),
)
def test_place_undoes_unplace(x, y, heading, speed, lateral, yaw_rate, acceleration, grade, rotation, projection):
    origin = MapFrame(projection).to_map(math.radians(40.01), math.radians(-82.98))
    lot = MapFrame(projection, (-origin[0], -origin[1]))
    placement = Placement(lot, Alignment(rotation, 250.0, -75.0), MOUNTING, EPOCH)
    pose = Pose(12.5, Point.REAR_AXLE, x, y, heading, speed, lateral, yaw_rate, acceleration, grade)
    back = placement.place(placement.unplace(pose))
    assert (back.x, back.y) == pytest.approx((x, y), abs=1e-6)
    assert abs(wrap_angle(back.heading - heading)) < 1e-9
    for name in ("time", "speed", "lateral_speed", "yaw_rate", "acceleration", "grade"):
        assert getattr(back, name) == pytest.approx(getattr(pose, name), abs=1e-9), name


def test_a_fix_that_is_not_a_number_stays_so():
    pose = Placement(MapFrame(LINDEN), Alignment(), MOUNTING, EPOCH).place(fix_of(math.nan, -82.98, 90.0))
    assert not math.isfinite(pose.x + pose.y)
