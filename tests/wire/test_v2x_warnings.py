"""Warnings and perceived bodies as packets, read back by their codecs, by tshark and by pycrate."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pyproj
import pytest

from tests.sensors.scenes import BUMPER, FUSION, actors, car, rear_axle
from tests.sensors.test_perception import both, child
from tests.v2x import tshark
from tests.v2x.pycrate_release2 import compiled, read_and_made_again
from tests.wire.test_v2x import CONTEXT, EPOCH, FRAME, PERIOD, sample
from vve_sumo.drive.brain import Publisher, virtual_placement
from vve_sumo.drive.pipeline import SensorFrame
from vve_sumo.frames import Mounting
from vve_sumo.sensors.street import walls_of
from vve_sumo.sensors.v2x import V2xConfig, V2xReceiver
from vve_sumo.v2x import cpm, denm, geonetworking, its_time
from vve_sumo.v2x.data_elements import StationType
from vve_sumo.v2x.denm import Denm, Termination
from vve_sumo.v2x.geonetworking import AreaShape, Packet
from vve_sumo.v2x.pdu_header import MessageId
from vve_sumo.values import Actors, Pose
from vve_sumo.wire.outputs import DenmOutput, V2xOutput
from vve_sumo.wire.sample import OwnMotion, Sample, no_fix
from vve_sumo.wire.sample_codec import decode_sample, encode_sample

CONFIG = dataclasses.replace(
    V2xConfig().ideal(), warnings=True, perceiving=1.0, hazard_lights=frozenset({"broken"}), equipped_vulnerable=0.0
)


def scene(time: float) -> Actors:
    """One stands with its hazard lights on until 4 s, then drives off; a lorry that comes sees a child."""
    gone = max(time - 4.0, 0.0)
    cars = actors([car(30.0 + 2.0 * gone, 0.0, 0.0, 2.0 if gone else 0.0)], ["broken"])
    lorry = actors([car(80.0, 3.0, math.pi, 0.0)], ["lorry"], kind="truck")
    return both(both(cars, lorry), child(50.0, 4.0 + 0.5 * time))


def said(seconds: float, config: V2xConfig = CONFIG) -> tuple[list[tuple[float, Packet]], list[bytes], V2xReceiver]:
    receiver = V2xReceiver(config, FUSION, np.random.default_rng(1), walls_of(()), FRAME)
    output, packets, raw = V2xOutput(CONTEXT), [], []
    for tick in range(round(seconds / PERIOD)):
        time = tick * PERIOD
        receiver.step(time, rear_axle(), scene(time))
        receiver.prepare()
        for data in output.step(sample(time, rear_axle(), receiver)):
            raw.append(data)
            packets.append((time, geonetworking.decode(data)))
    return packets, raw, receiver


def denms(packets: Sequence[tuple[float, Packet]]) -> list[tuple[float, Packet, Denm]]:
    port = geonetworking.PORTS[MessageId.DENM]
    return [(time, packet, denm.decode(packet.payload)) for time, packet in packets if packet.port == port]


def test_a_warning_goes_out_once_to_everyone_near_its_event_and_so_does_its_end() -> None:
    packets, _raw, _receiver = said(26.0)
    found = denms(packets)
    times = [one.reference_time_ms for _, _, one in found]
    assert len(set(times)) == len(times)
    assert np.diff(times) == pytest.approx([1000] * (len(times) - 1), abs=121)
    assert {one.cause for _, _, one in found if one.termination is None} == {94}
    ended = [one.termination is Termination.CANCELLATION for _, _, one in found]
    assert ended == sorted(ended)
    assert sum(ended) == 15
    for time, packet, one in found:
        assert 50 <= its_time.from_gnss(EPOCH + time) - one.reference_time_ms <= 71
        assert packet.area is not None
        assert (packet.area.shape, packet.area.distance_a) == (AreaShape.CIRCLE, 1000)
        assert packet.area.latitude_deg == pytest.approx(one.latitude_deg, abs=1e-7)
        assert (packet.hops, packet.lifetime, packet.traffic_class) == (10, 30.0, 1)
    _, _, first = found[0]
    place = FRAME.to_map(math.radians(first.latitude_deg), math.radians(first.longitude_deg))
    assert place == pytest.approx((32.25, 0.0), abs=0.02)
    assert [packet.sequence for _, packet, _ in found] == list(range(1, len(found) + 1))


def test_a_cpm_tells_from_its_sender_s_place_where_the_child_was() -> None:
    """By geodesics on the ellipsoid, from what the packet says alone."""
    packets, _raw, _receiver = said(3.0)
    port, geod, count = geonetworking.PORTS[MessageId.CPM], pyproj.Geod(ellps="WGS84"), 0
    for time, packet in packets:
        if packet.port != port:
            continue
        message = cpm.decode(packet.payload)
        then = (message.reference_time_ms - its_time.from_gnss(EPOCH)) / 1000.0
        assert 0.05 <= time - then <= 0.071
        for one in message.objects:
            if one.kind is not StationType.PEDESTRIAN:
                continue
            count += 1
            latitude, longitude = FRAME.to_geodetic(50.0, 4.0 + 0.5 * then)
            azimuth, _, far = geod.inv(
                message.longitude_deg, message.latitude_deg, math.degrees(longitude), math.degrees(latitude)
            )
            assert math.hypot(one.x, one.y) == pytest.approx(far, abs=0.04)
            assert math.degrees(math.atan2(one.x, one.y)) == pytest.approx(azimuth, abs=0.1)
            assert one.velocity_x == pytest.approx(1.4, abs=0.02)
    assert count >= 4


def test_the_confidence_of_a_place_holds_the_sender_s_error_and_its_sensor_s() -> None:
    """Of normal errors of 0.8 m and 0.6 m on each axis, 95 % are within 1.96 times a metre."""
    noisy = dataclasses.replace(CONFIG, position_sigma=0.8, sector=dataclasses.replace(CONFIG.sector, sigma=0.6))
    packets, _raw, _receiver = said(2.0, noisy)
    port = geonetworking.PORTS[MessageId.CPM]
    objects = [one for _, packet in packets if packet.port == port for one in cpm.decode(packet.payload).objects]
    assert objects
    for one in objects:
        assert (one.confidence_x, one.confidence_y) == pytest.approx((1.96, 1.96), abs=0.021)


def test_pycrate_makes_the_same_cpm_again(tmp_path_factory: pytest.TempPathFactory) -> None:
    release2 = compiled(tmp_path_factory)
    packets, _raw, _receiver = said(2.0)
    port = geonetworking.PORTS[MessageId.CPM]
    messages = [packet.payload for _, packet in packets if packet.port == port]
    assert len(messages) >= 4
    for data in messages:
        kind = release2.CPM_PDU_Descriptions.CollectivePerceptionMessage
        content = read_and_made_again(kind, data)
        assert content["header"]["messageId"] == 14


@tshark.needs_tshark
def test_tshark_reads_the_warnings(tmp_path: Path) -> None:
    packets, raw, _receiver = said(6.0)
    port = geonetworking.PORTS[MessageId.DENM]
    frames = [
        geonetworking.ethernet_frame(data, b"\x02\x00\x00\x00\x00\x01")
        for data, (_, packet) in zip(raw, packets, strict=True)
        if packet.port == port
    ]
    found = tshark.read(frames, tmp_path)
    assert len(found) == len(denms(packets)) >= 4
    for fields, (_, _packet, one) in zip(found, denms(packets), strict=True):
        assert one.cause == 94
        tshark.assert_read(
            fields,
            {
                "denm.detectionTime": one.detection_time_ms,
                "denm.referenceTime": one.reference_time_ms,
                "its.latitude": round(one.latitude_deg * 1e7),
                "its.longitude": round(one.longitude_deg * 1e7),
                "its.causeCode": 94,
                "its.speedValue": round(100.0 * (one.speed or 0.0)),
                "denm.validityDuration": 30,
                "denm.transmissionInterval": 1000,
            },
        )


# --- the ego's own ----------------------------------------------------------------------------------------------------


def own(
    seconds: float, pose: Callable[[float], Pose], valid: Callable[[float], bool]
) -> list[tuple[float, Packet, Denm]]:
    output, found = DenmOutput(CONTEXT), []
    for tick in range(round(seconds / PERIOD)):
        time = tick * PERIOD
        measured = sample(time, pose(time)).measured if valid(time) else None
        one = Sample(1, EPOCH + time, time, measured, OwnMotion(pose(time), 0.02))
        found += [(time, geonetworking.decode(data)) for data in output.step(one)]
    return denms(found)


def stopping(time: float) -> Pose:
    """At 10 m/s until 2 s, then braking at 7 m/s2."""
    since = min(max(time - 2.0, 0.0), 10.0 / 7.0)
    x = 10.0 * min(time, 2.0) + 10.0 * since - 3.5 * since**2
    braking = 2.0 <= time < 2.0 + 10.0 / 7.0
    return dataclasses.replace(rear_axle(x, 0.0, 0.0, 10.0 - 7.0 * since), acceleration=-7.0 if braking else 0.0)


def test_the_ego_warns_of_its_hard_braking_and_of_standing_after_a_fault() -> None:
    """A fault at 2 s: from then on the outputs are invalid. It rests at 3.43 s, and tells of that at once."""
    found = own(10.0, stopping, lambda time: time < 2.0)
    braking = [(time, one) for time, _, one in found if one.cause == 99]
    standing = [(time, one) for time, _, one in found if one.cause == 94]
    assert [time for time, _ in braking] == pytest.approx([2.0 + 0.1 * n for n in range(15)], abs=0.021)
    slow = 2.0 + (10.0 - 0.3) / 7.0
    assert standing[0][0] == pytest.approx(slow, abs=0.1)
    assert np.diff([time for time, _ in standing]) == pytest.approx([1.0] * (len(standing) - 1))
    for time, one in braking:
        front = FRAME.to_map(math.radians(one.latitude_deg), math.radians(one.longitude_deg))
        assert front == pytest.approx((stopping(time).x + BUMPER, 0.0), abs=0.02)
        assert (one.station, one.detection_time_ms) == (1, its_time.from_gnss(EPOCH + time))
    assert {packet.area.distance_a for _, packet, one in found if packet.area and one.cause == 99} == {500}


def test_an_ego_that_waits_in_traffic_or_has_not_begun_warns_of_nothing() -> None:
    assert own(20.0, lambda time: rear_axle(), lambda time: True) == []
    assert own(20.0, lambda time: rear_axle(), lambda time: False) == []


def test_an_ego_that_drives_on_calls_its_warning_off() -> None:
    found = own(40.0, lambda time: rear_axle(speed=0.0 if time < 10.0 else 5.0), lambda time: not 2.0 <= time < 10.0)
    assert [one.termination for _, _, one in found][-15:] == [Termination.CANCELLATION] * 15
    assert {one.sequence for _, _, one in found} == {0}


def test_nothing_goes_out_where_nobody_knows_where_the_ego_is() -> None:
    output = DenmOutput(CONTEXT)
    output.step(sample(0.0, rear_axle()))
    for tick in range(1, 400):
        assert output.step(Sample(tick, EPOCH + 0.02 * tick, 0.02 * tick, None)) == ()


def test_where_the_ego_is_goes_with_a_sample_only_where_a_wire_tells_of_it() -> None:
    for tells in (False, True):
        sent: list[Sample] = []
        publisher = Publisher(sent.append, virtual_placement(FRAME, Mounting(0.0, 0.0), EPOCH), EPOCH, needs_ego=tells)
        fix = dataclasses.replace(no_fix(EPOCH, 0.0), position_sigma=0.03)
        seen = SensorFrame(rear_axle(7.0), fix, Actors.none(0.0), {})
        for faults in (("bus_silent",), ("pose_stale",)):
            publisher.publish(1.0, seen, faults)
        publisher.publish(1.0, None, ())
        known = [OwnMotion(rear_axle(7.0), 0.03) if tells else None, None, None]
        assert [one.own for one in sent] == known
        assert [one.measured for one in sent] == [None] * 3
        assert [decode_sample(encode_sample(one, actors=False)) for one in sent] == sent
