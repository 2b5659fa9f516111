"""Receivers that send u-blox UBX over a serial line."""

from __future__ import annotations

from vve_sumo.pose.receivers.port import Receiver
from vve_sumo.pose.receivers.serial_line import SerialReceiver
from vve_sumo.pose.receivers.ubx import UbxReceiver


class UbxSerial(SerialReceiver, UbxReceiver):
    """u-blox UBX over a serial line."""


def make() -> type[Receiver]:
    """Return the kind's class."""
    return UbxSerial
