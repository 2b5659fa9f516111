"""Receivers that serve NovAtel OEM7 logs over TCP."""

from __future__ import annotations

from vve_sumo.pose.receivers.novatel import NovatelReceiver
from vve_sumo.pose.receivers.port import Receiver
from vve_sumo.pose.receivers.tcp import TcpReceiver


class NovatelTcp(TcpReceiver, NovatelReceiver):
    """NovAtel OEM7 logs from a TCP server."""


def make() -> type[Receiver]:
    """Return the kind's class."""
    return NovatelTcp
