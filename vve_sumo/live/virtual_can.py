"""Whether a SocketCAN interface is one of this computer alone: a card could have been renamed to `vcan0`.

Reads where the kernel's list of network interfaces has them; opens none. It tells cards of a PCI, USB or platform bus.
What is attached by a serial line (slcan) has no device of its own in older kernels and lies among the virtual ones:
named `vcan0`, the name does not tell the two apart. `ip -details link` shows which kind an interface is.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

from vve_sumo.rig.schema import Rig

#: the kernel's list of network interfaces, each a link to its device; devices without hardware are in one folder
INTERFACES: Final = Path("/sys/class/net")
VIRTUAL_DEVICES: Final = ("devices", "virtual", "net")


def hardware_obstacle(rig: Rig, interfaces: Path = INTERFACES) -> str | None:
    """Return why the program may not engage by itself over the car's bus, because it is hardware; None where it may.

    An interface that is not there is refused when it is opened.
    """
    if not rig.operator.automatic or rig.bus.interface != "socketcan" or rig.car_start is None:
        return None
    for channel in (rig.bus.channel, rig.car_start.channel or rig.bus.channel):
        entry = interfaces / channel
        if entry.exists() and entry.resolve().parts[-4:-1] != VIRTUAL_DEVICES:
            return (
                f"operator.automatic: {channel} is a CAN card and not virtual, a person has to engage over it; "
                "set operator.automatic = false, or see ip -details link"
            )
    return None
