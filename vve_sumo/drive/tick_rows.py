"""What the record keeps of a tick, put together from what the tick came to."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple, Protocol

from vve_sumo.drive.pipeline import TickResult
from vve_sumo.drive.virtual_road import VirtualRoad
from vve_sumo.path import Path
from vve_sumo.values import Detections, GatewayStatus, Pose, TickRow
from vve_sumo.world.ego_sync import EgoSyncReport


class ScanRecorder(Protocol):
    """What keeps radar scans: a record, or the way to one."""

    def scanned(self, tick: int, detections: Detections, seen: Sequence[str]) -> None:
        """Keep one radar scan; `seen` names the actor behind each detection."""
        ...


class RecordedTick(NamedTuple):
    """One tick: when it was, what it was told, and what was made of it."""

    tick: int
    now: float  #: drive time [s]
    datagrams: int  #: portions of pose bytes taken in so far
    steering: float  #: road-wheel angle that the car had reported [rad]
    decided: TickResult
    verdict: GatewayStatus  #: the gateway's newest


def keep_scan(record: ScanRecorder, tick: int, decided: TickResult) -> None:
    """Keep the radar scan that came out at a tick, where one did, with the names behind its detections."""
    if decided.scan is not None:
        record.scanned(tick, decided.scan.detections, decided.scan.actors)


def tick_row(
    moment: RecordedTick,
    truth: Pose | None,
    path: Path,
    asked: Pose | None,
    report: EgoSyncReport | None,
    street: VirtualRoad,
) -> TickRow:
    """Return what the record keeps of a tick, after the street has advanced."""
    nan = math.nan
    decided, verdict = moment.decided, moment.verdict
    pose, setpoint = decided.pose, decided.setpoint
    beside = nan
    if truth is not None:
        near = decided.station if math.isfinite(decided.station) else None
        beside = path.project(truth.x, truth.y, near).offset
    return TickRow(
        tick=moment.tick,
        time_s=moment.now,
        datagrams=moment.datagrams,
        pose_trusted=pose is not None and not decided.pose_reasons and "pose_stale" not in decided.faults,
        pose_age_s=decided.pose_age,
        pose_reasons="+".join(decided.pose_reasons),
        x_m=pose.x if pose else nan,
        y_m=pose.y if pose else nan,
        heading_rad=pose.heading if pose else nan,
        speed_mps=pose.speed if pose else nan,
        acceleration_mps2=pose.acceleration if pose else nan,
        yaw_rate_radps=pose.yaw_rate if pose else nan,
        station_m=decided.station,
        estimated_deviation_m=decided.deviation,
        true_x_m=truth.x if truth else nan,
        true_y_m=truth.y if truth else nan,
        true_heading_rad=truth.heading if truth else nan,
        true_speed_mps=truth.speed if truth else nan,
        true_acceleration_mps2=truth.acceleration if truth else nan,
        lateral_deviation_m=beside,
        scanned=decided.scan is not None,
        scan_time_s=decided.detections.time if math.isfinite(decided.detections.time) else nan,
        detections=len(decided.detections.range),
        steering_setpoint_rad=setpoint.steering if setpoint else nan,
        acceleration_setpoint_mps2=setpoint.acceleration if setpoint else nan,
        emergency=setpoint is not None and setpoint.emergency,
        note=setpoint.note if setpoint else "",
        found="+".join(decided.found),
        faults="+".join(decided.faults),
        state=verdict.state.value,
        reasons="+".join(verdict.reasons),
        limited="+".join(verdict.limited),
        steering_rad=verdict.steering,
        granted_acceleration_mps2=verdict.acceleration,
        brake_torque_nm=verdict.brake_torque,
        throttle_percent=100.0 * verdict.throttle,
        measured_steering_rad=moment.steering,
        asked_x_m=asked.x if asked else nan,
        asked_y_m=asked.y if asked else nan,
        asked_heading_rad=asked.heading if asked else nan,
        asked_speed_mps=asked.speed if asked else nan,
        anchor_position_error_m=report.position_error if report else nan,
        anchor_speed_error_mps=report.speed_error if report else nan,
        anchor_faults="+".join(report.faults) if report else "",
        lane=report.lane if report else "",
        actors=len(street.actors.ids),
        contacts="+".join(street.contacts),
    )
