"""Common part of receivers whose bytes come over a serial line."""

from __future__ import annotations

from typing import Annotated, ClassVar

from pydantic import Field

from vve_sumo.config_file import Name
from vve_sumo.pose import sources
from vve_sumo.pose.far_ends import PtyFarEnd
from vve_sumo.pose.receivers.port import OpenBus, OpenFarBus, ReceiverTable
from vve_sumo.pty_link import PREFIX


class SerialReceiver(ReceiverTable):
    """A receiver at a serial port of this machine."""

    silent_hint: ClassVar[str] = "see pose.device and pose.baud, and what the receiver sends on its serial output"

    far_end_first: ClassVar[bool] = True

    device: Name = Field(
        description="serial port; of the simulated vehicle `pty:FILE`: FILE becomes a link to a line of its own"
    )
    baud: Annotated[int, Field(ge=4800, le=921_600)] = Field(default=115_200, description="of the serial port")

    def open(self, _open_bus: OpenBus) -> sources.Source:
        """Open the port; raises RigError naming the key."""
        return sources.open_serial(self.device.removeprefix(PREFIX), self.baud)

    def far_end(self, _open_far_bus: OpenFarBus) -> PtyFarEnd:
        """Make the pseudo-terminal that the device is a link to."""
        return PtyFarEnd(self.device)

    def not_simulated(self) -> str:
        """Return why the simulated vehicle cannot send as this receiver: it writes to no device of this machine."""
        if why := super().not_simulated():
            return why
        expected = f"device: the simulated vehicle makes its own line, expected '{PREFIX}FILE'"
        return "" if self.device.startswith(PREFIX) else f"{expected}, got {self.device!r}"

    def place(self) -> str:
        """Return device and baud rate."""
        return f"{self.device} at {self.baud} baud"
