"""One resolved vehicle: all that lockstep, playback, sweep, suite and live drive need to know of the car they drive.

Plain values in SI units, without any file or rig; `VehicleModel.rig` tells whose measurements replaced declared values.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, is_dataclass
from typing import Any, Self, TypeVar, get_type_hints

from vve_sumo.frames import Mounting
from vve_sumo.values import Vehicle
from vve_sumo.vehicle.calibration import Calibration
from vve_sumo.vehicle.interface import DEFAULT, InterfaceConfig
from vve_sumo.vehicle.limits import Limits

Value = TypeVar("Value")


@dataclass(frozen=True, slots=True)
class SimulatedParameters:
    """Further parameters of the simulated vehicle, which are not declared of a real one."""

    laden_mass: float  #: largest permitted, with which suites drive it laden [kg]
    track: float  #: between the wheels of an axle [m]
    mass_height: float  #: of the centre of mass above ground [m]
    throttle_delay: float  #: dead time from frame to first force [s]


@dataclass(frozen=True, slots=True)
class VehicleModel:
    """A vehicle as declared and calibrated, with the further parameters of its simulated vehicle."""

    name: str  #: of the vehicle's file, without its ending
    vehicle: Vehicle
    calibration: Calibration
    simulated: SimulatedParameters
    mounting: Mounting  #: of the GNSS receiver, as declared
    limits: Limits = field(default_factory=Limits)  #: that the gateway keeps to
    interface: InterfaceConfig = DEFAULT  #: of the drive-by-wire controller
    steering_wheel_bias: float = 0.0  #: reported angle at which the wheels point straight [rad], left positive
    rig: str = ""  #: title of the rig whose measurements replaced declared values; empty where there is none

    @property
    def laden_factor(self) -> float:
        """Mass of the laden vehicle over the declared mass."""
        return self.simulated.laden_mass / self.vehicle.mass

    def to_dict(self) -> dict[str, Any]:
        """Return all of it as plain JSON, as a record keeps it."""
        return asdict(self)

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Self:
        """Return the vehicle that `to_dict` gave; raises KeyError, TypeError or ConfigError for other data."""
        return rebuilt(cls, data)


def rebuilt(kind: type[Value], data: Mapping[str, Any]) -> Value:
    """Return the dataclass that `asdict` gave as `data`, nested ones too; raises KeyError or TypeError otherwise."""
    kinds = get_type_hints(kind)
    nested = {name: rebuilt(kinds[name], value) for name, value in data.items() if is_dataclass(kinds[name])}
    return kind(**{**data, **nested})
