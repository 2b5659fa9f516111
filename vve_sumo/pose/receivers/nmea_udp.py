"""Receivers that send NMEA 0183 in UDP datagrams."""

from __future__ import annotations

from vve_sumo.pose.receivers.nmea import NmeaReceiver
from vve_sumo.pose.receivers.port import Receiver
from vve_sumo.pose.receivers.udp import UdpReceiver


class NmeaUdp(UdpReceiver, NmeaReceiver):
    """NMEA 0183 in UDP datagrams."""


def make() -> type[Receiver]:
    """Return the kind's class."""
    return NmeaUdp
