"""What a rig has, in the words by which roles and checklists choose.

Reads a rig; opens nothing.
"""

from __future__ import annotations

import ipaddress

from vve_sumo.pose.receivers.udp import UdpReceiver
from vve_sumo.rig.resolve import receiver_of
from vve_sumo.rig.schema import Rig


def features_of(rig: Rig) -> frozenset[str]:
    """Return the features that a rig has, of those that `briefing.toml` names."""
    test = rig.watchdog_test
    has = {
        "real": rig.car == "real",
        "armed": test is not None and test.armed,
        "person": bool(rig.people),
        "page": not ipaddress.ip_address(rig.view.address).is_loopback,
        "button": rig.operator.stop_can_id is not None,
        "brain": rig.brain.kind != "own",
        "external": rig.brain.kind == "external",
        "v2x": rig.v2x is not None,
        "udp": isinstance(receiver_of(rig), UdpReceiver),
        "stored": rig.alignment.kind != "matched_start",
    }
    return frozenset(name for name, there in has.items() if there)
