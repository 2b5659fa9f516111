"""The shipped controller: follows the path, keeps the speed, stops for what its sensor sees, brakes hard if it must.

It composes the other files of this folder; the tuning keys are below, with their defaults.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Final, NamedTuple, Protocol

from vve_sumo.controller import Tuning, settle
from vve_sumo.errors import ConfigError
from vve_sumo.laws import clamp, jerk_limit
from vve_sumo.path import PathProjection, ReferencePath
from vve_sumo.values import CommandedPath, ControlCommand, Observation, Vehicle

from .approach import NOWHERE, Approach, Goal, Standstill
from .delay_observers import delay_observer
from .deviation import Deviation, DeviationObserver
from .emergency import Emergency
from .give_way import GiveWay
from .green_advice import advised_acceleration
from .lqr import LateralRegulator
from .others_on_ways import LidarMount
from .preview import PreviewSteering, PreviewTuning
from .pure_pursuit import PurePursuit
from .radar_stop import RadarStop
from .sightings import Sense
from .signal_stop import SignalStop
from .speed import SPEEDING_UP, Profile, SpeedKeeper, SpeedProfile
from .stanley import Stanley
from .tracks import Target, Tracker
from .trim import SteeringTrim

PERIOD: Final = 0.02  #: of the tick [s]
COMFORT_LIMIT: Final = -3.3  #: of comfort, inside the gateway's comfort envelope [m/s2]
STOPPED: Final = 1.0  #: an emergency braking that lasts down to this speed has stopped the car [m/s]
JERK_DOWN, JERK_UP = 4.0, 2.5  #: of comfort [m/s3]

TUNING: dict[str, float | str | bool] = {
    "steering": "preview",  #: law: preview, pure_pursuit, stanley or lqr
    "look_ahead_time_s": 0.8,  #: preview and pure pursuit: look-ahead over speed; lqr: settling time
    "look_ahead_least_m": 4.0,  #: preview and pure pursuit: shortest look-ahead; lqr: shortest settling way
    "stanley_rate_per_s": 1.0,  #: stanley: how fast a deviation dies out
    "trim_share": 0.25,  #: steering-zero learning, as a share of the law's stiffness; 0 turns it off
    "gap_m": 5.0,  #: bumper to target at rest
    "time_headway_s": 1.5,  #: behind a moving target, on top of the gap
    "stop_deceleration_m_s2": 2.0,  #: of a comfortable stop
    "lateral_acceleration_m_s2": 2.0,  #: that bends are driven with at most
    "emergency": True,  #: whether the emergency layer is there
    "signals": True,  #: whether it obeys the signals that a sensor of kind `signals` knows of
    "right_of_way": True,  #: whether it gives way as a sensor of kind `right_of_way` knows; others are seen by a lidar
    "gap_margin_s": 1.0,  #: between the car and one who goes first, at the least
    "others_over_limit": 1.0,  #: speed of those who may be hidden, over the limit
    "lidar_forward_m": 1.4,  #: of that lidar from the rear axle
    "lidar_height_m": 1.9,  #: of that lidar over the road
    "lidar_range_m": 90.0,  #: as far as that lidar sees a car
    "comfort": True,  #: whether it slows and stops comfortably for what is in the way, before that becomes urgent
}


#: where the lidar is that others at a junction are seen by
LIDAR: Final = ("lidar_forward_m", "lidar_height_m", "lidar_range_m")
#: what a tuning key may be; what lies outside is a slip of the unit
RANGES: dict[str, tuple[float, float]] = {
    "look_ahead_time_s": (0.1, 5.0),
    "look_ahead_least_m": (1.0, 30.0),
    "stanley_rate_per_s": (0.05, 5.0),
    "trim_share": (0.0, 1.0),
    "gap_m": (0.5, 50.0),
    "time_headway_s": (0.0, 5.0),
    "stop_deceleration_m_s2": (0.5, 3.3),
    "lateral_acceleration_m_s2": (0.3, 4.0),
    "gap_margin_s": (0.0, 5.0),
    "others_over_limit": (0.5, 2.0),
    "lidar_forward_m": (-5.0, 15.0),
    "lidar_height_m": (0.2, 5.0),
    "lidar_range_m": (10.0, 300.0),
}


class SteeringLaw(Protocol):
    """What all steering laws have in common."""

    def steer(self, deviation: Deviation, observation: Observation) -> float:
        """Return the road-wheel angle [rad]."""
        ...


class CarFollowing(Protocol):
    """What all car-following laws have in common."""

    def acceleration(self, speed: float, desired: float, gap: float, lead_speed: float) -> float:
        """Return the acceleration [m/s2]; infinite where the law sets no limit.

        `speed` and the `desired` speed of the own car [m/s]; `gap` from the front bumper to the target [m], infinite
        for none; `lead_speed` of the target along the path [m/s].
        """
        ...


class Warner(Protocol):
    """Whatever knows of who will be in the way, besides the radar."""

    def step(self, observation: Observation, projection: PathProjection) -> Target | None:
        """Return the nearest target; called at every tick."""
        ...


class Way(NamedTuple):
    """The way that the car takes, at one tick: the scenario's path, or one around what is in it."""

    path: ReferencePath
    projection: PathProjection  #: of the car onto it
    profile: Profile  #: the speeds along it
    commanded: CommandedPath | None  #: the same way, as a command carries it; None for the scenario's path
    target: Target | None  #: the nearest thing in this way
    dangers: list[Target]  #: all that the car would meet on it, or may


class Avoidance(Protocol):
    """Whatever leads the car around what is in its way."""

    def step(self, observation: Observation, projection: PathProjection, tracker: Tracker) -> Way | None:
        """Return the way to take, None for the scenario's path; called at every tick, once the tracker has stepped."""
        ...

    def in_path(self, observation: Observation, projection: PathProjection) -> Target | None:
        """Return the nearest thing in the scenario's path as the avoidance sees it; called where that path is taken."""
        ...


class FollowAndStop:
    """One step: projection onto the path, deviation, steering; target, goals, acceleration."""

    def __init__(
        self,
        vehicle: Vehicle,
        law: SteeringLaw,
        tuning: dict[str, float],
        following: CarFollowing | None = None,
        warned: Warner | None = None,
        sense: Sense | None = None,
        avoidance: Avoidance | None = None,
        pass_at_green: bool = False,
    ) -> None:
        """`following` decides what is done behind a target; without it, the target is approached as a goal.

        `warned` adds a target that no scan shows yet. Without a `sense` it sees by the radar. Without an `avoidance` it
        keeps to the path. With `pass_at_green` it slows early to pass signals while they are green.
        """
        self._following, self._warned, self._avoidance = following, warned, avoidance
        self._law, self._steering_limit = law, vehicle.steering_limit
        #: for the gain design; None where it steers by another law
        self.preview_tuning = law.tuning if isinstance(law, PreviewSteering) else None
        self._lateral = tuning["lateral_acceleration_m_s2"]
        self._observer = DeviationObserver(vehicle)
        time, least, around = tuning["look_ahead_time_s"], tuning["look_ahead_least_m"], delay_observer(law)
        washout_time = None if around is None else around[1]
        self._trim = SteeringTrim(vehicle, tuning["trim_share"], time, least, washout_time)
        self._keeper = SpeedKeeper(vehicle, PERIOD)
        self._tracker = Tracker(vehicle, sense)
        self._stop = RadarStop(tuning["gap_m"], tuning["time_headway_s"])
        self._approach = Approach(vehicle, tuning["stop_deceleration_m_s2"], PERIOD)
        self._standstill = Standstill(PERIOD)
        self._signals = SignalStop(vehicle, PERIOD) if tuning.get("signals", 1.0) else None
        self._signal, self._pass_at_green = NOWHERE, pass_at_green
        self._give_way = _giving_way(vehicle, tuning)
        self._yield = NOWHERE
        self._emergency = Emergency(vehicle, PERIOD) if tuning["emergency"] else None
        self._comfort = bool(tuning["comfort"])
        self._stopped = False
        self._profile: SpeedProfile | None = None
        self._s: float | None = None
        self._saturated = False
        self._acceleration = 0.0
        self._cruising = True

    def step(self, observation: Observation) -> ControlCommand:
        """Answer one observation; called once every PERIOD."""
        pose = observation.pose
        projection = observation.path.project(pose.x, pose.y, self._s)
        self._s = projection.s
        to_end = observation.path.length - projection.s
        target = self._tracker.step(observation, projection)
        warned = self._warned.step(observation, projection) if self._warned is not None else None
        if self._signals is not None:
            self._signal = self._signals.goal(observation, projection.s)
        if self._give_way is not None:
            line = None if self._signals is None else self._signals.line
            self._yield = self._give_way.goal(observation, projection.s, line, self._profiled(observation.path))
        way = None if self._avoidance is None else self._avoidance.step(observation, projection, self._tracker)
        dangers = self._tracker.dangers(observation.time, projection.s)
        if way is None:
            seen = None if self._avoidance is None else self._avoidance.in_path(observation, projection)
            if seen is not None and (target is None or seen.gap < target.gap):
                target = seen
            way = Way(observation.path, projection, self._profiled(observation.path), None, target, dangers)
        else:
            observation = replace(observation, path=way.path)
            # That somebody crosses, the radar tells before the outlines do.
            way = way._replace(dangers=[*way.dangers, *(one for one in dangers if one.foreseen)])
        deviation = self._observer.step(pose, way.path, way.projection, PERIOD)
        if self._emergency is not None and self._emergency.step(way.dangers, pose.speed):
            self._acceleration, self._stopped = COMFORT_LIMIT, pose.speed < STOPPED
            steering, demand = self._steer(deviation, observation), self._emergency.demand
            return ControlCommand(steering, demand, emergency=True, note="emergency", path=way.commanded)
        if self._comfort:
            acceleration, note = self._accelerate(observation, way, to_end, warned)
        elif self._stopped:
            # Nobody else stops for what is ahead: going on would be into it.
            acceleration, note = Standstill.HOLD, "hold"
        else:
            acceleration, note = self._accelerate(observation, way._replace(target=None), to_end, None)
        return ControlCommand(self._steer(deviation, observation), acceleration, note=note, path=way.commanded)

    def _steer(self, deviation: Deviation, observation: Observation) -> float:
        trim = self._trim.step(deviation.d, deviation.speed, PERIOD, self._saturated)
        wanted = self._law.steer(deviation, observation) + trim
        granted = clamp(wanted, -self._steering_limit, self._steering_limit)
        self._saturated = granted != wanted
        return granted

    def _accelerate(
        self, observation: Observation, way: Way, to_end: float, warned: Target | None
    ) -> tuple[float, str]:
        speed, measured, target = observation.pose.speed, observation.pose.acceleration, way.target
        s, desired = way.projection.s, observation.desired_speed
        cruise = self._keeper.step(way.profile, s, speed, measured, desired, self._cruising)
        candidates = {"cruise": cruise}
        goals = {"path_end": Goal(to_end), "target": self._stop.goal(target)}
        if warned is not None:
            goals["warned"] = self._stop.goal(warned)
        if self._signals is not None:
            goals["signal"] = self._signal
            if self._pass_at_green:
                candidates["green"] = advised_acceleration(
                    self._signals.line, self._signals.distance, speed, observation.desired_speed, observation.time
                )
        goals["give_way"] = self._yield
        for note, goal in goals.items():
            if goal is not NOWHERE:
                candidates[note] = self._approach.acceleration(goal, speed, measured)
        if self._following is not None:
            gap, lead_speed = (math.inf, 0.0) if target is None else (target.gap, max(target.speed, 0.0))
            candidates["target"] = self._following.acceleration(speed, desired, gap, lead_speed)
        note = min(candidates, key=candidates.__getitem__)
        self._cruising = note == "cruise"
        nearest = min(goals.values())
        last_bit = self._approach.is_last_bit(nearest, speed, measured)
        decided = self._give_way is not None and self._give_way.sets_out
        held = self._standstill.step(nearest.distance, speed, last_bit, at_once=decided)
        if held is not None:
            note = "hold"
        wanted = candidates[note] if held is None else held
        self._acceleration = jerk_limit(
            wanted, self._acceleration, COMFORT_LIMIT, SPEEDING_UP, JERK_DOWN, JERK_UP, PERIOD
        )
        return self._acceleration, note

    def _profiled(self, path: ReferencePath) -> SpeedProfile:
        if self._profile is None:
            self._profile = SpeedProfile(path, self._lateral)
        return self._profile


def _giving_way(vehicle: Vehicle, tuning: dict[str, float]) -> GiveWay | None:
    """Return what gives way at junctions; None where the tuning turns it off."""
    if not tuning.get("right_of_way", 1.0):
        return None
    defaults = {key: float(TUNING[key]) for key in ("gap_margin_s", "others_over_limit", *LIDAR)}
    numbers = defaults | {key: tuning[key] for key in defaults if key in tuning}
    lidar = LidarMount(*(numbers[key] for key in LIDAR))
    return GiveWay(vehicle, PERIOD, numbers["gap_margin_s"], numbers["others_over_limit"], lidar)


def steering_law(name: str, vehicle: Vehicle, tuning: dict[str, float]) -> SteeringLaw:
    """Make a steering law by its name; raises ConfigError where there is none of that name."""
    time, least = tuning["look_ahead_time_s"], tuning["look_ahead_least_m"]
    if name == "preview":
        return PreviewSteering(vehicle, PreviewTuning(time, least))
    if name == "pure_pursuit":
        return PurePursuit(vehicle, time, least)
    if name == "stanley":
        return Stanley(vehicle, tuning["stanley_rate_per_s"])
    if name == "lqr":
        return LateralRegulator(vehicle, PERIOD, time, least)
    raise ConfigError(f"tuning key 'steering' must be preview, pure_pursuit, stanley or lqr, got {name!r}")


def make(vehicle: Vehicle, tuning: Tuning) -> FollowAndStop:
    """Make the controller; raises ConfigError on a tuning key or value that it cannot take."""
    settled = settle(tuning, TUNING, RANGES)
    name = str(settled.pop("steering"))
    numbers = {key: float(value) for key, value in settled.items()}
    return FollowAndStop(vehicle, steering_law(name, vehicle, numbers), numbers)
