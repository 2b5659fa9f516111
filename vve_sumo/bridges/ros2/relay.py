"""Hands a ROS 2 driver's fixes on to a rig: hears its topics, sends NCOM to the port where the drive listens.

It is a program of its own: the drive reads its receiver as ever, over UDP on the loopback, and DDS is not in the loop.
Where this program stalls or dies no fix comes, and the gateway stops the car. It knows sockets, the rig and DDS; it
must not know what stands in a message.
"""

from __future__ import annotations

import contextlib
import ipaddress
import select
import socket
from collections.abc import Callable, Mapping
from typing import Final

from vve_sumo.bridges.ros2.dds import Dds
from vve_sumo.bridges.ros2.fixes import FIX, IMU, ODOM, FixAssembler
from vve_sumo.errors import ConfigError
from vve_sumo.pose.ncom import Encoder
from vve_sumo.pose.receivers.udp import UdpReceiver
from vve_sumo.rig.resolve import mounting_of, receiver_of
from vve_sumo.rig.schema import Rig

#: topics that are heard where nobody names others; not those of the bridge, which tell of the virtual road
TOPICS: Final = {"fix": "/receiver/fix", "imu": "/receiver/imu", "odom": "/receiver/odom"}
#: types of the topics, in the order in which what has come is taken: a fix finds its Imu and its Odometry
KINDS: Final = {"imu": IMU, "odom": ODOM, "fix": FIX}
RECEIVER: Final = "ncom_udp"  #: kind of the rig's receiver, which the fixes go out to
#: how often it is looked whether it has to end [s]
POLL: Final = 0.2


class FixRelay:
    """A relay with its socket and its domain; always call `close`."""

    def __init__(self, rig: Rig, topics: Mapping[str, str]) -> None:
        """Open all; raises ConfigError for a rig that it cannot serve, RigError for what cannot be opened."""
        pose, age = rig.pose, rig.ros2.corrections_age_s
        is_ncom = pose.kind == RECEIVER
        if not is_ncom or not isinstance(pose, UdpReceiver) or not ipaddress.ip_address(pose.address).is_loopback:
            expected = "the fixes go out as NCOM on this machine, expected kind 'ncom_udp' on 127.0.0.1"
            raise ConfigError(f"pose: {expected}, got {receiver_of(rig).place()}")
        if age is None:
            raise ConfigError("ros2.corrections_age_s is missing: a NavSatFix does not say how old its corrections are")
        self._to = pose.address, pose.port
        self._kinds = {topics[key]: kind for key, kind in KINDS.items()}
        self.assembler, self._encoder = FixAssembler(mounting_of(rig), age), Encoder()
        self.lost = 0  #: fixes that could not be sent
        self.place = f"{pose.address} port {pose.port}"  #: to which they go
        with contextlib.ExitStack() as opening:
            self._out = opening.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
            self._out.setblocking(False)
            self._dds = Dds(rig.ros2.domain_id)
            opening.callback(self._dds.close)
            for topic, kind in self._kinds.items():
                self._dds.subscribe(topic, kind)
            self._closing = opening.pop_all()

    def run(self, ended: Callable[[], bool]) -> None:
        """Run until `ended` says so."""
        while not ended():
            select.select([self._dds], [], [], POLL)
            for heard in self._dds.receive():
                fix = self.assembler.take(self._kinds[heard.topic], heard.writer, heard.message)
                if fix is not None:
                    self._send(self._encoder.encode(fix))

    def _send(self, packet: bytes) -> None:
        try:
            self._out.sendto(packet, self._to)
        except OSError:
            self.lost += 1

    def report(self) -> str:
        """Return one line on what was sent and refused."""
        refused = ", ".join(f"{count} x {why}" for why, count in sorted(self.assembler.refused.items())) or "none"
        return f"{self.assembler.made} fixes sent, messages refused {refused}; {self.lost} fixes lost"

    def close(self) -> None:
        """Close all that is open."""
        self._closing.close()
