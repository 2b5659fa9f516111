"""Whether a SocketCAN interface is one of this computer alone: a card could have been renamed to `vcan0`.

Reads what the kernel says of network interfaces; opens none.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

from vve_sumo.errors import RigError
from vve_sumo.rig.schema import Rig

#: the kernel's list of network interfaces, each a link to its device; devices without hardware are in one folder
INTERFACES: Final = Path("/sys/class/net")
VIRTUAL_DEVICES: Final = ("devices", "virtual", "net")


def refuse_card(rig: Rig, interfaces: Path = INTERFACES) -> None:
    """Raise RigError where the program would engage by itself over hardware; an interface that is not there may pass.

    It is refused when it is opened.
    """
    if not rig.operator.automatic or rig.bus.interface != "socketcan" or rig.car_start is None:
        return
    for channel in (rig.bus.channel, rig.car_start.channel or rig.bus.channel):
        entry = interfaces / channel
        if entry.exists() and entry.resolve().parts[-4:-1] != VIRTUAL_DEVICES:
            raise RigError(
                f"operator.automatic: {channel} is a CAN card and not virtual, a person has to engage over it; "
                "set operator.automatic = false, or see ip -details link"
            )
