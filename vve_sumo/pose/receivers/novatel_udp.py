"""Receivers that send NovAtel OEM7 logs in UDP datagrams."""

from __future__ import annotations

from vve_sumo.pose.receivers.novatel import NovatelReceiver
from vve_sumo.pose.receivers.port import Receiver
from vve_sumo.pose.receivers.udp import UdpReceiver


class NovatelUdp(UdpReceiver, NovatelReceiver):
    """NovAtel OEM7 logs in UDP datagrams."""


def make() -> type[Receiver]:
    """Return the kind's class."""
    return NovatelUdp
