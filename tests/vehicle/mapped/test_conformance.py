"""Wires by a mapping against the port's suite."""

from __future__ import annotations

from pathlib import Path

from tests.ports.vehicle_interface import VehicleInterfaceConformance
from vve_sumo.vehicle.interface import InterfaceConfig

EXAMPLE = Path(__file__).resolve().parents[3] / "examples" / "own_car" / "campus_shuttle.toml"


class TestWorkedExample(VehicleInterfaceConformance):
    config = InterfaceConfig("generic", {"mapping_file": str(EXAMPLE)})
