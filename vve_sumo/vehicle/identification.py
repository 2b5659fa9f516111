"""Identifies a car's response to its commands from recorded drives: the pure fits.

Arrays in, numbers with their uncertainty out. Each fit is least squares on a model of a few parameters: dead time,
first-order lag, forces along the car, a steered axle. The module knows no file, no bus frame and no rig.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vve_sumo.physical_constants import AIR_DENSITY, GRAVITY
from vve_sumo.values import Floats, Vehicle
from vve_sumo.vehicle.calibration import Calibration

Mask = NDArray[np.bool_]
Bounds = tuple[float, float]

ROLLING_SPEED = 0.15  #: slower than this, static friction matters [m/s]
MIN_SPEED = 1.0  #: of fits whose noise grows with one over the speed [m/s]
COURSE_SPEED = 3.0  #: from this speed on the direction of motion is well defined [m/s]
MAX_LINEAR_STEERING = 0.1  #: road-wheel angle up to which a car is a single track: angle, tangent and links agree [rad]
MAX_STRAIGHT_YAW_RATE = 0.02  #: the car goes straight below this yaw rate [rad/s]
MIN_SAMPLES = 50  #: fewer give no estimate
RESIDUAL_CORRELATION_TIME = 1.0  #: residuals farther apart than this count as independent [s]
DIFFERENCE_BASE = 0.1  #: over which the wheels' acceleration is computed [s]
SLEW_STEP = 0.005  #: time step of a command that moves at the DBW controller's largest rate [s]
MAX_DRAG_UNCERTAINTY = 0.25  #: air drag known worse than to this share is left as declared
BETWEEN_DRIVES = 10.0  #: between drives that are fitted together: longer than any response [s]
MAX_STEPS = 20  #: of a fit; a good drive takes 7 at most, a drive without excitation would take very long
MIN_LAG = 1e-3  #: the exponential needs a positive lag [s]

UNBOUND: Final[Bounds] = (-math.inf, math.inf)
DELAYS: Final[Bounds] = (-0.1, 0.5)  # negative where two clocks differ [s]
LAGS: Final[Bounds] = (MIN_LAG, 1.5)  # [s]


class Series(NamedTuple):
    """One quantity over time, in order of time, all numbers finite."""

    time: Floats  #: [s]
    value: Floats

    def at(self, time: Floats) -> Floats:
        """Linear between the samples, constant beyond them."""
        return np.interp(time, self.time, self.value)

    def where(self, keep: Mask) -> Series:
        """The samples that a mask keeps."""
        return Series(self.time[keep], self.value[keep])


@dataclass(frozen=True, slots=True)
class Log:
    """The signals of a drive, or of several, on one clock: commands as sent, measurements as received."""

    brake_torque: Series  #: commanded, all wheels [N m]
    throttle: Series  #: commanded, 0 to 1
    wheel_command: Series  #: steering-wheel angle commanded [rad], left positive
    wheel_angle: Series  #: reported [rad], left positive
    wheels: Series  #: mean of the rear wheels [rad/s], forward positive
    speed: Series  #: of the rear axle along the receiver's heading [m/s], by GNSS
    slip: Series  #: direction of the rear axle's motion less the receiver's heading [rad], counter-clockwise
    yaw_rate: Series  #: by the receiver [rad/s], counter-clockwise
    acceleration: Series  #: by the receiver, along the car, gravity's share by pitch taken out [m/s2]
    grade: Series  #: the receiver's pitch, nose up positive [rad]
    obedient: tuple[tuple[float, float], ...]  #: from when to when the car is in drive and obeys commands [s], in order

    def usable(self, time: Floats, radius: float = 1.0, least: float = -math.inf) -> Mask:
        """Which times lie in these, with the car moving forward at `least` [m/s] or more on wheels of `radius` [m]."""
        within = [(time >= begin) & (time <= end) for begin, end in self.obedient]
        obeys: Mask = np.logical_or.reduce(within)
        return obeys & (radius * self.wheels.at(time) >= least)


#: names of a log's signals
SIGNALS: Final = tuple(one.name for one in fields(Log) if one.name != "obedient")


def joined(logs: Sequence[Log]) -> Log:
    """Return the logs of several drives of one car as one, each BETWEEN_DRIVES after the end of the one before."""
    shifted: list[Log] = []
    free = 0.0
    for log in logs:
        every = [getattr(log, name) for name in SIGNALS]
        by = free - min(float(series.time[0]) for series in every)
        moved = {name: Series(series.time + by, series.value) for name, series in zip(SIGNALS, every, strict=True)}
        shifted.append(Log(**moved, obedient=tuple((begin + by, end + by) for begin, end in log.obedient)))
        free = BETWEEN_DRIVES + max(float(series.time[-1]) for series in moved.values())
    whole = {
        name: Series(*(np.concatenate(parts) for parts in zip(*(getattr(log, name) for log in shifted), strict=True)))
        for name in SIGNALS
    }
    return Log(**whole, obedient=tuple(span for log in shifted for span in log.obedient))


@dataclass(frozen=True, slots=True)
class Estimate:
    """One identified number of the car."""

    value: float
    sigma: float  #: its standard deviation, by the fit's residuals
    problem: str = ""  #: why it should not be used; empty where it may be

    @property
    def good(self) -> bool:
        """Whether it may be used."""
        return not self.problem


class Curve(NamedTuple):
    """The data and the result of a fit, for plots."""

    time: Floats  #: [s]
    measured: Floats
    fitted: Floats

    @property
    def misfit(self) -> float:
        """Root mean square of the residuals."""
        return float(np.sqrt(np.mean((self.measured - self.fitted) ** 2))) if len(self.time) else math.nan


@dataclass(frozen=True, slots=True)
class Identified:
    """All that a drive tells of its car; names and units as in `REQUIRED_PRECISION` and `MAX_RESIDUAL`."""

    estimates: dict[str, Estimate]
    curves: dict[str, Curve]


#: how well a number must be known (standard deviation) to be used: absolute, and as a share of its value
REQUIRED_PRECISION: Final[dict[str, tuple[float, float]]] = {
    "wheel_radius": (0.0, 0.005),  # [m]
    "heading_misalignment": (math.radians(0.05), 0.0),  # receiver's heading minus the car's [rad], counter-clockwise
    "acceleration_bias": (0.02, 0.0),  # [m/s2]
    "steering_delay": (0.01, 0.0),  # [s]
    "steering_lag": (0.015, 0.0),  # [s]
    "steering_ratio": (0.0, 0.005),
    "steering_wheel_bias": (math.radians(0.2), 0.0),  # reported angle that drives straight [rad], left positive
    "brake_gain": (0.0, 0.02),  # torque for each m/s2 [kg m]
    "brake_delay": (0.01, 0.0),  # [s]
    "brake_lag": (0.015, 0.0),  # [s]
    "drive_force_limit": (0.0, 0.03),  # at full throttle, for the declared mass [N]
    "drive_delay": (0.02, 0.0),  # [s]
    "drive_lag": (0.04, 0.0),  # [s]
    "creep_force": (0.0, 0.1),  # for the declared mass [N]
    "creep_speed": (0.2, 0.0),  # [m/s]
    "rolling_resistance": (0.002, 0.0),
    "drag_area": (0.0, MAX_DRAG_UNCERTAINTY),  # for the declared mass [m2]
}

#: numbers that may be negative
SIGNED: Final = frozenset({"heading_misalignment", "acceleration_bias", "steering_wheel_bias"})

#: largest root mean square of each model's residuals; beyond it none of the model's numbers is used
MAX_RESIDUAL: Final[dict[str, float]] = {
    "wheel_radius": 0.15,  # [m/s]
    "heading_misalignment": math.radians(2.0),  # [rad]
    "acceleration": 0.5,  # [m/s2]
    "steering_answer": math.radians(2.0),  # of the steering wheel [rad]
    "steering_geometry": 0.01,  # [rad/s]
    "pedals": 0.1,  # [m/s]
}


def identify(log: Log, vehicle: Vehicle, calibration: Calibration) -> Identified:
    """Identify the car's numbers; `vehicle` and `calibration` are the declared ones, at which the fits begin."""
    radius, rolled = wheel_radius(log, vehicle.wheel_radius)
    effective = radius.value if radius.good else vehicle.wheel_radius
    misaligned, course = heading_misalignment(log, vehicle, effective)
    bias, felt = acceleration_bias(log, effective)
    answer, wheel = steering_response(log, vehicle)
    geometry, turned = steering_geometry(log, vehicle, effective)
    forces, driven = pedals(log, vehicle, calibration, effective)
    found = {"wheel_radius": radius, "heading_misalignment": misaligned, "acceleration_bias": bias}
    curves = {
        "wheel_radius": rolled,
        "heading_misalignment": course,
        "acceleration": felt,
        "steering_answer": wheel,
        "steering_geometry": turned,
        "pedals": driven,
    }
    return Identified(found | answer | geometry | forces, curves)


class FirstOrderResponse:
    """Response of dead time and first-order lag to commands that each hold until the next.

    It is exact, so that a fit sees a smooth function of delay and lag, whatever the commands' period.
    """

    def __init__(self, commands: Series, delay: float, lag: float) -> None:
        """`delay` and `lag` in [s]; before the first command takes effect the actuator is at that command's value."""
        self._lag = max(lag, MIN_LAG)
        self._starts = commands.time + delay
        self._targets = commands.value
        spans = np.diff(self._starts)
        decays = np.exp(-spans / self._lag)
        states, state = [], float(commands.value[0])
        for target, decay in zip(commands.value.tolist(), [*decays.tolist(), 0.0], strict=True):
            states.append(state)
            state = target + (state - target) * decay
        self._away = np.array(states) - commands.value
        parts = commands.value[:-1] * spans + self._away[:-1] * self._lag * (1.0 - decays)
        self._sums = np.concatenate(([0.0], np.cumsum(parts)))

    def at(self, time: Floats) -> Floats:
        """The response at each `time` [s]."""
        row, since = self._rows(time)
        return self._targets[row] + self._away[row] * np.exp(-since / self._lag)

    def integral(self, time: Floats) -> Floats:
        """The response's integral over time, up to a constant."""
        row, since = self._rows(time)
        gone = -self._lag * np.expm1(-since / self._lag)
        return self._sums[row] + self._targets[row] * since + self._away[row] * gone

    def _rows(self, time: Floats) -> tuple[NDArray[np.intp], Floats]:
        row = np.maximum(np.searchsorted(self._starts, time, side="right") - 1, 0)
        return row, np.maximum(time - self._starts[row], 0.0)


def rate_limited(commands: Series, rate: float) -> Series:
    """Commands as the DBW controller passes them on: changing by `rate` [1/s] at most, sampled every `SLEW_STEP`."""
    time = np.arange(commands.time[0], commands.time[-1], SLEW_STEP)
    wanted = commands.value[np.searchsorted(commands.time, time + 1e-9, side="right") - 1]
    change, value, passed = rate * SLEW_STEP, float(wanted[0]), []
    for target in wanted.tolist():
        value += min(max(target - value, -change), change)
        passed.append(value)
    return Series(time, np.array(passed))


@dataclass(frozen=True, slots=True)
class _Fit:
    """Parameters of a model, by least squares."""

    values: list[float]
    sigmas: list[float]
    curve: Curve
    edges: list[bool]  #: which parameters ended at a limit


Model = Callable[[Floats], Floats]


def _fit(model: Model, measured: Series, start: Sequence[float], limits: Sequence[Bounds]) -> _Fit:
    """Fit `model` (parameters to values at the measured times) by least squares, from `start` and within `limits`."""
    from scipy.optimize import least_squares

    low, high = (np.array(side) for side in zip(*limits, strict=True))
    if len(measured.time) < MIN_SAMPLES:
        nothing, empty = [math.nan] * len(start), np.zeros(0)
        return _Fit(nothing, nothing, Curve(empty, empty, empty), [False] * len(start))

    def residual(guess: Floats) -> Floats:
        return model(guess) - measured.value

    found = least_squares(
        residual,
        np.clip(np.array(start, dtype=np.float64), low, high),
        bounds=(low, high),
        x_scale="jac",
        jac="3-point",
        max_nfev=MAX_STEPS,
    )
    memory = round(RESIDUAL_CORRELATION_TIME / float(np.median(np.diff(measured.time))))
    curve = Curve(measured.time, measured.value, found.fun + measured.value)
    return _Fit(
        found.x.tolist(),
        sigmas(np.asarray(found.jac), found.fun, memory).tolist(),
        curve,
        (found.active_mask != 0).tolist(),
    )


def sigmas(jacobian: Floats, residual: Floats, memory: int) -> Floats:
    """Standard deviations of least-squares parameters whose residuals are correlated over `memory` samples.

    Newey and West, Econometrica 55 (1987). A parameter without effect has an infinite standard deviation.
    """
    scale = np.sqrt((jacobian**2).sum(axis=0))
    known = scale > 0.0
    columns = jacobian[:, known] / scale[known]
    bread = np.linalg.pinv(columns.T @ columns)
    scores = columns * residual[:, None]
    meat = scores.T @ scores
    for lag in range(1, min(memory, len(residual) - 1) + 1):
        shifted = scores[lag:].T @ scores[:-lag]
        meat += (1.0 - lag / (memory + 1.0)) * (shifted + shifted.T)
    sigmas = np.full(len(scale), math.inf)
    # With these weights the variance is negative only by rounding.
    sigmas[known] = np.sqrt(np.maximum(np.diag(bread @ meat @ bread), 0.0)) / scale[known]
    return sigmas


def _judged(name: str, model: str, value: float, sigma: float, fit: _Fit, edge: bool = False) -> Estimate:
    """The estimate with its verdict; `model` is its key in `MAX_RESIDUAL`. NaN fails every comparison."""
    absolute, share = REQUIRED_PRECISION[name]
    wanted = absolute + share * abs(value)
    problem = ""
    if not math.isfinite(value + sigma):
        problem = "nothing in this drive to learn it from"
    elif not fit.curve.misfit <= MAX_RESIDUAL[model]:
        problem = f"its model leaves {fit.curve.misfit / MAX_RESIDUAL[model]:.1f} times what is tolerated"
    elif not sigma <= wanted:
        problem = f"uncertain by {sigma / wanted:.1f} times what is wanted"
    elif edge:
        problem = "at the edge of what was searched"
    elif name not in SIGNED and value < -2.0 * sigma:
        problem = "below zero, which no car has"
    return Estimate(value if name in SIGNED else max(value, 0.0), sigma, problem)


def wheel_radius(log: Log, declared: float) -> tuple[Estimate, Curve]:
    """Rolling radius [m]: GNSS speed over the rear wheels' rate; the clocks' difference is fitted too, and dropped."""
    measured = log.speed.where(log.usable(log.speed.time, declared, MIN_SPEED))
    fit = _fit(
        lambda guess: guess[0] * log.wheels.at(measured.time - guess[1]),
        measured,
        (declared, 0.0),
        (UNBOUND, (-0.3, 0.3)),
    )
    return _judged("wheel_radius", "wheel_radius", fit.values[0], fit.sigmas[0], fit), fit.curve


def heading_misalignment(log: Log, vehicle: Vehicle, radius: float) -> tuple[Estimate, Curve]:
    """Receiver's heading minus the car's [rad], counter-clockwise: on straights a car moves where it points.

    The rear tyres' slip in the slight bends that remain is taken out (single track, declared stiffness).
    """
    slip = log.slip
    speed, yaw_rate = radius * log.wheels.at(slip.time), log.yaw_rate.at(slip.time)
    straight = log.usable(slip.time, radius, COURSE_SPEED) & (np.abs(yaw_rate) < MAX_STRAIGHT_YAW_RATE)
    needed = -_rear_compliance(vehicle) * speed * yaw_rate
    # As a lateral speed, whose noise does not depend on the speed.
    measured, speed = Series(slip.time, (needed - slip.value) * speed).where(straight), speed[straight]
    fit = _fit(lambda guess: guess[0] * speed, measured, (0.0,), (UNBOUND,))
    curve = (
        Curve(measured.time, fit.curve.measured / speed, fit.curve.fitted / speed) if len(fit.curve.time) else fit.curve
    )
    estimate = _judged(
        "heading_misalignment", "heading_misalignment", fit.values[0], fit.sigmas[0], replace(fit, curve=curve)
    )
    return estimate, curve


def _rear_compliance(vehicle: Vehicle) -> float:
    """Slip of the rear axle for each m/s2 of lateral acceleration [rad s2/m] (Rajamani, Vehicle Dynamics, 3.3)."""
    return vehicle.mass * vehicle.front_axle_to_mass / vehicle.wheelbase / vehicle.cornering_stiffness_rear


def acceleration_bias(log: Log, radius: float) -> tuple[Estimate, Curve]:
    """Bias of the receiver's acceleration against the wheels [m/s2]; it includes the error of the receiver's pitch."""
    time = log.acceleration.time
    gained = (
        radius
        * (log.wheels.at(time + 0.5 * DIFFERENCE_BASE) - log.wheels.at(time - 0.5 * DIFFERENCE_BASE))
        / DIFFERENCE_BASE
    )
    fit = _fit(lambda guess: gained + guess[0], log.acceleration, (0.0,), (UNBOUND,))
    return _judged("acceleration_bias", "acceleration", fit.values[0], fit.sigmas[0], fit), fit.curve


def steering_response(log: Log, vehicle: Vehicle) -> tuple[dict[str, Estimate], Curve]:
    """Dead time and lag [s] from a commanded steering-wheel angle to the reported one, beyond the declared rate."""
    measured = log.wheel_angle.where(log.usable(log.wheel_angle.time))
    passed = rate_limited(log.wheel_command, vehicle.steering_rate_limit * vehicle.steering_ratio)
    fit = _fit(
        lambda guess: FirstOrderResponse(passed, guess[0], guess[1]).at(measured.time) + guess[2],
        measured,
        (vehicle.steering_delay, vehicle.steering_lag, 0.0),
        (DELAYS, LAGS, UNBOUND),
    )
    return {
        name: _judged(name, "steering_answer", fit.values[row], fit.sigmas[row], fit, fit.edges[row])
        for row, name in enumerate(("steering_delay", "steering_lag"))
    }, fit.curve


def steering_geometry(log: Log, vehicle: Vehicle, radius: float) -> tuple[dict[str, Estimate], Curve]:
    """Steering ratio, and the reported wheel angle that drives straight [rad, left positive], against the yaw rate.

    Single track with the declared wheelbase L and understeer K: yaw rate = v (angle - bias) / ratio / (L + K v^2),
    later by a dead time and a lag, which stand for the tyres and for the clocks' difference. Ratio and wheelbase
    can't be told apart: an error of one shows in the other. Sharp bends are left out.
    """
    time = log.yaw_rate.time
    angle, speed = log.wheel_angle.at(time), radius * log.wheels.at(time)
    gentle = np.abs(angle) < MAX_LINEAR_STEERING * vehicle.steering_ratio
    measured = log.yaw_rate.where(gentle & log.usable(time, radius, MIN_SPEED))
    length = vehicle.wheelbase + vehicle.understeer_gradient * speed * speed

    def model(guess: Floats) -> Floats:
        turn = speed * (angle - guess[1]) / (guess[0] * length)
        return FirstOrderResponse(Series(time, turn), guess[2], guess[3]).at(measured.time)

    fit = _fit(model, measured, (vehicle.steering_ratio, 0.0, 0.0, 0.05), ((5.0, 50.0), UNBOUND, DELAYS, LAGS))
    return {
        name: _judged(name, "steering_geometry", fit.values[row], fit.sigmas[row], fit, fit.edges[row])
        for row, name in enumerate(("steering_ratio", "steering_wheel_bias"))
    }, fit.curve


#: parameters of the forces, over mass: brake torque [1/(kg m)], full throttle [m/s2], rolling [m/s2], air [1/m], creep
#: [m/s2] and where it ends [m/s], dead time and lag [s] of brakes and of throttle
_BRAKE, _THROTTLE, _ROLL, _AIR, _CREEP, _CREEP_SPEED, _BRAKE_DELAY, _BRAKE_LAG, _DRIVE_DELAY, _DRIVE_LAG = range(10)
_NOT_LINEAR: Final = frozenset({_CREEP_SPEED, _BRAKE_DELAY, _BRAKE_LAG, _DRIVE_DELAY, _DRIVE_LAG})
_FORCE_LIMITS: Final = (*(UNBOUND,) * 5, (0.5, 6.0), DELAYS, LAGS, DELAYS, LAGS)


class _Forces:
    """Speed as the integral of forces over mass, in pieces of driving without rest, each with its own initial speed.

    Valid up to the speed at which the engine's power limits its force: a fit beyond it needs more road.
    """

    def __init__(self, log: Log, calibration: Calibration, radius: float) -> None:
        time, speed = log.wheels.time, radius * log.wheels.value
        top = calibration.drive_power_limit / calibration.drive_force_limit
        self._log, self._time, self._speed = log, time, speed
        self._keep = log.usable(time, radius, ROLLING_SPEED) & (speed < top)
        self.measured = Series(time, speed).where(self._keep)
        rows = np.flatnonzero(self._keep)
        self._piece = np.cumsum(np.diff(rows, prepend=rows[:1]) > 1)
        self._begins = np.flatnonzero(np.diff(self._piece, prepend=-1))
        self.starts: list[float] = self.measured.value[self._begins].tolist()
        self._square = self._integrated(speed * np.abs(speed))
        self._climbed = self._integrated(GRAVITY * np.sin(log.grade.at(time)))

    def speed_of(self, guess: Floats, air: float | None = None) -> Floats:
        """The model: `guess` holds the parameters, then an initial speed for each piece; `air` replaces air drag."""
        log, time = self._log, self.measured.time
        gained = guess[_THROTTLE] * FirstOrderResponse(log.throttle, guess[_DRIVE_DELAY], guess[_DRIVE_LAG]).integral(
            time
        )
        gained -= guess[_BRAKE] * FirstOrderResponse(log.brake_torque, guess[_BRAKE_DELAY], guess[_BRAKE_LAG]).integral(
            time
        )
        gained += guess[_CREEP] * self._integrated(np.maximum(1.0 - self._speed / guess[_CREEP_SPEED], 0.0))
        gained -= guess[_ROLL] * time + (guess[_AIR] if air is None else air) * self._square + self._climbed
        starts: Floats = guess[len(_FORCE_LIMITS) :] - gained[self._begins]
        modelled: Floats = gained + starts[self._piece]
        return modelled

    def start(self, declared: Sequence[float]) -> list[float]:
        """Initial guess: `declared`, except that the parameters in which the model is linear are solved for."""
        guess = np.array([*declared, *self.starts])
        linear = [row for row in range(len(guess)) if row not in _NOT_LINEAR]
        guess[linear] = 0.0
        without = self.speed_of(guess)
        columns = []
        for row in linear:
            guess[row] = 1.0
            columns.append(self.speed_of(guess) - without)
            guess[row] = 0.0
        guess[linear] = np.linalg.lstsq(np.array(columns).T, self.measured.value - without, rcond=None)[0]
        return [float(value) for value in guess]

    def _integrated(self, values: Floats) -> Floats:
        steps = 0.5 * (values[1:] + values[:-1]) * np.diff(self._time)
        return np.concatenate(([0.0], np.cumsum(steps)))[self._keep]


def pedals(log: Log, vehicle: Vehicle, calibration: Calibration, radius: float) -> tuple[dict[str, Estimate], Curve]:
    """Effect of brake torque and throttle, with their delays, drag and creep, by the rear wheels' speed.

    Forces are for the declared mass, which can't be told from them: a heavier car shows weaker forces and a greater
    brake gain, and that is what its commands need. Rolling resistance includes engine braking and the error of a
    receiver's pitch that is too low. For these estimates, air drag that is too uncertain is held as declared.
    """
    forces = _Forces(log, calibration, radius)
    mass = calibration.mass
    air = 0.5 * AIR_DENSITY * calibration.drag_area / mass
    declared = [
        1.0 / calibration.brake_gain, calibration.drive_force_limit / mass, calibration.rolling_resistance * GRAVITY,
        air, calibration.creep_force / mass, calibration.creep_speed,
        vehicle.brake_delay, vehicle.brake_lag, 0.0, calibration.drive_lag,
    ]  # fmt: skip
    start, limits = forces.start(declared), (*_FORCE_LIMITS, *(UNBOUND,) * len(forces.starts))
    fit = free = _fit(forces.speed_of, forces.measured, start, limits)
    if not free.sigmas[_AIR] <= MAX_DRAG_UNCERTAINTY * abs(free.values[_AIR]):
        fit = _fit(lambda guess: forces.speed_of(guess, air), forces.measured, start, limits)
    return _force_estimates(fit, free, mass), fit.curve


def _force_estimates(fit: _Fit, free: _Fit, mass: float) -> dict[str, Estimate]:
    """The parameters as the calibration defines them; air drag is always that of the `free` fit."""

    def judged(name: str, row: int, factor: float = 1.0, of: _Fit = fit) -> Estimate:
        return _judged(name, "pedals", factor * of.values[row], factor * of.sigmas[row], of, of.edges[row])

    brake = fit.values[_BRAKE]
    gain = 1.0 / brake if brake else math.nan
    return {
        "brake_gain": _judged("brake_gain", "pedals", gain, gain * gain * fit.sigmas[_BRAKE], fit, gain < 0.0),
        "brake_delay": judged("brake_delay", _BRAKE_DELAY),
        "brake_lag": judged("brake_lag", _BRAKE_LAG),
        "drive_force_limit": judged("drive_force_limit", _THROTTLE, mass),
        "drive_delay": judged("drive_delay", _DRIVE_DELAY),
        "drive_lag": judged("drive_lag", _DRIVE_LAG),
        "creep_force": judged("creep_force", _CREEP, mass),
        "creep_speed": judged("creep_speed", _CREEP_SPEED),
        "rolling_resistance": judged("rolling_resistance", _ROLL, 1.0 / GRAVITY),
        "drag_area": judged("drag_area", _AIR, mass / (0.5 * AIR_DENSITY), free),
    }
