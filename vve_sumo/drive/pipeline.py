"""Computes a tick: from pose bytes to the setpoint, the ego's pose for SUMO and the fallback path.

Nothing here waits for SUMO; what can be computed before a tick is prepared in the slack of the tick before it. Knows no
I/O, no clock and no gateway. `drive.tick` defines the order of the calls, `drive.assembly` builds the pipeline.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Final, Protocol

from vve_sumo.commanded_path import curve
from vve_sumo.controller import GuardedController
from vve_sumo.frames import Placement, move_point
from vve_sumo.frozen import fast_frozen
from vve_sumo.intersections import SignalPhase
from vve_sumo.lot.fallback import fallback_path
from vve_sumo.lot.geofence import Geofence
from vve_sumo.path import ReferencePath
from vve_sumo.pose.dating import FixDater, Undated
from vve_sumo.pose.predict import Predictor
from vve_sumo.pose.receivers.port import FixDecoder
from vve_sumo.pose.trust import TrustGate
from vve_sumo.sensors.guarded import GuardedSensor
from vve_sumo.sensors.port import Column
from vve_sumo.timing import SETPOINT_LIFETIME
from vve_sumo.values import (
    Actors,
    CommandedPath,
    ControlCommand,
    DeferredFallbackPath,
    FallbackPath,
    Fix,
    Observation,
    Point,
    Pose,
    SensorOutput,
    Setpoint,
    Vehicle,
)

#: greatest difference of a tick's time from the time for which its fallback path was prepared [s]; else prepared anew
PREPARED_TIME_TOLERANCE: Final = 0.01
#: below it the car stands, and a commanded path that was refused is judged anew [m/s]
STANDSTILL: Final = 0.1
#: of how many setpoints the requested angles are kept for the geofence: those that a car may not have answered yet
STEERING_HISTORY: Final = 10

#: the sensors' readings at a tick: the columns of each sensor's table in the record, by the sensor's name
Readings = Mapping[str, tuple[Column, ...]]

#: from pose, reported road-wheel angle [rad], path, s of the pose [m] and vehicle to the fallback path
FallbackRule = Callable[[Pose, float, ReferencePath, float, Vehicle], FallbackPath | DeferredFallbackPath | None]

_NO_READINGS: Readings = MappingProxyType({})
_NO_SIGNALS: Mapping[str, SignalPhase] = MappingProxyType({})


@fast_frozen
@dataclass(frozen=True, slots=True)
class TickResult:
    """What the pipeline computed at one tick."""

    setpoint: Setpoint | None  #: for the gateway; None before the first trusted fix
    pose: Pose | None  #: of the rear axle at the tick; None before the first trusted fix
    s: float  #: distance along the path of the pose [m]
    d: float  #: distance of the pose from the path [m], left positive
    readings: Readings  #: of the sensors that gave one at this tick
    sensors: Mapping[str, SensorOutput]  #: the newest output of every sensor, by the sensor's name
    pose_age: float  #: tick minus epoch of the newest trusted fix [s]
    pose_reasons: tuple[str, ...]  #: why the newest fix was not trusted
    shell_faults: tuple[str, ...]  #: faults that the shell and the virtual road handed in
    faults: tuple[str, ...]  #: all faults of this tick
    commanded_path: CommandedPath | None  #: that the controller's command carries; None for none


@fast_frozen
@dataclass(frozen=True, slots=True)
class _Sensed:
    """What a tick knows before its controller is called."""

    pose: Pose | None
    readings: Readings
    faults: tuple[str, ...]


class OutputPublisher(Protocol):
    """What carries the virtual sensors to a control computer of somebody else's."""

    def publish(self, now: float, seen: SensorFrame | None, faults: tuple[str, ...]) -> None:
        """Send out what the sensors saw at drive time `now` [s]; None before the first trusted fix.

        Any reason code in `faults` makes what is sent invalid. Must not raise.
        """
        ...


@fast_frozen
@dataclass(frozen=True, slots=True)
class SensorFrame:
    """What a tick's virtual sensors say, for the outgoing wires."""

    pose: Pose  #: of the rear axle on the virtual road, predicted to the tick
    fix: Fix  #: the newest trusted one
    actors: Actors  #: that the sensors saw
    sensors: Mapping[str, SensorOutput]  #: the newest output of every sensor, by the sensor's name


class Pipeline:
    """Turns pose bytes into setpoints; holds all state between ticks.

    A tick is `receive` for each portion of bytes that came, `see`, `decide`, and in the slack after it `prepare`.
    """

    def __init__(
        self,
        *,
        decoder: FixDecoder,
        gate: TrustGate,
        placement: Placement,
        predictor: Predictor,
        sensors: Mapping[str, GuardedSensor],
        controller: GuardedController,
        vehicle: Vehicle,
        path: ReferencePath,
        desired_speed: float,
        deviation_limit: float = math.inf,
        speed_margin: float = math.inf,
        dater: FixDater | None = None,
        epoch: float = 0.0,
        geofence: Geofence | None = None,
        wires: OutputPublisher | None = None,
        fallback: FallbackRule = fallback_path,
    ) -> None:
        """Put the pipeline together.

        A lateral deviation above `deviation_limit` [m] is the fault `off_path`. A speed above `desired_speed` [m/s] by
        more than `speed_margin` [m/s] is the fault `above_desired_speed`.
        `dater` maps the receiver's times to drive time; without one the receiver's clock is the drive's. GNSS second
        `epoch` is drive time 0. `geofence` is the lot's; without one the car may stop anywhere.
        `wires` carry the virtual sensors to an external controller; without them nothing goes out.
        `fallback` gives the fallback path; where the gateway lives in this process it may be a deferred one.
        """
        self._decoder, self._gate, self._placement, self._predictor = decoder, gate, placement, predictor
        self._sensors, self._controller = dict(sensors), controller
        self._vehicle, self._path, self._desired_speed = vehicle, path, desired_speed
        self._deviation_limit, self._speed_limit = deviation_limit, desired_speed + speed_margin
        self._dater, self._epoch, self._geofence, self._wires = dater, epoch, geofence, wires
        self._fallback_rule = fallback
        self._sequence = 0
        self._s: float | None = None
        self._way, self._moved = 0.0, math.inf  # driven since the first pose [m]; drive time up to which it counts [s]
        self._newest = -math.inf
        self._reasons: tuple[str, ...] = ()
        self._outputs = self._newest_outputs()
        self._sensed = _Sensed(None, _NO_READINGS, ())
        self._newest_fix: Fix | None = None
        self._actors: Actors | None = None
        self._fallback: FallbackPath | DeferredFallbackPath | None = None
        self._prepared_for = -math.inf
        self._geofence_breach: tuple[str, ...] = ()
        self._requested: deque[float] = deque(maxlen=STEERING_HISTORY)  # road-wheel angles [rad]
        # Of the newest command, and where along it the car is [m].
        self._commanded: CommandedPath | None = None
        self._commanded_s = 0.0
        self._refused: tuple[str, ...] = ()  # what the geofence said of a commanded path, until the car stands
        self.newest_epoch = -math.inf  #: of the newest fix, trusted or not, as drive time [s]

    def receive(self, received: float, data: bytes) -> None:
        """Take pose bytes that arrived at drive time `received` [s]."""
        for fix in self._decoder.feed(data, received):
            dated = fix if self._dater is None else self._dater.date(received, fix)
            if isinstance(dated, Undated):
                self._reasons = (dated.reason,)
            else:
                self.accept(received, dated)

    def accept(self, now: float, fix: Fix) -> Pose | None:
        """Judge one fix; if the fix is trusted, place it on the virtual road and update the predictor.

        Returns the rear axle's pose as measured, None where the fix is not trusted.
        """
        self.newest_epoch = fix.time - self._epoch
        trust = self._gate.step(now, fix)
        self._reasons = trust.reasons
        if not trust.trusted:
            return None
        pose = self._placement.place(fix)
        self._newest, self._newest_fix = pose.time, fix
        self._predictor.update(pose)
        return pose

    @property
    def sees_signals(self) -> bool:
        """Whether a sensor is to be handed what the signals of the virtual road show."""
        return any(sensor.sees_signals for sensor in self._sensors.values())

    def see(self, now: float, actors: Actors, signals: Mapping[str, SignalPhase] = _NO_SIGNALS) -> None:
        """Predict the pose to drive time `now` [s] and step every sensor on the `actors` and `signals` of this tick."""
        faults = self._gate.stale(now) + self._gate.unsteady() if self._newest > -math.inf else ()
        if not self._gate.profile.may_arm:
            faults += ("profile_may_not_arm",)
        pose, readings = self._predictor.at(now), _NO_READINGS
        if pose is not None:
            stepped = {name: sensor.step(now, pose, actors, signals) for name, sensor in self._sensors.items()}
            faults += tuple({code: None for sensor in self._sensors.values() for code in sensor.faults})
            readings = {name: reading for name, reading in stepped.items() if reading is not None}
            if readings:
                self._outputs = self._newest_outputs()
        self._sensed, self._actors = _Sensed(pose, readings, faults), actors

    def decide(self, tick: int, now: float, steering: float, shell_faults: tuple[str, ...] = ()) -> TickResult:
        """Call the controller for drive time `now` [s], after `see`.

        `steering` is the road-wheel angle that the car reports [rad], NaN where the car reported none; `shell_faults`
        are reason codes of faults that the shell and the virtual road found. The setpoint carries all faults to the
        gateway, for which a setpoint with faults is only a reason to stop. Without a pose there is no setpoint.
        """
        sensed, pose = self._sensed, self._sensed.pose
        faults = shell_faults + sensed.faults
        setpoint, s, d, commanded = None, math.nan, math.nan, None
        if pose is not None:
            projection = self._path.project(pose.x, pose.y, self._s)
            self._s, s, d = projection.s, projection.s, projection.d
            self._way += abs(pose.speed) * max(now - self._moved, 0.0)
            self._moved = now
            faults += ("off_path",) if not abs(d) <= self._deviation_limit else ()
            faults += ("above_desired_speed",) if not pose.speed <= self._speed_limit else ()
            if not abs(now - self._prepared_for) <= PREPARED_TIME_TOLERANCE:
                # Ticks were skipped: the car is no longer where the prepared fallback path begins.
                self.prepare(now, steering)
            faults += self._geofence_breach
        if self._wires is not None:
            self._wires.publish(now, self._seen(), faults)
        if pose is not None:
            command, failures = self._controller.step(self._observation(tick, now, pose, steering))
            faults += failures
            if command is not None:
                # A controller that fails leaves its last path in place: it is where the car was meant to go.
                self._commanded, self._commanded_s = command.path, 0.0
                commanded = command.path
            setpoint = self._stamped(command or _after_failure(steering), now, pose, faults)
            self._requested.append(setpoint.steering)
        return TickResult(
            setpoint=setpoint,
            pose=pose,
            s=s,
            d=d,
            readings=sensed.readings,
            sensors=self._outputs,
            pose_age=now - self._newest if self._newest > -math.inf else math.nan,
            pose_reasons=self._reasons,
            shell_faults=shell_faults,
            faults=faults,
            commanded_path=commanded,
        )

    def _seen(self) -> SensorFrame | None:
        pose, fix, actors = self._sensed.pose, self._newest_fix, self._actors
        if pose is None or fix is None or actors is None:
            return None
        return SensorFrame(pose, fix, actors, self._outputs)

    def prepare(self, time: float, steering: float) -> None:
        """Prepare the fallback path from the pose predicted to drive time `time` [s], and check it with the geofence.

        `steering` is the road-wheel angle that the car reports [rad]. The next setpoint carries path and fault code.
        The fallback path leads along the path that the newest command carries, else along the scenario's. Where the
        geofence refuses the commanded one, the car is stopped along the scenario's, all the way: a shorter and shorter
        piece of a path that leads out of the lot lies inside.
        """
        pose = self._predictor.at(time)
        self._fallback, self._geofence_breach, self._prepared_for = None, (), time
        if pose is None or self._s is None:
            return
        commanded = self._commanded
        if commanded is None or abs(pose.speed) < STANDSTILL:
            self._refused = ()
        if commanded is not None:
            along = self._along_command(pose, commanded)
            if not self._refused:
                self._fallback, self._refused = self._judged(pose, steering, *along)
            if not self._refused:
                return
        self._fallback, breach = self._judged(pose, steering, self._path, self._s)
        self._geofence_breach = breach or self._refused

    def _along_command(self, pose: Pose, commanded: CommandedPath) -> tuple[ReferencePath, float]:
        """Return the curve of a commanded path, and the pose's place along it [m]."""
        path = curve(commanded)
        self._commanded_s = path.project(pose.x, pose.y, self._commanded_s).s
        return path, self._commanded_s

    def _judged(
        self, pose: Pose, steering: float, path: ReferencePath, s: float
    ) -> tuple[FallbackPath | DeferredFallbackPath | None, tuple[str, ...]]:
        """Return the fallback path from a pose at `s` [m] onto a path, and what the geofence says of it."""
        fallback = self._fallback_rule(pose, steering, path, s, self._vehicle)
        if self._geofence is None or self._s is None:
            return fallback, ()
        requested = (min(self._requested), max(self._requested)) if self._requested else None
        # The gateway compares the receiver with the car from the first setpoint on, however the car drives.
        driven = max(self._s, self._way)
        return fallback, self._geofence.check(pose, steering, fallback, driven, requested)

    def prepare_sensors(self) -> None:
        """Let the sensors do what they left to do at this tick: in its slack, else it is done at the next."""
        for sensor in self._sensors.values():
            sensor.prepare()

    def front_bumper_at(self, time: float) -> Pose | None:
        """Return the front bumper's pose to request of SUMO for drive time `time` [s]; None before a trusted fix."""
        pose = self._predictor.at(time)
        return None if pose is None else move_point(pose, self._vehicle.rear_axle_to_bumper, 0.0, Point.FRONT_BUMPER)

    def clock_report(self) -> dict[str, Any]:
        """Return the estimate of the receiver's clock against the drive's, for the summary; empty without a `dater`."""
        report = None if self._dater is None else self._dater.report()
        if report is None:
            return {}
        return {
            "age": report.age.value,
            "drift_ppm": report.drift_ppm,
            "jitter_p50_ms": 1000.0 * report.jitter_p50,
            "jitter_p99_ms": 1000.0 * report.jitter_p99,
        }

    @property
    def pose(self) -> Pose | None:
        """Pose of the rear axle at the tick of the last `see`; None before the first trusted fix."""
        return self._sensed.pose

    @property
    def newest_fix(self) -> Fix | None:
        """The newest trusted fix; None before the first."""
        return self._newest_fix

    @property
    def failure(self) -> str:
        """Text of the controller's last failure, or else of a sensor's; empty where none ever failed."""
        return self._controller.text or next((sensor.text for sensor in self._sensors.values() if sensor.text), "")

    def _newest_outputs(self) -> Mapping[str, SensorOutput]:
        return MappingProxyType({name: sensor.output for name, sensor in self._sensors.items()})

    def _observation(self, tick: int, now: float, pose: Pose, steering: float) -> Observation:
        return Observation(
            tick=tick,
            time=now,
            pose=pose,
            path=self._path,
            desired_speed=self._desired_speed,
            sensors=self._outputs,
            steering=steering,
        )

    def _stamped(self, command: ControlCommand, now: float, pose: Pose, faults: tuple[str, ...]) -> Setpoint:
        self._sequence += 1
        return Setpoint(
            steering=command.steering,
            acceleration=command.acceleration,
            emergency=command.emergency,
            note=command.note,
            sequence=self._sequence,
            time=now,
            expires=now + SETPOINT_LIFETIME,
            x=pose.x,
            y=pose.y,
            heading=pose.heading,
            speed=pose.speed,
            yaw_rate=pose.yaw_rate,
            grade=pose.grade,
            faults=faults,
            fallback_path=self._fallback,
        )


def _after_failure(steering: float) -> ControlCommand:
    """Return a command in place of a failed controller's; the faults in the same setpoint make the gateway stop."""
    return ControlCommand(steering if math.isfinite(steering) else 0.0, 0.0, note="failed")
