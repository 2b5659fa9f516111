"""A probe, not a driver: keeps the speed until something in the way is near, then brakes open loop and never lets go.

What comes between the world and the brake shows undamped in where the car comes to rest: a delay of T costs v T. It
regulates nothing while it brakes; whoever shall stop at a place wants follow_and_stop.
"""

from __future__ import annotations

from typing import Final

from vve_sumo.controller import Tuning, settle
from vve_sumo.laws import clamp, jerk_limit, stopping_distance
from vve_sumo.values import ControlCommand, Observation, Vehicle

from .deviation import DeviationObserver
from .preview import PreviewSteering, PreviewTuning
from .speed import SPEEDING_UP, SpeedKeeper, SpeedProfile
from .tracks import Target, Tracker
from .trim import SteeringTrim

PERIOD: Final = 0.02  #: of the tick [s]
JERK: Final = 4.0  #: with which the brake sets in, less than the gateway's comfort would cut [m/s3]

TUNING: dict[str, float | str | bool] = {
    "trigger_m": 45.0,  #: bumper to target when it begins to brake
    "deceleration_m_s2": 3.0,  #: that it asks for then, whatever comes of it
}

#: what a tuning key may be; what lies outside is a slip of the unit, or more than comfort braking
RANGES: dict[str, tuple[float, float]] = {"trigger_m": (1.0, 140.0), "deceleration_m_s2": (0.5, 3.5)}


class BrakeAt:
    """Follows the path at the desired speed; brakes once."""

    def __init__(self, vehicle: Vehicle, tuning: dict[str, float]) -> None:
        self.preview_tuning = preview = PreviewTuning()  # for the gain design
        self._trigger, self._deceleration = tuning["trigger_m"], tuning["deceleration_m_s2"]
        self._steering_limit = vehicle.steering_limit
        self._answer = vehicle.brake_delay + vehicle.brake_lag + PERIOD
        self._observer, self._law = DeviationObserver(vehicle), PreviewSteering(vehicle, preview)
        self._trim = SteeringTrim(vehicle, 0.25, preview.look_ahead_time, preview.look_ahead_least)
        self._keeper, self._tracker = SpeedKeeper(vehicle, PERIOD), Tracker(vehicle)
        self._profile: SpeedProfile | None = None
        self._s: float | None = None
        self._acceleration = 0.0
        self._since: float | None = None  # when it began to brake [s]

    def step(self, observation: Observation) -> ControlCommand:
        """Answer one observation; called once every PERIOD."""
        pose, path = observation.pose, observation.path
        projection = path.project(pose.x, pose.y, self._s)
        self._s = projection.s
        deviation = self._observer.step(pose, path, projection, PERIOD)
        trim = self._trim.step(deviation.d, deviation.speed, PERIOD, False)
        steering = clamp(self._law.steer(deviation, observation) + trim, -self._steering_limit, self._steering_limit)
        target = self._tracker.step(observation, projection)
        if self._since is None:
            self._since = self._onset(observation, target, path.length - projection.s)
        if self._since is None:
            return ControlCommand(steering, self._cruise(observation, projection.s), note="cruise")
        braking = min(JERK * (observation.time - self._since), self._deceleration)
        return ControlCommand(steering, -braking, note="brake")

    def _onset(self, observation: Observation, target: Target | None, to_end: float) -> float | None:
        """When the trigger was passed, inside the last tick [s]; None before that.

        Ticks are 20 ms apart, which at 14 m/s is 0.28 m: counted from the passing itself, the brake does not depend
        on how the ticks fall.
        """
        speed = observation.pose.speed
        if not to_end > stopping_distance(speed, self._deceleration, self._answer, self._deceleration / JERK):
            return observation.time
        if target is None or target.gap > self._trigger:
            return None
        passed, closing = self._trigger - target.gap, speed - target.speed
        return observation.time - (min(PERIOD, passed / closing) if closing > 0.0 else 0.0)

    def _cruise(self, observation: Observation, s: float) -> float:
        if self._profile is None:
            self._profile = SpeedProfile(observation.path)
        pose = observation.pose
        wanted = self._keeper.step(self._profile, s, pose.speed, pose.acceleration, observation.desired_speed, True)
        self._acceleration = jerk_limit(wanted, self._acceleration, -JERK, SPEEDING_UP, JERK, JERK, PERIOD)
        return self._acceleration


def make(vehicle: Vehicle, tuning: Tuning) -> BrakeAt:
    """Make the controller; raises ConfigError on a tuning key or value that it cannot take."""
    numbers = {key: float(value) for key, value in settle(tuning, TUNING, RANGES).items()}
    return BrakeAt(vehicle, numbers)
