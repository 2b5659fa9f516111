"""Builds a tick's row of the record; a replay compares with the same definition of every column."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from vve_sumo.drive.pipeline import TickResult
from vve_sumo.drive.virtual_road import VirtualRoad
from vve_sumo.path import Path
from vve_sumo.values import GatewayStatus, Pose, TickRow
from vve_sumo.world.ego_sync import EgoSyncReport

_NAN = math.nan


class RecordedTick(NamedTuple):
    """One tick: its time, inputs and results."""

    tick: int
    now: float  #: drive time [s]
    datagrams: int  #: portions of pose bytes received since the drive began
    steering: float  #: road-wheel angle that the car had reported [rad]
    result: TickResult
    status: GatewayStatus  #: the gateway's newest
    truth: Pose | None  #: true pose of the rear axle on the virtual road; None where it is unknown


def result_columns(result: TickResult) -> dict[str, Any]:
    """Return the pipeline's results, by the record's columns."""
    pose, setpoint = result.pose, result.setpoint
    return {
        "x_m": pose.x if pose else _NAN,
        "y_m": pose.y if pose else _NAN,
        "heading_rad": pose.heading if pose else _NAN,
        "speed_mps": pose.speed if pose else _NAN,
        "acceleration_mps2": pose.acceleration if pose else _NAN,
        "yaw_rate_radps": pose.yaw_rate if pose else _NAN,
        "s_m": result.s,
        "estimated_deviation_m": result.d,
        "pose_age_s": result.pose_age,
        "pose_reasons": "+".join(result.pose_reasons),
        "readings": len(result.readings),
        "steering_setpoint_rad": setpoint.steering if setpoint else _NAN,
        "acceleration_setpoint_mps2": setpoint.acceleration if setpoint else _NAN,
        "emergency": setpoint is not None and setpoint.emergency,
        "note": setpoint.note if setpoint else "",
        "faults": "+".join(result.faults),
    }


def status_columns(status: GatewayStatus) -> dict[str, Any]:
    """Return the gateway's status, by the record's columns."""
    return {
        "state": status.state.value,
        "reasons": "+".join(status.reasons),
        "limited": "+".join(status.limited),
        "steering_rad": status.steering,
        "granted_acceleration_mps2": status.acceleration,
        "brake_torque_nm": status.brake_torque,
        "throttle_percent": 100.0 * status.throttle,
    }


def tick_row(
    recorded: RecordedTick, path: Path, asked: Pose | None, report: EgoSyncReport | None, road: VirtualRoad
) -> TickRow:
    """Return a tick's row of the record, after the virtual road has advanced."""
    result, truth = recorded.result, recorded.truth
    return TickRow(
        tick=recorded.tick,
        time_s=recorded.now,
        datagrams=recorded.datagrams,
        pose_trusted=result.pose is not None and not result.pose_reasons and "pose_stale" not in result.faults,
        true_x_m=truth.x if truth else _NAN,
        true_y_m=truth.y if truth else _NAN,
        true_heading_rad=truth.heading if truth else _NAN,
        true_speed_mps=truth.speed if truth else _NAN,
        true_acceleration_mps2=truth.acceleration if truth else _NAN,
        lateral_deviation_m=_NAN if truth is None else _beside(truth, result.s, path),
        shell_faults="+".join(result.shell_faults),
        measured_steering_rad=recorded.steering,
        requested_x_m=asked.x if asked else _NAN,
        requested_y_m=asked.y if asked else _NAN,
        requested_heading_rad=asked.heading if asked else _NAN,
        requested_speed_mps=asked.speed if asked else _NAN,
        ego_sync_position_error_m=report.position_error if report else _NAN,
        ego_sync_speed_error_mps=report.speed_error if report else _NAN,
        ego_sync_faults="+".join(report.faults) if report else "",
        lane=report.lane if report else "",
        actors=len(road.actors.ids),
        contacts="+".join(road.contacts),
        **result_columns(result),
        **status_columns(recorded.status),
    )


def _beside(truth: Pose, s: float, path: Path) -> float:
    """Return the distance of the true rear axle from the path [m], left positive."""
    return path.project(truth.x, truth.y, s if math.isfinite(s) else None).offset
