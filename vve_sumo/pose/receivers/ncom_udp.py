"""OXTS receivers that send NCOM in UDP datagrams."""

from __future__ import annotations

from typing import ClassVar

from vve_sumo.pose import ncom
from vve_sumo.pose.receivers.port import Receiver
from vve_sumo.pose.receivers.udp import UdpReceiver
from vve_sumo.pose.trust import DRIVE, TrustProfile


class NcomUdp(UdpReceiver):
    """NCOM in UDP datagrams."""

    profile: ClassVar[TrustProfile] = DRIVE

    def decoder(self) -> ncom.Decoder:
        """Return a fresh decoder."""
        return ncom.Decoder()

    def encoder(self) -> ncom.Encoder:
        """Return a fresh encoder."""
        return ncom.Encoder()

    def recognises(self, datagram: bytes) -> bool:
        """Return whether a datagram holds a whole packet."""
        decoder = self.decoder()
        decoder.feed(datagram, 0.0)
        return decoder.packets > 0


def make() -> type[Receiver]:
    """Return the kind's class."""
    return NcomUdp
