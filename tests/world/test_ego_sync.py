"""The contract of the ego in SUMO, driven against the real SUMO."""

from __future__ import annotations

import dataclasses
import math
import random
from pathlib import Path

import libsumo
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.isolated import isolated
from tests.world.following import follower_accelerations
from tests.world.streets import (
    ALONE,
    FUSION,
    PERIOD,
    along,
    crossing,
    demand,
    grid,
    lane_points,
    pose,
    street,
    trips,
    way,
)
from vve_sumo.values import EGO, Point
from vve_sumo.world.ego_sync import TOLERANCE, Ego, compass, heading_of
from vve_sumo.world.world import World

BLOCK = ["B1C1", "C1C2", "C2B2", "B2B1"]
TICKS = 30_000


def _ten_minutes(folder: str) -> dict[str, object]:
    """Round a block for 10 min at 50 Hz with 2 cm of noise, over lane lines and off the road and back."""
    root = Path(folder)
    network = grid(root)
    lap = list(along(lane_points(network, way(network, BLOCK * 3 + BLOCK[:1])), 9.0 * PERIOD))
    chance = np.random.default_rng(3)
    noise, speeds = chance.normal(0.0, 0.02, (TICKS, 2)), chance.normal(9.0, 0.03, TICKS)
    worst, faults, off_road, lanes = [0.0, 0.0, 0.0], [], 0, set()
    traffic = trips(root, network, 20, 6.0)
    with World(
        network, demand=[traffic], seed=2, period=PERIOD, egos=[Ego(EGO, FUSION, tuple(BLOCK * 30))], warm_up=30.0
    ) as world:
        for k in range(TICKS):
            x, y, heading = lap[k % len(lap)]
            phase = k % 3000
            aside = 3.2 * math.sin((phase - 1000) / 400 * math.pi) if 1000 <= phase < 1400 else 0.0
            aside -= 9.0 * math.sin((phase - 2000) / 600 * math.pi) if 2000 <= phase < 2600 else 0.0
            x, y = x - aside * math.sin(heading) + noise[k, 0], y + aside * math.cos(heading) + noise[k, 1]
            report = world.step({EGO: pose(k * PERIOD, x, y, heading, speeds[k])})[EGO]
            errors = (report.position_error, report.heading_error, report.speed_error)
            worst = [max(pair) for pair in zip(worst, errors, strict=True)]
            faults += report.faults
            off_road += not report.on_road
            lanes.add(report.lane)
    return {"worst": worst, "faults": faults, "off_road": off_road, "lanes": len(lanes)}


@pytest.mark.slow
def test_sumo_has_the_asked_pose_and_speed_in_every_tick_of_ten_minutes(tmp_path):
    reported = isolated(_ten_minutes, str(tmp_path))
    assert reported["faults"] == []
    assert max(reported["worst"]) <= TOLERANCE
    assert reported["off_road"] > 1000
    assert reported["lanes"] > 10


def _refusals(folder: str) -> list[tuple[str, tuple[str, ...], float, float, float]]:
    network = street(Path(folder))
    bad = [math.nan, math.inf, -math.inf, 1e300, -1e300, 1e18]
    cases = [(field, value) for field in ("x", "y", "heading", "speed") for value in bad]
    random.Random(1).shuffle(cases)
    reported = []
    with World(network, seed=1, period=PERIOD, egos=ALONE) as world:
        assert world.step({EGO: pose(0.0, 100.0, -1.6, 0.0, 5.0)})[EGO].faults == ()
        for field, value in cases:
            report = world.step({EGO: dataclasses.replace(pose(0.0, 100.0, -1.6, 0.0, 5.0), **{field: value})})[EGO]
            x, y = libsumo.vehicle.getPosition("ego")
            reported.append((f"{field}={value}", report.faults, x, y, libsumo.vehicle.getSpeed("ego")))
        assert world.step({EGO: pose(0.0, 101.0, -1.6, 0.0, 5.0)})[EGO].faults == ()
    return reported


def test_a_pose_that_sumo_must_not_see_is_a_fault_and_the_ego_stands(tmp_path):
    for case, faults, x, y, speed in isolated(_refusals, str(tmp_path), timeout=60.0):
        if case in ("heading=1e+300", "heading=-1e+300", "heading=1e+18"):
            assert faults == (), case  # an angle is a direction, however often it went round
            continue
        assert faults in (("pose_not_finite",), ("pose_out_of_bounds",)), case
        assert (x, y, speed) == (100.0, -1.6, 0.0), case


def _odd_ticks(folder: str) -> list[tuple[str, ...]]:
    network = street(Path(folder))
    reported = []
    with World(network, seed=1, period=PERIOD, egos=ALONE) as world:
        reported.append(world.step({})[EGO].faults)
        start = pose(0.0, 100.0, -1.6, 0.0, 33.3)
        reported.append(world.step({EGO: dataclasses.replace(start, x=math.nan)})[EGO].faults)
        reported.append(world.step({EGO: start})[EGO].faults)
        reported.append(world.step({})[EGO].faults)
        reported.append(world.step({EGO: dataclasses.replace(start, point=Point.REAR_AXLE)})[EGO].faults)
        reported.append(world.step({EGO: dataclasses.replace(start, speed=-2.0)})[EGO].faults)
        libsumo.vehicle.remove("ego")
        reported.append(world.step({EGO: start})[EGO].faults)
        reported.append(world.step({EGO: start})[EGO].faults)
        reported.append(world.step({EGO: start})[EGO].faults)
        reported.append(world.actors(EGO).ids)
    return reported


def test_missing_wrong_and_lost_egos_are_named_and_come_back(tmp_path):
    reported = isolated(_odd_ticks, str(tmp_path))
    assert reported[0] == ("ego_not_placed", "ego_absent")
    assert reported[1] == ("pose_not_finite", "ego_absent")
    assert reported[2] == ()  # its first step has the right speed, above the lane's limit
    assert reported[3] == ("ego_not_placed",)
    assert reported[4] == ("pose_not_front_bumper",)
    assert reported[5] == ()  # SUMO knows no reversing: the contract is on max(speed, 0)
    assert "ego_lost" in reported[6]
    assert reported[8] == ()


@given(st.floats(-1e9, 1e9))
def test_compass_and_heading_are_inverse(heading):
    angle = compass(heading)
    assert 0.0 <= angle <= 360.0
    assert math.cos(heading_of(angle) - heading) == pytest.approx(1.0, abs=1e-6)


@pytest.mark.parametrize(
    ("heading", "angle"), [(0.0, 90.0), (math.pi / 2, 0.0), (math.pi, 270.0), (-math.pi / 2, 180.0)]
)
def test_compass_points(heading, angle):
    assert compass(heading) == pytest.approx(angle)


def _minor_road(folder: str, offset: float, native: bool, route: tuple[str, ...]) -> bool:
    """Whether a car on the minor road goes first; both have crossed 16 s after the start."""
    network = crossing(Path(folder))
    minor = (
        '<vType id="car" sigma="0" speedDev="0" maxSpeed="10"/>'
        f'<vehicle id="minor" type="car" depart="0" departPos="{200.0 + offset}" departSpeed="10">'
        '<route edges="sc cn"/></vehicle>'
    )
    major = (
        '<vehicle id="major" type="car" depart="0.04" departPos="200" departSpeed="10"><route edges="wc ce"/></vehicle>'
    )
    cars = demand(Path(folder), minor + (major if native else ""))
    first, egos = None, [Ego(EGO, FUSION, route)]
    with World(network, demand=[cars], seed=1, period=PERIOD, egos=egos, warm_up=0.04) as world:
        for k in range(800):
            place = (0.0, 900.0, 0.0, 0.0) if native else (-100.0 + k * PERIOD * 10.0, -1.6, 0.0, 10.0)
            world.step({EGO: pose(k * PERIOD, *place)})
            names = libsumo.vehicle.getIDList()
            if "minor" not in names or (native and "major" not in names):
                continue
            ours_x, _ = libsumo.vehicle.getPosition("major" if native else "ego")
            _, other = libsumo.vehicle.getPosition("minor")
            if first is None and (other > 0.0 or ours_x > 0.0):
                first = other > 0.0
            if not native:
                assert world.contacts(EGO) == ()
    assert first is not None
    return first


def _who_goes_first(folder: str, offsets: list[float], native: bool, route: tuple[str, ...]) -> list[bool]:
    return [_minor_road(folder, offset, native, route) for offset in offsets]


@pytest.mark.thorough
def test_a_car_on_the_minor_road_yields_as_to_a_native_car(tmp_path):
    offsets = [-40.0, -20.0, -10.0, 0.0, 5.0, 10.0, 20.0, 30.0, 60.0]
    native = isolated(_who_goes_first, str(tmp_path), offsets, True, ())
    assert native == [False] * 8 + [True]
    assert isolated(_who_goes_first, str(tmp_path), offsets, False, ("wc", "ce")) == native


@pytest.mark.thorough
def test_a_car_yields_to_an_ego_of_unknown_route_too(tmp_path):
    assert isolated(_who_goes_first, str(tmp_path), [0.0, 5.0, 10.0], False, ()) == [False] * 3


def _follow(folder: str, position_noise: float, speed_noise: float) -> float:
    chance = np.random.default_rng(5)
    noise = chance.normal(0.0, 1.0, (1500, 3))
    poses = [
        pose(
            k * PERIOD,
            110.0 + 15.0 * k * PERIOD + position_noise * noise[k, 0],
            -1.6 + position_noise * noise[k, 1],
            0.0,
            15.0 + speed_noise * noise[k, 2],
        )
        for k in range(1500)
    ]
    return min(follower_accelerations(Path(folder), poses)[500:])


@pytest.mark.thorough
def test_a_follower_keeps_calm_behind_a_smooth_ego_and_not_behind_a_noisy_one(tmp_path):
    smooth = isolated(_follow, str(tmp_path), 0.0, 0.0)
    noisy = isolated(_follow, str(tmp_path), 0.02, 0.03)
    print(f"hardest braking of the follower: smooth {smooth:.3f}, noisy {noisy:.3f} m/s2")
    assert smooth > -0.3
    assert noisy < smooth
