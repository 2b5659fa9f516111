"""Receivers that serve Septentrio SBF over TCP."""

from __future__ import annotations

from vve_sumo.pose.receivers.port import Receiver
from vve_sumo.pose.receivers.sbf import SbfReceiver
from vve_sumo.pose.receivers.tcp import TcpReceiver


class SbfTcp(TcpReceiver, SbfReceiver):
    """Septentrio SBF from a TCP server."""


def make() -> type[Receiver]:
    """Return the kind's class."""
    return SbfTcp
