"""An AutonomouStuff PACMod 3 as a `VehicleInterface`.

The public sources state identifiers, places and scales of its signals, which is what `pacmod3.dbc` restates, and that
an override ends when it is cleared; not what the firmware does when commands stop.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Final

from vve_sumo.vehicle.interface import SettingValue
from vve_sumo.vehicle.mapped import shipped
from vve_sumo.vehicle.mapped.interface import MappedInterface

MAPPING: Final = Path(__file__).with_name("pacmod3.toml")
WHOLE_PEDAL: Final = 1.0  # the wire's unit is the whole pedal


def make(settings: Mapping[str, SettingValue]) -> MappedInterface:
    """Make the interface; its settings are those of every shipped interface that is made of a mapping."""
    return shipped.make(MAPPING, WHOLE_PEDAL, settings)
