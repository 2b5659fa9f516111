"""Builds a tick's row of the record; a replay compares with the same definition of every column."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from vve_sumo.drive.pipeline import TickResult
from vve_sumo.drive.virtual_road import EgoSurroundings
from vve_sumo.path import ReferencePath
from vve_sumo.record.rows import TickRow
from vve_sumo.values import ControlCommand, GatewayStatus, Point, Pose
from vve_sumo.world.ego_sync import EgoSyncReport

_NAN = math.nan

#: what stands in the row where there is no pose, no setpoint, no report
_NO_POSE = Pose(_NAN, Point.REAR_AXLE, _NAN, _NAN, _NAN, _NAN, _NAN, _NAN, _NAN, _NAN)
_NO_COMMAND = ControlCommand(_NAN, _NAN)
_NO_REPORT = EgoSyncReport(_NAN, _NAN, _NAN, _NAN, "", False, ())


class RecordedTick(NamedTuple):
    """One tick of an ego: its time, inputs and results."""

    tick: int
    now: float  #: drive time [s]
    datagrams: int  #: portions of pose bytes received since the drive began
    steering: float  #: road-wheel angle that the car had reported [rad]
    result: TickResult
    status: GatewayStatus  #: the gateway's newest
    truth: Pose | None  #: true pose of the rear axle on the virtual road; None where it is unknown


def result_columns(result: TickResult) -> dict[str, Any]:
    """Return the pipeline's results, by the record's columns."""
    pose, asked = result.pose or _NO_POSE, result.setpoint or _NO_COMMAND
    return {
        "x_m": pose.x,
        "y_m": pose.y,
        "heading_rad": pose.heading,
        "speed_mps": pose.speed,
        "acceleration_mps2": pose.acceleration,
        "yaw_rate_radps": pose.yaw_rate,
        "s_m": result.s,
        "estimated_deviation_m": result.d,
        "pose_age_s": result.pose_age,
        "pose_reasons": "+".join(result.pose_reasons),
        "readings": len(result.readings),
        "steering_setpoint_rad": asked.steering,
        "acceleration_setpoint_mps2": asked.acceleration,
        "emergency": asked.emergency,
        "note": asked.note,
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
    recorded: RecordedTick,
    path: ReferencePath,
    requested: Pose | None,
    report: EgoSyncReport | None,
    around: EgoSurroundings,
) -> TickRow:
    """Return a tick's row of the record, after the virtual road has advanced to what is `around` the ego now."""
    result = recorded.result
    truth, asked, found = recorded.truth or _NO_POSE, requested or _NO_POSE, report or _NO_REPORT
    return TickRow(
        tick=recorded.tick,
        time_s=recorded.now,
        datagrams=recorded.datagrams,
        pose_trusted=result.pose is not None and not result.pose_reasons and "pose_stale" not in result.faults,
        true_x_m=truth.x,
        true_y_m=truth.y,
        true_heading_rad=truth.heading,
        true_speed_mps=truth.speed,
        true_acceleration_mps2=truth.acceleration,
        lateral_deviation_m=_NAN if recorded.truth is None else _beside(truth, result.s, path),
        shell_faults="+".join(result.shell_faults),
        measured_steering_rad=recorded.steering,
        requested_x_m=asked.x,
        requested_y_m=asked.y,
        requested_heading_rad=asked.heading,
        requested_speed_mps=asked.speed,
        ego_sync_position_error_m=found.position_error,
        ego_sync_speed_error_mps=found.speed_error,
        ego_sync_faults="+".join(found.faults),
        lane=found.lane,
        actors=len(around.actors.ids),
        contacts="+".join(around.contacts),
        red_light=around.red_light,
        stop_sign=around.stop_sign,
        **result_columns(result),
        **status_columns(recorded.status),
    )


def _beside(truth: Pose, s: float, path: ReferencePath) -> float:
    """Return the distance of the true rear axle from the path [m], left positive."""
    return path.project(truth.x, truth.y, s if math.isfinite(s) else None).d
