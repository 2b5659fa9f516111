"""Checks of a drive-by-wire interface against its simulated other end: handshake, driver, time-outs, counters, faults.

Each is one row of a table. They show what gateway and interface do together on this wire, and not what a real
controller does: that is tried on the car (docs/live.md).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Mapping
from typing import Any, Final

from vve_sumo.commissioning.findings import Check, CheckResult, judged
from vve_sumo.commissioning.interface_bench import HELD, NEUTRAL, SUBSYSTEMS, Bench
from vve_sumo.commissioning.interface_drive import Drive
from vve_sumo.timing import MAX_GEAR_REPORT_AGE, MAX_REPORT_AGE
from vve_sumo.values import ArmingState, Frame, identifier_text
from vve_sumo.vehicle.engagement import HANDSHAKE_TIME, SHIFT_TIME
from vve_sumo.vehicle.interface import (
    INTERFACE_KINDS,
    REQUIRED,
    DriverInputs,
    Gear,
    GearState,
    Malformed,
    VehicleInterface,
    WhenCommandsStop,
    error_text,
)
from vve_sumo.vehicle.model import VehicleModel

#: Share of the oldest age that the gateway allows at which reports have to come.
RATE_SHARE: Final = 0.6
BRAKE, THROTTLE = DriverInputs(brake_pedal=0.40), DriverInputs(throttle_pedal=0.40)
LEFT, RIGHT = DriverInputs(steering_torque=5.0), DriverInputs(steering_torque=-5.0)
HANDS: Final = {
    "brake pedal": BRAKE,
    "throttle pedal": THROTTLE,
    "wheel to the left": LEFT,
    "wheel to the right": RIGHT,
}
#: Reason codes of which one has to be among those that the gateway stops for, for each kind that can be injected.
STOPS_FOR: Final[Mapping[str, tuple[str, ...]]] = {
    "brake_fault": ("brake_fault",),
    "throttle_fault": ("throttle_fault",),
    "steering_fault": ("steering_fault",),
    "report_malformed": ("report_malformed",),
    "steering_report_frozen": ("steering_report_frozen", "steering_mismatch", "steering_not_following"),
    "brake_report_frozen": ("brake_report_frozen",),
    "throttle_report_frozen": ("throttle_report_frozen",),
    "override_false": ("override_unconfirmed",),
}


def checks(model: VehicleModel) -> Iterator[Check]:
    """Check the interface of a vehicle model; raises ConfigError where it cannot be made or has no simulated end.

    An interface whose own code raises fails the check that it raised in.
    """
    bench = Bench(model.interface, model.calibration)
    yield Check("interface", _facts(bench))
    for name, check in _CHECKS.items():
        try:
            yield from check(model)
        except Exception as error:  # of the interface under test
            yield Check(name, f"its code raised {error_text(error)}", CheckResult.NO_GO, "correct the interface")


def _facts(bench: Bench) -> str:
    facts = bench.interface.facts
    if facts.acceleration_limits is None:
        takes = f"brake torque to {facts.brake_torque_limit:g} N m and throttle"
    else:
        takes = f"acceleration, {facts.acceleration_limits.minimum:g} to {facts.acceleration_limits.maximum:g} m/s2"
    wheel = f"steering wheel to {math.degrees(facts.wheel_angle_limit):.0f} deg"
    return f"{facts.title}: {takes}; {wheel}; commands {', '.join(map(identifier_text, sorted(facts.commands)))}"


def _reports(model: VehicleModel) -> Iterator[Check]:
    bench = _bench(model)
    bench.run(3.0, NEUTRAL)
    for kind in sorted(REQUIRED, key=lambda one: one.__name__):
        limit = MAX_GEAR_REPORT_AGE if kind is GearState else MAX_REPORT_AGE
        times = [0.0, *bench.times.get(kind, ()), bench.now]
        gap = max(two - one for one, two in itertools.pairwise(times))
        found = f"{kind.__name__} every {1e3 * gap:.0f} ms at most, allowed {1e3 * limit:.0f}"
        yield judged("reports", found, gap <= RATE_SHARE * limit, "the gateway would call it stale now and then")
    lengths = ", ".join(map(identifier_text, sorted(bench.malformed)))
    yield judged(
        "understood", f"malformed: {lengths or 'none'}", not bench.malformed, "simulated end and decode differ"
    )


def _handshake(model: VehicleModel) -> Iterator[Check]:
    bench = _bench(model)
    bench.run(0.5, None)
    bench.run(0.5, NEUTRAL)
    quiet = not any(bench.enabled()) and not any(bench.end.enabled)
    yield judged("enable", "nothing is enabled before it is commanded", quiet, "it is enabled without a command")
    begun = bench.now
    while not all(bench.enabled()) and bench.now - begun < 2.0 * HANDSHAKE_TIME:
        bench.run(0.02, HELD)
    took = bench.now - begun
    found = f"brake, throttle and steering enabled after {1e3 * took:.0f} ms, allowed {1e3 * HANDSHAKE_TIME:.0f}"
    yield judged("enable", found, all(bench.enabled()) and took <= HANDSHAKE_TIME, "no module may stay behind")
    for gear in (Gear.DRIVE, Gear.PARK):
        begun = bench.now
        while bench.newest[GearState].gear is not gear and bench.now - begun < SHIFT_TIME:
            bench.run(0.02, HELD._replace(gear=gear))
        shifted = bench.newest[GearState].gear is gear
        found = f"{gear.name.lower()} confirmed after {bench.now - begun:.2f} s, allowed {SHIFT_TIME:g}"
        yield judged("gear", found, shifted, "at rest, on the brakes, the shifter has to follow")


def _override(model: VehicleModel) -> Iterator[Check]:
    for name, hands in HANDS.items():
        bench = _engaged(model)
        bench.run(0.3, HELD, hands)
        took = _overridden(bench) and not all(bench.end.enabled)
        bench.run(0.3, HELD)
        kept = _overridden(bench) and not all(bench.end.enabled)
        bench.run(0.1, NEUTRAL._replace(clear=True))
        cleared = not _overridden(bench)
        found = f"{name}: takes the car {_yes(took)}, keeps it {_yes(kept)}, until a clear {_yes(cleared)}"
        yield judged("override", found, took and kept and cleared, "the driver's foot and hand have to win, and latch")


def _timeouts(model: VehicleModel) -> Iterator[Check]:
    bench = _engaged(model)
    facts = bench.interface.facts
    timeout, stops = facts.command_timeout, facts.when_commands_stop
    bench.run(0.6 * timeout, None)
    early = not all(bench.end.enabled)
    bench.run(0.4 * timeout + 0.05, None)
    goes_on = stops.action is WhenCommandsStop.HOLDS
    late = any(bench.end.enabled) is not goes_on
    found = f"without commands for {1e3 * timeout:.0f} ms it {stops.action.value}: {stops.words}"
    yield judged("time-out", found, not early and not late, f"it acts {'too early' if early else 'otherwise'}")
    braking = bench.end.watchdog_braking is (stops.action is WhenCommandsStop.BRAKES)
    brakes = "brakes by itself" if bench.end.watchdog_braking else "does not brake by itself"
    yield judged("watchdog", f"then it {brakes}", braking, "facts.when_commands_stop says otherwise")
    if stops.action is not WhenCommandsStop.BRAKES:
        advice = "when the gateway dies, nobody brakes this car but its driver"
        yield Check("watchdog", stops.action.value, CheckResult.NOTE, advice)


def _counters(model: VehicleModel) -> Iterator[Check]:
    bench = _engaged(model)
    facts = bench.interface.facts
    if not facts.counts:
        advice = "a program that has frozen behind its driver looks alive to such a car"
        yield Check("counter", "none on this wire", CheckResult.NOTE, advice)
        return
    sent = [bench.interface.encode(NEUTRAL) for _ in range(600)]
    runs = all(one != two for one, two in itertools.pairwise(sent))
    yield judged("counter", "no two of 600 steps are alike", runs, "the counter has to count once a step")
    bench = _engaged(model)
    bench.repeat(facts.command_timeout + 0.1, bench.interface.encode(HELD))
    found = f"a counter that stands still: {'lets go' if not any(bench.end.enabled) else 'goes on'}"
    goes_on = facts.when_commands_stop.action is WhenCommandsStop.HOLDS
    yield judged("counter", found, goes_on or not all(bench.end.enabled), "the simulated end does not look at it")


def _values(model: VehicleModel) -> Iterator[Check]:
    interface = _bench(model).interface
    facts = interface.facts
    limits = facts.acceleration_limits
    taken = ("brake_torque", "throttle") if limits is None else ("acceleration",)
    passed = [
        name
        for name in (*taken, "wheel_angle", "wheel_rate")
        for value in (math.nan, math.inf, -math.inf)
        if not _refused(interface, name, value)
    ]
    found = f"NaN and infinity refused, but for {passed[0]}" if passed else "NaN and infinity are refused"
    yield judged("values", found, not passed, "encode has to raise ValueError")
    beyond = {"wheel_angle": 1.01 * facts.wheel_angle_limit, "wheel_rate": 1.01 * facts.wheel_rate_limit}
    if limits is None:
        beyond |= {"brake_torque": 1.01 * facts.brake_torque_limit, "throttle": 1.01}
    else:
        beyond |= {"acceleration": 1.01 * limits.minimum}
    clipped = [name for name, value in beyond.items() if not _refused(interface, name, value)]
    found = f"beyond the range of {', '.join(clipped)} nothing is refused" if clipped else "beyond a range is refused"
    yield judged("values", found, not clipped, "encode has to raise ValueError, and to clip nothing")


def _garbled(model: VehicleModel) -> Iterator[Check]:
    """Frames that are cut short, and ones with a wrong bit."""
    bench = _engaged(model)
    sealed: list[str] = []
    unsealed: list[str] = []
    for frame in _newest_frames(bench):
        short = bench.interface.decode(Frame(frame.id, frame.data[:-1]))
        if not isinstance(short, Malformed):
            yield Check("length", f"{identifier_text(frame.id)} is read one byte short", CheckResult.NO_GO, "refuse it")
        wrong = bench.interface.decode(Frame(frame.id, bytes([frame.data[0] ^ 1, *frame.data[1:]])))
        (sealed if isinstance(wrong, Malformed) else unsealed).append(identifier_text(frame.id))
    found = f"a wrong bit shows in {', '.join(sealed) or 'no report'}; not in {', '.join(unsealed) or 'none'}"
    advice = "these have no checksum: the monitors have to find it" if unsealed else ""
    yield Check("checksum", found, CheckResult.NOTE if unsealed else CheckResult.GO, advice)


def _fault_bits(model: VehicleModel) -> Iterator[Check]:
    """What the simulated end can inject, each under way; and which kinds this wire cannot tell."""
    injectable = _bench(model).end.injectable
    for kind, codes in STOPS_FOR.items():
        if kind not in injectable:
            continue
        drive = Drive(model)
        drive.engage()
        drive.run(3.0, 1.5)
        drive.inject(kind, 1.0)
        drive.swerve(1.5)
        stopped = drive.state is not ArmingState.ENGAGED and not set(codes).isdisjoint(drive.reasons)
        found = f"{kind}: {drive.state.value}, {', '.join(drive.reasons) or 'no reason'}"
        if kind == "override_false" and "driver_override" in drive.reasons:
            advice = "this wire has nothing that confirms an override: a false one lets the car go"
            yield Check("fault bit", found, CheckResult.NOTE, advice)
            continue
        yield judged("fault bit", found, stopped, f"the gateway has to stop with {' or '.join(codes)}")
    untold = sorted(INTERFACE_KINDS.keys() - injectable)
    advice = "rows of docs/faults.md with them are refused on this wire"
    found = ", ".join(untold) or "none"
    yield Check("fault bit", f"not told by this wire: {found}", CheckResult.NOTE if untold else CheckResult.GO, advice)


def _stale(model: VehicleModel) -> Iterator[Check]:
    facts = _bench(model).interface.facts
    needed = [number for number, kinds in facts.reports.items() if not REQUIRED.isdisjoint(kinds)]
    for number in needed:
        drive = Drive(model)
        drive.engage()
        drive.run(3.0, 1.5)
        drive.withheld = frozenset({number})
        drive.run(0.4, 0.0)
        stale = [code for code in drive.reasons if code.endswith("_stale")]
        found = f"without {identifier_text(number)}: {drive.state.value}, {', '.join(stale) or 'nothing noticed'}"
        yield judged("stale", found, drive.state is not ArmingState.ENGAGED and bool(stale), "it has to be missed")


def _driven(model: VehicleModel) -> Iterator[Check]:
    drive = Drive(model)
    drive.engage()
    drive.run(4.0, 1.5)
    fastest = drive.speed
    drive.run(6.0, -2.0)
    stands = drive.speed == 0.0 and drive.state is ArmingState.ENGAGED
    drive.end()
    drive.run(5.0, 0.0)
    parked = drive.gear is Gear.PARK and drive.gateway.done
    found = f"drives off to {fastest:.1f} m/s, stops {_yes(stands)}, parks {_yes(parked)}"
    yield judged("drive", found, fastest > 3.0 and stands and parked, f"reasons: {', '.join(drive.reasons)}")
    drive = Drive(model)
    drive.engage()
    drive.run(3.0, 1.5)
    drive.run(0.3, 0.0, driver=BRAKE)
    gone = drive.state is ArmingState.FAULT and "driver_override" in drive.reasons and not any(drive.enabled)
    yield judged("driver", f"takes the car from the gateway {_yes(gone)}", gone, f"reasons: {', '.join(drive.reasons)}")
    drive = Drive(model)
    drive.engage()
    drive.run(2.0, 1.5)
    drive.intrude()
    seen = drive.state is ArmingState.STOPPING and "another_writer" in drive.reasons
    yield judged("intruder", f"another sender of the commands is noticed {_yes(seen)}", seen, "see facts.commands")


_CHECKS: Final[dict[str, Callable[[VehicleModel], Iterator[Check]]]] = {
    "reports": _reports,
    "enable": _handshake,
    "values": _values,
    "counter": _counters,
    "time-out": _timeouts,
    "override": _override,
    "checksum": _garbled,
    "fault bit": _fault_bits,
    "stale": _stale,
    "drive": _driven,
}


def _bench(model: VehicleModel) -> Bench:
    return Bench(model.interface, model.calibration)


def _engaged(model: VehicleModel) -> Bench:
    bench = _bench(model)
    bench.run(0.1, NEUTRAL)
    bench.run(HANDSHAKE_TIME, HELD)
    return bench


def _overridden(bench: Bench) -> bool:
    return any(bench.newest[kind].override for kind in SUBSYSTEMS)


def _newest_frames(bench: Bench) -> list[Frame]:
    """Return a report frame of each identifier, as the simulated end sends it next."""
    frames: dict[int, Frame] = {}
    for _ in range(20):
        bench.run(0.005, HELD)
        frames |= {frame.id: frame for frame in bench.end.reports(bench.measured)}
    return [frames[number] for number in sorted(frames) if number in bench.interface.facts.reports]


def _refused(interface: VehicleInterface, name: str, value: float) -> bool:
    try:
        changes: dict[str, Any] = {name: value}
        interface.encode(NEUTRAL._replace(**changes))
    except ValueError:
        return True
    return False


def _yes(good: bool) -> str:
    return "(yes)" if good else "(NO)"
