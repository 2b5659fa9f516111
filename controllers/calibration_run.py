"""Drives a car through the manoeuvres that its calibration is fitted from: pedals at several levels, steering.

A plan of short phases along a straight path: creep, speed up, coast, brake, keep the speed, steer left and right. It
sees no traffic and stops for none: it is for an empty street. The phase is the setpoint's note. It must not know what
is fitted, or how. Where the path is too short for the plan, the stop at its end cuts the plan short; where a lot is too
short for the whole, it is driven in parts.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from vve_sumo.controller import Tuning, settle
from vve_sumo.errors import ConfigError
from vve_sumo.laws import clamp
from vve_sumo.values import ControlCommand, Observation, Pose, Vehicle

from .approach import Approach, Goal, Standstill
from .deviation import Deviation, DeviationObserver, steady_steering, tyre_response_time
from .preview import PreviewSteering, PreviewTuning
from .trim import SteeringTrim

PERIOD: Final = 0.02  #: of the tick [s]

TUNING: dict[str, float | str | bool] = {
    "top_acceleration_m_s2": 1.9,  #: the gateway's comfort ends at 2.0
    "top_deceleration_m_s2": 3.2,  #: the gateway's comfort ends at 3.5
    "steering_speed_m_s": 6.0,  #: at which is steered, where the desired speed is not less
    "wheel_angle_deg": 30.0,  #: of the steering wheel, to each side
    "part": "whole",  #: or "pedals" or "steering": what is driven of it
}
#: what `part` may be
PARTS: Final = ("whole", "pedals", "steering")

#: what a tuning key may be; what lies outside is a slip of the unit, or teaches nothing
RANGES: dict[str, tuple[float, float]] = {
    "top_acceleration_m_s2": (0.8, 2.0),
    "top_deceleration_m_s2": (1.5, 3.5),
    "steering_speed_m_s": (4.0, 8.0),
    "wheel_angle_deg": (10.0, 60.0),
}

#: pulls: shares of the top acceleration, the desired speed and the top deceleration, and seconds of coasting in between
PULLS = ((0.5, 0.5, 0.25, 1.0), (0.75, 0.75, 0.5, 1.5), (1.0, 1.0, 0.75, 2.0), (0.75, 0.75, 1.0, 0.0))
CREEP, CREEP_SPEED = 0.15, 0.6  #: about what a car in drive does by itself [m/s2], up to here [m/s]
COAST: Final = -0.12  #: about what a car without pedals does by itself [m/s2]
SLOW: Final = 0.7  #: where braking ends: no car rests before the end [m/s]
RELEASE: Final = 10.0  #: with which the gateway lets a brake go [m/s3]: what is lost on the way is braked less
PUSHING: Final = 0.4  #: about how long a throttle that is let go still pushes: gateway's jerk limit and engine [s]
TRACKING: Final = 0.8  #: acceleration for each m/s of speed error where a speed is kept [1/s]
STEP_TIME, SINE_TIME = 0.8, 2.0  #: a quarter of the steps, a half of the sines [s]
SETTLE_TIME, STRAIGHT_TIME = 2.0, 3.0  #: back to the path, and straight on at top speed [s]
FORGETTING: Final = 0.5  #: time constant with which an excursion that is over is forgotten [s]
STOP: Final = 1.5  #: deceleration of the last stop [m/s2]


@dataclass(frozen=True, slots=True)
class Manoeuvre:
    """One manoeuvre: what to do, and when it is over."""

    note: str
    accelerate: Callable[[float], float]  #: acceleration [m/s2] at a speed [m/s]
    over: Callable[[float, float], bool]  #: told the time since its start [s] and the speed [m/s]
    steer: Callable[[float], float] | None = None  #: road-wheel angle [rad] at a time [s]; None keeps to the path


def plan(vehicle: Vehicle, tuning: dict[str, float], top: float, part: str) -> tuple[Manoeuvre, ...]:
    """Lay out all phases of one of PARTS but the last stop, none faster than `top` [m/s]."""
    pedals, steering = _pedals(tuning, top), _steering(vehicle, tuning, top)
    straight = (
        _faster(f"accelerate_{len(PULLS) + 2}", 0.75 * tuning["top_acceleration_m_s2"], top),
        _keep("straight", top, STRAIGHT_TIME),
    )
    return {"whole": (*pedals, *steering, *straight), "pedals": pedals, "steering": steering}[part]


def _pedals(tuning: dict[str, float], top: float) -> tuple[Manoeuvre, ...]:
    pull, brake = tuning["top_acceleration_m_s2"], tuning["top_deceleration_m_s2"]
    phases = [_faster("creep", CREEP, CREEP_SPEED)]
    for number, (share, speed_share, brake_share, coast) in enumerate(PULLS, 1):
        phases.append(_faster(f"accelerate_{number}", share * pull, speed_share * top))
        phases += [Manoeuvre(f"coast_{number}", lambda _speed: COAST, _after(coast))] if coast else []
        phases.append(_slower(f"brake_{number}", brake_share * brake))
    return tuple(phases)


def _steering(vehicle: Vehicle, tuning: dict[str, float], top: float) -> tuple[Manoeuvre, ...]:
    steady = min(tuning["steering_speed_m_s"], top)
    angle = math.radians(tuning["wheel_angle_deg"]) / vehicle.steering_ratio
    return (
        _faster(f"accelerate_{len(PULLS) + 1}", 0.75 * tuning["top_acceleration_m_s2"], steady),
        _keep("settle_1", steady, SETTLE_TIME),
        _keep("steer_steps", steady, 4.0 * STEP_TIME, lambda time: angle * _steps(time)),
        _keep("settle_2", steady, SETTLE_TIME),
        _keep("steer_sines", steady, 2.0 * SINE_TIME, lambda time: angle * _sines(time)),
        _keep("settle_3", steady, SETTLE_TIME),
    )


def _after(duration: float) -> Callable[[float, float], bool]:
    return lambda time, _speed: time >= duration - 0.5 * PERIOD


def _faster(note: str, acceleration: float, speed: float) -> Manoeuvre:
    return Manoeuvre(note, lambda _speed: acceleration, lambda _time, now: now >= speed - PUSHING * acceleration)


def _slower(note: str, deceleration: float) -> Manoeuvre:
    end = SLOW + 0.5 * deceleration * deceleration / RELEASE
    return Manoeuvre(note, lambda _speed: -deceleration, lambda _time, speed: speed <= end)


def _keep(note: str, speed: float, duration: float, steer: Callable[[float], float] | None = None) -> Manoeuvre:
    return Manoeuvre(note, lambda now: TRACKING * (speed - now), _after(duration), steer)


def _steps(time: float) -> float:
    """Left, twice as long right, left again: heading and place come back by themselves."""
    return -1.0 if STEP_TIME <= time < 3.0 * STEP_TIME else 1.0


def _sines(time: float) -> float:
    """One sine, then the same mirrored: heading and place come back by themselves."""
    sine = math.sin(math.tau * time / SINE_TIME)
    return sine if time < SINE_TIME else -sine


class Excursion:
    """Where a steering manoeuvre should bring the car beside its path, so that only what is off that is corrected."""

    def __init__(self, vehicle: Vehicle, speed: float) -> None:
        """`speed` is the manoeuvres' [m/s], for which the answer's delay is reckoned."""
        self._vehicle = vehicle
        self._heading = self._d = self._yaw_rate = 0.0
        actuator = vehicle.steering_delay + vehicle.steering_lag
        answer = 1.5 * PERIOD + actuator + tyre_response_time(vehicle, speed)
        self._under_way = deque([0.0] * round(answer / PERIOD))

    def step(self, angle: float | None, speed: float) -> None:
        """Move on by a tick of steering by `angle` [rad], None between manoeuvres, at a speed [m/s]."""
        self._under_way.append(0.0 if angle is None else angle)
        taken = self._under_way.popleft()
        self._yaw_rate = speed * taken / steady_steering(self._vehicle, speed, 1.0)
        self._heading += self._yaw_rate * PERIOD
        self._d += speed * math.sin(self._heading) * PERIOD
        if angle is None:
            self._heading -= self._heading * PERIOD / FORGETTING
            self._d -= self._d * PERIOD / FORGETTING

    def taken_out(self, deviation: Deviation) -> Deviation:
        """The deviation from where the car should be."""
        return deviation._replace(
            d=deviation.d - self._d,
            heading_error=deviation.heading_error - self._heading,
            yaw_rate_error=deviation.yaw_rate_error - self._yaw_rate,
        )


class CalibrationRun:
    """Goes through the plan; the path is followed as everywhere, steering manoeuvres come on top."""

    def __init__(self, vehicle: Vehicle, tuning: dict[str, float], part: str) -> None:
        self.preview_tuning = preview = PreviewTuning()  # for the gain design
        self._vehicle, self._tuning, self._part = vehicle, tuning, part
        self._phases: tuple[Manoeuvre, ...] | None = None
        self._steering_limit = vehicle.steering_limit
        self._observer = DeviationObserver(vehicle)
        self._law = PreviewSteering(vehicle, preview)
        self._trim = SteeringTrim(vehicle, 0.25, preview.look_ahead_time, preview.look_ahead_least)
        self._excursion = Excursion(vehicle, tuning["steering_speed_m_s"])
        self._approach = Approach(vehicle, STOP, PERIOD)
        self._standstill = Standstill(PERIOD)
        self._number = 0
        self._since = 0.0  # begin of the phase [s]
        self._s: float | None = None

    def step(self, observation: Observation) -> ControlCommand:
        """Answer one observation; called once every PERIOD."""
        pose, path = observation.pose, observation.path
        projection = path.project(pose.x, pose.y, self._s)
        self._s = projection.s
        phase, time = self._phase(observation)
        excess = phase.steer(time) if phase is not None and phase.steer is not None else None
        steering = self._steer(excess, self._observer.step(pose, path, projection, PERIOD), observation)
        acceleration, note = self._accelerate(phase, Goal(path.length - projection.s), pose)
        return ControlCommand(steering, acceleration, note=note)

    def _steer(self, excess: float | None, deviation: Deviation, observation: Observation) -> float:
        """Road-wheel angle [rad]: the law's, about the manoeuvre's `excess`; the trim learns between manoeuvres."""
        self._excursion.step(excess, deviation.speed)
        trim = self._trim.step(deviation.d, deviation.speed, PERIOD, excess is not None)
        wanted = self._law.steer(self._excursion.taken_out(deviation), observation) + trim + (excess or 0.0)
        return clamp(wanted, -self._steering_limit, self._steering_limit)

    def _phase(self, observation: Observation) -> tuple[Manoeuvre | None, float]:
        """The phase of this tick, None after the last, and the time since its start [s]."""
        if self._phases is None:
            self._phases = plan(self._vehicle, self._tuning, observation.desired_speed, self._part)
            self._since = observation.time
        now, speed = observation.time, observation.pose.speed
        while self._number < len(self._phases) and self._phases[self._number].over(now - self._since, speed):
            self._number, self._since = self._number + 1, now
        phase = self._phases[self._number] if self._number < len(self._phases) else None
        return phase, now - self._since

    def _accelerate(self, phase: Manoeuvre | None, end: Goal, pose: Pose) -> tuple[float, str]:
        """The phase's acceleration, unless the end of the path asks for less."""
        to_end = self._approach.acceleration(end, pose.speed, pose.acceleration)
        last_bit = self._approach.is_last_bit(end, pose.speed, pose.acceleration)
        held = self._standstill.step(end.distance, pose.speed, last_bit)
        if held is not None:
            return held, "hold"
        wanted = -STOP if phase is None else phase.accelerate(pose.speed)
        if phase is None or to_end < wanted:
            return min(to_end, wanted), "stop"
        return wanted, phase.note


def make(vehicle: Vehicle, tuning: Tuning) -> CalibrationRun:
    """Make the controller; raises ConfigError on a tuning key or value that it cannot take."""
    settled = settle(tuning, TUNING, RANGES)
    part = str(settled.pop("part"))
    if part not in PARTS:
        raise ConfigError(f"tuning key 'part' must be {', '.join(PARTS[:-1])} or {PARTS[-1]}, got {part!r}")
    return CalibrationRun(vehicle, {key: float(value) for key, value in settled.items()}, part)
