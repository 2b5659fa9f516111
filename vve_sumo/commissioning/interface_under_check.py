"""Finds which interface is meant by a name: the interface's own, a mapping's, or a vehicle's or a rig's file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from vve_sumo import workspace
from vve_sumo.config_file import read
from vve_sumo.errors import ConfigError
from vve_sumo.rig import load as rigs
from vve_sumo.rig import resolve as meaning
from vve_sumo.vehicle import load as vehicles
from vve_sumo.vehicle.interface import InterfaceConfig, SettingValue
from vve_sumo.vehicle.model import VehicleModel


def model(name: str, settings: Mapping[str, SettingValue], vehicle: str, working: Path) -> VehicleModel:
    """Return a vehicle model with the interface that `name` means.

    A rig's or a vehicle's file gives its own car; with a mapping or an interface the car is `vehicle`. Raises
    ConfigError for a file that is none of these, and for settings beside a file that has its own.
    """
    if not name.endswith(".toml"):
        return _with(InterfaceConfig(name, settings), vehicle, working)
    file = working / name
    table = read(file, "interface")
    if settings:
        raise ConfigError(f"{name}: --set is for an interface by its name, a file has its own settings")
    if "dbc" in table:
        return _with(InterfaceConfig("generic", {"mapping_file": str(file.resolve())}), vehicle, working)
    if "lot" in table:
        return meaning.model_of(rigs.load(file, working))
    if "drive_by_wire" in table:
        return vehicles.load(file)
    raise ConfigError(f"{name}: expected a mapping (dbc = ...), a vehicle or a rig, found none of them")


def _with(interface: InterfaceConfig, vehicle: str, working: Path) -> VehicleModel:
    return replace(vehicles.load(workspace.find("vehicle", vehicle, working)), interface=interface)
