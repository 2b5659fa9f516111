"""The bridge between the datagrams of a drive's wires and messages: what is shown, and above all what is not."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rosbags", reason="needs pip install 'vve-sumo[ros2]'")
from tests.bridges.ros2.drive import (
    EPOCH,
    FAR,
    SPEED,
    Wires,
    heading_of,
    installation,
    pose_at,
    sample_at,
)
from tests.vehicles import FUSION
from vve_sumo.bridges.ros2.bridge import Bridge
from vve_sumo.sensors.camera import no_objects
from vve_sumo.wire.datagrams import SetpointDatagram, decode_setpoint
from vve_sumo.wire.ros2.messages import TOPICS, unix_nanoseconds
from vve_sumo.wire.sample import LidarTurn, Sample
from vve_sumo.wire.senses import SenseDatagram, encode_sense
from vve_sumo.wire.setpoints import SetpointInbox
from vve_sumo.wire.signature import signed

VEHICLE = FUSION.vehicle
KEY = bytes(range(32))
#: ticks until the receiver's packets have said the date and all accuracies
SETTLED = 12


@dataclass
class Stage:
    """A bridge, its wires, and what it published and sent."""

    key: bytes = b""
    commands: str = "twist_stamped"
    messages: list[tuple[str, Any]] = field(default_factory=list)
    setpoints: list[bytes] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.wires = Wires(VEHICLE, self.key)
        made = installation(VEHICLE, self.key, self.commands)
        self.bridge = Bridge(made, lambda topic, message: self.messages.append((topic, message)), self.setpoints.append)
        for tick in range(SETTLED):
            self.tick(sample_at(tick))
        self.messages.clear()

    def tick(self, sample: Sample, *, without: str = "", now: float | None = None) -> list[str]:
        """Hand over a tick's datagrams; return the topics of the messages that it brought."""
        before = len(self.messages)
        for kind, data in self.wires.of(sample).items():
            whole = signed(data, self.key) if self.key and kind != "ncom" else data
            if kind == without:
                continue
            if kind == "ncom":
                self.bridge.take_ncom(whole)
            elif kind == "scene":
                self.bridge.take_scene(whole)
            else:
                self.bridge.take_radar(whole, sample.drive_time if now is None else now)
        return [topic for topic, _ in self.messages[before:]]

    def command(self, tick: int, writer: int = 1, speed: float = 5.0) -> SetpointDatagram | None:
        """Command; return the setpoint that was sent."""
        sec, nanosec = divmod(unix_nanoseconds(EPOCH + 0.02 * tick), 1_000_000_000)
        header = SimpleNamespace(stamp=SimpleNamespace(sec=sec, nanosec=nanosec))
        twist = SimpleNamespace(linear=SimpleNamespace(x=speed), angular=SimpleNamespace(z=0.0))
        before = len(self.setpoints)
        self.bridge.take_command(writer, SimpleNamespace(header=header, twist=twist))
        if len(self.setpoints) == before:
            return None
        body = self.setpoints[-1][:-16] if self.key else self.setpoints[-1]
        got = decode_setpoint(body)
        assert isinstance(got, SetpointDatagram)
        return got


def test_a_tick_is_shown_whole_and_odometry_is_the_last_that_a_node_drives_by() -> None:
    stage = Stage()
    topics = stage.tick(sample_at(SETTLED))
    assert topics[0] == "/clock"
    assert topics[topics.index("/odom") + 1 :] == ["/bodies", "/diagnostics"]
    assert set(topics) == TOPICS.keys() - {"/tf_static", "/path"}
    got, pose = dict(stage.messages), pose_at(SETTLED)
    odometry, place = got["/odom"], got["/odom"].pose.pose
    # NCOM carries angles in 1e-6 rad, speeds in 1e-4 m/s, places in 64 bits.
    assert (place.position.x, place.position.y) == pytest.approx((pose.x, pose.y), abs=2e-6)
    assert heading_of(place.orientation.z, place.orientation.w) == pytest.approx(pose.heading, abs=2e-6)
    assert odometry.twist.twist.linear.x == pytest.approx(SPEED, abs=2e-4)
    assert odometry.pose.covariance[0] == pytest.approx(0.02**2)
    assert got["/tf"].transforms[0].transform.translation.x == place.position.x
    points = np.frombuffer(got["/radar/points"].data.tobytes(), "<f4").reshape(-1, 6)
    assert points[0, 3] == np.float32(FAR - 2.25 - 3.84 - SPEED * 0.02 * SETTLED)
    assert [each.ns for each in got["/bodies"].markers] == ["", "parked"]
    values = {pair.key: pair.value for pair in got["/diagnostics"].status[0].values}
    gap = FAR - 2.25 - VEHICLE.rear_axle_to_bumper - SPEED * 0.02 * SETTLED
    assert (values["state"], values["reasons"], values["valid"]) == ("engaged", "", "true")
    assert float(values["gap_m"]) == pytest.approx(gap, abs=2e-3)


def test_what_is_latched_comes_once_a_drive() -> None:
    stage = Stage()
    for tick in range(SETTLED, SETTLED + 5):
        assert not {"/tf_static", "/path"} & set(stage.tick(sample_at(tick)))
    again = stage.tick(sample_at(0), now=100.0)  # another drive, after a silence
    assert Counter(again)["/tf_static"] == Counter(again)["/path"] == 1


def _sensed(sequence: int, parts: int = 1) -> list[bytes]:
    """Return the datagrams of a turn of a lidar that went out with a tick."""
    turn = LidarTurn(
        0.0, 5e-5, np.arange(4, dtype=np.uint16), np.zeros(2), np.array([-0.1, 0.1]),
        np.full(8, 500, np.uint16), np.zeros(8, np.uint8),
    )  # fmt: skip
    halves = [replace(turn, azimuth=turn.azimuth[::parts], range=turn.range[::parts],
                      reflectivity=turn.reflectivity[::parts])] * parts  # fmt: skip
    return [encode_sense(SenseDatagram(sequence, EPOCH + 0.1, number, parts, turn=half))
            for number, half in enumerate(halves)]  # fmt: skip


def test_a_turn_is_shown_with_its_tick_before_odometry() -> None:
    stage = Stage()
    for data in _sensed(SETTLED + 1, parts=2):
        stage.bridge.take_sense("roof", data)
    topics = stage.tick(sample_at(SETTLED))
    assert topics.count("/roof/points") == 1
    assert topics[topics.index("/odom") + 1 :] == ["/bodies", "/diagnostics"]
    cloud = dict(stage.messages)["/roof/points"]
    assert (cloud.width, cloud.header.frame_id) == (8, "roof")
    assert cloud.header.stamp.nanosec == 100_000_000
    assert "/roof/points" not in stage.tick(sample_at(SETTLED + 1))


def test_a_list_is_shown_as_a_cloud_and_as_detections() -> None:
    stage = Stage()
    listed = replace(no_objects(0.1), number=np.array([7]), kind=np.zeros(1, np.int8), status=np.ones(1, np.int8),
                     **{name: np.ones(1) for name in ("x", "y", "relative_speed", "width", "length")})  # fmt: skip
    stage.bridge.take_sense("front", encode_sense(SenseDatagram(SETTLED + 1, EPOCH + 0.1, objects=listed)))
    assert {"/front/objects", "/front/detections"} <= set(stage.tick(sample_at(SETTLED)))


@pytest.mark.parametrize("sequence", [SETTLED, SETTLED + 2])
def test_a_measurement_of_another_tick_is_not_shown(sequence: int) -> None:
    stage = Stage()
    for data in _sensed(sequence):
        stage.bridge.take_sense("roof", data)
    assert "/roof/points" not in stage.tick(sample_at(SETTLED))
    assert ("/roof/points" in stage.tick(sample_at(SETTLED + 1))) == (sequence == SETTLED + 2)


def test_a_measurement_of_an_invalid_tick_is_never_shown() -> None:
    stage = Stage()
    for data in _sensed(SETTLED + 1):
        stage.bridge.take_sense("roof", data)
    assert stage.tick(sample_at(SETTLED, valid=False)) == ["/clock", "/diagnostics"]
    assert "/roof/points" not in stage.tick(sample_at(SETTLED + 1))


def test_a_measurement_of_the_drive_before_is_never_shown() -> None:
    stage = Stage()
    for data in _sensed(SETTLED + 30):
        stage.bridge.take_sense("roof", data)
    stage.tick(sample_at(0), now=100.0)  # another drive, after a silence
    shown = [stage.tick(sample_at(tick), now=100.0 + 0.02 * tick) for tick in range(1, SETTLED + 40)]
    assert not any("/roof/points" in topics for topics in shown)


def test_a_bridge_that_is_two_ticks_late_shows_each_tick_by_its_own_fix_and_scene() -> None:
    stage = Stage()
    late = [stage.wires.of(sample_at(SETTLED + number)) for number in range(3)]
    for data in late:
        stage.bridge.take_ncom(data["ncom"])
        stage.bridge.take_scene(data["scene"])
    for number, data in enumerate(late):
        stage.messages.clear()
        stage.bridge.take_radar(data["radar"], 0.02 * (SETTLED + number))
        got = dict(stage.messages)
        assert got["/odom"].pose.pose.position.x == pytest.approx(pose_at(SETTLED + number).x, abs=2e-6)
        assert len(got["/bodies"].markers) == 2


def test_a_scan_is_shown_once() -> None:
    stage = Stage()
    first = stage.tick(sample_at(SETTLED, scan_age=0.04))
    second = stage.tick(sample_at(SETTLED + 1, scan_age=0.06))  # the same scan
    assert "/radar/points" in first
    assert "/odom" in second
    assert "/radar/points" not in second


DRIVEN_BY = {"/odom", "/tf", "/fix", "/imu", "/radar/points"}


@pytest.mark.parametrize(
    "spoilt",
    [
        lambda stage: stage.tick(sample_at(SETTLED, valid=False)),
        lambda stage: stage.tick(sample_at(SETTLED, scan_age=0.32)),
        lambda stage: stage.tick(sample_at(SETTLED + 10), without="ncom"),  # the newest fix is 0.2 s old
    ],
    ids=["invalid", "old scan", "old fix"],
)
def test_nobody_drives_by_what_is_invalid_or_old(spoilt: Any) -> None:
    stage = Stage()
    assert stage.command(SETTLED - 1) is not None
    topics = spoilt(stage)
    assert "/clock" in topics
    assert not DRIVEN_BY & set(topics)
    assert dict(stage.messages)["/diagnostics"].status[0].level == 2
    assert stage.command(SETTLED - 1) is None
    assert stage.command(SETTLED) is None


def test_an_invalid_tick_tells_why() -> None:
    stage = Stage()
    topics = stage.tick(sample_at(SETTLED, valid=False))
    assert topics == ["/clock", "/diagnostics"]
    values = {pair.key: pair.value for pair in stage.messages[-1][1].status[0].values}
    assert values == {"state": "stopping", "reasons": "pose_stale", "valid": "false", "gap_m": ""}


def test_a_repeated_datagram_brings_nothing() -> None:
    stage = Stage()
    assert stage.tick(sample_at(SETTLED))
    assert not stage.tick(sample_at(SETTLED))
    assert not stage.tick(sample_at(SETTLED - 3))


@pytest.mark.parametrize("kind", ["radar", "scene", "sense"])
def test_damaged_and_unsigned_datagrams_are_counted_and_bring_nothing(kind: str) -> None:
    stage = Stage(key=KEY)
    data = (stage.wires.of(sample_at(SETTLED)) | {"sense": _sensed(SETTLED + 1)[0]})[kind]
    take = {
        "radar": lambda got: stage.bridge.take_radar(got, 0.0),
        "scene": stage.bridge.take_scene,
        "sense": lambda got: stage.bridge.take_sense("roof", got),
    }[kind]
    for bad in (data, signed(data, KEY)[:-1], b"", signed(data[:-4], KEY), signed(data, bytes(32))):
        take(bad)
    assert (stage.bridge.unread, stage.messages) == (5, [])


@pytest.mark.parametrize("key", [b"", KEY])
def test_the_inbox_of_the_gateway_takes_the_answer_to_a_command(key: bytes) -> None:
    stage, inbox = Stage(key=key), SetpointInbox(EPOCH, key)
    stage.tick(sample_at(SETTLED))
    inbox.sample_sent(SETTLED + 1)
    assert stage.command(SETTLED) is not None
    assert inbox.take(0.02 * SETTLED + 0.005, stage.setpoints[-1]) == ""
    command = inbox.command(0.02 * SETTLED + 0.05)
    assert command is not None
    assert command.acceleration == pytest.approx((5.0 - SPEED) / 0.5)
    assert inbox.command(0.02 * SETTLED + 0.2) is None  # no older than any setpoint may be


def test_nothing_is_sent_without_a_command() -> None:
    stage = Stage()
    for tick in range(SETTLED, SETTLED + 20):
        stage.tick(sample_at(tick))
    assert stage.setpoints == []


def test_a_second_publisher_silences_the_bridge() -> None:
    stage = Stage()
    assert stage.command(SETTLED - 1, writer=1) is not None
    assert stage.command(SETTLED - 1, writer=2) is None
    assert stage.command(SETTLED - 1, writer=1) is None


def test_bytes_that_are_no_command_are_counted() -> None:
    stage = Stage()
    stage.bridge.take_command(1, None)
    assert stage.bridge.answers.refused == Counter({"command_malformed": 1})
