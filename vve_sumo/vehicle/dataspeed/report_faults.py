"""Alters the simulated car's reports as a faulty module or sensor would.

It knows frames and their content, and nothing of the car or of who receives them.
"""

from __future__ import annotations

import math
from typing import Any, Final

from vve_sumo.values import Frame
from vve_sumo.vehicle.dataspeed import codec, layout
from vve_sumo.vehicle.dataspeed.messages import BrakeInfo, BrakeReport, SteeringReport, ThrottleReport
from vve_sumo.vehicle.interface import Due, WheelSpeeds

#: Reports in which a fault sets some fields: identifier to the fault's kind and those fields.
_SET: Final[dict[int, tuple[str, dict[str, Any]]]] = {
    layout.BRAKE_REPORT: ("brake_fault", {"fault_channel_1": True}),
    layout.THROTTLE_REPORT: ("throttle_fault", {"fault_channel_1": True}),
    layout.STEERING_REPORT: ("steering_fault", {"fault_bus_1": True}),
    layout.WHEEL_SPEEDS: ("wheel_speed_invalid", {"rear_left": math.nan}),
}

#: Reports that a fault freezes: identifier to the fault's kind.
_FROZEN: Final = {
    layout.WHEEL_SPEEDS: "wheel_speeds_frozen",
    layout.STEERING_REPORT: "steering_report_frozen",
    layout.YAW_RATE: "yaw_rate_frozen",
    layout.BRAKE_REPORT: "brake_report_frozen",
    layout.THROTTLE_REPORT: "throttle_report_frozen",
}

#: Reports of the car's speed. All come from the same four sensors, so they go wrong together.
_OF_SPEED: Final = frozenset({layout.WHEEL_SPEEDS, layout.STEERING_REPORT, layout.BRAKE_INFO})


class ReportFaults:
    """Alters reports, one after the other."""

    def __init__(self, variant: layout.Variant) -> None:
        self._variant = variant
        self._kept: dict[int, Frame] = {}  # content of each frozen report, by identifier

    def alter(self, time: float, frame: Frame, due: Due) -> Frame:
        """Return what is sent at `time` in place of a report, by the faults that are due."""
        if frame.id == layout.STEERING_REPORT and due("report_malformed", time) is not None:
            return Frame(frame.id, frame.data[:-1])
        return self._set(time, self._scaled(time, self._frozen(time, frame, due), due), due)

    def _frozen(self, time: float, frame: Frame, due: Due) -> Frame:
        if due(_FROZEN.get(frame.id, ""), time) is None:
            self._kept.pop(frame.id, None)
            return frame
        return self._kept.setdefault(frame.id, frame)

    def _scaled(self, time: float, frame: Frame, due: Due) -> Frame:
        if frame.id not in _OF_SPEED:
            return frame
        stands = due("wheel_speeds_zero", time) is not None
        factor = 0.0 if stands else due("wheel_speeds_scaled", time)
        if factor is None:
            return frame
        match codec.decode(frame, self._variant):
            case WheelSpeeds() as wheels:
                return codec.encode(WheelSpeeds(*(factor * wheel for wheel in wheels)), self._variant)
            case SteeringReport() as report:
                return codec.encode(report._replace(speed=factor * report.speed), self._variant)
            case BrakeInfo() as info:
                return codec.encode(info._replace(stationary=stands or info.stationary), self._variant)
            case other:
                raise AssertionError(f"the car itself says nothing wrong: {other}")

    def _set(self, time: float, frame: Frame, due: Due) -> Frame:
        kind, changes = _SET.get(frame.id, ("", {}))
        if due(kind, time) is None:
            return frame
        report = codec.decode(frame, self._variant)
        assert isinstance(report, BrakeReport | ThrottleReport | SteeringReport | WheelSpeeds)
        return codec.encode(report._replace(**changes), self._variant)
