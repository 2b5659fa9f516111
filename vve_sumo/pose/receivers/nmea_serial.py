"""Receivers that send NMEA 0183 over a serial line."""

from __future__ import annotations

from typing import ClassVar

from vve_sumo.pose.receivers.nmea import NmeaReceiver
from vve_sumo.pose.receivers.port import Receiver
from vve_sumo.pose.receivers.serial_line import SerialReceiver


class NmeaSerial(SerialReceiver, NmeaReceiver):
    """NMEA 0183 over a serial line."""

    silent_hint: ClassVar[str] = (
        "see pose.device and pose.baud, and the receiver's serial output: GGA, HDT or THS, VTG, RMC, GST"
    )


def make() -> type[Receiver]:
    """Return the kind's class."""
    return NmeaSerial
