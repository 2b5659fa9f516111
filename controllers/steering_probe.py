"""A probe, not a driver: comes up to its speed on a straight road, then keeps beside the path by a step.

The answer to the step shows whether the steering loop is stable: the probe stops once it has died out, and for nothing
else. Laws and observers are those of delay_tolerant.
"""

from __future__ import annotations

import math
from typing import Final

from vve_sumo.controller import Tuning, settle
from vve_sumo.values import ControlCommand, Observation, Vehicle

from . import delay_tolerant
from .delay_tolerant import DelayTolerant
from .deviation import Deviation
from .follow_and_stop import SteeringLaw, steering_law

TUNING: dict[str, float | str | bool] = delay_tolerant.TUNING | {
    "cdob_time_constant_s": 0.0,
    "trim_share": 0.0,  #: of its own the trim would take the step for a deviation
    "emergency": False,
    "comfort": False,
    "step_m": 0.3,  #: left of the path; small, so that nothing limits the steering
    "settled_s": 4.0,  #: at its speed before the step
}
RANGES: dict[str, tuple[float, float]] = delay_tolerant.RANGES | {"step_m": (-2.0, 2.0), "settled_s": (0.0, 60.0)}
SPEED_SHARE: Final = 0.02  #: of the desired speed: so near to it counts as having it
DECELERATION: Final = -2.0  #: once the verdict is known [m/s2]


class Beside:
    """A steering law that keeps beside the path."""

    def __init__(self, law: SteeringLaw) -> None:
        self.law = law
        self.step = 0.0  #: to keep left of the path [m]

    def steer(self, deviation: Deviation, observation: Observation) -> float:
        """Return the road-wheel angle [rad]."""
        return self.law.steer(deviation._replace(d=deviation.d - self.step), observation)


class Verdict:
    """Tells from the answer to a step whether it dies out: what is left late against what was left early."""

    FIRST, SECOND, LAST = 15.0, 30.0, 60.0  #: ends of the windows after the step [s]; the last one is as long as others
    DIED_OUT = 0.15  #: of the answer's first part: what is left below it comes of the steering's quanta

    def __init__(self) -> None:
        self._first = self._early = self._late = 0.0  # greatest distance from the aim, by window [m]

    def step(self, elapsed: float, error: float) -> bool:
        """Take the distance from the aim [m] at a time after the step [s]; tell whether the answer has died out."""
        size = abs(error)
        if elapsed < self.FIRST:
            self._first = max(self._first, size)
        elif elapsed < self.SECOND:
            self._early = max(self._early, size)
        elif self._early < self.DIED_OUT * self._first:
            return True
        elif self.LAST + self.FIRST - self.SECOND <= elapsed < self.LAST:
            self._late = max(self._late, size)
        return elapsed >= self.LAST and self._late < max(self._early, self.DIED_OUT * self._first)


class SteeringProbe:
    """Drives as delay_tolerant does, steps beside the path, and stops once the answer has died out.

    While it does not, the probe drives on: until the car is too far off its path, or the time is over.
    """

    def __init__(self, controller: DelayTolerant, beside: Beside, step: float, settled: float) -> None:
        """`step` to keep left of the path [m], once the speed has been kept for `settled` [s]."""
        self._controller, self._beside = controller, beside
        self._step, self._settled = step, settled
        self._since: float | None = None  # drive time from which the speed has been kept [s]
        self._stepped = math.inf  # drive time of the step [s]
        self._s: float | None = None
        self._verdict, self._stable = Verdict(), False
        self.preview_tuning, self.trim_share = controller.preview_tuning, controller.trim_share
        self.delay_observer = controller.delay_observer

    def step(self, observation: Observation) -> ControlCommand:
        """Answer one observation; called once a tick."""
        now, pose = observation.time, observation.pose
        here = observation.path.project(pose.x, pose.y, self._s)
        self._s = here.s
        if now < self._stepped:
            self._wait(now, pose.speed, observation.desired_speed)
        self._stable = self._stable or self._verdict.step(now - self._stepped, here.d - self._step)
        command = self._controller.step(observation)
        if self._stable:
            return ControlCommand(command.steering, DECELERATION, note="stable")
        if now < self._stepped:
            return command
        return ControlCommand(command.steering, command.acceleration, note="step")

    def _wait(self, now: float, speed: float, desired: float) -> None:
        """Step once the speed has been kept for long enough."""
        if not abs(speed - desired) <= SPEED_SHARE * desired:
            self._since = None
        elif self._since is None:
            self._since = now
        elif now - self._since >= self._settled:
            self._stepped, self._beside.step = now, self._step


def make(vehicle: Vehicle, tuning: Tuning) -> SteeringProbe:
    """Make the controller; raises ConfigError on a tuning key or value that it cannot take."""
    settled = settle(tuning, TUNING, RANGES)
    name = str(settled.pop("steering"))
    numbers = {key: float(value) for key, value in settled.items()}
    beside = Beside(steering_law(name, vehicle, numbers))
    controller = DelayTolerant(vehicle, beside, numbers)
    return SteeringProbe(controller, beside, numbers["step_m"], numbers["settled_s"])
