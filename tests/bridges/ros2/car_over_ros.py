"""A receiver for tests whose simulated end speaks to a ROS 2 node: the drive hears NCOM, the node JSON of each fix."""

from __future__ import annotations

import json
import math
from dataclasses import asdict

from vve_sumo.pose.far_ends import UdpFarEnd
from vve_sumo.pose.receivers.ncom_udp import NcomUdp
from vve_sumo.pose.receivers.port import OpenFarBus
from vve_sumo.pose.receivers.udp import NetworkPort
from vve_sumo.values import Fix


class JsonEncoder:
    """Writes a fix as JSON, what is unknown as null."""

    def encode(self, fix: Fix) -> bytes:
        """Return the bytes of a fix."""
        known = {name: None if isinstance(value, float) and math.isnan(value) else value
                 for name, value in asdict(fix).items()}  # fmt: skip
        return json.dumps(known).encode()


class CarOverRos(NcomUdp):
    """NCOM over UDP, of a car whose receiver's driver is a ROS 2 node."""

    node_port: NetworkPort

    def encoder(self) -> JsonEncoder:  # type: ignore[override]
        """Return what the simulated vehicle speaks."""
        return JsonEncoder()

    def far_end(self, _open_far_bus: OpenFarBus) -> UdpFarEnd:
        """Return a socket that sends to the node."""
        return UdpFarEnd(self.address, self.node_port)


def make() -> type[CarOverRos]:
    """Return the kind's class."""
    return CarOverRos
