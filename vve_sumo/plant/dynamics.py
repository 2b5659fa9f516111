"""Vehicle dynamics: longitudinal forces, a linear single-track model for lateral motion, exact standstill.

Its inputs are road-wheel angle, drive force and brake force; it knows no actuator, frame or receiver. The ground has
one slope along the car's path and is level across it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from vve_sumo.physical_constants import AIR_DENSITY, GRAVITY

KINEMATIC_SPEED: Final = 1.0  # at and below it wheels roll where they point: slip angles divide by speed [m/s]
# From here on the tyre model alone applies; the two differ by 0.1 % on a steady circle [m/s]
DYNAMIC_SPEED: Final = 3.0


@dataclass(frozen=True, slots=True)
class Chassis:
    """Parameters of the car as a body on four wheels."""

    mass: float  #: with occupants; rotating masses are part of it [kg]
    yaw_inertia: float  #: about the centre of mass [kg m2]
    wheelbase: float  #: [m]
    front_axle_to_mass: float  #: [m]
    cornering_stiffness_front: float  #: whole axle, at its load at rest [N/rad]
    cornering_stiffness_rear: float  #: whole axle, at its load at rest [N/rad]
    mass_height: float  #: of the centre of mass above ground [m]
    friction: float  #: of tyre on road, caps each axle's side force and all braking
    rolling_resistance: float  #: rolling drag over weight
    drag_area: float  #: drag coefficient times frontal area [m2]
    combined_slip: bool = False  #: friction caps side force and braking of an axle together, not each for itself


def blend(speed: float) -> float:
    """Share of the dynamic model at `speed` [m/s]: 0 up to walking pace and in reverse, 1 when driving, smooth between.

    Where it is above 0, the explicit integration of the tyres is stable for steps up to 5 ms.
    """
    share = (speed - KINEMATIC_SPEED) / (DYNAMIC_SPEED - KINEMATIC_SPEED)
    if share <= 0.0:
        return 0.0
    return 1.0 if share >= 1.0 else share * share * (3.0 - 2.0 * share)


def _share_within(friction: float, longitudinal: float, side: float) -> float:
    """Share of a force over load, `longitudinal` and `side`, that lies within the circle of radius `friction`."""
    force = math.hypot(longitudinal, side)
    return 1.0 if force <= friction else friction / force


class Dynamics:
    """Motion of the car in the plane; position, heading and speeds are those of the middle of the rear axle.

    Single-track model with cornering stiffness proportional to axle load (Rajamani, Vehicle Dynamics and Control,
    chapter 2), small slip and steering angles in the tyre forces, cornering drag left out: good up to the limit of
    grip, not for what a car does beyond it. Lengths are measured in plan.

    With `combined_slip` the forces of an axle lie within a circle of radius friction times axle load (Pacejka, Tire and
    Vehicle Dynamics, chapter 1): what brakes, engine and slip angle ask for beyond it is scaled down to it, direction
    kept, as a sliding tyre's force opposes its slip. Braking and driving forces are shared among the axles by load, as
    a distribution does that uses the grip of both; rolling drag is no part of them.

    What steps of 5 ms miss is far below the receiver's noise: over 220 m with lane changes of 8 m/s2 and hard braking
    less than 3 mm, 1e-5 rad and 0.3 mm/s, most of it because the air's drag is that of a step's beginning. The tests of
    the integration error compare with equations solved by scipy and with steps of 0.5 ms.
    """

    __slots__ = (
        "_drag", "_front_gain", "_front_grip", "_front_load", "_grip_force", "_load_shift", "_mass_lateral_speed",
        "_mass_yaw_rate", "_rear", "_rear_gain", "_rear_grip", "_rear_load", "_rolling", "_slope_force", "acceleration",
        "chassis", "distance", "grade", "heading", "lateral_speed", "speed", "x", "y", "yaw_rate",
    )  # fmt: skip

    def __init__(
        self, chassis: Chassis, start: tuple[float, float, float], speed: float = 0.0, grade: float = 0.0
    ) -> None:
        """Stand at `start` (x, y [m], heading [rad]), or roll straight ahead at `speed` [m/s], on `grade` [rad]."""
        self.chassis = chassis
        self.grade = grade  #: slope along the path [rad], uphill positive
        self.x, self.y, self.heading = start
        self.speed = speed  #: along the heading [m/s]
        self.lateral_speed = 0.0  #: across the heading [m/s], left positive
        self.yaw_rate = 0.0  #: [rad/s]
        self.acceleration = 0.0  #: of the last step, along the heading [m/s2]
        self.distance = 0.0  #: rolled since the start, backward counts negative [m]
        self._mass_lateral_speed = 0.0
        self._mass_yaw_rate = 0.0
        self._rear = chassis.wheelbase - chassis.front_axle_to_mass
        self._slope_force = chassis.mass * GRAVITY * math.sin(grade)
        self._drag = 0.5 * AIR_DENSITY * chassis.drag_area
        weight = chassis.mass * GRAVITY * math.cos(grade)
        self._rolling = chassis.rolling_resistance * weight
        self._grip_force = chassis.friction * weight
        # Axle loads at rest, stiffness per newton of them, and the load that shifts to the rear for each m/s2.
        self._front_load = weight * self._rear / chassis.wheelbase
        self._rear_load = weight * chassis.front_axle_to_mass / chassis.wheelbase
        self._front_gain = chassis.cornering_stiffness_front / self._front_load
        self._rear_gain = chassis.cornering_stiffness_rear / (weight - self._front_load)
        self._load_shift = chassis.mass * chassis.mass_height / chassis.wheelbase
        # Bound of an axle's side force over its load; combined slip lowers it.
        self._front_grip = self._rear_grip = chassis.friction

    def advance(self, duration: float, steering: float, drive: float, brake: float) -> None:
        """Move on by `duration` [s, at most 5 ms] under constant inputs.

        `steering` is the road-wheel angle [rad], left positive; `drive` the force at the wheels [N], forward
        positive; `brake` the force that the brakes can hold [N], not negative: it opposes motion, never causes it.
        """
        if self.chassis.combined_slip:
            drive, brake = self._within_circle(steering, drive, brake)
        speed = self._roll(duration, drive, brake)
        share = blend(speed)
        tangent = math.tan(steering) / self.chassis.wheelbase
        yaw_rate, lateral = speed * tangent, 0.0
        if share:
            middle_lateral, middle_yaw_rate = self._slide(duration, speed, steering)
            yaw_rate += share * (middle_yaw_rate - yaw_rate)
            lateral = share * (middle_lateral - self._rear * middle_yaw_rate)
        self._displace(duration, speed, lateral, yaw_rate)
        rolling = self.speed * tangent
        if not share:
            self._mass_yaw_rate, self._mass_lateral_speed = rolling, rolling * self._rear
        self.yaw_rate = rolling + share * (self._mass_yaw_rate - rolling)
        self.lateral_speed = share * (self._mass_lateral_speed - self._rear * self._mass_yaw_rate)

    def _within_circle(self, steering: float, drive: float, brake: float) -> tuple[float, float]:
        """Return drive and brake force [N] that the axles' friction circles leave, and set the bounds of side force.

        Longitudinal force over load is the same for both axles; an axle that slides loses its own share of it.
        """
        friction, speed = self.chassis.friction, self.speed
        weight, shift = self._front_load + self._rear_load, self._load_shift * self.acceleration
        brake = min(brake, self._grip_force)
        longitudinal = abs(brake - math.copysign(1.0, speed) * drive) / weight
        front, rear = self._side_forces_over_load(speed, steering)
        front_share = _share_within(friction, longitudinal, front)
        rear_share = _share_within(friction, longitudinal, rear)
        self._front_grip = math.sqrt(max(friction * friction - (front_share * longitudinal) ** 2, 0.0))
        self._rear_grip = math.sqrt(max(friction * friction - (rear_share * longitudinal) ** 2, 0.0))
        share = ((self._front_load - shift) * front_share + (self._rear_load + shift) * rear_share) / weight
        return share * drive, share * brake

    def _side_forces_over_load(self, speed: float, steering: float) -> tuple[float, float]:
        """Return the side force over load that the slip angles of front and rear axle ask for, before any bound."""
        share = blend(speed)
        if not share:
            return 0.0, 0.0
        lateral, yaw_rate = self._mass_lateral_speed, self._mass_yaw_rate
        front = steering - (lateral + self.chassis.front_axle_to_mass * yaw_rate) / speed
        rear = (self._rear * yaw_rate - lateral) / speed
        return share * self._front_gain * front, share * self._rear_gain * rear

    def _roll(self, duration: float, drive: float, brake: float) -> float:
        """Advance the speed; return its mean over the step. Brakes and rolling drag act as dry friction."""
        mass, speed = self.chassis.mass, self.speed
        push = drive - self._slope_force - self._drag * speed * abs(speed)
        grip = self._grip_force
        hold = (grip if brake > grip else brake) + self._rolling
        if speed == 0.0 and abs(push) <= hold:
            self.acceleration = 0.0
            return 0.0
        acceleration = (push - math.copysign(hold, speed or push)) / mass
        final = speed + acceleration * duration
        if final < 0.0 < speed or speed < 0.0 < final:
            # Friction stops the car and cannot reverse it; the next step decides whether it starts to move again.
            mean, final = -0.5 * speed * speed / (acceleration * duration), 0.0
        else:
            mean = 0.5 * (speed + final)
        self.acceleration = (final - speed) / duration
        self.speed = final
        self.distance += mean * duration
        return mean

    def _slide(self, duration: float, speed: float, steering: float) -> tuple[float, float]:
        """Advance lateral speed and yaw rate of the centre of mass (explicit midpoint); return those of mid-step."""
        lateral, yaw_rate = self._mass_lateral_speed, self._mass_yaw_rate
        shift = self._load_shift * self.acceleration
        front_load, rear_load = max(self._front_load - shift, 0.0), max(self._rear_load + shift, 0.0)
        rate_1, rate_2 = self._tyres(speed, steering, lateral, yaw_rate, front_load, rear_load)
        middle_lateral = lateral + 0.5 * duration * rate_1
        middle_yaw_rate = yaw_rate + 0.5 * duration * rate_2
        rate_1, rate_2 = self._tyres(speed, steering, middle_lateral, middle_yaw_rate, front_load, rear_load)
        self._mass_lateral_speed = lateral + duration * rate_1
        self._mass_yaw_rate = yaw_rate + duration * rate_2
        return middle_lateral, middle_yaw_rate

    def _tyres(
        self, speed: float, steering: float, lateral: float, yaw_rate: float, front_load: float, rear_load: float
    ) -> tuple[float, float]:
        """Lateral [m/s2] and yaw [rad/s2] acceleration of the centre of mass under the axle loads [N]."""
        chassis, rear_length = self.chassis, self._rear
        front_length, front_grip, rear_grip = chassis.front_axle_to_mass, self._front_grip, self._rear_grip
        front = self._front_gain * (steering - (lateral + front_length * yaw_rate) / speed)
        rear = self._rear_gain * (rear_length * yaw_rate - lateral) / speed
        front = front_load * (-front_grip if front < -front_grip else front_grip if front > front_grip else front)
        rear = rear_load * (-rear_grip if rear < -rear_grip else rear_grip if rear > rear_grip else rear)
        return (
            (front + rear) / chassis.mass - speed * yaw_rate,
            (front_length * front - rear_length * rear) / chassis.yaw_inertia,
        )

    def _displace(self, duration: float, speed: float, lateral: float, yaw_rate: float) -> None:
        middle = self.heading + 0.5 * duration * yaw_rate
        cosine, sine = math.cos(middle), math.sin(middle)
        self.x += duration * (speed * cosine - lateral * sine)
        self.y += duration * (speed * sine + lateral * cosine)
        self.heading = math.remainder(self.heading + duration * yaw_rate, math.tau)
