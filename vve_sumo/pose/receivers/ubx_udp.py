"""Receivers that send u-blox UBX in UDP datagrams."""

from __future__ import annotations

from vve_sumo.pose.receivers.port import Receiver
from vve_sumo.pose.receivers.ubx import UbxReceiver
from vve_sumo.pose.receivers.udp import UdpReceiver


class UbxUdp(UdpReceiver, UbxReceiver):
    """u-blox UBX in UDP datagrams."""

    def recognises(self, datagram: bytes) -> bool:
        """Return whether a datagram holds a whole message that is read."""
        decoder = self.decoder()
        decoder.feed(datagram, 0.0)
        return decoder.recognised > 0


def make() -> type[Receiver]:
    """Return the kind's class."""
    return UbxUdp
