"""Common part of NovAtel OEM7 receivers with an inertial unit, over any transport."""

from __future__ import annotations

from typing import ClassVar

from vve_sumo.pose import novatel, novatel_encoder
from vve_sumo.pose.receivers.port import ReceiverTable
from vve_sumo.pose.trust import NOVATEL, TrustProfile


class NovatelReceiver(ReceiverTable):
    """A NovAtel receiver: INSPVAX and BESTPOS."""

    profile: ClassVar[TrustProfile] = NOVATEL

    def decoder(self) -> novatel.Decoder:
        """Return a fresh decoder."""
        return novatel.Decoder()

    def encoder(self) -> novatel_encoder.Encoder:
        """Return a fresh encoder."""
        return novatel_encoder.Encoder()
