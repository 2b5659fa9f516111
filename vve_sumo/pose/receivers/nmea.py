"""Common part of receivers that send NMEA 0183, over any transport."""

from __future__ import annotations

import math
from typing import ClassVar

from pydantic import Field

from vve_sumo.config_file import Positive
from vve_sumo.pose import nmea, nmea_encoder
from vve_sumo.pose.receivers.port import ReceiverTable
from vve_sumo.pose.trust import NMEA, TrustProfile


class NmeaReceiver(ReceiverTable):
    """A receiver whose sentences leave accuracies open that a car cannot be driven without."""

    profile: ClassVar[TrustProfile] = NMEA

    velocity_sigma_mps: Positive = Field(
        description="1 sigma of the velocity, from the receiver's data sheet, for NMEA does not say it"
    )
    heading_sigma_deg: Positive = Field(
        description="1 sigma of the heading, from the receiver's data sheet, for NMEA does not say it"
    )

    def decoder(self) -> nmea.Decoder:
        """Return a fresh decoder."""
        return nmea.Decoder(velocity_sigma=self.velocity_sigma_mps, heading_sigma=math.radians(self.heading_sigma_deg))

    def encoder(self) -> nmea_encoder.Encoder:
        """Return a fresh encoder."""
        return nmea_encoder.Encoder()
