"""Receivers that serve NMEA 0183 over TCP."""

from __future__ import annotations

from vve_sumo.pose.receivers.nmea import NmeaReceiver
from vve_sumo.pose.receivers.port import Receiver
from vve_sumo.pose.receivers.tcp import TcpReceiver


class NmeaTcp(TcpReceiver, NmeaReceiver):
    """NMEA 0183 from a TCP server."""


def make() -> type[Receiver]:
    """Return the kind's class."""
    return NmeaTcp
