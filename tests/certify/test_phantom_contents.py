"""Phantoms in a camera's list, a V2X receiver's table and a lidar's turn: as shipped sensors see a true car there."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
import pytest
import shapely

from tests.certify.test_phantoms import BUMPER, SPEED, TICK, pose, track
from tests.vehicles import FUSION
from vve_sumo.certify.phantom_contents import HEIGHT, LENGTH, WIDTH, LidarMount
from vve_sumo.certify.phantoms import Installation, MissedDetections, Phantom, Phantoms
from vve_sumo.frames import local_frame
from vve_sumo.sensors.lidar_settings import LidarSettings
from vve_sumo.sensors.port import configured
from vve_sumo.sensors.street import Street
from vve_sumo.values import Actors, CameraObjects, PointCloud, Stations
from vve_sumo.wire.sample import NO_SCAN, Sample, SampleContent, no_fix
from vve_sumo.wire.vlp16 import ELEVATIONS_DEG, RANGE_QUANTUM, turn_of

FRAME = local_frame(math.radians(40.0), math.radians(-83.0))
LIDAR = LidarSettings(ideal=True, channels_deg=tuple(map(float, ELEVATIONS_DEG)), azimuth_step_deg=0.5)
CONFIG = LIDAR.config()
MOUNT = LidarMount(CONFIG.x, CONFIG.y, CONFIG.z, CONFIG.yaw, CONFIG.elevations)
INSTALLATION = Installation(BUMPER, FRAME, {"other": MOUNT})
BEGINS, CURVATURES, PACES = 1.0, [0.0, 0.02, -0.02], [0.0, 0.5, 1.5]


def car(time: float, phantom: Phantom, curvature: float) -> Actors:
    """A true car where plane geometry has the phantom: its rear on the circle that the ego drives."""
    driven = SPEED * BEGINS + BUMPER + phantom.ahead + phantom.speed * (time - BEGINS)
    rear = pose(driven / SPEED, curvature)
    x = rear.x - phantom.d * math.sin(rear.heading) + 0.5 * LENGTH * math.cos(rear.heading)
    y = rear.y + phantom.d * math.cos(rear.heading) + 0.5 * LENGTH * math.sin(rear.heading)
    row = [np.array([one]) for one in (x, y, rear.heading, phantom.speed, LENGTH, WIDTH, 10.0, 0.0, HEIGHT)]
    return Actors(time, ("car",), *row, np.zeros(1, np.int8))


def outputs(kind: str, settings: dict[str, Any], phantom: Phantom | None, curvature: float, until: float) -> list[Any]:
    """What a shipped sensor says at every tick from BEGINS on; without a phantom on an empty street."""
    street = Street(map_frame=FRAME)
    sensor = configured(kind, settings).sensor_along(street, FUSION.vehicle, np.random.default_rng(1))
    said = []
    for tick in range(round(until / TICK)):
        now = TICK * tick
        sensor.step(now, pose(now, curvature), car(now, phantom, curvature) if phantom else Actors.none(now))
        if hasattr(sensor, "prepare"):
            sensor.prepare()
        if now >= BEGINS - 1e-9:
            said.append((now, sensor.output))
    return said


def altered(now: float, output: Any, fault: Any, curvature: float) -> Any:
    """What a wire of the sensor carries under a fault."""
    there: dict[str, Any] = {"lists": {}, "stations_by_receiver": {}, "turns": {}}
    name = {CameraObjects: "lists", Stations: "stations_by_receiver", PointCloud: "turns"}[type(output)]
    there[name] = {"other": turn_of(output) if name == "turns" else output}
    content = SampleContent(
        no_fix(now, now), pose(now, curvature), NO_SCAN, math.inf, Actors.none(now), **there
    )  # fmt: skip
    shown = fault.step(Sample(1, 1000.0 + now, now, content), True)
    assert shown.measured is not None
    return getattr(shown.measured, name)["other"]


def phantoms(phantom: Phantom, curvature: float) -> Phantoms:
    """The fault of one phantom."""
    return Phantoms(track(curvature), BEGINS, INSTALLATION, [phantom])


@pytest.mark.parametrize("pace", PACES)
@pytest.mark.parametrize("curvature", CURVATURES)
def test_a_camera_lists_it_as_it_lists_a_true_car(curvature: float, pace: float) -> None:
    phantom = Phantom(18.0, 0.0, pace * SPEED)
    true = outputs("camera", {"ideal": True}, phantom, curvature, 2.0)
    none = outputs("camera", {"ideal": True}, None, curvature, 2.0)
    compared = 0
    for (now, one), (_, empty) in zip(true, none, strict=True):
        if not len(one.x) or one.time < BEGINS:
            continue
        shown = altered(now, empty, phantoms(phantom, curvature), curvature)
        assert shown.time == one.time
        for name in ("x", "y", "relative_speed", "width"):
            np.testing.assert_allclose(getattr(shown, name), getattr(one, name), atol=0.12, err_msg=name)
        assert shown.kind.tolist() == one.kind.tolist()
        assert (shown.status == 1).tolist() == [pace == 0.0]
        compared += 1
    assert compared > 5


@pytest.mark.parametrize("pace", PACES)
@pytest.mark.parametrize("curvature", CURVATURES)
def test_a_v2x_receiver_knows_it_as_it_knows_a_true_car(curvature: float, pace: float) -> None:
    phantom = Phantom(18.0, 0.0, pace * SPEED)
    true = outputs("v2x", {"ideal": True}, phantom, curvature, 3.0)
    none = outputs("v2x", {"ideal": True}, None, curvature, 3.0)
    compared = 0
    for (now, one), (_, empty) in zip(true, none, strict=True):
        if not len(one.x) or one.time - one.age[0] < BEGINS:
            continue
        shown = altered(now, empty, phantoms(phantom, curvature), curvature)
        assert (shown.time, 0.0 <= shown.age[0] <= 0.1) == (now, True)
        # The two tell of its place at different times.
        later = (now - float(shown.age[0])) - (one.time - float(one.age[0]))
        heading = float(one.true_heading[0]) + 0.5 * later * phantom.speed * curvature
        there = FRAME.to_map(one.latitude[0], one.longitude[0])
        assert FRAME.to_map(shown.latitude[0], shown.longitude[0]) == pytest.approx(
            (
                there[0] + later * phantom.speed * math.cos(heading),
                there[1] + later * phantom.speed * math.sin(heading),
            ),
            abs=0.1 + abs(later * phantom.speed * curvature) * LENGTH,  # the front swings out
        )
        for name in ("heading", "true_heading"):
            turned = abs(later * phantom.speed * curvature) + abs((now - one.time) * SPEED * curvature) + 0.01
            assert getattr(shown, name)[0] == pytest.approx(getattr(one, name)[0], abs=turned), name
        assert shown.speed[0] == pytest.approx(one.speed[0], abs=0.01)
        assert (shown.length[0], shown.width[0]) == pytest.approx((LENGTH, WIDTH), abs=0.1)
        compared += 1
    assert compared > 5


def test_its_messages_come_ten_times_a_second_and_move_with_it() -> None:
    phantom, told = Phantom(18.0, 0.0, 5.0), {}
    for now, empty in outputs("v2x", {"ideal": True}, None, 0.0, 2.0):
        shown = altered(now, empty, phantoms(phantom, 0.0), 0.0)
        told[round(shown.time - shown.age[0], 3)] = FRAME.to_map(shown.latitude[0], shown.longitude[0])[0]
    times = sorted(told)
    assert np.diff(times) == pytest.approx(0.1, abs=1e-3)
    assert np.diff([told[time] for time in times]) == pytest.approx(0.5, abs=0.01)


@pytest.mark.parametrize("pace", PACES)
@pytest.mark.parametrize("curvature", CURVATURES)
def test_a_lidars_rays_end_where_shapely_ends_them(curvature: float, pace: float) -> None:
    phantom = Phantom(14.0, 0.8, pace * SPEED)
    turns = {}
    for now, cloud in outputs("lidar", LIDAR.model_dump(), None, curvature, 2.0):
        if cloud.time >= BEGINS + 0.1 and cloud.time not in turns:
            turns[cloud.time] = now, cloud
    rays = 0
    for now, cloud in list(turns.values())[:3]:
        shown = altered(now, cloud, phantoms(phantom, curvature), curvature)
        before, after = turn_of(cloud).range.reshape(-1, 16), shown.range.reshape(-1, 16)
        body = car(cloud.time, phantom, curvature)
        for firing in range(len(before)):
            hits = _by_shapely(cloud, firing, body, curvature, phantom.speed)
            for channel, far in enumerate(hits):
                got = RANGE_QUANTUM * float(after[firing, channel])
                if far < math.inf and (before[firing, channel] == 0 or far < RANGE_QUANTUM * before[firing, channel]):
                    assert got == pytest.approx(far, abs=0.05)
                    rays += 1
                elif far == math.inf:
                    assert after[firing, channel] == before[firing, channel]
    assert rays > 30


def _by_shapely(cloud: PointCloud, firing: int, body: Actors, curvature: float, speed: float) -> list[float]:
    """Range of each channel of a firing to a box [m], by shapely; NaN at the box's edges, where either will do."""
    time = cloud.time + float(cloud.time_offset[firing])
    at = pose(time, curvature)
    cos, sin = math.cos(at.heading), math.sin(at.heading)
    origin = at.x + MOUNT.x * cos - MOUNT.y * sin, at.y + MOUNT.x * sin + MOUNT.y * cos
    heading = float(body.heading[0])
    moved = speed * (time - cloud.time)
    centre = float(body.x[0]) + moved * math.cos(heading), float(body.y[0]) + moved * math.sin(heading)

    def distance(grown: float) -> float:
        box = shapely.box(-LENGTH / 2 - grown, -WIDTH / 2 - grown, LENGTH / 2 + grown, WIDTH / 2 + grown)
        box = shapely.affinity.rotate(box, heading, (0.0, 0.0), use_radians=True)
        box = shapely.affinity.translate(box, *centre)
        angle = at.heading + MOUNT.yaw + float(cloud.azimuth[firing])
        ray = shapely.LineString([origin, (origin[0] + 90.0 * math.cos(angle), origin[1] + 90.0 * math.sin(angle))])
        met = ray.intersection(box)
        return math.inf if met.is_empty else met.distance(shapely.Point(origin))

    level, larger, smaller = distance(0.0), distance(0.05), distance(-0.05)
    found = []
    for elevation in MOUNT.elevations:
        heights = [MOUNT.z + one * math.tan(elevation) for one in (larger, level, smaller) if one < math.inf]
        inside = {0.0 <= height <= HEIGHT for height in heights} | {True for _ in () if heights}
        if math.isinf(larger) or (heights and inside == {False}):
            found.append(math.inf)
        elif math.isinf(smaller) or inside != {True}:
            found.append(math.nan)
        else:
            found.append(level / math.cos(elevation))
    return found


def test_what_is_missing_leaves_the_road_alone() -> None:
    fault, phantom = MissedDetections(INSTALLATION), Phantom(14.0)
    for kind in ("camera", "v2x"):
        now, true = outputs(kind, {"ideal": True}, phantom, 0.0, 1.6)[-1]
        assert len(true.x) == 1
        shown = altered(now, true, fault, 0.0)
        assert len(shown.x) == len(shown.number) == 0
        assert shown.time == true.time
    now, cloud = outputs("lidar", LIDAR.model_dump(), phantom, 0.0, 1.6)[-1]
    height = MOUNT.z + cloud.points()[:, 2]
    assert np.any(height > 0.5)
    shown = altered(now, cloud, fault, 0.0)
    back = dataclasses.replace(cloud, range=RANGE_QUANTUM * shown.range.reshape(cloud.range.shape).astype(np.float64))
    left = MOUNT.z + back.points()[:, 2]
    assert np.all(left <= 0.21)
    assert len(left) == pytest.approx(np.sum(height <= 0.2), abs=2)
