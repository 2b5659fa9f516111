"""Alters the simulated car's reports as a faulty module would.

It knows frames and their content, and nothing of the car or of who receives them.
"""

from __future__ import annotations

from typing import Any, Final

from vve_sumo.values import Frame
from vve_sumo.vehicle.dataspeed import codec, layout
from vve_sumo.vehicle.dataspeed.messages import BrakeReport, GearReport, SteeringReport, ThrottleReport
from vve_sumo.vehicle.interface import Due

_NO_DRIVER: Final = {"override": False, "driver": False}

#: Faults that set some fields of a report: identifier of the report to each kind and those fields.
_SET: Final[dict[int, dict[str, dict[str, Any]]]] = {
    layout.BRAKE_REPORT: {"brake_fault": {"fault_channel_1": True}, "brake_driver_bits_zero": _NO_DRIVER},
    layout.THROTTLE_REPORT: {"throttle_fault": {"fault_channel_1": True}, "throttle_driver_bits_zero": _NO_DRIVER},
    layout.STEERING_REPORT: {"steering_fault": {"fault_bus_1": True}},
}

#: Reports of which `override_false` sets the override, by the value that selects them.
_OVERRIDDEN: Final = {
    1.0: layout.BRAKE_REPORT,
    2.0: layout.THROTTLE_REPORT,
    3.0: layout.STEERING_REPORT,
    4.0: layout.GEAR_REPORT,
}

#: Reports that a fault freezes: identifier to the fault's kind.
_FROZEN: Final = {
    layout.STEERING_REPORT: "steering_report_frozen",
    layout.BRAKE_REPORT: "brake_report_frozen",
    layout.THROTTLE_REPORT: "throttle_report_frozen",
}

#: All kinds of fault that are injected here.
KINDS: Final = frozenset(
    {"report_malformed", "override_false", *_FROZEN.values(), *(kind for kinds in _SET.values() for kind in kinds)}
)


class ReportFaults:
    """Alters reports, one after the other."""

    def __init__(self, variant: layout.Variant) -> None:
        self._variant = variant
        self._frozen_content: dict[int, Frame] = {}  # content of each frozen report, by identifier

    def alter(self, time: float, frame: Frame, due: Due) -> Frame:
        """Return what is sent at `time` in place of a report, by the faults that are due."""
        if frame.id == layout.STEERING_REPORT and due("report_malformed", time) is not None:
            return Frame(frame.id, frame.data[:-1])
        return self._set(time, self._frozen(time, frame, due), due)

    def _frozen(self, time: float, frame: Frame, due: Due) -> Frame:
        if due(_FROZEN.get(frame.id, ""), time) is None:
            self._frozen_content.pop(frame.id, None)
            return frame
        return self._frozen_content.setdefault(frame.id, frame)

    def _set(self, time: float, frame: Frame, due: Due) -> Frame:
        changes: dict[str, Any] = {}
        for kind, fields in _SET.get(frame.id, {}).items():
            if due(kind, time) is not None:
                changes |= fields
        if (module := due("override_false", time)) is not None and frame.id == _OVERRIDDEN[module]:
            changes["override"] = True
        if not changes:
            return frame
        report = codec.decode(frame, self._variant)
        assert isinstance(report, BrakeReport | ThrottleReport | SteeringReport | GearReport)
        return codec.encode(report._replace(**changes), self._variant)
