"""How late and how slowly the brakes answered in a stop: dead time and lag from commanded torque to lost speed.

Reads a run and fits; it must not know what was declared of the brakes, nor judge them.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vve_sumo.analysis.run import Run
from vve_sumo.metrics.stopping import Stop
from vve_sumo.physical_constants import AIR_DENSITY
from vve_sumo.values import DRIVE_LAG, Floats
from vve_sumo.vehicle.identification import MIN_SAMPLES, RESIDUAL_CORRELATION_TIME, FirstOrderResponse, Series, sigmas

#: what is assumed of drag, creep and throttle, whatever was calibrated; the fit finds mass, brake gain and grade itself
DRAG_PER_MASS: Final = 0.62 / 1690.0  #: drag area over mass of a mid-size car [m2/kg]
CREEP_SPEED: Final = 2.0  #: above it an idling engine pushes no more [m/s]
THROTTLE_DELAY: Final = 0.05  #: assumed dead time of the throttle [s]; its lag is found
DRAG: Final = 0.5 * AIR_DENSITY * DRAG_PER_MASS  #: deceleration by air over speed squared [1/m]

#: the stretch that is fitted: from so long before the onset to so long after it [s] ...
TIME_BEFORE_ONSET: Final = 0.5
TIME_AFTER_ONSET: Final = 3.0
#: ... and not below this speed, where an idling engine pushes [m/s]
MIN_SPEED: Final = 1.1 * CREEP_SPEED
#: commands from so long before that stretch still act in it, through the throttle's lag [s]
LEAD: Final = 1.5

#: mean delay (dead time plus lag) [s], square of the lag's share in it, throttle's lag [s]: limits of the search, and
#: steps of its slopes
LOWER_BOUNDS: Final = (1e-3, 1e-4, 0.03)
UPPER_BOUNDS: Final = (0.7, 1.0, 1.0)
STEPS: Final = (2e-3, 3e-2, 1e-2)
#: of each of these lags [s] the search begins at the best of these mean delays [s], and the best that it finds counts:
#: a long lag can hide in the throttle's
LAGS: Final = (0.015, 0.1, 0.25)
DELAYS: Final = tuple(np.arange(0.04, 0.62, 0.04).tolist())
MAX_STEPS: Final = 20
#: a model that leaves more than this of the speed, root mean square, describes no such brakes [m/s]: a road without
#: grip, a foot on the pedal
MISFIT: Final = 0.02
#: nor do brakes as strong as this over declared: 15 % of mass and 10 % of gain together are 0.78 to 1.29. Where the
#: tyres slide, or the DBW controller limits, more torque slows the car no more, and the fit finds a few tenths or less
STRENGTH: Final = (0.65, 1.6)


class TimeInterval(NamedTuple):
    """A time [s], and between what it lies: two standard deviations of the fit to either side; NaN where unknown."""

    value: float
    low: float
    high: float


class BrakeAnswer(NamedTuple):
    """From the torque commanded to the deceleration: a dead time, then a first-order lag."""

    reaction: TimeInterval  #: the dead time
    build_up: TimeInterval  #: the lag's time constant
    together: TimeInterval  #: their sum, which a record tells far better than how it is split


UNKNOWN: Final = BrakeAnswer(*[TimeInterval(math.nan, math.nan, math.nan)] * 3)


def brake_answer(run: Run, stop: Stop) -> BrakeAnswer:
    """Return how the brakes answered at the beginning of a stop; UNKNOWN where the record does not tell.

    Fitted to the speed: what a constant push (rolling, grade), the assumed air drag, the fading throttle and the
    commanded torque after dead time and lag leave of it. Strength of brakes and throttle, the push and the throttle's
    lag are found with them, so that a wrong mass, brake gain or grade is no delay. The lag enters as a squared share of
    the whole delay: a short one shows as its square, also at zero, and none is longer than the whole.
    """
    time, speed = run.motion.time, run.motion.speed
    rows = _stretch(run, stop)
    torque, throttle = _commands(run, time[rows])
    if len(rows) < MIN_SAMPLES or not np.isfinite(speed[rows]).all() or not np.any(torque.value > 0.0):
        return UNKNOWN
    declared = run.vehicle.mass * run.vehicle.wheel_radius
    torque = Series(torque.time, torque.value / declared)
    return _fitted(_Model(time[rows], speed[rows], torque, throttle), round(RESIDUAL_CORRELATION_TIME / run.period))


def _stretch(run: Run, stop: Stop) -> NDArray[np.intp]:
    time, speed = run.motion.time, run.motion.speed
    onset = time[stop.onset]
    slow = np.flatnonzero(~(speed[stop.onset : stop.rest] > MIN_SPEED))
    end = stop.onset + int(slow[0]) if len(slow) else stop.rest
    return np.flatnonzero((time[:end] >= onset - TIME_BEFORE_ONSET) & (time[:end] <= onset + TIME_AFTER_ONSET))


def _commands(run: Run, time: Floats) -> tuple[Series, Series]:
    """Return brake torque and throttle that act at these times; live by the steps of the gateway that sent them."""
    table = run.arrow("gateway" if run.live and run.holds("gateway") else "ticks")
    sent = table["time_s"].to_numpy()
    rows = np.flatnonzero((sent >= time[0] - LEAD) & (sent <= time[-1])) if len(time) else np.zeros(0, np.intp)
    torque, throttle = (table[name].to_numpy()[rows] for name in ("brake_torque_nm", "throttle_percent"))
    known = np.isfinite(torque) & np.isfinite(throttle)
    return Series(sent[rows][known], torque[known]), Series(sent[rows][known], throttle[known])


class _Model:
    """The speed of a stretch, and what any dead time and lags leave of it."""

    def __init__(self, time: Floats, speed: Floats, torque: Series, throttle: Series) -> None:
        """`torque` is commanded, as the deceleration [m/s2] that it is declared to give; `throttle` is in any unit."""
        self._time = time
        self._torque, self._throttle = torque, throttle
        self.pushed = bool(np.ptp(throttle.value) > 0.0)
        air = DRAG * 0.5 * (speed[1:] ** 2 + speed[:-1] ** 2) * np.diff(time)
        self._speed = speed - speed[0] + np.concatenate(([0.0], np.cumsum(air)))
        self._steady = [np.ones_like(time), time - time[0]]

    def residual(self, guess: Floats) -> Floats:
        """What the best strengths leave of the speed [m/s] at a guess, as LOWEST and HIGHEST have it."""
        return self._solved(guess)[0]

    def strength(self, guess: Floats) -> float:
        """Return the best strength of the brakes over the declared one at a guess."""
        return self._solved(guess)[1]

    def _solved(self, guess: Floats) -> tuple[Floats, float]:
        lag = guess[0] * math.sqrt(guess[1])
        columns = [*self._steady, -FirstOrderResponse(self._torque, guess[0] - lag, lag).integral(self._time)]
        if self.pushed:
            columns.append(FirstOrderResponse(self._throttle, THROTTLE_DELAY, guess[2]).integral(self._time))
        # Integrals from the stretch's beginning, or a large constant would cost their last digits.
        matrix = np.column_stack([columns[0], *(column - column[0] for column in columns[1:])])
        factors = np.linalg.lstsq(matrix, self._speed)[0]
        return matrix @ factors - self._speed, float(factors[len(self._steady)])

    def slopes(self, guess: Floats) -> Floats:
        """Its change with each parameter of the guess, over STEPS: the square root of a lag has no smaller one."""
        here, columns = self.residual(guess), []
        for row in range(len(guess)):
            beside = guess.copy()
            beside[row] += STEPS[row]
            columns.append((self.residual(beside) - here) / STEPS[row])
        return np.column_stack(columns)


def _fitted(model: _Model, memory: int) -> BrakeAnswer:
    found = min((_search(model, lag) for lag in LAGS), key=lambda one: one.misfit)
    low, high = STRENGTH
    if not (found.misfit <= MISFIT and low <= model.strength(found.guess) <= high):
        return UNKNOWN
    reach = 2.0 * sigmas(found.slopes, found.residual, memory)
    return _intervals(*found.guess[:2].tolist(), *reach[:2].tolist())


class _Found(NamedTuple):
    """Where a search ended."""

    guess: Floats
    residual: Floats
    slopes: Floats

    @property
    def misfit(self) -> float:
        """Root mean square of what is left of the speed [m/s]."""
        return math.sqrt(np.mean(self.residual**2))


def _search(model: _Model, lag: float) -> _Found:
    from scipy.optimize import least_squares

    many = 3 if model.pushed else 2
    guesses = [np.array((delay, (lag / delay) ** 2, DRIVE_LAG)[:many]) for delay in DELAYS if delay > lag]
    ended = least_squares(
        model.residual,
        min(guesses, key=lambda guess: float(np.sum(model.residual(guess) ** 2))),
        jac=model.slopes,
        bounds=(LOWER_BOUNDS[:many], UPPER_BOUNDS[:many]),
        x_scale=STEPS[:many],
        max_nfev=MAX_STEPS,
    )
    return _Found(ended.x, ended.fun, np.asarray(ended.jac))


def _intervals(mean: float, share: float, mean_reach: float, share_reach: float) -> BrakeAnswer:
    """Return the parts, the intervals of dead time and lag as wide as both reaches together can make them."""
    low, lag, high = (mean * math.sqrt(max(value, 0.0)) for value in (share - share_reach, share, share + share_reach))
    reaction = TimeInterval(mean - lag, max(mean - mean_reach - high, 0.0), mean + mean_reach - low)
    return BrakeAnswer(reaction, TimeInterval(lag, low, high), TimeInterval(mean, mean - mean_reach, mean + mean_reach))
