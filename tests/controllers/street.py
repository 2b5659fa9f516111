"""A street in a few lines for closed-loop tests: a single-track car with honest flaws, boxes, a noisy radar.

Written against textbooks, sharing no code with the package's own plant or radar, so that both can be wrong alone.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from vve_sumo.controller import Controller
from vve_sumo.path import ReferencePath
from vve_sumo.values import ControlCommand, Detections, Observation, Point, Pose, Vehicle

PERIOD = 0.02
SUBSTEPS = 10

FUSION = Vehicle(
    length=4.872, width=1.852, wheelbase=2.85, front_overhang=0.99, mass=1690.0, yaw_inertia=3000.0,
    front_axle_to_mass=1.27, cornering_stiffness_front=120e3, cornering_stiffness_rear=100.74e3, wheel_radius=0.3245,
    steering_ratio=14.8, steering_limit=0.55, steering_rate_limit=0.5, steering_delay=0.04, steering_lag=0.08,
    brake_delay=0.03, brake_lag=0.15, brake_torque_limit=3250.0, deceleration_limit=5.9,
)  # fmt: skip


@dataclass
class Flaws:
    """What is wrong with the car that its controller was not told."""

    steering_zero: float = 0.0024  #: road wheel [rad]
    misalignment: float = math.radians(0.2)  #: of the receiver's heading [rad]
    brake_gain: float = 1.0  #: deceleration got over deceleration asked
    drag: float = 0.0  #: that the throttle map forgets [m/s2]
    stiffness: float = 1.0  #: of the tyres, over what is declared
    pose_sigma: float = 0.01  #: [m]
    velocity_sigma: float = 0.02  #: [m/s]


class Car:
    """Linear single track (kinematic at walking pace), first-order actuators with dead time, jerk-limiting gateway."""

    def __init__(self, vehicle: Vehicle, path: ReferencePath, flaws: Flaws, speed: float = 0.0) -> None:
        start = path.at(0.0)
        self.vehicle, self.flaws = vehicle, flaws
        self.x, self.y, self.heading, self.speed = start.x, start.y, start.heading, speed
        self.lateral_speed = self.yaw_rate = self.wheel = self.acceleration = 0.0
        self.granted = 0.0
        # One tick to compute and send, then the actuator's own dead time.
        self.steering_queue = deque([0.0] * round((PERIOD + vehicle.steering_delay) / PERIOD))
        self.brake_queue = deque([0.0] * round((PERIOD + vehicle.brake_delay) / PERIOD))

    def drive(self, setpoint: ControlCommand) -> None:
        """Go on by one period."""
        jerk, least = (30.0, -9.0) if setpoint.emergency else (5.0, -3.5)
        wanted = min(max(setpoint.acceleration, least), 2.0)
        self.granted += min(max(wanted - self.granted, -jerk * PERIOD), jerk * PERIOD)
        self.steering_queue.append(setpoint.steering)
        self.brake_queue.append(max(self.granted, -self.vehicle.deceleration_limit))
        steering, braking = self.steering_queue.popleft(), self.brake_queue.popleft()
        braking = braking * self.flaws.brake_gain if braking < 0.0 else braking - self.flaws.drag
        for _ in range(SUBSTEPS):
            self._advance(steering, braking, PERIOD / SUBSTEPS)

    def _advance(self, steering: float, braking: float, dt: float) -> None:
        car = self.vehicle
        rate = (steering + self.flaws.steering_zero - self.wheel) / car.steering_lag
        self.wheel += min(max(rate, -car.steering_rate_limit), car.steering_rate_limit) * dt
        self.acceleration += (braking - self.acceleration) / car.brake_lag * dt
        if self.speed <= 0.0 and self.acceleration < 0.0:
            self.speed = self.acceleration = self.lateral_speed = self.yaw_rate = 0.0
            return
        self.speed = max(self.speed + self.acceleration * dt, 0.0)
        if self.speed < 1.5:
            self.lateral_speed, self.yaw_rate = 0.0, self.speed * math.tan(self.wheel) / car.wheelbase
        else:
            self._slip(dt)
        cos, sin = math.cos(self.heading), math.sin(self.heading)
        self.x += (self.speed * cos - self.lateral_speed * sin) * dt
        self.y += (self.speed * sin + self.lateral_speed * cos) * dt
        self.heading += self.yaw_rate * dt

    def _slip(self, dt: float) -> None:
        car, v = self.vehicle, self.speed
        lf, lr = car.front_axle_to_mass, car.wheelbase - car.front_axle_to_mass
        across = self.lateral_speed + lr * self.yaw_rate
        front = self.flaws.stiffness * car.cornering_stiffness_front * (self.wheel - (across + lf * self.yaw_rate) / v)
        rear = -self.flaws.stiffness * car.cornering_stiffness_rear * (across - lr * self.yaw_rate) / v
        yaw_acceleration = (lf * front - lr * rear) / car.yaw_inertia
        across += ((front + rear) / car.mass - v * self.yaw_rate) * dt
        self.yaw_rate += yaw_acceleration * dt
        self.lateral_speed = across - lr * self.yaw_rate

    def pose(self, time: float, random: np.random.Generator) -> Pose:
        """What the receiver and the predictor make of it: misaligned, with noise."""
        noise = random.normal(size=4).tolist()
        turn = self.flaws.misalignment
        forward = self.speed * math.cos(turn) + self.lateral_speed * math.sin(turn)
        left = self.lateral_speed * math.cos(turn) - self.speed * math.sin(turn)
        return Pose(
            time, Point.REAR_AXLE, self.x + self.flaws.pose_sigma * noise[0], self.y + self.flaws.pose_sigma * noise[1],
            self.heading + turn, forward + self.flaws.velocity_sigma * noise[2],
            left + self.flaws.velocity_sigma * noise[3], self.yaw_rate, self.acceleration, 0.0,
        )  # fmt: skip


@dataclass
class Obstacle:
    """A box on the path, its rear end at `s`; it moves along the path by a speed over time."""

    s: float  #: of its rear end [m]
    d: float = 0.0  #: of its middle beside the path [m]
    speed: Callable[[float], float] = field(default=lambda _time: 0.0)  #: [m/s] over drive time [s]
    length: float = 4.5
    width: float = 1.8


def scan(
    time: float, pose: Pose, path: ReferencePath, obstacles: list[Obstacle], sight: float, random: np.random.Generator,
    vehicle: Vehicle,
) -> Detections:  # fmt: skip
    """Nearest of many points on each box, with noise, quanta and misses."""
    front = vehicle.rear_axle_to_bumper
    bumper = np.array([pose.x + front * math.cos(pose.heading), pose.y + front * math.sin(pose.heading)])
    rows = []
    for box in obstacles:
        rear = path.at(box.s)
        along = np.array([math.cos(rear.heading), math.sin(rear.heading)])
        left = np.array([-along[1], along[0]])
        corner = np.array([rear.x, rear.y]) + (box.d - 0.5 * box.width) * left
        edge = np.linspace(0.0, 1.0, 41)[:, None]
        points = np.concatenate((corner + edge * box.width * left, corner + edge * box.length * along,
                                 corner + box.width * left + edge * box.length * along))  # fmt: skip
        offsets = points - bumper
        nearest = offsets[np.argmin((offsets**2).sum(axis=1))]
        distance = float(np.hypot(*nearest))
        azimuth = math.remainder(math.atan2(nearest[1], nearest[0]) - pose.heading, math.tau)
        own = np.array([
            pose.speed * math.cos(pose.heading) - (pose.lateral_speed + pose.yaw_rate * front) * math.sin(pose.heading),
            pose.speed * math.sin(pose.heading) + (pose.lateral_speed + pose.yaw_rate * front) * math.cos(pose.heading),
        ])  # fmt: skip
        rate = float((box.speed(time) * along - own) @ nearest) / distance
        seen = distance < sight and abs(azimuth) < math.radians(10 if distance > 60 else 45) and random.random() < 0.9
        if seen:
            rows.append((
                round(distance + random.normal(0.0, 0.25), 1), azimuth + random.normal(0.0, math.radians(0.5)),
                round(rate + random.normal(0.0, 0.12), 2), 0 if distance > 60 else 1,
            ))  # fmt: skip
    rows.sort()
    columns = np.array([row[:3] for row in rows]).reshape(-1, 3)
    return Detections(time, *columns.T.copy(), np.array([row[3] for row in rows], np.int8))


@dataclass
class Drive:
    """What came of a drive: one row a tick."""

    time: np.ndarray
    speed: np.ndarray
    acceleration: np.ndarray  #: of the car
    d: np.ndarray  #: of the true rear axle from the path
    gap: np.ndarray  #: true, along the path, to the nearest obstacle
    emergency: np.ndarray
    setpoints: list[ControlCommand]
    final_s: float


def drive(
    controller: Controller, path: ReferencePath, desired_speed: float, obstacles: list[Obstacle], seconds: float, *,
    flaws: Flaws | None = None, sight: float = 174.0, seed: int = 0, start_speed: float = 0.0, stay: float = 2.0,
    vehicle: Vehicle = FUSION,
) -> Drive:  # fmt: skip
    """Run the loop for some seconds, or until the car has stood for `stay` [s].

    `vehicle` is the car that really drives; the controller was made for what was declared.
    """
    random = np.random.default_rng(seed)
    car = Car(vehicle, path, flaws or Flaws(), start_speed)
    newest = Detections(-math.inf, np.empty(0), np.empty(0), np.empty(0), np.empty(0, np.int8))
    near, rows, setpoints, standing = 0.0, [], [], 0
    next_scan = 0.0
    for tick in range(round(seconds / PERIOD)):
        time = tick * PERIOD
        pose = car.pose(time, random)
        if time >= next_scan - 1e-9:
            newest = scan(time, pose, path, obstacles, sight, random, vehicle)
            next_scan += 0.05
        setpoint = controller.step(Observation(tick, time, pose, path, desired_speed, {"radar": newest}, car.wheel))
        projection = path.project(car.x, car.y, near)
        near = projection.s
        gap = min((box.s for box in obstacles), default=math.inf) - projection.s - vehicle.rear_axle_to_bumper
        rows.append((time, car.speed, car.acceleration, projection.d, gap, setpoint.emergency))
        setpoints.append(setpoint)
        standing = standing + 1 if car.speed == 0.0 and time > 3.0 else 0
        if standing > stay / PERIOD:
            break
        car.drive(setpoint)
        for box in obstacles:
            box.s += box.speed(time) * PERIOD
    columns = np.array(rows, dtype=float).T
    return Drive(*columns[:5], columns[5] > 0.5, setpoints, near)
