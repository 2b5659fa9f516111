"""Wires by a mapping against the port's suite."""

from __future__ import annotations

from pathlib import Path

from tests.ports.vehicle_interface import VehicleInterfaceConformance
from vve_sumo.vehicle.interface import InterfaceConfig

EXAMPLE = Path(__file__).resolve().parents[3] / "examples" / "own_car" / "campus_shuttle.toml"


class TestWorkedExample(VehicleInterfaceConformance):
    config = InterfaceConfig("generic", {"mapping_file": str(EXAMPLE)})


class TestPacmod3(VehicleInterfaceConformance):
    config = InterfaceConfig(
        "pacmod3", {"brake_nm": 3412.0, "command_timeout_s": 0.1, "when_commands_stop": "releases"}
    )


class TestNewEagleRaptor(VehicleInterfaceConformance):
    config = InterfaceConfig(
        "new_eagle_raptor", {"brake_nm": 5000.0, "command_timeout_s": 0.1, "when_commands_stop": "brakes"}
    )


class TestUlc2018(VehicleInterfaceConformance):
    config = InterfaceConfig("dataspeed_ulc", {"variant": "dbw1_2018"})


class TestUlc2024(VehicleInterfaceConformance):
    config = InterfaceConfig("dataspeed_ulc", {"variant": "dbw1_2024"})
