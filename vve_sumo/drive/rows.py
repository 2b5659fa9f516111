"""What the record keeps of a tick, put together from what the tick came to."""

from __future__ import annotations

import math

from vve_sumo.drive.chain import Acted, Chain
from vve_sumo.drive.street import Street
from vve_sumo.path import Path
from vve_sumo.values import Pose, TickRow
from vve_sumo.world.anchor import AnchorReport


def tick_row(
    tick: int,
    now: float,
    acted: Acted,
    chain: Chain,
    truth: Pose | None,
    path: Path,
    asked: Pose | None,
    report: AnchorReport | None,
    street: Street,
) -> TickRow:
    """Return what the record keeps of a tick."""
    nan = math.nan
    pose, setpoint, verdict = acted.pose, acted.setpoint, acted.verdict
    beside = nan
    if truth is not None:
        near = acted.station if math.isfinite(acted.station) else None
        beside = path.project(truth.x, truth.y, near).offset
    return TickRow(
        tick=tick,
        time_s=now,
        pose_trusted=pose is not None and not acted.pose_reasons and "pose_stale" not in acted.faults,
        pose_age_s=acted.pose_age,
        pose_reasons="+".join(acted.pose_reasons),
        x_m=pose.x if pose else nan,
        y_m=pose.y if pose else nan,
        heading_rad=pose.heading if pose else nan,
        speed_mps=pose.speed if pose else nan,
        acceleration_mps2=pose.acceleration if pose else nan,
        yaw_rate_radps=pose.yaw_rate if pose else nan,
        station_m=acted.station,
        estimated_deviation_m=acted.deviation,
        true_x_m=truth.x if truth else nan,
        true_y_m=truth.y if truth else nan,
        true_heading_rad=truth.heading if truth else nan,
        true_speed_mps=truth.speed if truth else nan,
        true_acceleration_mps2=truth.acceleration if truth else nan,
        lateral_deviation_m=beside,
        scanned=acted.scan is not None,
        detections=len(acted.detections.range),
        steering_setpoint_rad=setpoint.steering if setpoint else nan,
        acceleration_setpoint_mps2=setpoint.acceleration if setpoint else nan,
        emergency=setpoint is not None and setpoint.emergency,
        note=setpoint.note if setpoint else "",
        faults="+".join(acted.faults),
        state=verdict.state.value,
        reasons="+".join(verdict.reasons),
        limited="+".join(verdict.limited),
        steering_rad=verdict.steering,
        granted_acceleration_mps2=verdict.acceleration,
        brake_torque_nm=verdict.brake_torque,
        throttle_percent=100.0 * verdict.throttle,
        measured_steering_rad=chain.measured_steering,
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
