"""Receivers that send NMEA 0183 in UDP datagrams."""

from __future__ import annotations

from vve_sumo.pose.receivers.nmea import NmeaReceiver
from vve_sumo.pose.receivers.port import Receiver
from vve_sumo.pose.receivers.udp import UdpReceiver


class NmeaUdp(UdpReceiver, NmeaReceiver):
    """NMEA 0183 in UDP datagrams."""

    def recognises(self, datagram: bytes) -> bool:
        """Return whether a datagram holds a whole sentence."""
        decoder = self.decoder()
        decoder.feed(datagram, 0.0)
        return decoder.sentences > 0


def make() -> type[Receiver]:
    """Return the kind's class."""
    return NmeaUdp
