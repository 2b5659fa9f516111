"""Two observers around any steering law: one against delay in its loop, one against what pushes the car off its path.

`CommunicationDisturbanceObserver` takes a delay for a disturbance of the measured deviation and takes the disturbance
out, without knowing how long the delay is (Natori, Ohnishi, IEEE Trans. Industrial Electronics 55, 1154, 2008). With
the loop C G of law and car its answer to a step of the path is

    Y/R = C G e^-Ts / (1 + C G Q + C G (1 - Q) e^-Ts),   Q = W / (tau s + 1),   W = s^2 / (s^2 + 2 D w s + w^2).

W = 1 is the form of the literature. A car integrates its steering twice, so that with W = 1 a lasting disturbance
would drive it ever farther off: the law would see the model's deviation and never the car's. The washout W gives the
law the measured deviation back, over about 1 / w, and with it the delay that the loop tolerates becomes finite, about
0.7 / w.

`DisturbanceObserver` compares the yaw rate with the one that the steering explains, and steers the difference away
(Ohnishi, Shibata, Murakami, IEEE/ASME Trans. Mechatronics 1, 56, 1996).

Neither knows which law it is wrapped around.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Final

from vve_sumo.laws import clamp
from vve_sumo.values import Observation, Vehicle

from .deviation import Deviation, steady_steering
from .single_track import DAMPING, LateralModel, RequestDelay, yaw_response_time

if TYPE_CHECKING:
    from .follow_and_stop import SteeringLaw

PERIOD: Final = 0.02  #: of the tick [s]
MIN_SPEED: Final = 1.0  #: below it the law has the measured deviation, and nothing is observed [m/s]
MIN_SPEED_OF_YAW: Final = 3.0  #: below it the yaw rate says little of the steering angle [m/s]
MAX_DISTURBANCE: Final = 0.03  #: road-wheel angle that is steered away at most [rad]: 25 deg at the wheel

YAW_RATE_LAG: Final = 0.08  #: of the smoothing of a pose's yaw rate [s], as the predictor of poses has it

#: tuning keys of both, with their defaults; 0 of a time constant leaves that observer out
TUNING: Final[dict[str, float]] = {
    "cdob_time_constant_s": 0.0,  #: tau of the communication disturbance observer
    "cdob_washout_s": 3.0,  #: 1 / w of its washout: the delay that is tolerated is about 0.7 of it
    "dob_time_constant_s": 0.0,  #: of the disturbance observer
}
RANGES: Final[dict[str, tuple[float, float]]] = {
    "cdob_time_constant_s": (0.0, 2.0),
    "cdob_washout_s": (0.5, 60.0),
    "dob_time_constant_s": (0.0, 10.0),
}


class Washout:
    """s^2 / (s^2 + 2 D w s + w^2): passes what changes, forgets what lasts."""

    def __init__(self, frequency: float, period: float) -> None:
        """`frequency` is w [rad/s], 0 passes everything; `period` of the tick [s]."""
        self._damping, self._stiffness = 2.0 * DAMPING * frequency * period, frequency * frequency * period
        self._period = period
        self._lasting = self._rate = 0.0

    def step(self, value: float) -> float:
        """Return what is left of a value; the first one passes whole."""
        left = value - self._lasting
        self._lasting += self._rate * self._period + self._damping * left
        self._rate += self._stiffness * left
        return left


class CommunicationDisturbanceObserver:
    """A steering law that bears delay: the law is given the deviation that the car has without the delay."""

    def __init__(
        self,
        law: SteeringLaw,
        vehicle: Vehicle,
        time_constant: float = 0.1,
        washout_time: float = 3.0,
        period: float = PERIOD,
    ) -> None:
        """Wrap a `law`; `time_constant` is tau [s], `washout_time` 1 / w [s], infinite for no washout."""
        self.law = law
        self.time_constant, self.washout_time = time_constant, washout_time
        self._vehicle, self._period, self._frequency = vehicle, period, 1.0 / washout_time
        self._share = -math.expm1(-period / time_constant)
        self._model = LateralModel(vehicle, period, self._frequency, YAW_RATE_LAG)
        self._washouts: tuple[Washout, ...] = ()
        self._correction = (0.0, 0.0, 0.0)

    def steer(self, deviation: Deviation, observation: Observation) -> float:
        """Return the road-wheel angle [rad]."""
        if not deviation.speed > MIN_SPEED:
            self._washouts = ()
            return self.law.steer(deviation, observation)
        if not self._washouts:
            self._start(deviation)
        d, heading, yaw_rate = self._observed(deviation)
        corrected = deviation._replace(
            d=deviation.d + d,
            heading_error=deviation.heading_error + heading,
            yaw_rate_error=deviation.yaw_rate_error + yaw_rate,
        )
        angle = self.law.steer(corrected, _moved(observation, deviation.s, d, heading, yaw_rate))
        limit = self._vehicle.steering_limit
        bend = steady_steering(self._vehicle, deviation.speed, deviation.curvature)
        self._model.step(clamp(angle, -limit, limit) - bend, deviation.speed)
        return angle

    def _start(self, deviation: Deviation) -> None:
        self._washouts = tuple(Washout(self._frequency, self._period) for _ in range(3))
        self._correction = (0.0, 0.0, 0.0)
        self._model.start(deviation.d, deviation.heading_error, deviation.yaw_rate_error, deviation.speed)

    def _observed(self, deviation: Deviation) -> tuple[float, float, float]:
        """Return what the delay hides, filtered: of d [m], heading error [rad] and yaw-rate error [rad/s]."""
        model, (d, heading, yaw_rate) = self._model, self._washouts
        hidden = (
            model.d - d.step(deviation.d),
            model.heading_error - heading.step(deviation.heading_error),
            # The yaw rate's model has no integrator, so that its washout may act on the difference.
            yaw_rate.step(model.yaw_rate_error - deviation.yaw_rate_error),
        )
        share, (old_d, old_heading, old_yaw_rate) = self._share, self._correction
        self._correction = (
            old_d + share * (hidden[0] - old_d),
            old_heading + share * (hidden[1] - old_heading),
            old_yaw_rate + share * (hidden[2] - old_yaw_rate),
        )
        return self._correction


def _moved(observation: Observation, s: float, d: float, heading: float, yaw_rate: float) -> Observation:
    """Return the observation of a car that is so much farther left [m], turned [rad] and turning [rad/s].

    Some laws, such as pure pursuit, look at the pose itself.
    """
    pose, along = observation.pose, observation.path.at(s).heading
    moved = replace(
        pose,
        x=pose.x - d * math.sin(along),
        y=pose.y + d * math.cos(along),
        heading=pose.heading + heading,
        yaw_rate=pose.yaw_rate + yaw_rate,
    )
    return replace(observation, pose=moved)


class DisturbanceObserver:
    """A steering law whose car yaws as its nominal model does: whatever else turns it is steered away.

    The model from road-wheel angle to yaw rate is that of a steady circle, V / (L + K V^2), behind the steering's dead
    time and a first-order lag. Without further delay the loop of the observer alone is stable for a dead time up to
    pi/2 of the time constant.
    """

    def __init__(self, law: SteeringLaw, vehicle: Vehicle, time_constant: float = 0.5, period: float = PERIOD) -> None:
        """Wrap a `law`; `time_constant` [s] is how soon a disturbance is steered away."""
        self.law, self.time_constant = law, time_constant
        self._vehicle, self._share = vehicle, -math.expm1(-period / time_constant)
        # A command waits one tick on its way; the one that is put in here is a tick old.
        self._delay = RequestDelay(vehicle.steering_delay, period)
        self._asked = self._turning = self._angle = 0.0  # filtered request [rad], filtered yaw rate [rad/s], request
        self._observing = False
        self.disturbance = 0.0  #: road-wheel angle that would turn the car as the disturbance does [rad]

    def steer(self, deviation: Deviation, observation: Observation) -> float:
        """Return the road-wheel angle [rad]."""
        wanted, speed = self.law.steer(deviation, observation), deviation.speed
        if not speed > MIN_SPEED_OF_YAW:
            self._observing = False
            return wanted
        self._observe(observation.pose.yaw_rate, wanted, speed)
        limit = self._vehicle.steering_limit
        self._angle = clamp(wanted - self.disturbance, -limit, limit)
        return self._angle

    def _observe(self, yaw_rate: float, wanted: float, speed: float) -> None:
        angle_per_yaw_rate = steady_steering(self._vehicle, speed, 1.0) / speed
        if not self._observing:
            self._observing, self._angle, self._turning = True, wanted, yaw_rate
            self._asked = yaw_rate * angle_per_yaw_rate + self.disturbance
            self._delay.clear(wanted)
        lag = self._vehicle.steering_lag + YAW_RATE_LAG + yaw_response_time(self._vehicle, speed)
        self._turning += self._share * (yaw_rate - self._turning)
        self._asked += self._share * (self._delay.step(self._angle) - self._asked)
        # (lag s + 1) / (time_constant s + 1) of the yaw rate: the model's inverse behind the filter.
        lead = lag / self.time_constant
        explained = angle_per_yaw_rate * (lead * yaw_rate + (1.0 - lead) * self._turning)
        self.disturbance = clamp(explained - self._asked, -MAX_DISTURBANCE, MAX_DISTURBANCE)


def with_observers(law: SteeringLaw, vehicle: Vehicle, tuning: Mapping[str, float]) -> SteeringLaw:
    """Return a law inside the observers that the keys of `TUNING` ask for; the law itself where they ask for none."""
    settled = {key: tuning.get(key, default) for key, default in TUNING.items()}
    if settled["cdob_time_constant_s"] > 0.0:
        law = CommunicationDisturbanceObserver(law, vehicle, settled["cdob_time_constant_s"], settled["cdob_washout_s"])
    if settled["dob_time_constant_s"] > 0.0:
        law = DisturbanceObserver(law, vehicle, settled["dob_time_constant_s"])
    return law


def layers(law: SteeringLaw) -> Iterator[SteeringLaw]:
    """Yield a law and all that it is wrapped around, from outside in: each wrapper has the next one as `law`."""
    here: SteeringLaw | None = law
    while here is not None:
        yield here
        here = getattr(here, "law", None)


def innermost(law: SteeringLaw) -> SteeringLaw:
    """Return the law that all wrappers are around."""
    *_wrappers, core = layers(law)
    return core


def delay_observer(law: SteeringLaw) -> tuple[float, float] | None:
    """Return time constant and washout time [s] of a law's communication disturbance observer; None for none."""
    observers = (layer for layer in layers(law) if isinstance(layer, CommunicationDisturbanceObserver))
    return next(((one.time_constant, one.washout_time) for one in observers), None)
