"""The hardware-free car's numbers: a 2018 Ford Fusion, and which of them were measured.

Identified by `benchmarks/identify_fusion.py` on public CAN recordings of one Fusion (repository autti/veloz, branch
20170214): 27 s in four pieces, one full braking, no coast-down, steering of 3.5 deg at most.
"""

from __future__ import annotations

from vve_sumo.frames import Mounting
from vve_sumo.plant.car import CarParameters
from vve_sumo.plant.receiver import ReceiverParameters
from vve_sumo.vehicle import fusion
from vve_sumo.vehicle.calibration import Calibration
from vve_sumo.vehicle.interface import DEFAULT, InterfaceConfig

TRACK = 1.5824  # between the wheels of an axle [m]; Dataspeed's default for this car (dbw_mkz_can)
MASS_HEIGHT = 0.55  # of the centre of mass [m]; an assumption
FRICTION = 0.9  # dry asphalt; an assumption
# With the calibration's lag of 0.25 s, half the force is gone 0.22 s after half the pedal; the recording shows 0.20 s.
THROTTLE_DELAY = 0.05  # [s]

#: The receiver in the trunk, its output point over the rear axle's left half; an assumption.
MOUNTING = Mounting(forward=0.30, left=0.20)


def parameters(
    mounting: Mounting = MOUNTING,
    *,
    calibration: Calibration | None = None,
    interface: InterfaceConfig = DEFAULT,
    noise: float = 1.0,
    delay: float = 0.01,
    hidden_delay: float = 0.0,
    mass_factor: float = 1.0,
    brake_gain_factor: float = 1.0,
    friction: float = FRICTION,
    grade: float = 0.0,
    steering_wheel_bias: float = 0.0,
    heading_misalignment: float = 0.0,
) -> CarParameters:
    """A Fusion as declared, but for the perturbations given; their meanings and units are those of `CarParameters`.

    `noise` scales the receiver's and the gyroscope's errors, 0 is none; both delays are the receiver's [s].
    """
    return CarParameters(
        vehicle=fusion.vehicle(),
        calibration=calibration or Calibration(),
        interface=interface,
        receiver=ReceiverParameters(mounting, delay=delay, hidden_delay=hidden_delay, noise=noise),
        track=TRACK,
        mass_height=MASS_HEIGHT,
        friction=friction,
        throttle_delay=THROTTLE_DELAY,
        mass_factor=mass_factor,
        brake_gain_factor=brake_gain_factor,
        grade=grade,
        steering_wheel_bias=steering_wheel_bias,
        heading_misalignment=heading_misalignment,
    )
