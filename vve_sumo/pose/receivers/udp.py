"""Common part of receivers whose messages come as UDP datagrams."""

from __future__ import annotations

import ipaddress
from typing import Annotated, ClassVar, Self

from pydantic import AfterValidator, Field, model_validator

from vve_sumo.pose import sources
from vve_sumo.pose.far_ends import UdpFarEnd
from vve_sumo.pose.receivers.port import OpenBus, OpenFarBus, ReceiverTable


def _address(text: str) -> str:
    try:
        ipaddress.ip_address(text)
    except ValueError:
        raise ValueError("expected an IP address in numbers") from None
    return text


def _sender(text: str) -> str:
    address = ipaddress.ip_address(_address(text))
    if address.version != 4 or address.is_unspecified or address.is_multicast or int(address) == 0xFFFFFFFF:
        raise ValueError("expected the IPv4 address of one device")
    return text


Address = Annotated[str, AfterValidator(_address)]
#: the IPv4 address of one device, which alone is heard
Sender = Annotated[str, AfterValidator(_sender)]
NetworkPort = Annotated[int, Field(ge=1, le=65535)]


def not_loopback(address: str) -> str:
    """Return why the simulated vehicle cannot be heard on an address of another machine, or of all; else ""."""
    if ipaddress.ip_address(address).is_loopback:
        return ""
    return f"address: the simulated vehicle is heard on a loopback address only, got {address!r}"


class UdpReceiver(ReceiverTable):
    """A receiver that sends datagrams to this machine."""

    silent_hint: ClassVar[str] = (
        "see pose.address, pose.port and pose.source, the receiver's Ethernet output, network card and firewall"
    )

    address: Address = Field(
        default="127.0.0.1", description="to listen on: this machine alone by default, `0.0.0.0` for a broadcast"
    )
    port: NetworkPort = Field(default=3000, description="to listen on")
    source: Sender | None = Field(
        default=None,
        description="address of the receiver, whose datagrams alone are taken; may be left out on the loopback, "
        "where the first program that speaks is taken",
    )

    @model_validator(mode="after")
    def _one_sender(self) -> Self:
        """Refuse a port that anyone on the network could speak to in the receiver's place."""
        alone = ipaddress.ip_address(self.address).is_loopback
        if self.source is None and not alone:
            raise ValueError(
                f"source is missing: anyone who reaches {self.address} could be the receiver, name its address"
            )
        if self.source is not None and alone and not ipaddress.ip_address(self.source).is_loopback:
            raise ValueError(f"source: {self.source} cannot be heard on {self.address}, which is this machine alone")
        return self

    def open(self, _open_bus: OpenBus) -> sources.Source:
        """Listen; raises RigError naming the key."""
        return sources.open_udp(self.address, self.port, self.source, genuine=self.recognises)

    def recognises(self, datagram: bytes) -> bool:
        """Return whether a datagram is one that a receiver of this kind sends; any is, unless the kind overrides this.

        The first sender of such a datagram is the receiver for as long as the port is open.
        """
        return bool(datagram)

    def far_end(self, _open_far_bus: OpenFarBus) -> UdpFarEnd:
        """Open a socket that sends to the port."""
        return UdpFarEnd(self.address, self.port)

    def not_simulated(self) -> str:
        """Return why the simulated vehicle cannot send as this receiver: also, it is heard on a loopback alone."""
        return super().not_simulated() or not_loopback(self.address)

    def place(self) -> str:
        """Return address and port."""
        return f"{self.address} port {self.port}"
