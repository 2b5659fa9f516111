"""A `VehicleInterface` by a mapping and a DBC file: a lab's own car, as `generic`, and the shipped interfaces made so.

Every message with a mapped command goes out once a step; counters count once a step. A report is given when every
message that it lies in came again, so its age is that of its oldest part.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Final

from vve_sumo.errors import ConfigError
from vve_sumo.values import Frame
from vve_sumo.vehicle.interface import (
    Accelerations,
    ActuationCommand,
    Commanded,
    Gear,
    GearState,
    InterfaceFacts,
    Malformed,
    Report,
    SettingValue,
    YawRate,
)
from vve_sumo.vehicle.mapped import mapping
from vve_sumo.vehicle.mapped.binding import Origin
from vve_sumo.vehicle.mapped.frames import Number, Placed, Views, count_in, views_of
from vve_sumo.vehicle.mapped.simulated import SimulatedMapped
from vve_sumo.vehicle.mapped.wire import ReportPlan, Wire, bound

#: share by which a limit in another unit may be missed by rounding alone
_ROUNDING: Final = 1e-9
#: Fields without a default that a mapping need not have.
_NOT_REPORTED: Final[Mapping[type, Mapping[str, float]]] = {
    YawRate: {"roll": math.nan},
    Accelerations: {"lateral": math.nan, "vertical": math.nan},
}


class MappedInterface:
    """The interface of one wire."""

    def __init__(self, wire: Wire) -> None:
        self._wire = wire
        self._counter = -1
        self._gear = Gear.PARK  # last reported, which a wire without a count for "no request" is sent again
        self._views: dict[int, Views] = {}
        self._counts: dict[int, int | None] = {}  # last counter of each report message
        self._missing = {id(plan): set(plan.messages) for plan in wire.reports}
        self._last: dict[type, Report] = {}

    @property
    def facts(self) -> InterfaceFacts:
        """Return identifiers, wire ranges and time-outs."""
        return self._wire.facts

    def encode(self, command: ActuationCommand) -> tuple[Frame, ...]:
        """Return a frame of every message with a command in it."""
        commands, facts = self._wire.commands, self._wire.facts
        angle, rate = facts.wheel_angle_limit, facts.wheel_rate_limit
        placed: list[tuple[int, Placed]] = []
        numbers: list[tuple[Number | None, float, float, float]] = [
            (commands.wheel_angle, command.wheel_angle, -angle, angle),
            (commands.brake_torque, command.brake_torque, 0.0, facts.brake_torque_limit),
            (commands.throttle, command.throttle, 0.0, 1.0),
        ]
        if facts.acceleration_limits is not None:
            numbers.append((commands.acceleration, command.acceleration, *facts.acceleration_limits))
        if not 0.0 <= command.wheel_rate <= rate:
            raise ValueError(f"steering-wheel rate must be 0 to {rate:g} rad/s, got {command.wheel_rate:g}")
        if commands.wheel_rate is not None:
            # Never more than is asked for, and never a count of zero: to some wires that is no rate, to others any.
            placed.append((commands.wheel_rate.message, commands.wheel_rate.placed_down(command.wheel_rate or rate)))
        for number, value, low, high in numbers:
            if number is not None:
                placed.append((number.message, _within(number, value, low, high)))
        selector = commands.gear
        gear = command.gear if command.gear in selector.counts else self._gear
        if (count := selector.counts.get(gear)) is None:
            count = selector.counts[Gear.PARK]
        placed.append((selector.message, Placed(selector.signal, count)))
        placed += [(one.message, one.placed(command.enable)) for one in commands.enable]
        placed += [(one.message, one.placed(command.clear)) for one in commands.clear]
        self._counter += 1
        return tuple(
            Frame(layout.id, layout.packed([one for of, one in placed if of == layout.id], self._counter))
            for layout in self._wire.command_layouts
        )

    def decode(self, frame: Frame) -> tuple[Report, ...] | Malformed:
        """Return the reports that a frame completes."""
        number, data = frame
        layout = self._wire.report_layouts.get(number)
        if layout is None:
            return ()
        if len(data) != layout.size:
            return Malformed(number, "length")
        if not layout.intact(data):
            return Malformed(number, "checksum")
        views = views_of(data)
        count = layout.count(views)
        if count is not None and self._counts.get(number) == count:
            return Malformed(number, "counter")
        self._counts[number], self._views[number] = count, views
        reports: list[Report] = []
        for plan in self._wire.reports:
            missing = self._missing[id(plan)]
            if number not in plan.messages:
                continue
            missing.discard(number)
            if missing:
                continue
            missing.update(plan.messages)
            report = self._read(plan)
            if report is None:
                return Malformed(number, "value")
            reports.append(report)
        return tuple(reports)

    def commanded(self, frame: Frame) -> Commanded | None:
        """Return what a recorded frame commands, in the gateway's units."""
        layout = next((one for one in self._wire.command_layouts if one.id == frame.id), None)
        if layout is None or len(frame.data) != layout.size or not layout.intact(frame.data):
            return None
        commands, views = self._wire.commands, views_of(frame.data)

        def read(number: Number | None) -> float:
            return number.read(views) if number is not None and number.message == frame.id else math.nan

        said = Commanded(
            read(commands.brake_torque), read(commands.throttle), read(commands.wheel_angle),
            read(commands.acceleration),
        )  # fmt: skip
        return None if all(map(math.isnan, said)) else said

    def simulated(self, duration: float) -> SimulatedMapped:
        """Return a simulated controller at the other end of the wire."""
        return SimulatedMapped(self._wire, duration)

    def _read(self, plan: ReportPlan) -> Report | None:
        """Return the report of a plan by the newest frames; None where a gear has no name."""
        views = self._views
        fields: dict[str, object] = {name: one.read(views[one.message]) for name, one in plan.numbers.items()}
        for name, conditions in plan.conditions.items():
            fields[name] = any(one.read(views[one.message]) for one in conditions)
        if plan.selector is not None:
            selector = plan.selector
            gear = selector.gears.get(count_in(selector.signal, views[selector.message]))
            if gear is None:
                return None
            fields["gear"] = gear
        report: Report = plan.kind(**{**_NOT_REPORTED.get(plan.kind, {}), **fields})
        if isinstance(report, GearState):
            self._gear = report.gear
        # What a report repeats is the same object: who asks for how long nothing has changed goes by that.
        if (last := self._last.get(plan.kind)) != report or last is None:
            self._last[plan.kind] = last = report
        return last


def _within(number: Number, value: float, low: float, high: float) -> Placed:
    """Return what stands for a value; raises ValueError for one beyond the limits that the interface states."""
    slack = _ROUNDING * max(abs(low), abs(high))
    if not low - slack <= value <= high + slack:
        raise ValueError(f"{number.signal.name} must be {low:g} to {high:g} in SI units, got {value:g}")
    return number.placed(min(max(value, number.low), number.high))


def interface_of(wanted: mapping.Mapping, mapping_file: Path, dbc: Path) -> MappedInterface:
    """Return the interface of a mapping; raises ConfigError, one line, where it does not fit its DBC file."""
    return MappedInterface(bound(wanted, Origin(mapping_file, dbc)))


def make(settings: Mapping[str, SettingValue]) -> MappedInterface:
    """Make the interface; its one setting is `mapping_file`, beside which lies the DBC file that it names."""
    if unknown := sorted(settings.keys() - {"mapping_file"}):
        raise ConfigError(f"setting {unknown[0]!r} is unknown; allowed is 'mapping_file'")
    name = settings.get("mapping_file")
    if not isinstance(name, str):
        raise ConfigError(f"setting 'mapping_file' must name a mapping, a TOML file; got {name!r}")
    file = Path(name)
    wanted = mapping.load(file)
    return interface_of(wanted, file, file.parent / wanted.dbc)
