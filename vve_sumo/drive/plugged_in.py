"""Lists the plug-ins of a drive and the files of their code, and finds the files that changed since a record.

A plug-in is a controller, a sensor, a file of metrics, a receiver or a drive-by-wire interface. No code of a plug-in is
run here.
"""

from __future__ import annotations

import hashlib
from collections.abc import Collection, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Final, NamedTuple

from vve_sumo import controller, workspace
from vve_sumo.metrics import port as metrics
from vve_sumo.ports import Port
from vve_sumo.pose.receivers import port as receivers
from vve_sumo.scenario.schema import Scenario
from vve_sumo.sensors import port as sensors
from vve_sumo.vehicle import interface
from vve_sumo.vehicle.interface import InterfaceConfig

#: prefix of the role of a plug-in's file; the name of the module follows
CONTROLLER: Final = "controller_"
INTERFACE: Final = "interface_"
RECEIVER: Final = "receiver_"
#: prefix of the role of a file that an interface is made of besides its code; the file's name follows
WIRE: Final = "wire_"
#: for a sensor, the sensor's name follows, then a colon and the name of the module
SENSOR: Final = "sensor_"
#: for a file of metrics, its number in the scenario's `metrics` follows, then a colon and the name of the module
METRIC: Final = "metric_"
PREFIXES: Final = (CONTROLLER, INTERFACE, RECEIVER, SENSOR, METRIC, WIRE)


class PluggedIn(NamedTuple):
    """A part of a drive that a user may supply."""

    port: Port
    name: str  #: by which the port finds the plug-in
    role: str  #: prefix of the roles of the plug-in's files
    search: Sequence[Path] = ()  #: folders in which the name is looked up

    def files(self) -> dict[str, Path]:
        """Return the files of the plug-in's code by role, after the plug-in was loaded; empty for a shipped one."""
        return {f"{self.role}{module}": file for module, file in self.port.sources(self.name, self.search).items()}

    def changed(self, recorded: Mapping[str, Collection[str]]) -> list[str]:
        """Return a line for every file of the plug-in's code that is not as recorded; none of that code is run.

        `recorded` holds the hashes that each role had. Raises ConfigError where the plug-in no longer exists.
        """
        if self.name in self.port.shipped:
            return []
        place = self.port.origin(self.name, self.search)
        roles = [role for role in sorted(recorded) if role.startswith(self.role)]
        if f"{self.role}{place.main}" not in roles:
            return [f"{self.port.kind} {self.name}: there is no hash of its code"]
        files = {role: place.file(role.removeprefix(self.role)) for role in roles}
        return [
            f"{role} has changed since" if file is not None else f"{role} is gone"
            for role, file in files.items()
            if file is None or digest(file) not in recorded[role]
        ]


def of_scenario(scenario: Scenario, working: Path) -> Iterator[PluggedIn]:
    """Yield the plug-ins that a scenario names: its controller, the sensors of its list, its metrics."""
    yield PluggedIn(controller.PORT, scenario.controller.name, CONTROLLER, workspace.controller_folders(working))
    for sensor in scenario.sensors:
        yield PluggedIn(sensors.PORT, sensor.kind, f"{SENSOR}{sensor.name}:")
    for number, name in enumerate(scenario.metrics):
        yield PluggedIn(metrics.PORT, name, f"{METRIC}{number}:")


def vehicle_interface(name: str) -> PluggedIn:
    """Return the drive-by-wire interface of this name as a plug-in."""
    return PluggedIn(interface.PORT, name, INTERFACE)


def wire_files(config: InterfaceConfig) -> dict[str, Path]:
    """Return the files that a shipped drive-by-wire interface is made of besides its code, by role.

    Raises ConfigError where the interface cannot be made of them any more.
    """
    if config.name not in interface.PORT.shipped:
        return {}  # none of a user's code is run here
    return {f"{WIRE}{file.name}": file for file in interface.load(config).facts.files}


def changed_wire(config: InterfaceConfig, recorded: Mapping[str, Collection[str]]) -> list[str]:
    """Return a line for every one of `wire_files` that is not as recorded."""
    files = wire_files(config)
    return [f"{role} has changed since" for role in sorted(files) if digest(files[role]) not in recorded.get(role, ())]


def receiver(kind: str) -> PluggedIn:
    """Return the receiver of this kind as a plug-in."""
    return PluggedIn(receivers.PORT, kind, RECEIVER)


def digest(file: Path) -> str:
    """Return the hash of a file (hexadecimal SHA-256)."""
    return hashlib.sha256(file.read_bytes()).hexdigest()


def digests(files: Mapping[str, Path]) -> dict[str, str]:
    """Return the hash of every file, by role, sorted."""
    return {role: digest(file) for role, file in sorted(files.items())}
