"""Receivers that send NMEA 0183 over a serial line."""

from __future__ import annotations

from typing import Annotated, ClassVar

from pydantic import Field

from vve_sumo.config_file import Name
from vve_sumo.pose import sources
from vve_sumo.pose.receivers.nmea import NmeaReceiver
from vve_sumo.pose.receivers.port import OpenBus, Receiver


class NmeaSerial(NmeaReceiver):
    """NMEA 0183 over a serial line."""

    silent_hint: ClassVar[str] = (
        "see pose.device and pose.baud, and the receiver's serial output: GGA, HDT, VTG, RMC, GST"
    )

    device: Name = Field(description="serial port")
    baud: Annotated[int, Field(ge=4800, le=921_600)] = Field(default=115_200, description="of the serial port")

    def open(self, _open_bus: OpenBus) -> sources.Source:
        """Open the port; raises RigError naming the key."""
        return sources.open_serial(self.device, self.baud)

    def place(self) -> str:
        """Return device and baud rate."""
        return f"{self.device} at {self.baud} baud"


def make() -> type[Receiver]:
    """Return the kind's class."""
    return NmeaSerial
