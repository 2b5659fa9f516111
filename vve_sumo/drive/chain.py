"""One tick of a drive: from pose bytes and car reports to CAN frames, and where the ego is to be placed.

The order is sense and act first: nothing here waits for SUMO. No I/O, no clock; every shell drives this same object.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from vve_sumo.controller import Guarded
from vve_sumo.frames import Placement, move_point
from vve_sumo.path import Path
from vve_sumo.pose.ncom import Decoder
from vve_sumo.pose.predict import Predictor
from vve_sumo.pose.trust import TrustGate
from vve_sumo.sensors.radar import BEFORE_FIRST_SCAN, Radar, Scan
from vve_sumo.values import Actors, Detections, Fix, Frame, Point, Pose, Setpoint, Situation, Vehicle, Verdict
from vve_sumo.vehicle.gateway import Act, Gateway

#: how long a setpoint may be acted on [s]; the drive-by-wire kit's own command time-out is the same 100 ms
SETPOINT_LIFE = 0.1


@dataclass(frozen=True, slots=True)
class Acted:
    """What one tick came to."""

    frames: tuple[Frame, ...]  #: for the actuation bus, in order
    verdict: Verdict  #: of the gateway
    setpoint: Setpoint | None  #: that the gateway was handed
    pose: Pose | None  #: of the rear axle at the tick; None before the first trusted fix
    station: float  #: distance along the path of the pose [m]
    deviation: float  #: of the pose from the path [m], left positive
    scan: Scan | None  #: of this tick; None where none was due
    detections: Detections  #: the newest scan's
    pose_age: float  #: tick minus epoch of the newest trusted fix [s]
    pose_reasons: tuple[str, ...]  #: why the newest fix was not trusted
    faults: tuple[str, ...]  #: found by the drive at this tick


class Chain:
    """The road from pose bytes to frames, with all that it remembers between ticks."""

    def __init__(
        self,
        *,
        decoder: Decoder,
        gate: TrustGate,
        placement: Placement,
        predictor: Predictor,
        radar: Radar,
        controller: Guarded,
        gateway: Gateway,
        vehicle: Vehicle,
        path: Path,
        desired_speed: float,
        deviation_limit: float = math.inf,
    ) -> None:
        """Put the chain together; farther than `deviation_limit` [m] off its path, the car is stopped."""
        self._decoder, self._gate, self._placement, self._predictor = decoder, gate, placement, predictor
        self._radar, self._controller, self._gateway = radar, controller, gateway
        self._vehicle, self._path, self._desired_speed = vehicle, path, desired_speed
        self._deviation_limit = deviation_limit
        self._sequence = 0
        self._station: float | None = None
        self._newest = -math.inf
        self._reasons: tuple[str, ...] = ()
        self._detections = BEFORE_FIRST_SCAN

    def receive(self, now: float, data: bytes) -> None:
        """Take pose bytes that arrived at drive time `now`."""
        for fix in self._decoder.feed(data, now):
            self.accept(now, fix)

    def accept(self, now: float, fix: Fix) -> Pose | None:
        """Take one fix: judge it, and where it is trusted place it on the street and learn from it.

        Returns the rear axle's pose as measured, None where the fix is not trusted.
        """
        trust = self._gate.step(now, fix)
        self._reasons = trust.reasons
        if not trust.trusted:
            return None
        pose = self._placement.place(fix)
        self._newest = pose.time
        self._predictor.update(pose)
        return pose

    def act(
        self,
        tick: int,
        now: float,
        actors: Actors,
        reports: Sequence[Frame],
        act: Act | None,
        found: tuple[str, ...] = (),
    ) -> Acted:
        """Sense and act: return the frames that answer what is known at drive time `now`.

        `actors` are those of this tick; `reports` are the car's frames since the last tick; `found` are reason codes
        of faults that the shell saw. Faults travel to the gateway in the setpoint, which is then a reason to stop and
        nothing else; without a pose there is no setpoint at all.
        """
        if act is Act.ENGAGE and not self._gate.profile.may_arm:
            act, found = None, (*found, "profile_may_not_arm")
        pose = self._predictor.at(now)
        faults = found + (self._gate.stale(now) if self._newest > -math.inf else ())
        scan, setpoint, station, deviation = None, None, math.nan, math.nan
        if pose is not None:
            scan = self._radar.step(now, pose, actors)
            if scan is not None:
                self._detections = scan.detections
                faults += ("actors_not_finite",) if scan.refused else ()
            beside = self._path.project(pose.x, pose.y, self._station)
            self._station, station, deviation = beside.s, beside.s, beside.offset
            faults += ("off_path",) if not abs(deviation) <= self._deviation_limit else ()
            answer, failures = self._controller.step(self._situation(tick, now, pose))
            faults += failures
            setpoint = self._stamped(answer or self._nothing(), now, pose, faults)
        output = self._gateway.step(now, setpoint, reports, act)
        return Acted(
            frames=output.frames,
            verdict=output.verdict,
            setpoint=setpoint,
            pose=pose,
            station=station,
            deviation=deviation,
            scan=scan,
            detections=self._detections,
            pose_age=now - self._newest if self._newest > -math.inf else math.nan,
            pose_reasons=self._reasons,
            faults=faults,
        )

    def front_bumper_at(self, time: float) -> Pose | None:
        """Return the pose to ask of SUMO for drive time `time`; None before the first trusted fix."""
        pose = self._predictor.at(time)
        return None if pose is None else move_point(pose, self._vehicle.rear_axle_to_bumper, 0.0, Point.FRONT_BUMPER)

    @property
    def failure(self) -> str:
        """What the controller's last failure said; empty where it never failed."""
        return self._controller.text

    @property
    def measured_steering(self) -> float:
        """Road-wheel angle that the car last reported [rad], left positive; NaN before the first report."""
        return self._gateway.measured_steering

    def _situation(self, tick: int, now: float, pose: Pose) -> Situation:
        return Situation(
            tick=tick,
            time=now,
            pose=pose,
            path=self._path,
            desired_speed=self._desired_speed,
            detections=self._detections,
            steering=self._gateway.measured_steering,
        )

    def _nothing(self) -> Setpoint:
        """Stand in for a controller that failed: the gateway stops for the faults that come with it."""
        steering = self._gateway.measured_steering
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
            expires=now + SETPOINT_LIFE,
            speed=pose.speed,
            yaw_rate=pose.yaw_rate,
            grade=pose.grade,
            faults=faults,
        )
