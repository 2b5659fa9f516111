"""Every figure by which the gateway judges a car, written down a second time, with the reason why it is that large.

Who changes a figure changes it here as well, and says why. A figure that is not listed fails a test.
"""

from __future__ import annotations

import math
from types import ModuleType
from typing import Final

import pytest

from vve_sumo.physical_constants import GRAVITY
from vve_sumo.timing import PERIOD
from vve_sumo.vehicle import (
    brake_monitor,
    command_echo,
    drift,
    driver_braking,
    engagement,
    gateway,
    limits,
    motion_control,
    plausibility,
    report_consistency,
    reports,
    slowing_monitor,
    standstill,
)
from vve_sumo.vehicle.dataspeed.pedals import pedal_to_torque

#: by module and name: the figure, in SI units, and its reason
FIGURES: Final[dict[ModuleType, dict[str, tuple[float | tuple[float, ...], str]]]] = {
    brake_monitor: {
        "BRAKE_SHARE": (0.75, "15 % more mass and 10 % less torque are 0.78"),
        "ACCELERATION_MARGIN": (0.25, "a grade of 1.5 % is 0.15, and the speeds have noise"),
        "PUSH_SHARE": (1.5, "an engine may push harder than calibrated, and its push fade more slowly"),
        "PUSH_MARGIN": (0.3, "creep differs with the engine's temperature"),
        "SPEED_EXCESS": (0.25, "what a car without brakes gains against a stop of 2.4 m/s2 in 0.1 s"),
        "GNSS_EXCESS": (0.10, "three sigma of RTK velocity: wheels alone may be wrong"),
        "MIN_SPEED": (0.1, "twice what a wheel at rest may be reported to turn"),
        "ROLL_SPEED": (0.08, "six times what a Fusion's reports resolve, 13 mm/s"),
        "GNSS_ROLL_SPEED": (0.10, "twice what the mean of a standing receiver's speed may be"),
        "ROLL_TIME": (0.1, "ten reports"),
        "GNSS_ROLL_TIME": (0.3, "a body that rocks after a stop does so at 1 to 2 Hz"),
        "ACCELERATION_LAG": (0.1, "five steps: a difference of two noisy speeds needs a mean"),
    },
    command_echo: {
        "ECHO_TIME": (0.1, "a step, the frame, the module's 20 ms, and as much again"),
        "TORQUE_CHANGE": (250.0, "a quarter of a light braking, and more than any wire rounds"),
        "OPENING_CHANGE": (0.04, "more than any wire rounds and a module cuts off"),
    },
    driver_braking: {
        "UNASKED_TORQUE": (150.0, "less than a pedal at 0.19 of its range asks for, 172 N m"),
        "UNASKED_SHARE": (0.15, "a brake controller that is 10 % off"),
        "UNASKED_TIME": (0.03, "two reports of 50 Hz"),
        "RELEASE_RATE": (8000.0, "full brakes are gone after 0.4 s; the simulated ones after 0.1 s, real ones later"),
        "REPORT_DELAY": (0.15, "the report's 20 ms, two steps, and brakes that are slower than declared"),
        "LAGS": (3.0, "after three lags 5 % are left"),
        "LATCH_TORQUE": (450.0, "less than the 517 N m at which a Dataspeed module latches"),
        "LATCH_TIME": (0.08, "less than the 0.1 s for which it takes them"),
    },
    drift: {
        "NOISE": (0.12, "an RTK receiver's noise and what the pose's filter adds"),
        "RESIDUE": (0.04, "what NOISE leaves open of a way's begin and end"),
        "CHANGE": (0.001, "the ground's slope across the way, and a tyre's warmth"),
        "MISALIGNMENT": (0.004, "0.23 degrees: what mounting and calibration leave of the receiver's heading"),
        "LEVER": (0.1, "a tape measure's error on the receiver's place"),
        "SLIP_SHARE": (1.0, "tyres of which nothing is known but their sign"),
        "DELAY": (0.30, "a longer hidden delay shows in how the car drives"),
        "LEARNING_DISTANCE": (100.0, "a shorter way teaches little against NOISE, a longer one hides a drift for long"),
    },
    engagement: {
        "HANDSHAKE_TIME": (0.4, "as Apollo's lincoln_controller waits"),
        "SHIFT_TIME": (3.0, "a rotary shifter takes about one second"),
        "STEERING_DIFFERENCE": (0.10, "six degrees of the road wheels"),
        "STEERING_DIFFERENCE_TIME": (0.5, "longer than any delay and lag of a steering that follows"),
    },
    gateway: {
        "MAX_STEP": (2.0, "periods: a step that is a whole period late is a fault"),
        "UNCERTAIN_TIME": (3.0, "as long as the receiver needs to be believed alone"),
        "PARK_TIME": (1.0, "a shift to drive under way shows within that"),
        "UNATTENDED_TIME": (1.0, "a driver's foot changes pedals within that"),
        "ATTENDED_TIME": (0.1, "a single old report among fresh ones is no foot"),
    },
    limits: {
        "SPEED_LIMIT_TIME": (0.8, "several times the drive's delay and lag"),
        "SPEED_LIMIT_BRAKING": (1.0, "who is a little too fast is not braked hard"),
        "SPEED_LIMIT_MARGIN": (1.0, "the wheels' scale, a steep slope, the last of a push"),
    },
    motion_control: {
        "MAX_WHEEL_SPEED_DEFICIT": (0.5, "ten sigma of RTK velocity, and the wheels' scale at 10 m/s"),
    },
    plausibility: {
        "SPEED_DIFFERENCE": (0.30, "ten sigma of RTK velocity"),
        "ACCELERATION_LAG": (0.1, "five steps: a difference of two noisy speeds needs a mean"),
        "DIFFERENCE_TIME": (0.5, "longer than wheels slip on a bump"),
        "GROSS_FACTOR": (3.0, "neither slip nor delay"),
        "GROSS_TIME": (0.1, "five reports"),
        "YAW_RATE_DIFFERENCE": (0.10, "ten times a gyroscope's bias; a wrong sign shows as twice the yaw rate"),
        "WINDOWS": ((1.0, 3.0, 10.0), "a step shows in the short one, a drift in the long one"),
        "SAMPLE_PERIOD": (0.1, "a tenth of the shortest window"),
        "POSITION_DIFFERENCE": (0.15, "ten sigma of RTK and what the pose's filter adds"),
        "LATERAL_SHARE": (0.008, "0.2 degrees of mounting, and half of the rear axle's slip"),
        "HEADING_DIFFERENCE": (0.03, "ten sigma of the receiver's heading and what the pose's filter adds"),
        "TURN_SHARE": (0.02, "a gyroscope's scale"),
        "BIAS_LEARNT": (0.001, "the noise of a mean over a second"),
        "BIAS_UNKNOWN": (0.012, "a gyroscope's bias is of the order of 0.01"),
        "BIAS_TIME": (10.0, "what is averaged longer follows the temperature too late"),
        "BIAS_MIN_TIME": (0.4, "twenty steps"),
        "MAX_BIAS": (0.05, "four times the bias that is allowed: what turns faster turns"),
        "STEERING_DIFFERENCE": (0.06, "the gyroscope's bias and the steering's play at walking pace"),
        "STEERING_SHARE": (0.20, "tyres, load and camber"),
        "FROZEN_TIME": (0.5, "25 reports to the last bit alike"),
        "FROZEN_SPEED_CHANGE": (0.20, "six sigma of RTK velocity"),
        "FROZEN_YAW_RATE_CHANGE": (0.04, "more than the noise of the receiver's yaw rate"),
        "FROZEN_STEERING_CHANGE": (0.03, "a steering that follows has moved by then"),
    },
    report_consistency: {
        "SPEED_SPIKE": (0.35, "five times the greatest of a real Fusion, 0.065 m/s"),
        "YAW_RATE_SPIKE": (0.05, "twenty times the greatest of a real Fusion, 0.0022 rad/s"),
        "STEERING_SPIKE": (0.07, "ten times the greatest of a real Fusion, 0.3 degrees"),
        "MAX_SPIKES": (3, "a damaged report, or a wheel that catches, makes one"),
        "WINDOW": (0.5, "25 reports"),
    },
    reports: {
        "TOLERANCE": (1e-6, "the rounding of a time"),
        "FOOT_TORQUE": (150.0, "between a pedal that a Dataspeed module calls touched and 0.19 of its range"),
        "FOOT_OPENING": (0.05, "the same of the throttle, with room for a sensor's offset"),
        "HAND_TORQUE": (2.0, "more than the friction of an untouched wheel"),
        "IDLE_TORQUE": (40.0, "less than the lightest touch asks for, 57 N m"),
        "STILL_TIME": (0.5, "25 reports to the last bit alike"),
    },
    slowing_monitor: {
        "BRAKE_SHARE": (1.35, "10 % more torque on a car 15 % lighter are 1.29"),
        "DRIVE_SHARE": (0.5, "a fifth less push on a car 15 % heavier is 0.70, less while it shifts"),
        "DRAG_SHARE": (1.5, "winter tyres and a head wind"),
        "DECELERATION_MARGIN": (0.35, "a grade of 1.5 %, and tyres at 3 m/s2 across"),
        "LEARNING_TIME": (15.0, "a foot must not be learnt within the seconds in which it is found"),
        "LEARNING_SPEED": (1.0, "how a car creeps is not known well below"),
        "CHANGE_MARGIN": (0.35, "as DECELERATION_MARGIN"),
        "CHANGE_SHARE": (0.15, "shifts of the transmission, warm brakes"),
        "RELEASE_LAG": (0.15, "brakes that are slower than declared"),
        "THROTTLE_DELAY": (0.10, "an engine that is slower than declared"),
        "SPEED_DEFICIT": (0.30, "what 0.6 m/s2 take away in half a second"),
        "CHANGE_DEFICIT": (0.70, "a shift of the transmission costs 0.5"),
        "GNSS_DEFICIT": (0.10, "three sigma of RTK velocity: wheels alone may be wrong"),
    },
    standstill: {
        "WHEEL_REST": (0.05, "four times what a Fusion's reports resolve, 13 mm/s"),
        "GNSS_REST": (0.30, "ten sigma of RTK velocity"),
        "GNSS_MEAN_REST": (0.05, "noise averages out, and a creeping car does not"),
        "GNSS_LAG": (0.1, "ten fixes"),
        "REST_TIME": (0.3, "fifteen steps"),
        "GNSS_REST_TIME": (3.0, "against wheels that are missing or turn, the receiver needs a long look"),
        "MAX_BRAKING": (12.0, "more than the friction of a dry road gives"),
        "QUANTUM": (0.04, "three times what a Fusion's reports resolve, 13 mm/s"),
        "BRAKING_SHARE": (0.5, "half of the commanded deceleration is a very weak car's"),
        "MIN_BRAKING": (0.3, "of a car that rolls out"),
        "UNANSWERED": (
            0.5,
            "twice what a car that drives off gains before it is seen to move, and more; 0.13 measured",
        ),
        "COASTING": (0.1, "rolling resistance alone"),
    },
}
ROWS = [(module, name, figure) for module, figures in FIGURES.items() for name, (figure, _) in figures.items()]


@pytest.mark.parametrize(
    ("module", "name", "figure"), ROWS, ids=[f"{m.__name__.split('.')[-1]}-{n}" for m, n, _ in ROWS]
)
def test_a_figure_is_what_its_reason_says(module: ModuleType, name: str, figure: float | tuple[float, ...]) -> None:
    assert getattr(module, name) == figure


@pytest.mark.parametrize("module", FIGURES, ids=lambda module: module.__name__.split(".")[-1])
def test_every_figure_is_listed(module: ModuleType) -> None:
    figures = {
        name
        for name, kind in module.__annotations__.items()
        if kind.startswith("Final")
        and not name.startswith("_")
        and isinstance(getattr(module, name), (int, float, tuple))
    }
    assert figures == set(FIGURES[module])


def test_reasons_that_can_be_reckoned() -> None:
    """From masses, torques, slopes and the pedal's table."""
    assert brake_monitor.BRAKE_SHARE < 0.9 / 1.15
    assert slowing_monitor.BRAKE_SHARE > 1.1 / 0.85
    assert slowing_monitor.DRIVE_SHARE < 0.8 / 1.15
    slope = GRAVITY * math.sin(math.atan(0.015))
    assert slope < brake_monitor.ACCELERATION_MARGIN < slowing_monitor.DECELERATION_MARGIN
    assert reports.IDLE_TORQUE < pedal_to_torque(0.18) < reports.FOOT_TORQUE < pedal_to_torque(0.19)
    assert pedal_to_torque(0.19) > driver_braking.UNASKED_TORQUE
    assert pedal_to_torque(0.22) > driver_braking.LATCH_TORQUE
    assert PERIOD < driver_braking.UNASKED_TIME < 2 * PERIOD
    assert math.exp(-driver_braking.LAGS) < 0.05
    assert standstill.WHEEL_REST < brake_monitor.ROLL_SPEED < brake_monitor.MIN_SPEED
    assert standstill.GNSS_MEAN_REST < brake_monitor.GNSS_ROLL_SPEED
