"""The shipped vehicles, loaded once for every test that drives one."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

from vve_sumo.plant.car import CarParameters
from vve_sumo.rig import car_parameters
from vve_sumo.vehicle.load import load
from vve_sumo.vehicle.model import VehicleModel

_SHIPPED: Final = Path(__file__).resolve().parents[1] / "vehicles"

FUSION: Final = load(_SHIPPED / "ford_fusion.toml")
MKZ: Final = load(_SHIPPED / "lincoln_mkz.toml")


def parameters(*mounting: Any, model: VehicleModel = FUSION, **perturbations: Any) -> CarParameters:
    """A simulated vehicle, the Fusion unless told otherwise, with the perturbations of `rig.car_parameters`."""
    return car_parameters.parameters(model, *mounting, **perturbations)
