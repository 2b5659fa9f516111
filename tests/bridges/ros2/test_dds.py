"""Topics over Cyclone DDS: what is sent is read again by DDS' own decoder, field by field; nobody else is heard."""

from __future__ import annotations

import math
import os
import select
import socket
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rosbags", reason="needs pip install 'vve-sumo[ros2]'")
pytest.importorskip("cyclonedds", reason="needs pip install 'vve-sumo[ros2]'")
from tests.bridges.ros2.drive import ACTORS, pose_at, sample_at
from tests.isolated import isolated
from tests.wire.ros2.test_clouds import LISTED
from vve_sumo.bridges.ros2.bridge import COMMANDS
from vve_sumo.bridges.ros2.dds import Dds, ReceivedMessage
from vve_sumo.bridges.ros2.loopback import udp_sockets
from vve_sumo.bridges.ros2.senses import topics_of
from vve_sumo.errors import RigError
from vve_sumo.path import ReferencePath
from vve_sumo.wire.ros2 import clouds, messages
from vve_sumo.wire.ros2.types import make, store
from vve_sumo.wire.sample import LidarTurn

AT = 1_767_225_600_020_000_000
TURN = LidarTurn(
    0.1, 5e-5, np.arange(0, 36_000, 20, dtype=np.uint16), np.zeros(16), np.linspace(-0.26, 0.26, 16),
    np.full(28_800, 5000, np.uint16), np.full(28_800, 40, np.uint8),
)  # fmt: skip
DOMAIN = 1 + os.getpid() % 100


@pytest.fixture(scope="module")
def dds() -> Iterator[Dds]:
    """One participant that publishes every topic and hears each of them."""
    joined = Dds(DOMAIN)
    senses = {**topics_of("roof", ("points",)), **topics_of("front", ("objects",))}
    for topic, kind in {**messages.TOPICS, **senses, **dict(COMMANDS.values())}.items():
        joined.advertise(topic, kind, latched=topic in messages.LATCHED)
        joined.subscribe(topic, kind)
    yield joined
    joined.close()


def _heard(dds: Dds, topic: str, message: Any) -> ReceivedMessage:
    dds.publish(topic, message)
    for _ in range(50):
        select.select([dds], [], [], 0.1)
        if got := dds.receive():
            assert len(got) == 1
            return got[0]
    raise AssertionError("nothing was heard")


def _same(name: str, sent: Any, got: Any) -> None:
    """Every field of a message that was made by rosbags stands in the one that Cyclone DDS decoded."""
    if hasattr(sent, "__msgtype__"):
        for field, _ in store().fielddefs[sent.__msgtype__][1]:
            _same(f"{name}.{field}", getattr(sent, field), getattr(got, field))
    elif isinstance(sent, (list, tuple, np.ndarray)):
        assert len(sent) == len(got), name
        for number, (one, other) in enumerate(zip(sent, got, strict=True)):
            _same(f"{name}[{number}]", one, other)
    elif ".color." in name:  # 32 bits
        assert got == np.float32(sent), name
    else:
        assert got == sent, name


def _messages() -> Iterator[tuple[str, Any]]:
    content = sample_at(20).measured
    assert content is not None
    yield "/clock", messages.clock(AT)
    yield "/tf", messages.transforms(AT, pose_at(3))
    yield "/tf_static", messages.static_transforms(AT, 3.84, (0.3, 0.2))
    yield "/fix", messages.nav_sat_fix(AT, content.fix)
    yield "/imu", messages.imu(AT, content.fix)
    yield "/radar/points", clouds.radar_cloud(AT, *(np.array([10.0, 20.0]) * s for s in (1.0, 0.01, -0.5)))
    yield "/bodies", messages.markers(AT, ACTORS)
    yield "/path/ahead", messages.path(AT, ReferencePath.from_points(np.array([0.0, 9.0]), np.zeros(2)))
    yield "/roof/points", clouds.lidar_cloud(AT, TURN, "roof")
    yield "/front/objects", clouds.table_cloud(AT, LISTED, "front")
    yield "/front/detections", clouds.detections(AT, LISTED, "front")
    yield "/diagnostics", messages.drive_status(AT, "engaged", ("a", "b"), valid=True, gap=math.pi)
    yield "/odom", messages.odometry(AT, pose_at(3), content.fix)
    stamp = make("std_msgs/msg/Header", messages.stamp(AT), "")
    drive = make("ackermann_msgs/msg/AckermannDrive", *(0.125 * n for n in range(5)))
    yield "/ackermann_cmd", make("ackermann_msgs/msg/AckermannDriveStamped", stamp, drive)


@pytest.mark.parametrize("topic", [topic for topic, _ in _messages()])
def test_every_field_is_read_again_by_another_decoder(dds: Dds, topic: str) -> None:
    sent = dict(_messages())[topic]
    got = _heard(dds, topic, sent)
    assert got.writer != 0
    _same(topic, sent, got.message)
    assert dds.dropped == 0


def test_its_ports_hear_nobody_on_a_network(dds: Dds) -> None:
    addresses = {line.split()[1] for line in Path("/proc/net/udp").read_text(encoding="ascii").splitlines()[1:]}
    ports = [7400 + 250 * DOMAIN + 10 + 2 * index + kind for index in range(65) for kind in (0, 1)]
    opened = [port for port in ports if f"00000000:{port:04X}" in addresses]
    assert opened, "DDS opens its ports on every network; the filter is what keeps them to this machine"
    # The kernel tells a filter's length, which is that of ours: five instructions.
    for number in udp_sockets():
        with socket.socket(fileno=os.dup(number)) as end:
            if end.getsockname()[1] in opened:
                assert end.getsockopt(socket.SOL_SOCKET, 26, 5 * 8)


def test_a_domain_that_cannot_be_joined_is_refused(dds: Dds) -> None:
    with pytest.raises(RigError, match=f"ros2: domain {DOMAIN} cannot be joined"):
        Dds(DOMAIN)


def _close_in_a_listener(domain: int) -> bool:
    """Leave the domain while a thread of DDS says that a message has come; return whether it was so."""
    joined, begun, write = Dds(domain), threading.Event(), os.write

    def slow(number: int, data: bytes) -> int:
        begun.set()
        time.sleep(0.1)
        return write(number, data)

    os.write = slow
    joined.advertise("/clock", messages.TOPICS["/clock"])
    joined.subscribe("/clock", messages.TOPICS["/clock"])
    # Within one process the listener is called by the thread that publishes.
    publisher = threading.Thread(target=joined.publish, args=("/clock", messages.clock(AT)))
    publisher.start()
    came = begun.wait(10.0)
    joined.close()
    publisher.join()
    return came


@pytest.mark.parametrize("attempt", range(5))
def test_it_leaves_while_a_message_comes(attempt: int) -> None:
    # Whether two threads wait for each other is chance: five times are enough to meet it.
    assert isolated(_close_in_a_listener, 1 + (os.getpid() + 25 + attempt) % 100, timeout=30.0)


class _Broken:
    """A subscription all of whose messages are bytes of something else."""

    def take(self, _count: int) -> list[Any]:
        raise ValueError("no such message")


def test_a_subscription_that_gives_only_errors_does_not_hold_it(dds: Dds) -> None:
    dds._readers.append(("/broken", _Broken()))
    try:
        got = dds.receive()
    finally:
        dds._readers.pop()
    assert 10 <= len(got) < 100
    assert {one.message for one in got} == {None}
