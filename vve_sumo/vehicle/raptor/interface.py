"""A New Eagle Raptor as a `VehicleInterface`: 29-bit identifiers, counters and checksums.

Every request must be sent all the time. What the driver does takes the car, and keeps it until the enable bits go.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Final

from vve_sumo.vehicle.interface import SettingValue
from vve_sumo.vehicle.mapped import shipped
from vve_sumo.vehicle.mapped.interface import MappedInterface

MAPPING: Final = Path(__file__).with_name("raptor.toml")
WHOLE_PEDAL: Final = 100.0  # the wire's unit is one per cent of a reference that depends on the car


def make(settings: Mapping[str, SettingValue]) -> MappedInterface:
    """Make the interface; its settings are those of every shipped interface that is made of a mapping."""
    return shipped.make(MAPPING, WHOLE_PEDAL, settings)
