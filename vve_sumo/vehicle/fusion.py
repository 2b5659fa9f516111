"""The 2018 Ford Fusion as it is declared to everybody: geometry, inertia, limits and lags.

Numbers only. Longitudinal calibration is `calibration.Calibration`, whose defaults are the same car's.
"""

from __future__ import annotations

import math
from typing import Final

from vve_sumo.values import Vehicle

STEERING_RATIO: Final = 14.8  # Dataspeed's default for this car (dbw_mkz_can, twist controller)
WHEEL_ANGLE_LIMIT: Final = math.radians(470.0)  # of the steering wheel; Dataspeed's joystick demo, Apollo
WHEEL_RATE_LIMIT: Final = 8.7  # of the steering wheel [rad/s]; Dataspeed's SteeringCmd.msg of 2018
#: Of the car with all it may carry [kg]: 1.24 times the declared mass, an assumption. The rating on the car's own label
#: is in none of our sources. Secondary ones: a Fusion Hybrid weighs 3668 lb empty (maplecar.ca) and may carry 800 to
#: 1000 lb (kevinsautos.com), together 2027 to 2117 kg.
MAXIMUM_MASS: Final = 2095.0


def vehicle() -> Vehicle:
    """A 2018 Ford Fusion with a Dataspeed drive-by-wire kit.

    Measured on public CAN recordings of one Fusion (`benchmarks/identify_fusion.py` prints them): mass from brake
    torque over deceleration, wheel radius, 15 ms of the brakes' dead time and their lag. Length, width, wheelbase and
    steering ratio are Ford's and Dataspeed's. Assumptions: overhang, yaw inertia, place of the centre of mass, front
    cornering stiffness, the steering's delay and lag, and the 10 ms that the kit adds to the brakes' dead time. The
    rear stiffness then follows from an understeer gradient of 3.3e-4 rad s2/m, which the recordings support no better
    than "nearly neutral": fits of the one with steering in it lie between -6.6e-4 and 0.
    """
    return Vehicle(
        length=4.872,
        width=1.852,
        wheelbase=2.850,
        front_overhang=0.99,
        mass=1690.0,
        yaw_inertia=3000.0,
        front_axle_to_mass=1.27,
        cornering_stiffness_front=120_000.0,
        cornering_stiffness_rear=100_740.0,
        wheel_radius=0.3245,
        steering_ratio=STEERING_RATIO,
        steering_limit=WHEEL_ANGLE_LIMIT / STEERING_RATIO,
        steering_rate_limit=WHEEL_RATE_LIMIT / STEERING_RATIO,
        steering_delay=0.04,
        steering_lag=0.08,
        brake_delay=0.025,
        brake_lag=0.015,
        brake_torque_limit=3250.0,
        deceleration_limit=5.9,
    )
