"""Common part of receivers that serve their bytes over TCP."""

from __future__ import annotations

from typing import ClassVar

from pydantic import Field

from vve_sumo.pose import sources
from vve_sumo.pose.far_ends import TcpFarEnd
from vve_sumo.pose.receivers.port import OpenBus, OpenFarBus, ReceiverTable
from vve_sumo.pose.receivers.udp import Address, NetworkPort, not_loopback


class TcpReceiver(ReceiverTable):
    """A receiver that is a TCP server."""

    silent_hint: ClassVar[str] = "see pose.address and pose.port, and that the receiver serves them"

    far_end_first: ClassVar[bool] = True

    address: Address = Field(default="127.0.0.1", description="of the receiver")
    port: NetworkPort = Field(default=3000, description="that the receiver serves")

    def open(self, _open_bus: OpenBus) -> sources.Source:
        """Connect; raises RigError naming the key."""
        return sources.open_tcp(self.address, self.port)

    def far_end(self, _open_far_bus: OpenFarBus) -> TcpFarEnd:
        """Serve the port."""
        return TcpFarEnd(self.address, self.port)

    def not_simulated(self) -> str:
        """Return why the simulated vehicle cannot send as this receiver: it serves a loopback address alone."""
        return super().not_simulated() or not_loopback(self.address)

    def place(self) -> str:
        """Return address and port."""
        return f"{self.address} port {self.port}"
