"""Alters the reports of a mapped wire as a faulty module would, as far as the wire can tell one fault from another.

It knows frames and their content, and nothing of the car or of who receives them.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

from vve_sumo.values import Frame
from vve_sumo.vehicle.interface import BrakeState, Due, GearState, SteeringState, ThrottleState
from vve_sumo.vehicle.mapped.frames import Condition, Placed, views_of
from vve_sumo.vehicle.mapped.wire import ReportPlan, Wire

_SUBSYSTEMS: Final[dict[str, type]] = {"brake": BrakeState, "throttle": ThrottleState, "steering": SteeringState}
#: Reports of which `override_false` sets the override, by the value that selects them.
_OVERRIDDEN: Final = {1.0: BrakeState, 2.0: ThrottleState, 3.0: SteeringState, 4.0: GearState}


class ReportFaults:
    """Alters reports, one after the other."""

    def __init__(self, wire: Wire) -> None:
        self._layouts = wire.report_layouts
        self._plans = {plan.kind: plan for plan in wire.reports}
        self._frozen_content: dict[tuple[str, int], bytes] = {}
        self._freezes = {f"{name}_report_frozen": kind for name, kind in _SUBSYSTEMS.items() if self._can_freeze(kind)}
        self._set = {
            f"{name}_fault": (self._own(kind, "fault"), True)
            for name, kind in _SUBSYSTEMS.items()
            if self._own(kind, "fault")
        }
        for name in ("brake", "throttle"):
            parts = [self._own(_SUBSYSTEMS[name], field) for field in ("override", "driver")]
            if all(parts):
                self._set[f"{name}_driver_bits_zero"] = (tuple(one for part in parts for one in part), False)
        overrides = {value: self._own(kind, "override") for value, kind in _OVERRIDDEN.items()}
        self._overrides = overrides if all(overrides.values()) else {}
        claimed = {"report_malformed", *self._freezes, *self._set}
        claimed |= {"override_false"} if self._overrides else set()
        claimed |= {"gear_lever"} if self._own(GearState, "override") else set()
        self.kinds = frozenset(claimed)  #: of all faults that the wire can tell

    def alter(self, time: float, frame: Frame, due: Due) -> Frame:
        """Return what is sent at `time` in place of a report, by the faults that are due."""
        number, data = frame
        if number in self._plans[SteeringState].messages and due("report_malformed", time) is not None:
            return Frame(number, data[:-1])
        layout, count = self._layouts[number], self._layouts[number].count(views_of(data))
        for kind, report in self._freezes.items():
            if number not in self._plans[report].messages:
                continue
            if due(kind, time) is None:
                self._frozen_content.pop((kind, number), None)
            else:
                data = layout.counted(self._frozen_content.setdefault((kind, number), data), count or 0)
        placed = [
            one.placed(value)
            for kind, (conditions, value) in self._set.items()
            if due(kind, time) is not None
            for one in _first(conditions, value)
            if one.message == number
        ]
        if self._overrides and (module := due("override_false", time)) is not None:
            placed += _true(self._overrides[module], number)
        return Frame(number, layout.altered(data, placed)) if placed else Frame(number, data)

    def _own(self, kind: type, field: str) -> tuple[Condition, ...]:
        """Return the conditions of a field that no other report is made of; none where it shares one."""
        conditions = self._plans[kind].conditions.get(field, ())
        others = {
            (one.message, one.signal.name)
            for plan in self._plans.values()
            for name, each in plan.conditions.items()
            if (plan.kind, name) != (kind, field)
            for one in each
        }
        return () if any((one.message, one.signal.name) in others for one in conditions) else conditions

    def _can_freeze(self, kind: type) -> bool:
        """Whether a report repeats what is commanded, in messages of its own; freezing any other one shows nowhere."""
        own: ReportPlan = self._plans[kind]
        repeats = not own.numbers.keys().isdisjoint(("command", "wheel_angle"))
        return repeats and all(plan is own or not plan.messages & own.messages for plan in self._plans.values())


def _first(conditions: Iterable[Condition], value: bool) -> Iterable[Condition]:
    """Return what has to be set: any one of several conditions to say yes, all of them to say no."""
    return list(conditions)[:1] if value else conditions


def _true(conditions: Iterable[Condition], number: int) -> list[Placed]:
    return [one.placed(True) for one in _first(conditions, True) if one.message == number]
