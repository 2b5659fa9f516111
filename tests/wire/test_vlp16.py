"""The packets of a VLP-16, decoded by a library that is not ours."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import velodyne_decoder as velodyne

from tests.sensors.scenes import actors, car
from tests.sensors.test_lidar import HOUSE, driven
from tests.sensors.test_ray_casting import Firings, by_mesh, mesh_of
from vve_sumo.pose.nmea_encoder import encode
from vve_sumo.sensors.body_shapes import blocks_of
from vve_sumo.sensors.lidar import LidarConfig, LidarScan
from vve_sumo.sensors.ray_casting import Channels
from vve_sumo.values import FixQuality, Floats
from vve_sumo.wire.sample import no_fix
from vve_sumo.wire.vlp16 import ELEVATIONS_DEG, Vlp16Encoder, past_the_hour, position_packet, turn_of

#: GNSS second of drive time 0: 18 s after 2024-05-18 16:53:20 UTC in GPS time
EPOCH = 1_400_000_018.0
EXACT = replace(LidarConfig().ideal(), range_quantum=0.002)
SCENE = actors([car(20.0, 3.0), car(-10.0, -4.0), car(8.0, 6.0, 1.0), car(14.0, -5.0, 0.4)])


def decoded(packets: list[bytes]) -> np.ndarray:
    """x ahead, y left, z up [m], intensity, time, column, ring, kind of each point, as the library says."""
    config = velodyne.Config(model=velodyne.Model.VLP16)
    config.min_range, config.max_range = 0.1, 200.0
    stream, found = velodyne.StreamDecoder(config), []
    for packet in packets:
        if (scan := stream.decode(EPOCH, packet)) is not None:
            found.append(scan[1])
    if (rest := stream.finish()) is not None:
        found.append(rest[1])
    return np.concatenate(found)


def packets_of(scans: list[LidarScan]) -> list[bytes]:
    encoder = Vlp16Encoder()
    return [packet for scan in scans for packet in encoder.encode(turn_of(scan.cloud), EPOCH)]


def in_order(scan: LidarScan) -> tuple[Floats, Floats, Floats]:
    """Horizontal range, azimuth and intensity of a turn's points in the order in which they were fired."""
    cloud = scan.cloud
    firing, channel = np.nonzero(cloud.range > 0.0)
    azimuth = cloud.azimuth[firing] + cloud.azimuth_offset[channel]
    level = cloud.range[firing, channel] * np.cos(cloud.elevation[channel])
    return level, azimuth, cloud.reflectivity[firing, channel].astype(float)


@pytest.mark.thorough
@pytest.mark.parametrize(("speed", "yaw_rate"), [(0.0, 0.0), (9.0, 0.3)])
def test_a_foreign_decoder_reads_every_point(speed: float, yaw_rate: float) -> None:
    scans = [scan for _, scan in driven(EXACT, 0.3, speed=speed, yaw_rate=yaw_rate, scene=SCENE, walls=HOUSE)]
    found = decoded(packets_of(scans))
    level, azimuth, intensity = (np.concatenate(parts) for parts in zip(*map(in_order, scans), strict=True))
    assert len(found) == len(level) > 35_000
    x, y = found[:, 0], found[:, 1]
    assert np.hypot(x, y) == pytest.approx(level, abs=1e-4)
    # The library knows azimuths to 0.01 degree.
    assert np.degrees(np.abs(np.remainder(np.arctan2(y, x) - azimuth + math.pi, math.tau) - math.pi)).max() < 0.011
    assert found[:, 3] == pytest.approx(intensity)


@pytest.mark.slow
def test_a_hundred_thousand_points_lie_where_another_library_casts_the_rays() -> None:
    """Wire and decoder included, the range is that of a mesh to the wire's own 2 mm."""
    chance, compared = np.random.default_rng(4), 0
    while compared < 100_000:
        rows = [car(*chance.uniform((-60, 6), (60, 40)), chance.uniform(-3, 3)) for _ in range(8)]
        rows += [car(*chance.uniform((-60, -40), (60, -6)), chance.uniform(-3, 3)) for _ in range(8)]
        scene = actors(rows)
        (_, scan) = driven(EXACT, 0.1, scene=scene, walls=HOUSE)[0]
        found, cloud = decoded(packets_of([scan])), scan.cloud
        channels = Channels.of(cloud.elevation, np.arange(16) / 24.0, EXACT.z, EXACT.range_max)
        fired = Firings(channels, np.full(1800, EXACT.x), np.zeros(1800), np.zeros(1800), cloud.azimuth, EXACT.step)
        far = by_mesh(fired, mesh_of(blocks_of(scene, np.arange(len(rows))), HOUSE))
        there = np.isfinite(far) & (far >= EXACT.range_min)
        truth = far[there] * np.cos(cloud.elevation)[np.nonzero(there)[1]]
        assert abs(len(found) - len(truth)) <= 2, "a ray along an edge may pass it on either side"
        if len(found) == len(truth):
            wrong = np.abs(np.hypot(found[:, 0], found[:, 1]) - truth) > 0.002
            assert wrong.mean() < 1e-4
            compared += len(found)


def test_packets_say_when_they_were_fired() -> None:
    (_, scan) = driven(EXACT, 0.1, scene=SCENE)[0]
    packets = packets_of([scan])
    assert len(packets) == 75
    times = [int.from_bytes(packet[1200:1204], "little") for packet in packets]
    begin = past_the_hour(EPOCH)
    assert times[0] == begin == (EPOCH - 18.0) % 3600 * 1e6
    assert np.diff(times) == pytest.approx(24 * 1e6 / 18_000, abs=1.0)
    assert {packet[1204:] for packet in packets} == {b"\x37\x22"}


@pytest.mark.parametrize(
    ("time", "expected"), [(18.0, 0), (3617.9999999, 0), (18.5, 500_000), (3617.999999, 3_599_999_999)]
)
def test_the_hour_ends_where_it_begins(time: float, expected: int) -> None:
    assert past_the_hour(time) == expected


def test_a_turn_that_fills_no_packet_waits_for_the_next() -> None:
    config = replace(EXACT, steps=900, rate=20.0)
    scans = [scan for _, scan in driven(config, 0.2, scene=SCENE)]
    encoder = Vlp16Encoder()
    counts = [len(encoder.encode(turn_of(scan.cloud), EPOCH)) for scan in scans]
    assert counts == [37, 38, 37, 38]
    level = np.concatenate([in_order(scan)[0] for scan in scans])
    found = decoded(packets_of(scans))
    assert np.hypot(found[:, 0], found[:, 1]) == pytest.approx(level, abs=1e-4)


def test_what_waited_is_not_sent_after_a_turn_that_never_came() -> None:
    config = replace(EXACT, steps=900, rate=20.0)
    one, _, three = [scan for _, scan in driven(config, 0.15, scene=SCENE)]
    encoder = Vlp16Encoder()
    assert len(encoder.encode(turn_of(one.cloud), EPOCH)) == 37
    packets = encoder.encode(turn_of(three.cloud), EPOCH)
    assert len(packets) == 37, "the half packet of the first turn is gone"
    assert int.from_bytes(packets[0][1200:1204], "little") == past_the_hour(EPOCH + 0.1)


def test_what_the_wire_cannot_say_is_nothing() -> None:
    """Two bytes of 2 mm end at 131 m; a lidar of other channels is no VLP-16."""
    cloud = driven(EXACT, 0.1, scene=SCENE)[0][1].cloud
    far = replace(cloud, range=np.where(cloud.range > 0.0, 140.0, 0.0))
    assert not turn_of(far).range.any()
    assert turn_of(replace(far, range=np.full_like(far.range, 131.07))).range.min() == 65_535
    few = replace(cloud, range=cloud.range[:, :8], reflectivity=cloud.reflectivity[:, :8])
    with pytest.raises(ValueError, match="a VLP-16 has 16 channels, got 8"):
        Vlp16Encoder().encode(turn_of(few), EPOCH)


def test_the_lidar_s_own_order_is_that_of_the_wire() -> None:
    assert np.degrees(LidarConfig().elevations) == pytest.approx(ELEVATIONS_DEG)


def test_a_position_packet_holds_the_time_and_the_place() -> None:
    fix = replace(
        no_fix(EPOCH + 0.25, 0.25), latitude=math.radians(40.0), longitude=math.radians(-83.0), altitude=250.0,
        heading=0.0, velocity_north=0.0, velocity_east=5.0, locked=True, quality=FixQuality.RTK_FIXED,
    )  # fmt: skip
    packet = velodyne.TelemetryPacket(position_packet(EPOCH + 0.25, encode(fix)))
    assert packet.usec_since_toh == past_the_hour(EPOCH + 0.25)
    assert packet.pps_status == velodyne.TelemetryPacket.PpsStatus.LOCKED
    nmea = packet.parse_nmea()
    assert (nmea.latitude, nmea.longitude) == pytest.approx((40.0, -83.0), abs=1e-6)
    assert nmea.fix_available


def test_a_receiver_without_a_place_says_so() -> None:
    packet = velodyne.TelemetryPacket(position_packet(EPOCH, encode(no_fix(EPOCH, 0.0))))
    assert ",V," in packet.nmea_sentence
