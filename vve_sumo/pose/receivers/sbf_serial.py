"""Receivers that send Septentrio SBF over a serial line."""

from __future__ import annotations

from vve_sumo.pose.receivers.port import Receiver
from vve_sumo.pose.receivers.sbf import SbfReceiver
from vve_sumo.pose.receivers.serial_line import SerialReceiver


class SbfSerial(SerialReceiver, SbfReceiver):
    """Septentrio SBF over a serial line."""


def make() -> type[Receiver]:
    """Return the kind's class."""
    return SbfSerial
