"""The rolling start: before drive time 0 the simulated vehicle comes up to speed, on its path or straight before it.

Car, receiver, pipeline and gateway are those of the drive, so the gateway engages at rest, as always. Only the virtual
road is missing: SUMO does not step, sensors see nobody, and nothing is recorded. Knows neither SUMO nor a record.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple, Protocol

from vve_sumo.controller import Controller
from vve_sumo.drive.pipeline import Pipeline
from vve_sumo.drive.resolved_scenario import ResolvedScenario
from vve_sumo.drive.snapshots import NO_ACTORS
from vve_sumo.errors import ConfigError
from vve_sumo.laws import clamp
from vve_sumo.path import ReferencePath
from vve_sumo.plant.car import CarOutput
from vve_sumo.timing import PERIOD
from vve_sumo.values import ArmingState, ControlCommand, Frame, GatewayStatus, Observation, Pose
from vve_sumo.vehicle.arming_machine import OperatorCommand
from vve_sumo.vehicle.gateway import Gateway
from vve_sumo.vehicle.model import VehicleModel

#: key of an ego's table, as messages name it
INITIAL_SPEED = "initial_speed_mps"
#: time in which the gateway finds the car at rest, engages it and shifts to drive [s]; by the shipped interface 0.8 s
ENGAGING_TIME = 2.0
#: time for which the controller holds the speed by itself before drive time 0 [s]
SETTLING_TIME = 3.0
#: rate at which the acceleration builds up and ends [m/s3]; comfortable
JERK = 1.5
#: share of the gateway's limit of acceleration, and of what the engine gives beyond drag, that the car is asked for
SHARE = 0.9, 0.7
#: asked for while the gateway engages [m/s2]: the brakes stay applied
HOLD = -1.0
#: acceleration for each m/s [1/s] and for each metre [1/s2] that the car is behind; both errors go in some 2 s
SPEED_GAIN, PLACE_GAIN = 1.2, 0.4
#: largest differences from speed [m/s] and place [m] with which a rolling start is one
SPEED_TOLERANCE, PLACE_TOLERANCE = 0.3, 2.0
#: a controller that brakes harder than this on the ramp, as ahead of a bend, is obeyed [m/s2]
BRAKING = 0.5


def require_start_from_rest(resolved: ResolvedScenario, why: str) -> None:
    """Raise ConfigError, with the reason `why`, for a scenario with a rolling start."""
    if resolved.scenario.ego.initial_speed_mps is not None:
        raise ConfigError(f"{resolved.where}.{INITIAL_SPEED}: {why}; take the key out")


class MovingCar(Protocol):
    """The simulated vehicle, as `plant.car.Car` is."""

    def step(self, until: float, frames: Sequence[Frame]) -> CarOutput:
        """Take in frames and advance to drive time `until` [s]."""
        ...


class Operator(Protocol):
    """Who engages the gateway."""

    def next_command(self) -> OperatorCommand | None:
        """Return the operator command for the next tick, None for none."""
        ...

    def observe(self, status: GatewayStatus) -> None:
        """Choose the next command by the gateway's status at a tick."""
        ...


class RampPoint(NamedTuple):
    """Where a car on a ramp of speed is."""

    s: float  #: distance from the begin [m]
    speed: float  #: [m/s]
    acceleration: float  #: [m/s2]


@dataclass(frozen=True, slots=True)
class Ramp:
    """The motion from rest to a speed with bounded acceleration and jerk; symmetric in time."""

    speed: float  #: at the end [m/s]
    acceleration: float  #: in the middle [m/s2]
    jerk: float  #: at both ends [m/s3]

    @classmethod
    def to(cls, speed: float, acceleration: float, jerk: float) -> Ramp:
        """Return the ramp with at most this `acceleration`; a slow car needs less of it."""
        return cls(speed, min(acceleration, math.sqrt(speed * jerk)), jerk)

    @property
    def duration(self) -> float:
        """Time from rest to the speed [s]."""
        return self.speed / self.acceleration + self.acceleration / self.jerk

    @property
    def length(self) -> float:
        """Distance from rest to the speed [m]: half the speed times the duration, for symmetry."""
        return 0.5 * self.speed * self.duration

    def at(self, time: float) -> RampPoint:
        """Return where the car is `time` [s] after the begin; it stands before, and keeps its speed afterwards."""
        left, build_up = self.duration - time, self.acceleration / self.jerk
        if time <= 0.0:
            return RampPoint(0.0, 0.0, 0.0)
        if left <= 0.0:
            return RampPoint(self.length - self.speed * left, self.speed, 0.0)
        if time < build_up:
            return RampPoint(self.jerk * time**3 / 6.0, 0.5 * self.jerk * time**2, self.jerk * time)
        if left < build_up:
            s = self.length - self.speed * left + self.jerk * left**3 / 6.0
            return RampPoint(s, self.speed - 0.5 * self.jerk * left**2, self.jerk * left)
        since = time - 0.5 * build_up
        s = 0.5 * self.acceleration * since**2 + self.acceleration * build_up**2 / 24.0
        return RampPoint(s, self.acceleration * since, self.acceleration)


@dataclass(frozen=True, slots=True)
class RollingStart:
    """What the car does before drive time 0, at which it passes a place on its path."""

    ramp: Ramp
    s: float  #: of that place [m]
    where: str  #: the ego's table and its file, for messages

    @classmethod
    def of(cls, resolved: ResolvedScenario) -> RollingStart | None:
        """Return a scenario's rolling start, None for a start from rest.

        Raises ConfigError for one that the scenario's car cannot have on its path.
        """
        ego, path, where = resolved.scenario.ego, resolved.path, resolved.where
        if ego.initial_speed_mps is None:
            return None
        if not ego.initial_s_m < path.length:
            raise ConfigError(f"{where}.initial_s_m: {ego.initial_s_m:g} lies beyond the path's {path.length:.1f} m")
        rolling = cls(cls._ramp(ego.initial_speed_mps, resolved.model, where), ego.initial_s_m, where)
        rolling._require_clear(path)
        return rolling

    @staticmethod
    def _ramp(speed: float, model: VehicleModel, where: str) -> Ramp:
        calibration, of_limit, of_engine = model.calibration, *SHARE
        spare = (calibration.full_throttle_force(speed) - calibration.drag(speed)) / calibration.mass
        acceleration = min(of_limit * model.limits.comfort.acceleration, of_engine * spare)
        if not acceleration > 0.0:
            raise ConfigError(f"{where}.{INITIAL_SPEED}: the car has no power to gain {speed:g} m/s")
        return Ramp.to(speed, acceleration, JERK)

    @property
    def speed(self) -> float:
        """Speed at drive time 0 [m/s]."""
        return self.ramp.speed

    @property
    def ticks(self) -> int:
        """Number of ticks before drive time 0."""
        return math.ceil((ENGAGING_TIME + self.ramp.duration + SETTLING_TIME) / PERIOD)

    @property
    def begin(self) -> float:
        """Drive time at which the car stands before it is engaged [s]: negative."""
        return -self.ticks * PERIOD

    @property
    def stands_at(self) -> float:
        """Where on the path the car stands before it is engaged, s [m]; below 0 on the straight before the path."""
        return self.s - self.ramp.length - SETTLING_TIME * self.speed

    def _require_clear(self, path: ReferencePath) -> None:
        """Raise ConfigError where another part of the path is nearer to the standing car than its own."""
        at = path.at(self.stands_at)
        found = path.project(at.x, at.y).s
        # From a start far before the path, the search stops on its way along the straight.
        if not abs(found - self.stands_at) < 1.0 and not self.stands_at < found <= 0.0:
            raise ConfigError(
                f"{self.where}.{INITIAL_SPEED}: the car would come up to speed from s {self.stands_at:.1f} m, "
                f"where the path passes again at s {found:.1f} m; start elsewhere, or from rest"
            )

    def reached(self, pose: Pose, s: float) -> bool:
        """Whether a car at `s` [m] on its path has the speed and the place of the last tick before drive time 0."""
        early = abs(s + self.speed * PERIOD - self.s)
        return abs(pose.speed - self.speed) <= SPEED_TOLERANCE and early <= PLACE_TOLERANCE

    def before(self, time: float) -> RampPoint:
        """Return speed, acceleration, and s on the path, of a drive time before 0 [s]."""
        point = self.ramp.at(time + SETTLING_TIME + self.ramp.duration)
        return point._replace(s=point.s + self.stands_at)


class RollingController:
    """The scenario's controller, with the ramp's acceleration in place of its own until the speed is reached.

    It is called at every tick, and steers at every tick. Until drive time 0 its desired speed is the initial one.
    """

    def __init__(self, own: Controller, rolling: RollingStart) -> None:
        self._own, self._rolling = own, rolling
        self._s: float | None = None

    def step(self, observation: Observation) -> ControlCommand:
        """Return the controller's command, on the ramp with the ramp's acceleration."""
        if observation.time >= 0.0:
            return self._own.step(observation)
        command = self._own.step(replace(observation, desired_speed=self._rolling.speed))
        if not _has_acceleration(command):
            return command  # what is wrong with it is found as in the drive
        if observation.time >= -SETTLING_TIME or command.emergency:
            return command
        ramp = self._acceleration(observation)
        return command if command.acceleration < min(-BRAKING, ramp) else replace(command, acceleration=ramp)

    def _acceleration(self, observation: Observation) -> float:
        wanted, pose = self._rolling.before(observation.time), observation.pose
        self._s = observation.path.project(pose.x, pose.y, self._s).s
        if wanted.speed == 0.0:
            return HOLD
        behind = clamp(wanted.s - self._s, -1.0, 1.0)
        return wanted.acceleration + SPEED_GAIN * (wanted.speed - pose.speed) + PLACE_GAIN * behind


def _has_acceleration(command: object) -> bool:
    return isinstance(command, ControlCommand) and math.isfinite(command.acceleration)


def roll(rolling: RollingStart, pipeline: Pipeline, gateway: Gateway, car: MovingCar, operator: Operator) -> CarOutput:
    """Bring the standing car up to speed; return what it sent for the tick of drive time 0, which nobody took in yet.

    Raises ConfigError where the car is not under way at its speed and place then.
    """
    came, output, result = CarOutput([], []), None, None
    for number in range(-rolling.ticks, 0):
        now = number * PERIOD
        for time, data in came.packets:
            pipeline.receive(time, data)
        pipeline.see(now, replace(NO_ACTORS, time=now))
        steering = gateway.monitor.measured_steering
        result = pipeline.decide(number, now, steering)
        reports = [frame for _time, frame in came.reports]
        output = gateway.step(now, result.setpoint, reports, operator.next_command())
        operator.observe(output.status)
        pipeline.prepare(now + PERIOD, steering)
        came = car.step((number + 1) * PERIOD, output.frames)
    assert output is not None
    assert result is not None
    pose, status = result.pose, output.status
    if status.state is not ArmingState.ENGAGED or pose is None or not rolling.reached(pose, result.s):
        speed = math.nan if pose is None else pose.speed
        why = f" ({', '.join(status.reasons)})" if status.reasons else ""
        raise ConfigError(
            f"{rolling.where}.{INITIAL_SPEED}: when the drive begins the car is {status.state} at {speed:.2f} m/s "
            f"and s {result.s:.1f} m{why}; expected engaged at {rolling.speed:g} m/s and s {rolling.s:g} m: choose "
            "a speed that the controller keeps there"
        )
    return came
