"""One resolved vehicle: all that lockstep, playback, sweep, suite and live drive need to know of the car they drive.

Plain values in SI units, without any file or rig; `VehicleModel.rig` tells whose measurements replaced declared values.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, is_dataclass
from typing import Any, Final, Self, TypeVar, get_type_hints

from vve_sumo.frames import Mounting
from vve_sumo.values import Vehicle
from vve_sumo.vehicle.calibration import Calibration
from vve_sumo.vehicle.interface import DEFAULT, InterfaceConfig
from vve_sumo.vehicle.limits import Limits

Value = TypeVar("Value")

FIX_PERIOD: Final = 0.01  # between the fixes of the simulated receiver [s]; NCOM's standard 100 Hz


@dataclass(frozen=True, slots=True)
class SimulatedParameters:
    """Further parameters of the simulated vehicle, which are not declared of a real one."""

    laden_mass: float  #: largest permitted, with which suites drive it laden [kg]
    track: float  #: between the wheels of an axle [m]
    mass_height: float  #: of the centre of mass above ground [m]
    throttle_delay: float  #: dead time from frame to first force [s]


@dataclass(frozen=True, slots=True)
class Imperfections:
    """How sensors, brakes, tyres and receiver of a real car differ from ideal ones; the defaults are ideal.

    A wheel sensor's runout is the amplitude of its error once per revolution of the wheel, over the wheel speed: the
    teeth of a tone ring that runs off centre pass at a rate that varies so.
    """

    wheel_runout_front_left: float = 0.0  #: amplitude once per revolution, share of the wheel speed
    wheel_runout_front_right: float = 0.0  #: the same
    wheel_runout_rear_left: float = 0.0  #: the same
    wheel_runout_rear_right: float = 0.0  #: the same
    wheel_jitter: float = 0.0  #: independent from report to report, 1 sigma, share of the wheel speed
    wheel_quantum: float = 0.0  #: step in which wheel speeds are reported [rad/s]; 0 is none
    wheel_front_right_over_left: float = 0.0  #: by which the right front wheel turns faster, share of the wheel speed
    wheel_rear_right_over_left: float = 0.0  #: by which the right rear wheel turns faster, share of the wheel speed
    longitudinal_acceleration_noise: float = 0.0  #: 1 sigma [m/s2]
    lateral_acceleration_noise: float = 0.0  #: 1 sigma [m/s2]
    acceleration_correlation: float = 0.0  #: correlation time of both noises [s]
    longitudinal_acceleration_bias: float = 0.0  #: 1 sigma of what is drawn once for a drive [m/s2]
    lateral_acceleration_bias: float = 0.0  #: 1 sigma of what is drawn once for a drive [m/s2]
    brake_gain_factor: float = 1.0  #: true brake force over what the calibration gives for a torque
    combined_slip: bool = False  #: longitudinal and lateral force of each axle are bounded together
    receiver_short_gaps: float = 0.0  #: share of fixes that arrive together with the one before; 0: evenly spaced
    receiver_gap_p95: float = 0.0  #: 95 % quantile of the time between arrivals [s]
    receiver_gap_max: float = 0.0  #: longest time between arrivals [s]
    receiver_float_every: float = 0.0  #: mean time between losses of the fixed ambiguities [s]; 0: never lost
    receiver_float_time: float = 0.0  #: mean time until they are fixed again [s]
    receiver_float_sigma: float = 0.0  #: error of a float position, north and east each, 1 sigma [m]

    @property
    def receiver_gap_min(self) -> float:
        """Shortest time between bursts [s].

        The times between arrivals are 0 in `receiver_short_gaps` of all cases, evenly spread from this to the 95 %
        quantile, and evenly from there to the longest. Their mean must be FIX_PERIOD, for as many fixes arrive as are
        measured; this is the one beginning with which it is.
        """
        late = 0.05 * 0.5 * (self.receiver_gap_p95 + self.receiver_gap_max)
        return 2.0 * (FIX_PERIOD - late) / (0.95 - self.receiver_short_gaps) - self.receiver_gap_p95


IDEAL = Imperfections()


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
    measured: Imperfections = IDEAL  #: of the simulated vehicle where a scenario asks for them
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
