"""Gain design of the preview steering: margins over speed, a latency it must bear, D-stability over a box.

Margins are read off the frequency response, in which dead time is exact.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vve_sumo.errors import ConfigError
from vve_sumo.path import Floats
from vve_sumo.values import Vehicle

from .gain_schedule import Schedule
from .preview import PreviewTuning
from .single_track import DAMPING
from .trim import slow_rate

SPEEDS = (2.2, 4.5, 6.7, 8.9, 11.2, 13.4, 15.6, 17.9, 20.1)  #: 5 to 45 mph in steps of 5 [m/s]
DEFAULT = PreviewTuning()
TRIM_SHARE: Final = 0.25  #: of the steering trim, as in follow_and_stop
TRIM_STATE: Final = 4  #: of the model's state: the integral of the offset
FREQUENCIES: Final[Floats] = np.geomspace(1e-3, 1e3, 6001)  #: at which a loop is computed [rad/s]

Complexes = NDArray[np.complex128]


class Margins(NamedTuple):
    """How far a loop is from instability, opened at its input."""

    gain_db: float  #: factor that may come on top [dB]
    phase_deg: float  #: at the crossover that bears least delay
    delay: float  #: dead time that may come on top [s]


class SpeedRow(NamedTuple):
    """The preview loop at one speed; what the car declares of its steering is counted in."""

    speed: float  #: [m/s]
    look_ahead: float  #: [m]
    proportional: float  #: [rad/m]
    gain_margin_db: float
    phase_margin_deg: float
    delay_margin: float  #: left for pose age, computing and CAN, beyond the steering's own dead time [s]


class DelayObserver(NamedTuple):
    """A communication disturbance observer around the law."""

    time_constant: float  #: of its filter [s]
    washout_time: float  #: infinite for none [s]


class Region(NamedTuple):
    """Where closed-loop poles shall lie (Ackermann, Robust Control, 2002: D-stability)."""

    decay: float = 0.15  #: real parts below minus this [1/s]; the slowest pole is the trim's
    damping: float = 0.45  #: at least, of each pair: a step overshoots by 20 % at most
    radius: float = 200.0  #: greatest modulus [rad/s]; the tyres' own poles at walking pace reach 150


def preview_model(
    vehicle: Vehicle,
    tuning: Schedule,
    speed: float,
    trim_share: float = TRIM_SHARE,
    yaw_rate_lag: float = 0.0,
    washout_time: float | None = None,
) -> tuple[Floats, Floats, Floats]:
    """A (6, 6), B (6, 1) and K (1, 6) of the single track under a steering request that the law answers with -K x.

    x = [lateral velocity of the mass centre, yaw rate, heading error, offset of the rear axle, its integral,
    road-wheel angle]. With a `yaw_rate_lag` [s] there is a seventh state, the smoothed yaw rate that the law is given.
    A `washout_time` [s] is that of an observer around the law: the trim is the slower for it.
    """
    cf, cr = vehicle.cornering_stiffness_front, vehicle.cornering_stiffness_rear
    lf, lr = vehicle.front_axle_to_mass, vehicle.wheelbase - vehicle.front_axle_to_mass
    m, inertia, lag, v = vehicle.mass, vehicle.yaw_inertia, vehicle.steering_lag, speed
    moment = cr * lr - cf * lf
    a = np.zeros((6, 6))
    a[0, [0, 1, 5]] = -(cf + cr) / (m * v), moment / (m * v) - v, cf / m
    a[1, [0, 1, 5]] = moment / (inertia * v), -(cf * lf * lf + cr * lr * lr) / (inertia * v), cf * lf / inertia
    a[2, 1] = 1.0
    a[3, [0, 1, 2]] = 1.0, -lr, v
    a[4, 3] = 1.0
    a[5, 5] = -1.0 / lag
    look_ahead, kp, kd = tuning.at(vehicle, v)
    trim = trim_share * 2.0 * vehicle.wheelbase / look_ahead**3 * v
    if washout_time is not None:
        trim = min(trim, slow_rate(vehicle, trim_share, washout_time, v) * v)
    k = [[0.0, kd * look_ahead, kp * look_ahead + kd * v, kp, trim, 0.0]]
    b = np.array([[0.0]] * 5 + [[1.0 / lag]])
    return _smoothed(a, b, np.array(k), yaw_rate_lag) if yaw_rate_lag > 0.0 else (a, b, np.array(k))


def _smoothed(a: Floats, b: Floats, k: Floats, lag: float) -> tuple[Floats, Floats, Floats]:
    """Return the model with the yaw rate smoothed by a first-order lag [s] before the law is given it."""
    a, b, k = np.pad(a, ((0, 1), (0, 1))), np.pad(b, ((0, 1), (0, 0))), np.pad(k, ((0, 0), (0, 1)))
    a[6, [1, 6]] = 1.0 / lag, -1.0 / lag
    k[0, [1, 6]] = 0.0, k[0, 1]
    return a, b, k


def observer_filter(observer: DelayObserver, s: Complexes) -> Complexes:
    """Return Q of a communication disturbance observer at complex frequencies [rad/s], washout included."""
    w = 1.0 / observer.washout_time
    washout = s * s / (s * s + 2.0 * DAMPING * w * s + w * w) if w > 0.0 else 1.0
    return np.asarray(washout / (observer.time_constant * s + 1.0))


def delayed_loop(
    vehicle: Vehicle,
    tuning: Schedule,
    speed: float,
    observer: DelayObserver | None,
    s: Complexes,
    true: Vehicle | None = None,
    trim_share: float = TRIM_SHARE,
    yaw_rate_lag: float = 0.0,
) -> Complexes:
    """Return the loop of the preview steering, opened where more delay would come in, at complex frequencies [rad/s].

    Without an observer that is L_true + L_trim, of law and trim. An observer's model is the declared `vehicle`, `true`
    is the car that drives: more delay then acts on L_true (1 - Q), inside a loop L Q that the delay does not touch. The
    trim is beside both, the observer's model knows nothing of it: L_true (1 - Q) / (1 + L Q) + L_trim. The steering's
    dead time is exact.
    """
    dead_time = np.exp(-vehicle.steering_delay * s)

    # The gains are those of the declared car, whatever car drives.
    washout_time = None if observer is None else observer.washout_time
    gains = preview_model(vehicle, tuning, speed, trim_share, yaw_rate_lag, washout_time)[2]
    learning = np.where(np.arange(gains.size) == TRIM_STATE, gains, 0.0)

    def answer(car: Vehicle, gains: Floats) -> Complexes:
        a, b, _ = preview_model(car, tuning, speed, trim_share, yaw_rate_lag)
        inputs = np.broadcast_to(b.astype(complex), (len(s), *b.shape))
        states = np.linalg.solve(s[:, None, None] * np.eye(len(a)) - a, inputs)
        return np.asarray((gains @ states)[:, 0, 0] * dead_time)

    car, law = true or vehicle, gains - learning
    if observer is None:
        return answer(car, gains)
    q = observer_filter(observer, s)
    return np.asarray(answer(car, law) * (1.0 - q) / (1.0 + answer(vehicle, law) * q) + answer(car, learning))


def is_stable(loop: Complexes, integrators: int) -> bool:
    """Tell whether a loop is stable once it is closed, by Nyquist's criterion from its frequency response.

    Opened it is stable but for so many `integrators`: then 1 + L turns by a quarter of a turn for each of them, and by
    half a turn less for each unstable pole. One integrator may act below the least frequency alone.
    """
    turned = np.unwrap(np.angle(1.0 + loop))
    return float(turned[-1] - turned[0]) > 0.5 * math.pi * (integrators - 1.5)


def swept_margins(frequencies: Floats, loop: Complexes) -> Margins:
    """Margins of an open loop from its frequency response [rad/s], straight between the logarithms of two of them."""
    gain, w = np.log(np.abs(loop)), np.log(frequencies)
    phase = np.unwrap(np.angle(loop))
    crossed = np.flatnonzero(gain[:-1] * gain[1:] < 0.0)
    share = gain[crossed] / (gain[crossed] - gain[crossed + 1])
    at = np.exp(w[crossed] + share * (w[crossed + 1] - w[crossed]))
    # Dead time turns the phase down: a margin counts from the next odd multiple of -180 deg below.
    angles = (phase[crossed] + share * (phase[crossed + 1] - phase[crossed]) + math.pi) % math.tau
    delay, angle = min(zip((angles / at).tolist(), angles.tolist(), strict=True), default=(math.inf, math.inf))
    turns = (phase + math.pi) / math.tau
    whole = np.floor(turns)
    flips = np.flatnonzero(whole[:-1] != whole[1:])
    share = (np.maximum(whole[flips], whole[flips + 1]) - turns[flips]) / (turns[flips + 1] - turns[flips])
    factors = -(gain[flips] + share * (gain[flips + 1] - gain[flips]))
    rising = float(factors[factors > 0.0].min(initial=math.inf))
    return Margins(20.0 * rising / math.log(10.0), math.degrees(angle), delay)


def margins(
    vehicle: Vehicle,
    tuning: Schedule = DEFAULT,
    speeds: Iterable[float] = SPEEDS,
    observer: DelayObserver | None = None,
    true: Vehicle | None = None,
    trim_share: float = TRIM_SHARE,
    yaw_rate_lag: float = 0.0,
) -> list[SpeedRow]:
    """Margins of the preview loop over speeds [m/s], with an observer where more delay would come in.

    `true` is the car that drives where it is another than the declared `vehicle`; `yaw_rate_lag` is that of the
    smoothing of the yaw rate that the law is given [s]. A loop that is unstable as it stands has no margin: all are 0.
    """
    rows = []
    for speed in speeds:
        s = FREQUENCIES.astype(np.complex128) * 1j
        loop = delayed_loop(vehicle, tuning, speed, observer, s, true, trim_share, yaw_rate_lag)
        # The car's course and place, and what the trim has learnt.
        stable = is_stable(loop, 3 if trim_share > 0.0 else 2)
        found = swept_margins(FREQUENCIES, loop) if stable else Margins(0.0, 0.0, 0.0)
        look_ahead, proportional, _ = tuning.at(vehicle, speed)
        rows.append(SpeedRow(speed, look_ahead, proportional, *found))
    return rows


def check(rows: Sequence[SpeedRow], latency: float) -> None:
    """Refuse a design that a latency [s] makes unstable: raises ConfigError naming the worst speed."""
    worst = min(rows, key=lambda row: row.delay_margin)
    if not worst.delay_margin > latency:
        raise ConfigError(
            f"design: at {worst.speed:.1f} m/s the steering loop bears {1e3 * worst.delay_margin:.0f} ms of latency, "
            f"{1e3 * latency:.0f} ms are stated: lengthen the look-ahead or shorten the latency"
        )


def table(rows: Sequence[SpeedRow]) -> str:
    """Lay the rows out for a person."""
    head = "speed_mps  look_ahead_m  kp_rad_per_m  gain_margin_db  phase_margin_deg  delay_margin_ms"
    lines = [
        f"{row.speed:9.1f}  {row.look_ahead:12.1f}  {row.proportional:12.4f}  {row.gain_margin_db:14.1f}"
        f"  {row.phase_margin_deg:16.1f}  {1e3 * row.delay_margin:15.0f}"
        for row in rows
    ]
    return "\n".join([head, *lines])


def d_unstable(
    vehicle: Vehicle,
    tuning: Schedule = DEFAULT,
    speeds: tuple[float, float] = (SPEEDS[0], SPEEDS[-1]),
    friction: tuple[float, float] = (0.8, 1.0),
    region: Region = Region(),  # noqa: B008 (immutable)
) -> list[tuple[float, float]]:
    """Vertices (V [m/s], friction) of the box whose closed-loop poles leave the region; none is good.

    Friction scales the tyres' stiffness, which is the virtual mass m / mu and inertia J / mu. The gains are
    those of the declared car at that speed; the steering's dead time is not in these poles.
    """
    failing = []
    for speed, mu in itertools.product(speeds, friction):
        slippery = replace(
            vehicle,
            cornering_stiffness_front=mu * vehicle.cornering_stiffness_front,
            cornering_stiffness_rear=mu * vehicle.cornering_stiffness_rear,
        )
        a, b, _ = preview_model(slippery, tuning, speed)
        k = preview_model(vehicle, tuning, speed)[2]
        if not all(_inside(complex(pole), region) for pole in np.linalg.eigvals(a - b @ k)):
            failing.append((speed, mu))
    return failing


def _inside(pole: complex, region: Region) -> bool:
    modulus = abs(pole)
    return pole.real < -region.decay and -pole.real >= region.damping * modulus and modulus < region.radius
