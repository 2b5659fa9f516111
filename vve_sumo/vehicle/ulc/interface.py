"""A Dataspeed ULC as a `VehicleInterface`: it drives and brakes by an acceleration; DBW1 steers and shifts.

The ULC's own steering takes a curvature or a yaw rate, which needs the car's geometry; it stays off, and the steering
wheel is commanded as on the DBW1 wire.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Final

from vve_sumo.config_file import read
from vve_sumo.errors import ConfigError
from vve_sumo.vehicle.interface import SettingValue
from vve_sumo.vehicle.mapped import mapping
from vve_sumo.vehicle.mapped.interface import MappedInterface, interface_of

MAPPING: Final = Path(__file__).with_name("ulc.toml")
#: By the generation of the DBW1 firmware: SI units in one of the four degrees per second that the DBC file has for a
#: count of the steering rate, and the largest angle and rate of the steering wheel [deg], [deg/s] (SteeringCmd.msg).
GENERATIONS: Final = {
    "dbw1_2018": (math.radians(0.5), 469.8, 498.4),
    "dbw1_2024": (math.radians(1.0), 550.0, 1002.6),
}


def make(settings: Mapping[str, SettingValue]) -> MappedInterface:
    """Make the interface; its one setting is `variant`, the DBW1 firmware's generation, to be verified on the car."""
    if unknown := sorted(settings.keys() - {"variant"}):
        raise ConfigError(f"setting {unknown[0]!r} is unknown; allowed is 'variant'")
    generation = GENERATIONS.get(str(settings.get("variant")))
    if generation is None:
        raise ConfigError(
            f"setting 'variant' must be {' or '.join(GENERATIONS)}, to be verified on the car; "
            f"got {settings.get('variant')!r}"
        )
    scale, angle, rate = generation
    table = read(MAPPING, "mapping")
    table["command"]["steering_wheel_rate"] = {"signal": table["command"]["steering_wheel_rate"], "scale": scale}
    table["limits"] = {"steering_wheel_angle_deg": angle, "steering_wheel_rate_degps": rate}
    wanted = mapping.parse(table, MAPPING)
    return interface_of(wanted, MAPPING, MAPPING.parent / wanted.dbc)
