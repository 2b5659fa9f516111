"""Receivers that send NovAtel OEM7 logs over a serial line."""

from __future__ import annotations

from vve_sumo.pose.receivers.novatel import NovatelReceiver
from vve_sumo.pose.receivers.port import Receiver
from vve_sumo.pose.receivers.serial_line import SerialReceiver


class NovatelSerial(SerialReceiver, NovatelReceiver):
    """NovAtel OEM7 logs over a serial line."""


def make() -> type[Receiver]:
    """Return the kind's class."""
    return NovatelSerial
