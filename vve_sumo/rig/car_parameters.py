"""The simulated vehicle's parameters: those of a vehicle model with the perturbations that a file states.

The perturbations are those that a scenario or a rig may state; no car is made here.
"""

from __future__ import annotations

import math
from typing import Final

from vve_sumo.errors import ConfigError
from vve_sumo.frames import Mounting
from vve_sumo.plant.car import CarParameters
from vve_sumo.plant.receiver import ReceiverParameters
from vve_sumo.scenario.schema import CarDifferences, Weather
from vve_sumo.vehicle.interface import InterfaceConfig
from vve_sumo.vehicle.model import IDEAL, Imperfections, VehicleModel

#: friction of tyre on road where no other is stated
DRY: Final = Weather().friction


def parameters(
    model: VehicleModel,
    mounting: Mounting | None = None,
    *,
    interface: InterfaceConfig | None = None,
    noise: float = 1.0,
    delay: float = 0.01,
    hidden_delay: float = 0.0,
    mass_factor: float = 1.0,
    brake_gain_factor: float = 1.0,
    friction: float = DRY,
    grade: float = 0.0,
    steering_wheel_bias: float = 0.0,
    heading_misalignment: float = 0.0,
    steering_delay: float = 0.0,
    imperfections: Imperfections = IDEAL,
) -> CarParameters:
    """A vehicle as declared, with the given perturbations; their meanings and units are those of `CarParameters`.

    `noise` scales the receiver's and the gyroscope's errors, 0 is none; `delay` and `hidden_delay` are the receiver's
    [s], `steering_delay` comes on top of the declared one [s]. The receiver is mounted as the model declares, unless
    `mounting` says otherwise, and the car has the model's drive-by-wire interface unless `interface` says otherwise.
    """
    numbers = model.simulated
    return CarParameters(
        vehicle=model.vehicle,
        calibration=model.calibration,
        interface=interface or model.interface,
        receiver=ReceiverParameters(mounting or model.mounting, delay=delay, hidden_delay=hidden_delay, noise=noise),
        track=numbers.track,
        mass_height=numbers.mass_height,
        friction=friction,
        throttle_delay=numbers.throttle_delay,
        mass_factor=mass_factor,
        brake_gain_factor=brake_gain_factor,
        grade=grade,
        steering_wheel_bias=steering_wheel_bias,
        heading_misalignment=heading_misalignment,
        steering_delay=steering_delay,
        imperfections=imperfections,
    )


def perturbed(model: VehicleModel, car: CarDifferences, friction: float = DRY) -> CarParameters:
    """A vehicle as declared, with the perturbations that a file states.

    Raises ConfigError for the fidelity `measured` of a model in whose file nothing is measured.
    """
    return parameters(
        model,
        noise=car.noise_factor if car.noise else 0.0,
        delay=car.gnss_delay_s,
        hidden_delay=car.gnss_hidden_delay_s,
        mass_factor=car.mass_factor,
        brake_gain_factor=car.brake_gain_factor,
        friction=friction,
        grade=math.atan(car.grade_percent / 100.0),
        steering_wheel_bias=model.steering_wheel_bias + math.radians(car.steering_wheel_bias_deg),
        heading_misalignment=-math.radians(car.heading_misalignment_deg),
        steering_delay=car.steering_delay_s,
        imperfections=imperfections_of(model, car),
    )


def imperfections_of(model: VehicleModel, car: CarDifferences) -> Imperfections:
    """Return the imperfections of the fidelity that a file states; raises ConfigError as `perturbed` does.

    A file that states none means those that were measured of the model, if any were.
    """
    if car.fidelity == "ideal":
        return IDEAL
    if car.fidelity == "measured" and model.measured == IDEAL:
        raise ConfigError(
            f"fidelity: expected 'ideal' with vehicle {model.name}, which has no [measured], got 'measured'"
        )
    return model.measured
