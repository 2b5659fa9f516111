"""How the sensors of a drive are drawn, by the content of its `scenario.json`.

A kind that this package ships says it by its code and the drive's settings; what any other kind declared stands in the
record, so that a reader needs none of its code.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from typing import Any, Final

from vve_sumo.errors import ConfigError
from vve_sumo.sensors.drawing import Drawing, from_dict, to_dict, wrong
from vve_sumo.sensors.port import PORT, STANDARD, SensorColumn, SensorSettings, configured, drawing_of
from vve_sumo.values import Vehicle

#: key of `scenario.json`: drawings of sensors of kinds that are not shipped, by the sensor's name
DRAWINGS: Final = "drawings"


def recorded(kinds: Mapping[str, str], sensors: Mapping[str, SensorSettings], vehicle: Vehicle) -> dict[str, Any]:
    """Return what `scenario.json` says of drawings: of each sensor, by name, whose kind this package does not ship.

    Raises ConfigError, naming the sensor, for any drawing that does not fit its sensor's columns.
    """
    found = {}
    for name, settings in sensors.items():
        try:
            drawing = drawing_of(settings, vehicle)
        except ConfigError as error:
            raise ConfigError(f"sensors.{name}: {error}") from None
        if drawing is not None and kinds[name] not in PORT.shipped:
            found[name] = to_dict(drawing)
    return {DRAWINGS: found} if found else {}


def drawings_of(resolved: Mapping[str, Any]) -> dict[str, Drawing]:
    """Return the drawing of each sensor that declares one, by name: that of every scenario first, then as listed.

    A drawing that does not fit the recorded columns, of another version of its kind, is left out.
    """
    settings, declared = resolved["settings"], resolved.get(DRAWINGS) or {}
    kinds = {STANDARD: (STANDARD, settings.get(STANDARD) or {})}
    kinds |= {each["name"]: (each["kind"], each.get("settings") or {}) for each in settings.get("sensors") or ()}
    vehicle = Vehicle(**{field.name: float(resolved["vehicle"][field.name]) for field in fields(Vehicle)})
    found = {}
    for name, (kind, own) in kinds.items():
        columns = resolved["sensors"].get(name) or ()
        try:
            drawing = from_dict(declared[name]) if name in declared else _shipped(kind, own, vehicle)
        except ConfigError:
            continue
        if drawing is not None and not wrong(drawing, [SensorColumn(*column) for column in columns]):
            found[name] = drawing
    return found


def _shipped(kind: str, settings: Mapping[str, Any], vehicle: Vehicle) -> Drawing | None:
    return configured(kind, settings).drawing(vehicle) if kind in PORT.shipped else None
