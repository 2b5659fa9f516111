"""The parts that plug into a drive, and the files of their code: what a record names, and whether it is as it was.

Runs nothing of a part but to find the files of one that was just loaded.
"""

from __future__ import annotations

import hashlib
from collections.abc import Collection, Iterator, Mapping, Sequence
from pathlib import Path as FilePath
from typing import Final, NamedTuple

from vve_sumo import controller, workspace
from vve_sumo.ports import Port
from vve_sumo.pose.receivers import port as receivers
from vve_sumo.scenario.schema import Scenario
from vve_sumo.sensors import port as sensors
from vve_sumo.vehicle import interface

#: how the role of a file of such a part begins; the name of its module follows
CONTROLLER: Final = "controller_"
INTERFACE: Final = "interface_"
RECEIVER: Final = "receiver_"
#: of a sensor its name follows, then a colon and the name of the module
SENSOR: Final = "sensor_"
PREFIXES: Final = (CONTROLLER, INTERFACE, RECEIVER, SENSOR)


class PluggedIn(NamedTuple):
    """A part that may be somebody's own."""

    port: Port
    name: str  #: that its port finds it by
    role: str  #: how the roles of its files begin
    search: Sequence[FilePath] = ()  #: folders in which its name is looked up

    def files(self) -> dict[str, FilePath]:
        """Return the files of its code, by role, once it was loaded; none of a part of this package."""
        return {f"{self.role}{module}": file for module, file in self.port.sources(self.name, self.search).items()}

    def changed(self, recorded: Mapping[str, Collection[str]]) -> list[str]:
        """Return a line for every file of its code that is not as it was recorded; none of that code is run.

        `recorded` holds the hashes that each role had. Raises ConfigError where there is no such part any more.
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


def of_scenario(scenario: Scenario, working: FilePath) -> Iterator[PluggedIn]:
    """Return the parts that a scenario names: its controller, and the sensors beside the radar."""
    yield PluggedIn(controller.PORT, scenario.controller.name, CONTROLLER, workspace.controller_folders(working))
    for sensor in scenario.sensors:
        yield PluggedIn(sensors.PORT, sensor.kind, f"{SENSOR}{sensor.name}:")


def vehicle_interface(name: str) -> PluggedIn:
    """Return the drive-by-wire interface of a vehicle."""
    return PluggedIn(interface.PORT, name, INTERFACE)


def receiver(kind: str) -> PluggedIn:
    """Return the receiver of a rig."""
    return PluggedIn(receivers.PORT, kind, RECEIVER)


def digest(file: FilePath) -> str:
    """Return the hash of a file (hexadecimal SHA-256)."""
    return hashlib.sha256(file.read_bytes()).hexdigest()


def digests(files: Mapping[str, FilePath]) -> dict[str, str]:
    """Return the hash of every file, by role, sorted."""
    return {role: digest(file) for role, file in sorted(files.items())}
