"""Common part of u-blox receivers, over any transport."""

from __future__ import annotations

from typing import ClassVar

from vve_sumo.pose import ubx, ubx_encoder
from vve_sumo.pose.receivers.port import ReceiverTable
from vve_sumo.pose.trust import UBX, TrustProfile


class UbxReceiver(ReceiverTable):
    """A u-blox receiver: NAV-PVT, and NAV-RELPOSNED of a moving baseline."""

    profile: ClassVar[TrustProfile] = UBX

    not_fixed_hint: ClassVar[str] = (
        "see that the moving base sends NAV-PVT and gets the corrections of a base station; the antennas, their view "
        "of the sky"
    )

    def decoder(self) -> ubx.Decoder:
        """Return a fresh decoder."""
        return ubx.Decoder()

    def encoder(self) -> ubx_encoder.Encoder:
        """Return a fresh encoder."""
        return ubx_encoder.Encoder()
