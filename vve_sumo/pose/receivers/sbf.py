"""Common part of Septentrio receivers, over any transport."""

from __future__ import annotations

from typing import ClassVar

from vve_sumo.pose import sbf, sbf_encoder
from vve_sumo.pose.receivers.port import ReceiverTable
from vve_sumo.pose.trust import SBF, TrustProfile


class SbfReceiver(ReceiverTable):
    """A Septentrio receiver with two antennas: PVTGeodetic, AttEuler and their covariances."""

    profile: ClassVar[TrustProfile] = SBF

    def decoder(self) -> sbf.Decoder:
        """Return a fresh decoder."""
        return sbf.Decoder()

    def encoder(self) -> sbf_encoder.Encoder:
        """Return a fresh encoder."""
        return sbf_encoder.Encoder()
