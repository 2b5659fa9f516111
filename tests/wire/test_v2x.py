"""What a V2X receiver heard and what the ego says, as packets, read back by their codecs and by tshark."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np
import pyproj
import pytest

from tests.sensors.scenes import BUMPER, FUSION, actors, car, rear_axle
from tests.v2x import tshark
from vve_sumo.body_kinds import number_of
from vve_sumo.frames import MapFrame, local_frame
from vve_sumo.sensors.street import walls_of
from vve_sumo.sensors.v2x import V2xConfig, V2xReceiver
from vve_sumo.v2x import cam, cpm, geonetworking, its_time, vam
from vve_sumo.v2x.cpm import Cpm
from vve_sumo.v2x.data_elements import StationType
from vve_sumo.v2x.pdu_header import MessageId
from vve_sumo.values import Actors, CameraObjects, Pose
from vve_sumo.wire.outputs import CamOutput, Context, CpmOutput, V2xOutput
from vve_sumo.wire.sample import NO_SCAN, Sample, SampleContent, no_fix

PERIOD = 0.02
EPOCH = 1.4e9
FRAME = local_frame(0.7, -1.4)
CONTEXT = Context(FUSION, FRAME.projection, FRAME.offset)


def sample(time: float, pose: Pose, receiver: V2xReceiver | None = None) -> Sample:
    heard = {"obu": receiver.output} if receiver is not None else {}
    fix = dataclasses.replace(no_fix(EPOCH + time, time), position_sigma=0.02)
    content = SampleContent(fix, pose, NO_SCAN, math.inf, Actors.none(time), stations_by_receiver=heard)
    return Sample(1, EPOCH + time, time, content).seen_by("obu")


def heard(scene: Actors, seconds: float = 3.0) -> tuple[list[tuple[float, bytes]], V2xReceiver]:
    """Packets with the times at which they went out, and the receiver."""
    receiver = V2xReceiver(V2xConfig().ideal(), FUSION, np.random.default_rng(1), walls_of(()), FRAME)
    output, packets = V2xOutput(CONTEXT), []
    for tick in range(round(seconds / PERIOD)):
        time = tick * PERIOD
        receiver.step(time, rear_axle(), scene)
        receiver.prepare()
        packets += [(time, packet) for packet in output.step(sample(time, rear_axle(), receiver))]
    return packets, receiver


def _row(rows: Sequence[tuple[float, ...]], kinds: Sequence[str]) -> Actors:
    scenes = [actors([row], [kind], kind=kind) for row, kind in zip(rows, kinds, strict=True)]  # type: ignore[list-item]
    columns = {
        field.name: np.concatenate([getattr(one, field.name) for one in scenes])
        for field in dataclasses.fields(Actors)
        if field.name not in ("time", "ids")
    }
    return Actors(0.0, tuple(kinds), **columns)


SCENE = _row([car(40.0, 3.0, 2.0, 7.5), (25.0, -4.0, 1.0, 1.4, 0.6, 0.5, 1.0)], ["truck", "pedestrian"])


def test_each_message_goes_out_once_and_says_what_the_receiver_knows() -> None:
    packets, receiver = heard(SCENE)
    known, found = receiver.output, {}
    for time, data in packets:
        packet = geonetworking.decode(data)
        now_ms = its_time.from_gnss(EPOCH + time)
        if packet.port == geonetworking.PORTS[MessageId.CAM]:
            said: cam.Cam | vam.Vam = cam.decode(packet.payload, now_ms)
        else:
            said = vam.decode(packet.payload, now_ms)
        assert 50 <= now_ms - said.time_ms <= 71
        assert (packet.source.address[2:], packet.source.time_ms) == (said.station.to_bytes(4), said.time_ms % 2**32)
        assert (said.station, said.time_ms) not in found
        found[said.station, said.time_ms] = said
    # Each moves, but not from its place: a second, and five, apart.
    assert [kind.station_type for kind in found.values()].count(StationType.HEAVY_TRUCK) == 3
    assert [kind.station_type for kind in found.values()].count(StationType.PEDESTRIAN) == 1
    for row, number in enumerate(known.number.tolist()):
        last = max((said for key, said in found.items() if key[0] == number), key=lambda said: said.time_ms)
        assert math.radians(last.latitude_deg) == pytest.approx(known.latitude[row], abs=1e-12)
        assert math.radians(last.longitude_deg) == pytest.approx(known.longitude[row], abs=1e-12)
        assert last.heading == pytest.approx(known.true_heading[row], abs=1e-12)
        assert last.speed == pytest.approx(known.speed[row], abs=1e-12)
        if isinstance(last, cam.Cam):
            assert (last.length, last.width) == (known.length[row], known.width[row])


def test_one_cam_in_half_a_second_has_the_low_frequency_container() -> None:
    """A truck that brakes at 8 m/s2 sends ten times a second."""
    receiver = V2xReceiver(V2xConfig().ideal(), FUSION, np.random.default_rng(1), walls_of(()), FRAME)
    output, lit = V2xOutput(CONTEXT), []
    for tick in range(round(2.5 / PERIOD)):
        time = tick * PERIOD
        receiver.step(time, rear_axle(), actors([car(40.0, 3.0, 0.0, 25.0 - 8.0 * time)], ["truck"], kind="truck"))
        receiver.prepare()
        for data in output.step(sample(time, rear_axle(), receiver)):
            said = cam.decode(geonetworking.decode(data).payload, its_time.from_gnss(EPOCH + time))
            lit.append((said.time_ms, said.lights is not None))
    times = [time for time, has in lit if has]
    assert len(lit) >= 20
    assert all(500 <= after - before <= 600 for before, after in pairwise(times))


def test_the_ego_s_cam_is_of_its_front_bumper_and_of_the_true_north() -> None:
    leaning = MapFrame("+proj=tmerc +lat_0=40 +lon_0=-86 +k=1 +x_0=0 +y_0=0 +datum=WGS84 +units=m +no_defs")
    x, y = leaning.to_map(math.radians(40.0), math.radians(-83.0))
    output = CamOutput(Context(FUSION, leaning.projection, leaning.offset))
    said = []
    for tick in range(round(2.0 / PERIOD)):
        time = tick * PERIOD
        pose = rear_axle(x + 12.0 * time * math.cos(1.0), y + 12.0 * time * math.sin(1.0), 1.0, 12.0, 0.05)
        for data in output.step(sample(time, pose)):
            now_ms = its_time.from_gnss(EPOCH + time)
            said.append((pose, cam.decode(geonetworking.decode(data).payload, now_ms)))
            assert said[-1][1].time_ms == now_ms
    assert len(said) == 5  # each 0.4 s, when it has gone 4.8 m
    for pose, one in said:
        latitude, longitude = math.radians(one.latitude_deg), math.radians(one.longitude_deg)
        front = (pose.x + BUMPER * math.cos(1.0), pose.y + BUMPER * math.sin(1.0))
        assert leaning.to_map(latitude, longitude) == pytest.approx(front, abs=0.01)
        assert one.heading == pytest.approx(1.0 - leaning.convergence(latitude, longitude), abs=math.radians(0.051))
        assert (one.speed, one.reversing, one.length) == (12.0, False, pytest.approx(FUSION.length, abs=0.1))
        assert one.confidence is not None
        assert one.confidence.semi_major == pytest.approx(0.05, abs=0.011)


def listed(time: float, rows: Sequence[tuple[int, str, float, float, float]]) -> CameraObjects:
    """A camera's list: number, kind, x, y [m] from the bumper and relative speed [m/s]."""
    count, columns = len(rows), list(zip(*rows, strict=True)) if rows else [()] * 5
    return CameraObjects(
        time, np.array(columns[0], np.int64), np.array([number_of(kind) for kind in columns[1]], np.int8),
        np.full(count, 3, np.int8), *(np.array(columns[n], np.float64) for n in (2, 3, 4)), np.full(count, 1.8),
        np.full(count, 4.5), False, 0.0, 0.0,
    )  # fmt: skip


def perceived(
    seconds: float, scene: Callable[[float], Sequence[tuple[int, str, float, float, float]]], frame: MapFrame = FRAME
) -> list[tuple[float, Cpm]]:
    """The ego's CPMs with the times at which they went out: at 10 m/s along 0.5 rad, by lists that are 0.1 s old."""
    output, said = CpmOutput(Context(FUSION, frame.projection, frame.offset)), []
    for tick in range(round(seconds / PERIOD)):
        time = tick * PERIOD
        objects = listed(time - 0.1, scene(time - 0.1))
        content = sample(time, driven(time, frame)).measured
        assert content is not None
        packets = output.step(Sample(1, EPOCH + time, time, dataclasses.replace(content, objects=objects)))
        for data in packets:
            packet = geonetworking.decode(data)
            assert packet.port == geonetworking.PORTS[MessageId.CPM]
            said.append((time, cpm.decode(packet.payload)))
    return said


def driven(time: float, frame: MapFrame) -> Pose:
    """Where the ego is: near 40 N, 83 W."""
    x, y = frame.to_map(math.radians(40.0), math.radians(-83.0))
    return rear_axle(x + 10.0 * time * math.cos(0.5), y + 10.0 * time * math.sin(0.5), 0.5, 10.0)


def test_a_cpm_says_where_in_the_world_the_camera_has_seen_somebody_and_when() -> None:
    """By geodesics on the ellipsoid, with a map whose north is 1.9 degrees off the true one."""
    leaning = MapFrame("+proj=tmerc +lat_0=40 +lon_0=-86 +k=1 +x_0=0 +y_0=0 +datum=WGS84 +units=m +no_defs")
    ((time, said), *_) = perceived(0.1, lambda _time: [(7, "truck", 20.0, 3.0, -4.0)], leaning)
    (one,) = said.objects
    then = driven(time - 0.1, leaning)
    ahead, left = BUMPER + 20.0 + 0.5 * 4.5, 3.0
    x = then.x + ahead * math.cos(0.5) - left * math.sin(0.5)
    y = then.y + ahead * math.sin(0.5) + left * math.cos(0.5)
    truth = [math.degrees(angle) for angle in leaning.to_geodetic(x, y)]
    azimuth, _, far = pyproj.Geod(ellps="WGS84").inv(said.longitude_deg, said.latitude_deg, truth[1], truth[0])
    assert math.hypot(one.x, one.y) == pytest.approx(far, abs=0.03)
    assert math.degrees(math.atan2(one.x, one.y)) == pytest.approx(azimuth, abs=0.1)
    assert (one.id, one.kind, one.sensors, said.total) == (7, StationType.HEAVY_TRUCK, (1,), 1)
    assert one.delta_time == pytest.approx(-0.1, abs=1e-3)
    assert one.velocity_x is not None
    assert one.velocity_y is not None
    assert math.hypot(one.velocity_x, one.velocity_y) == pytest.approx(6.0, abs=0.02)
    here = leaning.to_geodetic(then.x, then.y)
    assert math.atan2(one.velocity_y, one.velocity_x) == pytest.approx(0.5 - leaning.convergence(*here), abs=0.01)
    assert said.reference_time_ms == its_time.from_gnss(EPOCH + time)


def test_an_object_is_told_of_when_it_is_new_has_moved_or_a_second_has_passed() -> None:
    """Of three cars one comes after 1 s; one drives on at 6 m/s, the others stand."""

    def scene(time: float) -> list[tuple[int, str, float, float, float]]:
        cars = [(1, "car", 40.0 - 10.0 * time, 3.0, -10.0), (2, "car", 30.0 - 4.0 * time, 0.0, -4.0)]
        return cars + ([(3, "car", 60.0 - 10.0 * time, -3.0, -10.0)] if time >= 1.0 else [])

    told: dict[int, list[float]] = {1: [], 2: [], 3: []}
    for time, said in perceived(3.0, scene):
        for one in said.objects:
            told[one.id].append(time)
    assert np.diff(told[1]) == pytest.approx(1.0, abs=0.021)
    assert np.diff(told[2]) == pytest.approx(0.7, abs=0.021)  # 4.2 m
    assert 1.1 - 1e-9 <= told[3][0] <= 1.2
    assert len(told[3]) == 2


def test_people_are_told_of_together_and_twice_a_second() -> None:
    def scene(time: float) -> list[tuple[int, str, float, float, float]]:
        first = [(1, "pedestrian", 40.0 - 10.0 * time, 3.0, -10.0)]
        return first + ([(2, "child", 40.0 - 10.0 * time, 1.0, -10.0)] if time >= 0.7 else [])

    told = [(time, {one.id for one in said.objects}) for time, said in perceived(2.5, scene)]
    assert told[0][1] == {1}
    assert [who for time, who in told if time > 0.8 - 1e-9] == [{1, 2}] * 4
    assert np.diff([time for time, _who in told if time > 0.8 - 1e-9]) == pytest.approx(0.5, abs=0.021)


def test_a_camera_that_sees_nobody_and_one_whose_list_is_old_send_nothing() -> None:
    assert perceived(2.0, lambda _time: []) == []
    content = sample(3.0, rear_axle()).measured
    assert content is not None
    old = dataclasses.replace(content, objects=listed(2.0, [(1, "car", 20.0, 0.0, 0.0)]))
    assert list(CpmOutput(CONTEXT).step(Sample(1, EPOCH + 3.0, 3.0, old))) == []


def test_nothing_goes_out_while_the_outputs_are_invalid_or_nobody_was_heard() -> None:
    invalid = Sample(1, EPOCH, 0.0, None)
    for output in (V2xOutput(CONTEXT), CamOutput(CONTEXT), CpmOutput(CONTEXT)):
        assert list(output.step(invalid)) == []
    assert list(V2xOutput(CONTEXT).step(sample(0.0, rear_axle()))) == []
    assert heard(Actors.none(0.0))[0] == []


@tshark.needs_tshark
def test_tshark_reads_what_goes_out(tmp_path: Path) -> None:
    packets, receiver = heard(SCENE, 6.0)
    frames = [geonetworking.ethernet_frame(data, b"\x02\x00\x00\x00\x00\x01") for _, data in packets]
    cams = [found for found in tshark.read(frames, tmp_path) if found.get("its.messageID") == ["2"]]
    assert len(cams) == 6
    row = receiver.output.kind.tolist().index(number_of("truck"))
    tshark.assert_read(
        cams[-1],
        {
            "its.stationID": int(receiver.output.number[row]),
            "its.latitude": round(math.degrees(receiver.output.latitude[row]) * 1e7),
            "its.longitude": round(math.degrees(receiver.output.longitude[row]) * 1e7),
            "its.speedValue": round(100.0 * receiver.output.speed[row]),
        },
    )
