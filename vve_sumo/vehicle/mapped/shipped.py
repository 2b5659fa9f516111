"""Shipped interfaces made of a mapping: what differs from car to car, and nobody publishes, is a setting.

`brake_nm` is the brake torque of a whole pedal, all wheels together; `command_timeout_s` and `when_commands_stop` say
what the DBW controller does by itself. All three are to be found out on the car.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from vve_sumo.config_file import read
from vve_sumo.errors import ConfigError
from vve_sumo.vehicle.interface import SettingValue
from vve_sumo.vehicle.mapped import mapping
from vve_sumo.vehicle.mapped.interface import MappedInterface, interface_of

#: What such a mapping has in place of the torque of its whole brake pedal.
BRAKE_SCALE: Final = "brake"
MAX_BRAKE: Final = 20_000.0  # [N m]
_WORDS: Final = {
    "releases": "lets go of pedals and steering, as the rig says it was seen to",
    "brakes": "brakes by itself, as the rig says it was seen to",
}


def make(file: Path, whole: float, settings: Mapping[str, SettingValue]) -> MappedInterface:
    """Return an interface by its mapping's `file`; raises ConfigError for settings that are wrong.

    `whole` is the whole brake pedal in the unit that the wire has for it.
    """
    names = {"brake_nm", "command_timeout_s", "when_commands_stop"}
    if unknown := sorted(settings.keys() - names):
        raise ConfigError(f"setting {unknown[0]!r} is unknown; allowed are {', '.join(map(repr, sorted(names)))}")
    if missing := sorted(names - settings.keys()):
        raise ConfigError(f"setting {missing[0]!r} is missing, to be found out on the car")
    brake, stops = settings["brake_nm"], settings["when_commands_stop"]
    if isinstance(brake, bool) or not isinstance(brake, int | float) or not 0.0 < brake <= MAX_BRAKE:
        raise ConfigError(
            f"setting 'brake_nm' must be the torque of a whole brake pedal, 0 to {MAX_BRAKE:g} N m, got {brake!r}"
        )
    if stops not in _WORDS:
        raise ConfigError(f"setting 'when_commands_stop' must be {' or '.join(_WORDS)}, got {stops!r}")
    table = _scaled(read(file, "mapping"), brake / whole)
    table["watchdog"] = {
        "command_timeout_s": settings["command_timeout_s"],
        "when_commands_stop": stops,
        "words": _WORDS[str(stops)],
    }
    wanted = mapping.parse(table, file)
    return interface_of(wanted, file, file.parent / wanted.dbc)


def _scaled(table: Any, brake: float) -> Any:
    """Return a table with the torque of one unit of the brake pedal in its place."""
    if isinstance(table, dict):
        return {
            key: brake if key == "scale" and one == BRAKE_SCALE else _scaled(one, brake) for key, one in table.items()
        }
    return table
