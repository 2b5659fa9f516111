"""A car's wire by its mapping: which numbers and conditions command the car, and which it reports.

`bound` makes it of a mapping and its DBC file; the interface and the simulated other end both read and write by it.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Final

from vve_sumo.dbc import Signal
from vve_sumo.errors import ConfigError
from vve_sumo.vehicle.interface import (
    AccelerationLimits,
    Accelerations,
    BrakeState,
    BrakeTorque,
    CommandsStop,
    Gear,
    GearState,
    InterfaceFacts,
    SteeringState,
    ThrottleState,
    WheelSpeeds,
    WhenCommandsStop,
    YawRate,
)
from vve_sumo.vehicle.mapped import mapping
from vve_sumo.vehicle.mapped.binding import Binder, Origin
from vve_sumo.vehicle.mapped.frames import Condition, Layout, Number

#: Tables of a mapping's reports, and the kind of report that each makes.
KINDS: Final[Mapping[str, type]] = {
    "brake": BrakeState,
    "throttle": ThrottleState,
    "steering": SteeringState,
    "gear": GearState,
    "wheel_speeds": WheelSpeeds,
    "yaw_rate": YawRate,
    "accelerations": Accelerations,
    "brake_torque": BrakeTorque,
}
#: What a field that may be missing is a quantity of, where its own name does not say it.
_KIND_OF: Final = {("brake", "command"): "brake_torque", ("throttle", "command"): "throttle"}
_ACTIONS: Final = {action.value: action for action in WhenCommandsStop}


@dataclass(frozen=True, slots=True)
class Selector:
    """The gears by one signal's counts."""

    message: int  #: identifier
    signal: Signal
    counts: Mapping[Gear, int]
    gears: Mapping[int, Gear]


@dataclass(frozen=True, slots=True)
class Commands:
    """What commands the car."""

    wheel_angle: Number
    wheel_rate: Number | None
    acceleration: Number | None
    brake_torque: Number | None
    throttle: Number | None
    gear: Selector
    enable: tuple[Condition, ...]
    clear: tuple[Condition, ...]


@dataclass(frozen=True, slots=True)
class ReportPlan:
    """How the reports of one kind are read: each field by a number, by conditions, or by the selector."""

    kind: type
    numbers: Mapping[str, Number]
    conditions: Mapping[str, tuple[Condition, ...]]
    selector: Selector | None
    messages: frozenset[int]  #: identifiers of the messages that it is in; it is whole when all of them came again


@dataclass(frozen=True, slots=True)
class Wire:
    """A car's whole wire."""

    facts: InterfaceFacts
    commands: Commands
    command_layouts: tuple[Layout, ...]  #: in the order in which they are sent
    report_layouts: Mapping[int, Layout]
    reports: tuple[ReportPlan, ...]
    periods: Mapping[int, int]  #: of report messages, in hundredths of a second
    watchdog_deceleration: float  #: [m/s2]; inf where nobody states it


def bound(wanted: mapping.Mapping, origin: Origin) -> Wire:
    """Return the wire of a mapping; raises ConfigError, one line that names file and key, for a wrong one."""
    binder = Binder(wanted, origin)
    commands = _commands(binder, wanted)
    sent = binder.used()
    plans = _plans(binder, wanted.report)
    layouts = binder.layouts(wanted.command.constant)
    binder.wrong_period()
    received = {number for plan in plans for number in plan.messages}
    if both := received & sent.keys():
        raise ConfigError(f"{origin.mapping}: message {sent[min(both)]} is both a command and a report")
    return Wire(
        _facts(wanted, origin, binder, commands, plans, layouts, frozenset(sent)),
        commands,
        tuple(layouts[number] for number in sent),
        {number: layouts[number] for number in sorted(received)},
        plans,
        {number: binder.period(layouts[number].name) for number in received},
        wanted.watchdog.deceleration_mps2 or math.inf,
    )


def _commands(binder: Binder, wanted: mapping.Mapping) -> Commands:
    table, constants = wanted.command, wanted.command.constant

    def number(name: str) -> Number | None:
        quantity = getattr(table, name)
        if quantity is None:
            return None
        signal = quantity if isinstance(quantity, str) else quantity.signal
        binder.refuse_multiplexed(f"command.{name}", signal, constants)
        if name == "acceleration":
            binder.refuse_speed(f"command.{name}", signal)
        return binder.number(f"command.{name}", quantity)

    angle = number("steering_wheel_angle")
    assert angle is not None  # the schema asks for it
    commands = Commands(
        angle,
        number("steering_wheel_rate"),
        number("acceleration"),
        number("brake_torque"),
        number("throttle"),
        _selector(binder, "command.gear", table.gear),
        binder.conditions("command.enable", table.enable),
        binder.conditions("command.clear", table.clear),
    )
    _refuse_misuse(binder, commands, constants)
    return commands


def _refuse_misuse(binder: Binder, commands: Commands, constants: Mapping[str, int]) -> None:
    """Raise ConfigError for a signal that is set twice, and for one that would take the driver's override away."""
    numbers = (
        commands.wheel_angle, commands.wheel_rate, commands.acceleration, commands.brake_torque, commands.throttle,
        commands.gear,
    )  # fmt: skip
    names = [number.signal.name for number in numbers if number is not None]
    places = [(number.message, number.signal.name) for number in numbers if number is not None]
    for one in (*commands.enable, *commands.clear):
        places.append((one.message, one.signal.name))
        names.append(one.signal.name)
    for key in constants:
        message, signal = binder.signal(f"command.constant.{key}", key)
        places.append((message.id, signal.name))
        names += [signal.name] * bool(constants[key])
    for place in places:
        if places.count(place) > 1:
            raise ConfigError(f"{binder.mapping_file}: command: signal {place[1]} is set twice, expected each once")
    for name in names:
        if "ignore" in name.lower():
            raise ConfigError(
                f"{binder.mapping_file}: command: signal {name} is set, but no frame may ask to ignore the driver"
            )


def _selector(binder: Binder, key: str, table: mapping.Gears) -> Selector:
    counts = table.counts()
    message, signal = binder.signal(f"{key}.signal", table.signal)
    for gear, count in counts.items():
        binder.require_count(f"{key}.{gear.name.lower()}", signal, count)
    gears: dict[int, Gear] = {}
    for gear, count in counts.items():
        if count in gears:
            raise ConfigError(
                f"{binder.mapping_file}: {key}: {gears[count].name.lower()} and {gear.name.lower()} are both {count}"
            )
        gears[count] = gear
    for count in getattr(table, "between", ()):
        binder.require_count(f"{key}.between", signal, count)
        gears.setdefault(count, Gear.NONE)
    return Selector(message.id, signal, counts, gears)


def _plans(binder: Binder, table: mapping.ReportTable) -> tuple[ReportPlan, ...]:
    return tuple(_plan(binder, name, one) for name, one in table if one is not None)


def _plan(binder: Binder, table: str, wanted: Any) -> ReportPlan:
    numbers: dict[str, Number] = {}
    conditions: dict[str, tuple[Condition, ...]] = {}
    selector = _selector(binder, f"report.{table}", wanted) if isinstance(wanted, mapping.GearReport) else None
    for name, value in wanted:
        key = f"report.{table}.{name}"
        if value is None or (selector is not None and name in (*mapping.Gears.model_fields, "between")):
            continue
        if isinstance(value, tuple):
            conditions[name] = binder.conditions(key, value)
        elif name == "enabled":
            conditions[name] = (binder.condition(key, value),)
        else:
            numbers[name] = binder.number(key, value, _KIND_OF.get((table, name), ""))
    parts: list[Number | Condition | Selector] = [*numbers.values()]
    parts += [one for each in conditions.values() for one in each]
    parts += [selector] if selector is not None else []
    for part in parts:
        if part.signal.case is not None:
            raise ConfigError(
                f"{binder.mapping_file}: report.{table}: {part.signal.name} is multiplexed, expected a signal that "
                "every frame of its message holds"
            )
    kind, messages = KINDS[table], frozenset(part.message for part in parts)
    return ReportPlan(kind, numbers, conditions, selector, messages)


def _facts(
    wanted: mapping.Mapping,
    origin: Origin,
    binder: Binder,
    commands: Commands,
    plans: Iterable[ReportPlan],
    layouts: Mapping[int, Layout],
    sent: frozenset[int],
) -> InterfaceFacts:
    limits = wanted.limits
    kinds: dict[int, tuple[type, ...]] = {}
    for plan in plans:
        for number in plan.messages:
            kinds[number] = (*kinds.get(number, ()), plan.kind)
    angle, rate = commands.wheel_angle, commands.wheel_rate
    stated_rate = math.radians(limits.steering_wheel_rate_degps or math.inf)
    rate_limit = min(stated_rate, math.inf if rate is None else rate.high)
    if not math.isfinite(rate_limit):
        raise ConfigError(
            f"{origin.mapping}: limits.steering_wheel_rate_degps is missing: no signal limits the rate of the steering"
        )
    stated_angle = math.radians(limits.steering_wheel_angle_deg or math.inf)
    torque = commands.brake_torque
    action = _ACTIONS[wanted.watchdog.when_commands_stop]
    try:
        stops = CommandsStop(
            action, wanted.watchdog.words, deceleration=wanted.watchdog.deceleration_mps2 or math.inf
        )  # fmt: skip
    except ConfigError as error:
        raise ConfigError(f"{origin.mapping}: watchdog: {error}") from None
    return InterfaceFacts(
        title=wanted.title,
        commands=sent,
        reports=kinds,
        occupied=binder.identifiers(),
        brake_torque_limit=math.inf if torque is None else min(torque.high, limits.brake_torque_nm or math.inf),
        wheel_angle_limit=min(stated_angle, angle.high, -angle.low),
        wheel_rate_limit=rate_limit,
        command_timeout=wanted.watchdog.command_timeout_s,
        when_commands_stop=stops,
        dbc=origin.dbc,
        acceleration_limits=_acceleration_limits(wanted, origin, commands),
        counts=any(layouts[number].counter is not None for number in sent),
        files=(origin.mapping, origin.dbc),
    )


def _acceleration_limits(
    wanted: mapping.Mapping, origin: Origin, commands: Commands
) -> AccelerationLimits | None:  # fmt: skip
    limits, number = wanted.limits, commands.acceleration
    if number is None:
        return None
    least = max(number.low, -(limits.deceleration_mps2 or math.inf))
    greatest = min(number.high, limits.acceleration_mps2 or math.inf)
    if not least < 0.0 < greatest:
        raise ConfigError(
            f"{origin.mapping}: command.acceleration: expected a wire that takes braking and driving, "
            f"got {least:g} to {greatest:g} m/s2"
        )
    return AccelerationLimits(least, greatest)
