"""One tick of a drive: from pose bytes to a setpoint, where the ego is to be placed, and the way to rest.

The order is sense and act first: nothing here waits for SUMO, and what can be had ready before a tick is prepared in
the slack before it. No I/O, no clock, no gateway; every shell drives this same object.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

from vve_sumo.controller import Guarded
from vve_sumo.frames import Placement, move_point
from vve_sumo.lot.fallback import fallback_path
from vve_sumo.lot.geofence import Geofence
from vve_sumo.path import Path
from vve_sumo.pose.clock import Clock
from vve_sumo.pose.predict import Predictor
from vve_sumo.pose.receivers.port import FixDecoder
from vve_sumo.pose.trust import TrustGate
from vve_sumo.sensors.radar import BEFORE_FIRST_SCAN, Radar, Scan
from vve_sumo.values import Actors, Detections, FallbackPath, Fix, Observation, Point, Pose, Setpoint, Vehicle

#: a way to rest that was prepared for another moment than this far from the tick's is not the tick's [s]
PREPARED = 0.01
#: how long a setpoint may be acted on [s]; the drive-by-wire kit's own command time-out is the same 100 ms
SETPOINT_LIFETIME = 0.1


@dataclass(frozen=True, slots=True)
class TickResult:
    """What one tick came to."""

    setpoint: Setpoint | None  #: for the gateway; None before the first trusted fix
    pose: Pose | None  #: of the rear axle at the tick; None before the first trusted fix
    station: float  #: distance along the path of the pose [m]
    deviation: float  #: of the pose from the path [m], left positive
    scan: Scan | None  #: that came out at this tick; None where none did
    detections: Detections  #: the newest scan's
    pose_age: float  #: tick minus epoch of the newest trusted fix [s]
    pose_reasons: tuple[str, ...]  #: why the newest fix was not trusted
    found: tuple[str, ...]  #: faults that were handed in
    faults: tuple[str, ...]  #: all faults of this tick


@dataclass(frozen=True, slots=True)
class _Seen:
    """What a tick sees before its controller is asked."""

    pose: Pose | None
    scan: Scan | None
    faults: tuple[str, ...]


class Pipeline:
    """The road from pose bytes to setpoints, with all that it remembers between ticks.

    A tick is `receive` for each portion of bytes that came, `see`, `decide`, and in the slack after it `prepare`.
    """

    def __init__(
        self,
        *,
        decoder: FixDecoder,
        gate: TrustGate,
        placement: Placement,
        predictor: Predictor,
        radar: Radar,
        controller: Guarded,
        vehicle: Vehicle,
        path: Path,
        desired_speed: float,
        deviation_limit: float = math.inf,
        clock: Clock | None = None,
        epoch: float = 0.0,
        fence: Geofence | None = None,
    ) -> None:
        """Put the chain together; farther than `deviation_limit` [m] off its path, the car is stopped.

        `clock` brings the receiver's times to the drive's clock, on which GNSS second `epoch` is time 0; without one
        both run alike. `fence` is the lot's; without one the car may stop anywhere.
        """
        self._decoder, self._gate, self._placement, self._predictor = decoder, gate, placement, predictor
        self._radar, self._controller = radar, controller
        self._vehicle, self._path, self._desired_speed = vehicle, path, desired_speed
        self._deviation_limit = deviation_limit
        self._clock, self._epoch, self._fence = clock, epoch, fence
        self._sequence = 0
        self._station: float | None = None
        self._newest = -math.inf
        self._reasons: tuple[str, ...] = ()
        self._detections = BEFORE_FIRST_SCAN
        self._seen = _Seen(None, None, ())
        self._profile: FallbackPath | None = None
        self._prepared_for = -math.inf
        self._edge: tuple[str, ...] = ()
        self.heard = -math.inf  #: epoch of the newest fix, trusted or not, as drive time [s]

    def receive(self, received: float, data: bytes) -> None:
        """Take pose bytes that arrived at drive time `received` [s]."""
        for fix in self._decoder.feed(data, received):
            timed = fix if self._clock is None else self._timed(self._clock, received, fix)
            if timed is None:
                self._reasons = ("fix_ahead",)
            else:
                self.accept(received, timed)

    def _timed(self, clock: Clock, received: float, fix: Fix) -> Fix | None:
        """Date a fix on the drive's clock; None for one that the clock sets aside.

        One that the receiver calls late already teaches nothing of the clocks.
        """
        made = clock.step(received, fix.time) if fix.locked else clock.at(fix.time)
        if fix.locked and math.isnan(made):
            return None
        return replace(fix, time=self._epoch + made)

    def accept(self, now: float, fix: Fix) -> Pose | None:
        """Take one fix: judge it, and where it is trusted place it on the street and learn from it.

        Returns the rear axle's pose as measured, None where the fix is not trusted.
        """
        self.heard = fix.time - self._epoch
        trust = self._gate.step(now, fix)
        self._reasons = trust.reasons
        if not trust.trusted:
            return None
        pose = self._placement.place(fix)
        self._newest = pose.time
        self._predictor.update(pose)
        return pose

    def see(self, now: float, actors: Actors) -> None:
        """Find the pose at drive time `now` [s] and look at the `actors` of this tick with the radar."""
        faults = self._gate.stale(now) if self._newest > -math.inf else ()
        if not self._gate.profile.may_arm:
            faults += ("profile_may_not_arm",)
        pose, scan = self._predictor.at(now), None
        if pose is not None:
            scan = self._radar.step(now, pose, actors)
            faults += ("actors_not_finite",) if self._radar.refused else ()
            if scan is not None:
                self._detections = scan.detections
        self._seen = _Seen(pose, scan, faults)

    def decide(self, tick: int, now: float, steering: float, found: tuple[str, ...] = ()) -> TickResult:
        """Ask the controller what to do at drive time `now` [s], after `see`.

        `steering` is the road-wheel angle that the car reports [rad], NaN where it said none; `found` are reason codes
        of faults that the shell saw. Faults travel to the gateway in the setpoint, which is then a reason to stop and
        nothing else; without a pose there is no setpoint at all.
        """
        seen, pose = self._seen, self._seen.pose
        faults = found + seen.faults
        setpoint, station, deviation = None, math.nan, math.nan
        if pose is not None:
            beside = self._path.project(pose.x, pose.y, self._station)
            self._station, station, deviation = beside.s, beside.s, beside.offset
            faults += ("off_path",) if not abs(deviation) <= self._deviation_limit else ()
            if not abs(now - self._prepared_for) <= PREPARED:
                # Ticks were skipped: where the way was to begin, the car is no more.
                self.prepare(now, steering)
            faults += self._edge
            answer, failures = self._controller.step(self._situation(tick, now, pose, steering))
            faults += failures
            setpoint = self._stamped(answer or self._nothing(steering), now, pose, faults)
        return TickResult(
            setpoint=setpoint,
            pose=pose,
            station=station,
            deviation=deviation,
            scan=seen.scan,
            detections=self._detections,
            pose_age=now - self._newest if self._newest > -math.inf else math.nan,
            pose_reasons=self._reasons,
            found=found,
            faults=faults,
        )

    def prepare(self, time: float, steering: float) -> None:
        """Find the way to rest from where the car will be at drive time `time` [s], and whether it stays in the lot.

        `steering` is the road-wheel angle that the car reports [rad]; the next setpoint carries what is found.
        """
        pose = self._predictor.at(time)
        self._profile, self._edge, self._prepared_for = None, (), time
        if pose is None or self._station is None:
            return
        self._profile = fallback_path(pose, steering, self._path, self._station, self._vehicle)
        if self._fence is not None:
            self._edge = self._fence.check(pose, steering, self._profile)

    def front_bumper_at(self, time: float) -> Pose | None:
        """Return the pose to ask of SUMO for drive time `time`; None before the first trusted fix."""
        pose = self._predictor.at(time)
        return None if pose is None else move_point(pose, self._vehicle.rear_axle_to_bumper, 0.0, Point.FRONT_BUMPER)

    def clock_report(self) -> dict[str, Any]:
        """Return what is known of the receiver's clock against the drive's, to be told; empty where they are one."""
        if self._clock is None:
            return {}
        report = self._clock.report()
        return {
            "age": report.age.value,
            "drift_ppm": report.drift_ppm,
            "jitter_p50_ms": 1000.0 * report.jitter_p50,
            "jitter_p99_ms": 1000.0 * report.jitter_p99,
        }

    @property
    def pose(self) -> Pose | None:
        """Pose of the rear axle at the tick that was last seen; None before the first trusted fix."""
        return self._seen.pose

    @property
    def failure(self) -> str:
        """What the controller's last failure said; empty where it never failed."""
        return self._controller.text

    def _situation(self, tick: int, now: float, pose: Pose, steering: float) -> Observation:
        return Observation(
            tick=tick,
            time=now,
            pose=pose,
            path=self._path,
            desired_speed=self._desired_speed,
            detections=self._detections,
            steering=steering,
        )

    def _nothing(self, steering: float) -> Setpoint:
        """Stand in for a controller that failed: the gateway stops for the faults that come with it."""
        return Setpoint(steering if math.isfinite(steering) else 0.0, 0.0, note="failed")

    def _stamped(self, setpoint: Setpoint, now: float, pose: Pose, faults: tuple[str, ...]) -> Setpoint:
        self._sequence += 1
        return Setpoint(
            steering=setpoint.steering,
            acceleration=setpoint.acceleration,
            emergency=setpoint.emergency,
            note=setpoint.note,
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
            profile=self._profile,
        )
