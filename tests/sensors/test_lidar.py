"""The lidar: whole turns, the time of each ray, noise and lost rays, and what the record and a controller get."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.sensors.scenes import actors, car, rear_axle
from vve_sumo.sensors import lidar as lidar_module
from vve_sumo.sensors.lidar import Lidar, LidarConfig, LidarScan
from vve_sumo.sensors.ray_casting import WALL
from vve_sumo.sensors.street import Building, walls_of
from vve_sumo.values import Actors, Pose

PERIOD = 0.02
IDEAL = LidarConfig().ideal()
NO_WALLS = walls_of(())
#: the channel of an elevation in degrees
LASER = {round(math.degrees(elevation)): channel for channel, elevation in enumerate(IDEAL.elevations)}
HOUSE = walls_of([Building(((30.0, 10.0), (60.0, 10.0), (60.0, 30.0), (30.0, 30.0)), 6.0)])


def driven(
    config: LidarConfig, seconds: float, *, speed: float = 0.0, yaw_rate: float = 0.0, scene: Actors | None = None,
    walls: object = NO_WALLS, period: float = PERIOD, seed: int = 1,
) -> list[tuple[float, LidarScan]]:  # fmt: skip
    """The turns of a drive on a circle, each with the time of the tick in whose slack it was complete."""
    lidar, found = Lidar(config, np.random.default_rng(seed), walls), []  # type: ignore[arg-type]
    for tick in range(round(seconds / period) + 1):
        time = tick * period
        lidar.step(time, pose_at(time, speed, yaw_rate), scene or actors([car(20.0, 3.0)]))
        if (scan := lidar.prepare()) is not None:
            found.append((time, scan))
    return found


def pose_at(time: float, speed: float, yaw_rate: float) -> Pose:
    if yaw_rate == 0.0:
        return rear_axle(speed * time, 0.0, 0.0, speed)
    turned = yaw_rate * time
    radius = speed / yaw_rate
    return rear_axle(radius * math.sin(turned), radius * (1.0 - math.cos(turned)), turned, speed, yaw_rate)


# --- turns ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("rate", [5.0, 10.0, 20.0, 12.5])
def test_a_turn_is_complete_at_the_first_tick_after_its_last_ray(rate: float) -> None:
    config = replace(IDEAL, rate=rate)
    found = driven(config, 1.0)
    assert len(found) == int(rate)
    for number, (tick, scan) in enumerate(found):
        over = (number + 1) / rate
        assert scan.cloud.time == pytest.approx(over - config.firing_period)
        assert over - 1e-9 <= tick < over + PERIOD


def test_turns_before_drive_time_0_come_out_too() -> None:
    """As in a rolling start; and those from drive time 0 on are what they are without it."""
    lidar = Lidar(IDEAL, np.random.default_rng(1), NO_WALLS)
    times, last = [], None
    for tick in range(-50, 11):
        lidar.step(tick * PERIOD, rear_axle(), actors([car(20.0, 3.0)]))
        if (scan := lidar.prepare()) is not None:
            times.append(scan.cloud.time)
            last = scan
    np.testing.assert_allclose(times, np.arange(-0.9, 0.21, 0.1) - IDEAL.firing_period, atol=1e-9)
    assert last is not None
    np.testing.assert_array_equal(last.cloud.range, driven(IDEAL, 0.2)[-1][1].cloud.range)


def test_a_turn_looks_ahead_in_its_middle_and_turns_clockwise() -> None:
    ((_, scan),) = driven(IDEAL, 0.1)
    cloud = scan.cloud
    assert cloud.azimuth[0] == pytest.approx(math.pi)
    assert cloud.azimuth[900] == pytest.approx(0.0, abs=1e-9)
    assert np.diff(cloud.azimuth) == pytest.approx(-math.radians(0.2))
    assert (cloud.time_offset[-1], cloud.time_offset[0]) == pytest.approx((0.0, -1799 * 0.1 / 1800))


@pytest.mark.thorough
def test_ticks_of_another_length_see_the_same_street() -> None:
    """What stands and is driven past at an even speed does not depend on when the rays were cast."""
    fine, coarse = (driven(IDEAL, 0.6, speed=8.0, walls=HOUSE, period=period) for period in (0.02, 0.04))
    for (_, one), (_, other) in zip(fine, coarse, strict=True):
        assert one.cloud.range == pytest.approx(other.cloud.range, abs=1e-9)


def test_after_a_gap_a_part_of_the_turn_is_dark_and_the_next_one_is_whole() -> None:
    lidar = Lidar(IDEAL, np.random.default_rng(1), HOUSE)
    scans = []
    for time in (0.0, 0.02, 0.04, 0.06, 0.08, 0.10, 0.37, 0.39, 0.41, 0.43, 0.45, 0.47, 0.49, 0.51):
        lidar.step(time, rear_axle(), actors([]))
        scans.append(lidar.prepare())
    whole, dark, *later = (scan for scan in scans if scan is not None)
    ends = [scan.cloud.time + IDEAL.firing_period for scan in (whole, dark, *later)]
    assert ends == pytest.approx([0.1, 0.3, 0.4, 0.5]), "the turn from 0.1 to 0.2 s has no ray at all"
    assert not dark.cloud.range[:1260].any(), "up to 0.27 s"
    assert np.array_equal(dark.cloud.range[1260:], whole.cloud.range[1260:])
    assert all(np.array_equal(scan.cloud.range, whole.cloud.range) for scan in later)


@pytest.mark.parametrize("share", [0.001, 0.3, 1.0])
def test_how_many_rays_are_cast_at_once_changes_nothing(share: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """Noise and lost rays included, and with a gap that cuts a turn short while its rays wait."""

    def scans() -> list[LidarScan]:
        lidar, found = Lidar(LidarConfig(), np.random.default_rng(1), HOUSE), []
        times = [*(PERIOD * tick for tick in range(8)), *(PERIOD * tick for tick in range(24, 40))]
        for number, time in enumerate(times):
            scene = actors([car(20.0 + 5.0 * time, 3.0), car(15.0, -6.0)], ["a", "b"] if number % 3 else ["b", "c"])
            lidar.step(time, pose_at(time, 6.0, 0.2), scene)
            found.append(lidar.prepare())
        return [scan for scan in found if scan is not None]

    usual = scans()
    monkeypatch.setattr(lidar_module, "AT_ONCE", share)
    for one, other in zip(usual, scans(), strict=True):
        assert np.array_equal(one.cloud.range, other.cloud.range)
        assert all(np.array_equal(*columns) for columns in zip(one.columns()[:-1], other.columns()[:-1], strict=True))
        assert list(one.columns()[-1]) == list(other.columns()[-1])
    assert [round(scan.cloud.time, 3) for scan in usual] == [0.1, 0.4, 0.5, 0.6, 0.7], (
        "the turn from 0.1 s on is cut short"
    )


# --- each ray at its time ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("speed", "yaw_rate"), [(0.0, 0.0), (10.0, 0.0), (8.0, 0.4), (12.0, -0.3)])
def test_with_the_ego_s_motion_taken_out_a_wall_is_flat(speed: float, yaw_rate: float) -> None:
    (_, scan) = driven(IDEAL, 0.5, speed=speed, yaw_rate=yaw_rate, walls=HOUSE, scene=actors([]))[-1]
    cloud = scan.cloud
    wall = scan.returns.whose == WALL
    firing, channel = scan.returns.firing[wall], scan.returns.channel[wall]
    assert len(firing) > 200
    far, azimuth = cloud.range[firing, channel], cloud.azimuth[firing] + cloud.azimuth_offset[channel]
    level = far * np.cos(cloud.elevation[channel])
    places = [pose_at(time, speed, yaw_rate) for time in (cloud.time + cloud.time_offset[firing]).tolist()]
    x, y, heading = (np.array([getattr(place, name) for place in places]) for name in ("x", "y", "heading"))
    x, y = x + IDEAL.x * np.cos(heading), y + IDEAL.x * np.sin(heading)
    at_x, at_y = x + level * np.cos(heading + azimuth), y + level * np.sin(heading + azimuth)
    # Between ticks the lidar moves straight: 12 m/s with 0.3 rad/s is off by 0.2 mm.
    south, west = np.abs(at_y - 10.0), np.abs(at_x - 30.0)
    assert np.minimum(south, west).max() < 0.01


def test_a_car_that_drives_is_met_where_it_was_at_the_moment_of_the_ray() -> None:
    """The rear of a car ahead that drives away: 20 m/s in the half turn between its being met and the turn's end."""
    scene = actors([car(22.25 + 1.4, 0.0, 0.0, 20.0)])
    (_, scan) = driven(IDEAL, 0.1, scene=scene)[0]
    channel = LASER[-3]
    ahead = scan.cloud.range[900, channel] * math.cos(IDEAL.elevations[channel])
    # Met at 0.05 s, in the slack of the tick at 0.06 s, for which the scene is given.
    assert ahead == pytest.approx(20.0 - 20.0 * 0.01, abs=1e-3)


def test_the_mounting_is_where_the_rays_begin() -> None:
    turned = replace(IDEAL, x=0.5, y=0.4, z=1.2, yaw=math.radians(30.0))
    (_, scan) = driven(turned, 0.1, scene=actors([]), walls=HOUSE)[0]
    cloud, channel = scan.cloud, LASER[1]
    # The near face of the house is 9.6 m to the left of the lidar; the ray goes to 39.5 m ahead of it.
    direction = math.atan2(9.6, 39.5) - turned.yaw
    firing = int(np.argmin(np.abs(cloud.azimuth + cloud.azimuth_offset[channel] - direction)))
    azimuth = float(cloud.azimuth[firing] + cloud.azimuth_offset[channel]) + turned.yaw
    level = float(cloud.range[firing, channel]) * math.cos(turned.elevations[channel])
    assert level == pytest.approx(9.6 / math.sin(azimuth), rel=1e-9)
    ground = float(cloud.range[0, 0])
    assert ground * math.sin(math.radians(15.0)) == pytest.approx(1.2)


# --- noise and lost rays ----------------------------------------------------------------------------------------------


def test_the_range_has_the_declared_noise_and_quantum() -> None:
    config = replace(LidarConfig(), drop_out=False, range_sigma=0.03)
    exact = driven(IDEAL, 1.0, walls=HOUSE)
    noisy = driven(config, 1.0, walls=HOUSE)
    errors = np.concatenate([
        (own.cloud.range - true.cloud.range)[true.cloud.range > 0.0]
        for (_, own), (_, true) in zip(noisy, exact, strict=True)
    ])  # fmt: skip
    assert len(errors) > 50_000
    assert errors.std() == pytest.approx(0.03, rel=0.02)
    assert abs(errors.mean()) < 0.001
    ranges = noisy[-1][1].cloud.range
    assert np.round(ranges / 0.002) * 0.002 == pytest.approx(ranges, abs=1e-9)


def test_a_dark_wall_is_lost_beyond_its_range() -> None:
    """A wall of 35 % met squarely has the power of 10 % at 60 m when it stands at 60 * sqrt(3.5) = 112 m."""
    config = replace(LidarConfig(), range_max=200.0, range_sigma=0.0)
    shares = {}
    for distance in (80.0, 60.0 * math.sqrt(3.5), 150.0):
        wall = walls_of([Building(((distance + 1.4, -400.0), (distance + 1.4, 400.0), (distance + 9.0, 0.0)), 50.0)])
        lidar = Lidar(config, np.random.default_rng(3), wall)
        for tick in range(51):
            lidar.step(tick * PERIOD, rear_axle(), actors([]))
            scan = lidar.prepare()
            if scan is not None:
                ahead = scan.cloud.range[890:910, LASER[1]]  # a degree down the ground is nearer
                shares.setdefault(distance, []).append((ahead > 0.0).mean())
    near, half, far = (float(np.mean(values)) for values in shares.values())
    assert near > 0.95
    assert half == pytest.approx(0.5, abs=0.15)
    assert far < 0.1


def test_what_is_too_near_or_too_far_does_not_come_back() -> None:
    near = walls_of([Building(((1.4 + 0.3, -5.0), (1.4 + 0.3, 5.0), (9.0, 0.0)), 5.0)])
    (_, scan) = driven(IDEAL, 0.1, scene=actors([]), walls=near)[0]
    assert scan.cloud.range[900, LASER[-1]] == 0.0
    (_, scan) = driven(replace(IDEAL, range_max=15.0), 0.1, scene=actors([car(30.0, 0.0)]))[0]
    assert scan.cloud.range.max() <= 15.0


def test_the_same_seed_measures_the_same_and_another_does_not() -> None:
    one, two, other = (driven(LidarConfig(), 0.3, seed=seed)[-1][1].cloud.range for seed in (1, 1, 2))
    assert np.array_equal(one, two)
    assert not np.array_equal(one, other)


# --- what comes out ---------------------------------------------------------------------------------------------------


def test_a_row_of_the_record_is_a_point_of_the_cloud() -> None:
    (_, scan) = driven(
        LidarConfig(), 0.2, scene=actors([car(15.0, 0.0), car(25.0, 6.0)], ["lead", "beside"]), walls=HOUSE
    )[-1]
    channel, azimuth, elevation, far, reflectivity, whose = (np.asarray(column) for column in scan.columns())
    points = np.stack(
        (far * np.cos(elevation) * np.cos(azimuth), far * np.cos(elevation) * np.sin(azimuth), far * np.sin(elevation)),
        -1,
    )
    assert points == pytest.approx(scan.cloud.points(), abs=1e-12)
    assert elevation == pytest.approx(scan.cloud.elevation[channel])
    assert set(whose.tolist()) == {"lead", "beside", ""}
    assert (reflectivity[far > 0.0] >= 1).all()
    lead = points[whose == "lead"]
    assert np.abs(lead[:, 1]).max() < 1.0
    assert lead[:, 0].min() == pytest.approx(15.0 - 2.25 - 1.4, abs=0.1)


def test_actors_that_come_and_go_in_a_turn_keep_their_names() -> None:
    lidar, names = Lidar(IDEAL, np.random.default_rng(1), NO_WALLS), set()
    for tick in range(6):
        scene = actors([car(15.0, 0.0), car(15.0, 8.0)], ["a", "b"] if tick % 2 else ["b", "a"])
        lidar.step(tick * PERIOD, rear_axle(), scene)
        scan = lidar.prepare()
        if scan is not None:
            names = set(scan.columns()[-1])
    assert names == {"a", "b", ""}
