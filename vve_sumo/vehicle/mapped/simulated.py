"""Simulated other end of a mapped wire: receives command frames and sends its reports, each at its period.

`controller` defines its response to commands; the mapping says what of it the wire can tell.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Final

from vve_sumo.values import Frame
from vve_sumo.vehicle.interface import (
    Accelerations,
    BrakeState,
    BrakeTorque,
    DriverInputs,
    Due,
    Gear,
    GearState,
    Measured,
    Request,
    SteeringState,
    ThrottleState,
    WheelSpeeds,
    YawRate,
)
from vve_sumo.vehicle.mapped.controller import NO_COMMANDS, Controller, DecodedCommands
from vve_sumo.vehicle.mapped.frames import Condition, Number, Placed, Views, count_in, views_of
from vve_sumo.vehicle.mapped.report_faults import ReportFaults
from vve_sumo.vehicle.mapped.wire import Wire

TORQUE_SENSOR: Final = 7.9  # of the driver's steering torque, at most [N m]


class SimulatedMapped:
    """A `SimulatedInterface` of a wire."""

    def __init__(self, wire: Wire, duration: float) -> None:
        facts = wire.facts
        self._wire = wire
        self._controller = Controller(
            duration,
            facts.command_timeout,
            facts.wheel_rate_limit,
            facts.when_commands_stop.action,
            wire.watchdog_deceleration,
            clears=bool(wire.commands.clear),
        )
        self._faults = ReportFaults(wire)
        self._layouts = {layout.id: layout for layout in wire.command_layouts}
        self._views: dict[int, Views] = {}  # newest usable commands
        self._counts: dict[int, int | None] = {}
        self._fresh: set[int] = set()  # messages that came since the last time that all had come
        self._hundredths = 0
        self._sent = dict.fromkeys(wire.report_layouts, 0)

    @property
    def gear(self) -> Gear:
        """Return the gear that is engaged."""
        return self._controller.gear

    @property
    def enabled(self) -> tuple[bool, bool, bool]:
        """Return whether brake, throttle and steering act on commands."""
        return self._controller.enabled

    @property
    def watchdog_braking(self) -> bool:
        """Return whether the watchdog brakes."""
        return self._controller.watchdog_braking

    @property
    def injectable(self) -> frozenset[str]:
        """Return the kinds of fault that the wire can tell."""
        return self._faults.kinds

    @property
    def driver_brake_torque(self) -> float:
        """Return the brake torque that the driver's foot asks for [N m]."""
        return self._controller.foot_torque

    def receive(self, frames: Sequence[Frame], speed: float, brake_torque: float) -> None:
        """Take in frames; one with a wrong length, checksum or a counter that stands still is not one."""
        heard = False
        for number, data in frames:
            layout = self._layouts.get(number)
            if layout is None or len(data) != layout.size or not layout.intact(data):
                continue
            views = views_of(data)
            count = layout.count(views)
            if count is None or self._counts.get(number) != count:
                self._counts[number], self._views[number] = count, views
                self._fresh.add(number)
                heard = True
        if heard and self._views.keys() == self._layouts.keys():
            # Every message has its own time-out: one that stops, or whose counter does, is enough.
            whole = self._fresh == self._layouts.keys()
            self._controller.receive(self._decoded(), speed, brake_torque, in_time=whole)
            if whole:
                self._fresh.clear()

    def step(self, driver: DriverInputs, speed: float, wheel_angle: float) -> Request:
        """Advance by one step."""
        return self._controller.step(driver, speed, wheel_angle)

    def drop_out(self, subsystem: int | None) -> None:
        """Make one subsystem fail; None restores all."""
        self._controller.broken = None if subsystem is None else subsystem - 1

    def alter(self, time: float, frame: Frame, due: Due) -> Frame:
        """Return what is sent at `time` in place of a report."""
        return self._faults.alter(time, frame, due)

    def reports(self, measured: Measured) -> list[Frame]:
        """Return the frames that are due; one is left out whose measurement the wire cannot call unknown."""
        self._hundredths += 1
        due = [number for number, period in self._wire.periods.items() if self._hundredths % period == 0]
        placed = self._placed(measured) if due else {}
        frames = []
        for number in due:
            counts = placed.get(number)
            if counts is None:
                continue
            self._sent[number] += 1
            layout = self._wire.report_layouts[number]
            frames.append(Frame(number, layout.packed(counts, self._sent[number])))
        return frames

    def _decoded(self) -> DecodedCommands:
        commands, views = self._wire.commands, self._views

        def number(one: Number | None, without: float) -> float:
            return without if one is None else one.read(views[one.message])

        selector = commands.gear
        gear = selector.gears.get(count_in(selector.signal, views[selector.message]), Gear.NONE)
        return replace(
            NO_COMMANDS,
            brake_torque=number(commands.brake_torque, 0.0),
            throttle=number(commands.throttle, 0.0),
            acceleration=number(commands.acceleration, math.nan),
            wheel_angle=number(commands.wheel_angle, 0.0),
            wheel_rate=number(commands.wheel_rate, 0.0),
            gear=gear,
            enable=all(one.read(views[one.message]) for one in commands.enable),
            clear=any(one.read(views[one.message]) for one in commands.clear),
        )

    def _placed(self, measured: Measured) -> dict[int, list[Placed] | None]:
        """Return the counts of every report message; None for one that holds a number that it cannot call unknown."""
        states = self._states(measured)
        shared: dict[tuple[int, str], tuple[Condition, bool]] = {}
        placed: dict[int, list[Placed] | None] = {number: [] for number in self._wire.report_layouts}

        def put(message: int, more: list[Placed] | None) -> None:
            counts = placed[message]
            if more is None:
                placed[message] = None
            elif counts is not None:
                counts += more

        for plan in self._wire.reports:
            state = states[plan.kind]
            for name, number in plan.numbers.items():
                put(number.message, number.nearest(getattr(state, name)))
            for name, conditions in plan.conditions.items():
                for position, one in enumerate(conditions):
                    says = bool(getattr(state, name)) and position == 0
                    key = (one.message, one.signal.name)
                    # A signal that several subsystems share says yes to what any has, and is enabled where all are.
                    before = shared.get(key, (one, says))[1]
                    shared[key] = one, (before and says) if name == "enabled" else (before or says)
            if plan.selector is not None:
                count = plan.selector.counts.get(self.gear, plan.selector.counts[Gear.PARK])
                put(plan.selector.message, [Placed(plan.selector.signal, count)])
        for condition, value in shared.values():
            put(condition.message, [condition.placed(value)])
        return placed

    def _states(self, measured: Measured) -> dict[type, Any]:
        """Return what there is to be reported, as the port's own reports."""
        one = self._controller
        said, late, latched = one.commands, one.timed_out, one.watchdog_fault
        brake, throttle, steering = one.enabled
        torque = min(max(one.hand_torque, -TORQUE_SENSOR), TORQUE_SENSOR)
        angle = measured.wheel_angle
        return {
            BrakeState: BrakeState(
                brake, one.overrides[0], one.driver[0], late, False, latched, one.watchdog_braking, one.foot_torque,
                said.brake_torque,
            ),
            ThrottleState: ThrottleState(
                throttle, one.overrides[1], one.driver[1], late, False, latched, one.foot_opening, said.throttle
            ),
            SteeringState: SteeringState(angle, steering, one.overrides[2], late, False, latched, torque),
            GearState: GearState(one.gear, one.gear_override, False),
            WheelSpeeds: measured.wheels,
            YawRate: measured.rates,
            Accelerations: measured.accelerations,
            BrakeTorque: BrakeTorque(measured.brake_torque),
        }  # fmt: skip
