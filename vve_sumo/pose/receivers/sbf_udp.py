"""Receivers that send Septentrio SBF in UDP datagrams."""

from __future__ import annotations

from vve_sumo.pose.receivers.port import Receiver
from vve_sumo.pose.receivers.sbf import SbfReceiver
from vve_sumo.pose.receivers.udp import UdpReceiver


class SbfUdp(UdpReceiver, SbfReceiver):
    """Septentrio SBF in UDP datagrams."""

    def recognises(self, datagram: bytes) -> bool:
        """Return whether a datagram holds a whole block that is read."""
        decoder = self.decoder()
        decoder.feed(datagram, 0.0)
        return decoder.recognised > 0


def make() -> type[Receiver]:
    """Return the kind's class."""
    return SbfUdp
