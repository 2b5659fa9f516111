"""The doctor's checks of a rig: its documents, its lot, its receiver, the car's bus, and the path in the lot.

They only listen: nothing is sent on a real car's bus. The echo test is for a bus with a simulated vehicle alone.
"""

from __future__ import annotations

import contextlib
import datetime
import math
import select
import time
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

from vve_sumo.bus import Bus
from vve_sumo.commissioning import watchdog_record
from vve_sumo.commissioning.findings import Check, CheckReport, CheckResult, judged
from vve_sumo.drive.reasons import in_words
from vve_sumo.drive.resolved_scenario import ResolvedScenario
from vve_sumo.drive.virtual_road import pose_at_rest
from vve_sumo.errors import RigError
from vve_sumo.frames import Alignment, Placement
from vve_sumo.live import assembly, start_pose, start_simulated_vehicle
from vve_sumo.live.alignment import AVERAGING_TIME, MAX_STANDSTILL_SPEED, average_fixes, lot_alignment
from vve_sumo.lot.fit import corridor_excess, measured
from vve_sumo.pose.clock import AgeKind
from vve_sumo.pose.dating import FixDater, Undated
from vve_sumo.pose.receivers.port import CountedDecoder, Receiver
from vve_sumo.pose.sources import Source
from vve_sumo.pose.trust import Trust, TrustGate
from vve_sumo.rig import resolve as meaning
from vve_sumo.rig.dates import StatedDay, stated_days
from vve_sumo.rig.schema import Rig
from vve_sumo.rig.validation import PTY, arming_obstacle
from vve_sumo.values import Fix, Frame, identifier_text
from vve_sumo.vehicle.interface import (
    BrakeState,
    Gear,
    GearState,
    InterfaceFacts,
    SteeringState,
    ThrottleState,
    WheelSpeeds,
    YawRate,
    load,
)
from vve_sumo.vehicle.reports import CarReports

LISTENING_TIME: Final = 3.0  #: to receiver and bus [s]
POLL_INTERVAL: Final = 0.01  #: between two reads of them [s]
MAX_AGE_DAYS: Final = 365  #: an older test or calibration is noted
RATE_SHARE: Final = 0.9  #: lowest share of the declared fixes that must arrive
MAX_SHOWN: Final = 12  #: kinds of messages that are named, the most frequent first
IN_ORDER: Final = frozenset({"read", "fix", "other_message", "other_sentence"})  #: outcomes of messages and epochs
NO_COMMAND: Final = 0x7FE  #: identifier of the echo test: no shipped interface, receiver or radar uses it
ECHO_TIMEOUT: Final = 0.2  #: [s]

#: reports whose age the gateway checks
REPORTS: Final[dict[type, str]] = {
    BrakeState: "brake",
    ThrottleState: "throttle",
    SteeringState: "steering",
    GearState: "gear",
    WheelSpeeds: "wheels",
    YawRate: "yaw rate",
}


@dataclass(slots=True)
class Observed:
    """What was received from receiver and bus while listening."""

    dater: FixDater
    wall: float  #: GNSS second of drive time 0 by this machine's wall clock
    fixes: list[tuple[Fix, Trust]]  #: on the drive's clock; of a fix that cannot be dated the time is NaN
    frames: Counter[int]  #: by identifier
    ages: dict[int, float]  #: since the last frame of an identifier [s]
    troubles: Counter[str]  #: of the frames
    stale: list[str]  #: reports that were missing at the end
    reports: CarReports
    facts: InterfaceFacts  #: of the drive-by-wire interface
    counted: CountedDecoder | None  #: of a receiver that sends several kinds of messages

    @property
    def standing(self) -> list[Fix]:
        """The newest fixes in a row that are trusted and of a standing car."""
        row: list[Fix] = []
        for fix, trust in reversed(self.fixes):
            if not (trust.trusted and math.hypot(fix.velocity_north, fix.velocity_east) < MAX_STANDSTILL_SPEED):
                break
            row.append(fix)
        return row[::-1]


def examine(report: CheckReport, rig: Rig, resolved: ResolvedScenario | None, working: Path) -> None:
    """Make every possible check of a rig, and with a `resolved` scenario those of its path in the lot.

    The records that the rig names are looked up from `working`.
    """
    report.add(documents(rig, datetime.date.today()))
    report.add(watchdog_record.checks(rig, working))
    t0 = time.monotonic()
    with contextlib.ExitStack() as stack:
        receiver, source, bus = meaning.receiver_of(rig), None, None
        advice = "see that the adapter is there and its link up, bus.interface and bus.channel"
        # As in `open_receiver`: with the bus, the simulated vehicle is started.
        bus_first = rig.car == "simulated" and receiver.far_end_first
        if bus_first:
            bus = report.attempt("bus", advice, lambda: _bus(report, rig, t0, stack))
        if bus is not None or not bus_first:
            source = report.attempt("receiver", receiver.silent_hint, lambda: assembly.source_of(rig))
        if source is not None:
            stack.callback(source.close)
            report.add([Check("receiver", f"{rig.pose.kind}, {receiver.place()}")])
        if not bus_first and (source is not None or rig.car == "real"):
            bus = report.attempt("bus", advice, lambda: _bus(report, rig, t0, stack))
        observed = listen(rig, source, bus, t0)
    if bus is not None:
        report.add([Check("bus", bus.name), *bus_checks(observed)])
    if source is not None:
        report.add(sender_checks(source.sender_report()))
        report.add(pose_checks(rig, observed))
    if resolved is not None:
        advice = "vve-sumo align stores an alignment for this network"
        report.attempt("path in the lot", advice, lambda: report.add(path_checks(rig, resolved, observed)))


def documents(rig: Rig, today: datetime.date) -> Iterator[Check]:
    """Check what the rig file states: whether it may arm, the dates of tests and calibration, and the lot."""
    problem = arming_obstacle(rig, today)
    yield (
        Check("arming", "the rig may arm")
        if problem is None
        else Check(
            "arming",
            problem,
            CheckResult.NO_GO,
            "until then a drive runs with --shadow; docs/live.md tells how to test",
        )
    )
    days = {stated.key: stated for stated in stated_days(rig)}
    yield _watchdog(rig, days.get("watchdog_test.date"), today)
    if (calibrated := days.get("calibration.date")) is not None:
        yield _dated("calibration", f"of {calibrated.day}", calibrated, rig, today)
    elif rig.car == "real":
        model = rig.vehicle.model
        advice = f"pedals and steering are taken to be those of model {model}; vve-sumo calibrate finds this car's"
        yield Check("calibration", "none", CheckResult.NOTE, advice)
    lot, surveyed = meaning.lot_of(rig), days["lot.surveyed"]
    found = f"{lot.area:.0f} m2, {len(lot.holes)} holes, margin {lot.margin:g} m, grade {rig.lot.grade_percent:g} %"
    yield _dated("lot", f"{found}, surveyed {surveyed.day}", surveyed, rig, today)


def _watchdog(rig: Rig, stated: StatedDay | None, today: datetime.date) -> Check:
    test = rig.watchdog_test
    if test is None or stated is None:
        finding = CheckResult.NO_GO if rig.car == "real" else CheckResult.NOTE
        return Check("watchdog test", "none", finding, "docs/live.md tells how to make it")
    found = f"of {test.date}: {test.deceleration_mps2:g} m/s2 after {test.delay_s:g} s"
    dated = _dated("watchdog test", found, stated, rig, today)
    if test.armed or dated.finding is CheckResult.NO_GO:
        return dated
    advice = (
        "when the gateway itself dies, nobody brakes this car but its driver: have the watchdog of the drive-by-wire "
        "controller armed"
    )
    return Check("watchdog test", f"not armed, {dated.observed}", CheckResult.NOTE, advice)


def _dated(name: str, observed: str, stated: StatedDay, rig: Rig, today: datetime.date) -> Check:
    """Judge a day that the rig states; what a simulated vehicle's rig states does not grow old."""
    if stated.is_to_come(today):
        return Check(
            name, observed, CheckResult.NO_GO, "that day is still to come: correct the date, or this machine's clock"
        )
    age = (today - stated.day).days
    text = f"{observed}, {age} days ago"
    if stated.has_expired(today):
        table = stated.key.partition(".")[0]
        return Check(name, text, CheckResult.NO_GO, f"{table}.valid_days allows {stated.valid_days}: repeat it")
    young = rig.car == "simulated" or age <= MAX_AGE_DAYS
    return judged(name, text, young, "repeat it if anything was changed since", otherwise=CheckResult.NOTE)


def _bus(report: CheckReport, rig: Rig, t0: float, stack: contextlib.ExitStack) -> Bus:
    """Open the car's bus, after the simulated vehicle at its other end was started."""
    wire = rig.bus.interface, rig.bus.channel
    if rig.car == "simulated":
        report.add(echo(rig))
        car = start_simulated_vehicle.start(rig, t0, 1, stack, None)
        wire = car.bus if rig.bus.channel == PTY else wire
    return stack.enter_context(Bus(*wire, rig.bus.bitrate))


def echo(rig: Rig) -> Iterator[Check]:
    """Send one unused frame over a bus without a real car; a pty is left out, as its other end is not open yet."""
    start_pose, wanted = rig.car_start, rig.bus
    if wanted.channel == PTY or start_pose is None:
        return
    far = start_pose.channel or wanted.channel
    with Bus(wanted.interface, wanted.channel) as near_end, Bus(wanted.interface, far) as far_end:
        yield echoed(near_end, far_end)


def echoed(near_end: Bus, far_end: Bus) -> Check:
    """Check whether a frame gets from one end of a bus to the other."""
    sent, begun = Frame(NO_COMMAND, time.monotonic_ns().to_bytes(8, "big")), time.monotonic()
    near_end.send(sent)
    while (left := begun + ECHO_TIMEOUT - time.monotonic()) > 0.0:
        observed = far_end.receive(left)
        if observed is not None and observed[1] == sent:
            return Check("echo", f"a frame from {near_end.name} is heard on {far_end.name}")
    found = f"a frame from {near_end.name} is not heard on {far_end.name}"
    return Check("echo", found, CheckResult.NO_GO, "see that both are the same bus, at the same bitrate, and up")


def listen(rig: Rig, source: Source | None, bus: Bus | None, t0: float) -> Observed:
    """Listen to receiver and bus for LISTENING_TIME; a bus that fails shows as reports that are too old.

    Before, a receiver whose decoder takes its first fixes to be not locked is listened to for as long as that takes.
    """
    absolute, delay = assembly.absolute_epoch(rig, t0), assembly.minimum_delay_of(rig)
    interface = load(meaning.interface_of(rig))
    reports = CarReports(meaning.vehicle_of(rig).wheel_radius, interface)
    dater = FixDater(delay, math.nan if absolute is None else absolute, absolute=absolute is not None)
    wall = assembly.wall_epoch(t0)
    receiver = meaning.receiver_of(rig)
    decoder = receiver.decoder()
    counted = decoder if isinstance(decoder, CountedDecoder) else None
    observed = Observed(dater, wall, [], Counter(), {}, Counter(), [], reports, interface.facts, counted)
    gate: TrustGate | None = None
    last: dict[int, float] = {}
    if source is not None:
        source.receive()  # portions that arrived while the rest was opened are not counted
        settled = time.monotonic() + receiver.settling_time
        while time.monotonic() < settled:
            for stamp, data in source.receive():
                decoder.feed(data, stamp - t0)
            _drained(bus)
            select.select([source] if not source.lost else [], [], [], POLL_INTERVAL)
    _drained(bus)
    end = time.monotonic() + LISTENING_TIME
    while (now := time.monotonic()) < end:
        for stamp, data in source.receive() if source else []:
            for fix in decoder.feed(data, stamp - t0):
                dated = dater.date(stamp - t0, fix)
                if isinstance(dated, Undated):
                    observed.fixes.append((replace(fix, time=math.nan), Trust(False, (dated.reason,))))
                    continue
                gate = gate or TrustGate(receiver.profile, dater.epoch)
                observed.fixes.append((dated, gate.step(stamp - t0, dated)))
        frames = _drained(bus)
        observed.frames.update(frame.id for frame in frames)
        last |= dict.fromkeys((frame.id for frame in frames), now)
        observed.troubles.update(reports.take(now, frames))
        select.select([source] if source and not source.lost else [], [], [], POLL_INTERVAL)
    now = time.monotonic()
    observed.stale, observed.ages = reports.stale(now), {number: now - then for number, then in last.items()}
    return observed


def _drained(bus: Bus | None) -> list[Frame]:
    try:
        return bus.drain() if bus is not None else []
    except RigError:
        return []


def bus_checks(observed: Observed) -> Iterator[Check]:
    """Judge what was received on the car's bus."""
    reports, frames = observed.reports, observed.frames
    carriers = [(name, _carrying(kind, observed.facts)) for kind, name in REPORTS.items()]
    rates = [f"{name} {sum(frames[number] for number in ids) / LISTENING_TIME:.0f}" for name, ids in carriers]
    ages = [observed.ages[number] for _name, ids in carriers for number in ids if number in observed.ages]
    oldest = max((1e3 * age for age in ages), default=math.nan)
    found = f"{sum(frames.values()) / LISTENING_TIME:.0f} frames/s ({', '.join(rates)}), the oldest {oldest:.0f} ms old"
    advice = "see ignition, cable, termination and bus.bitrate" if not frames else _in_words(observed.stale)
    yield judged("reports", found, not observed.stale, advice)
    if not frames:
        return
    others = sorted(observed.facts.commands & frames.keys())
    names = ", ".join(f"{identifier_text(number)} {frames[number] / LISTENING_TIME:.0f}/s" for number in others)
    advice = "another program or node commands this car: end it, only one may"
    yield judged("commands", f"heard from others: {names or 'none'}", not others, advice)
    malformed = observed.troubles["report_malformed"]
    yield judged(
        "understood", f"{malformed} malformed", not malformed, "see drive_by_wire, and who else is on this bus"
    )
    yield from _interface_checks(reports)


def _carrying(kind: type, facts: InterfaceFacts) -> list[int]:
    return [number for number, kinds in facts.reports.items() if kind in kinds]


def _interface_checks(reports: CarReports) -> Iterator[Check]:
    faults = reports.faults()
    yield judged("faults", ", ".join(faults) or "none", not faults, _in_words(faults))
    enabled = reports.any_enabled()
    found = "the drive-by-wire controller is enabled" if enabled else "nothing is enabled"
    advice = "another program has the car: end it, or restart the drive-by-wire controller"
    yield judged("enabled", found, not enabled, advice)
    overrides = sorted(reports.overrides())
    found = f"latched: {', '.join(overrides) or 'none'}"
    yield judged("overrides", found, not overrides, "engaging clears them", otherwise=CheckResult.NOTE)
    gear = reports.gear.gear
    advice = "in D the driver's brake has to hold the car until it is taken over"
    in_drive = CheckResult.NOTE if gear is Gear.DRIVE else CheckResult.NO_GO
    advice = advice if gear is Gear.DRIVE else "shift to P"
    yield judged("gear", gear.name.lower(), gear is Gear.PARK, advice, otherwise=in_drive)
    speed = reports.fastest_wheel
    yield judged("wheels", f"{speed:.2f} m/s", abs(speed) < MAX_STANDSTILL_SPEED, "a drive begins at standstill")


def _in_words(codes: list[str]) -> str:
    return "; ".join(in_words(code) for code in codes)


def sender_checks(report: Mapping[str, Any]) -> Iterator[Check]:
    """Judge who sent to the receiver's port, by the source's report; no check for a source with one possible sender."""
    if not report:
        return
    refused = ", ".join(f"{count} datagrams of {sender}" for sender, count in report["refused"].items())
    advice = "end the other sender, or correct pose.source; docs/live.md tells how the receiver gets a link of its own"
    yield judged("sender", f"{report['sender'] or 'none'}; refused: {refused or 'none'}", not refused, advice)


def pose_checks(rig: Rig, observed: Observed) -> Iterator[Check]:
    """Judge the receiver's messages and fixes."""
    if observed.counted is not None:
        yield message_check(observed.counted, rig.pose.rate_hz)
    rate = len(observed.fixes) / LISTENING_TIME
    receiver, found = meaning.receiver_of(rig), f"{rate:.0f} fixes/s, the rig says {rig.pose.rate_hz:g}"
    if not observed.fixes:
        yield Check("fixes", f"none in {LISTENING_TIME:g} s", CheckResult.NO_GO, receiver.silent_hint)
        return
    advice = "correct pose.rate_hz, or look for what loses packets on the way"
    yield judged("fixes", found, rate >= RATE_SHARE * rig.pose.rate_hz, advice)
    yield from _quality(receiver, observed)
    yield _age(rig, observed)


def message_check(decoder: CountedDecoder, rate: float) -> Check:
    """Check which messages came, how often and in which order, and which of the needed ones are missing.

    `rate` is that of fixes, by the rig [1/s]. What went wrong with messages and epochs is counted by its outcome.
    """
    census = decoder.census
    rates = ", ".join(f"{name} {count / LISTENING_TIME:.3g}/s" for name, count in census.counts.most_common(MAX_SHOWN))
    order = " ".join(dict.fromkeys(census.epoch()))
    wrong = ", ".join(f"{count} {one}" for one, count in decoder.counts.items() if count and one not in IN_ORDER)
    found = "; ".join([rates or "none", *([f"in the order {order}"] if order else []), *([wrong] if wrong else [])])
    missing = list(census.missing(census.counts, RATE_SHARE * rate * LISTENING_TIME))
    return judged("messages", found, not missing, "; ".join(missing))


def _quality(receiver: Receiver, observed: Observed) -> Iterator[Check]:
    """Check whether a car could drive on the fixes of the last second, and whether it stands."""
    newest = observed.fixes[-1][0]
    found = (
        f"{'locked' if newest.locked else 'not locked'}, {newest.quality}; 1 sigma {newest.position_sigma:.3f} m, "
        f"{newest.velocity_sigma:.3f} m/s, {math.degrees(newest.heading_sigma):.2f} deg; "
        f"corrections {newest.differential_age:.1f} s old"
    )
    last = [trust for fix, trust in observed.fixes if fix.time_received > newest.time_received - 1.0]
    against = Counter(code for trust in last for code in trust.reasons)
    hints = [receiver.not_fixed_hint] if "not_rtk_fixed" in against else []
    advice = "; ".join([_in_words([code for code, _count in against.most_common(4)]), *hints])
    yield judged("fix", found, not against, advice)
    speed = math.hypot(newest.velocity_north, newest.velocity_east)
    yield judged("standing", f"{speed:.3f} m/s", bool(observed.standing), "the car has to stand, with fixes to trust")


def _age(rig: Rig, observed: Observed) -> Check:
    """Check how old fixes are when they arrive, with the offset and drift of the clocks."""
    report, epoch = observed.dater.report(), observed.dater.epoch
    ages = [1e3 * (fix.time_received - (fix.time - epoch)) for fix, _trust in observed.fixes if math.isfinite(fix.time)]
    if report is None or not ages:
        return Check(
            "age", "not known: no locked fix says the time", CheckResult.NO_GO, "wait until the receiver is locked"
        )
    drift = "drift known after 10 s" if math.isnan(report.drift_ppm) else f"drift {report.drift_ppm:.1f} ppm"
    ahead = observed.wall - observed.dater.measured_epoch
    found = (
        f"{min(ages):.1f} to {max(ages):.1f} ms old ({report.age}), jitter {1e3 * report.jitter_p50:.1f} ms, "
        f"p99 {1e3 * report.jitter_p99:.1f} ms; this machine's clock {ahead:+.3f} s from GNSS, {drift}"
    )
    if report.age is AgeKind.DECLARED and rig.pose.minimum_delay_ms == 0.0:
        return Check("age", found, CheckResult.NOTE, "pose.minimum_delay_ms is 0: no fix takes no time at all")
    advice = f"later than latency.deadline_ms, {rig.latency.deadline_ms:g} ms: such ticks run on prediction"
    in_time = report.jitter_p99 <= rig.latency.deadline_ms / 1000.0
    return judged("age", found, in_time, advice, otherwise=CheckResult.NOTE)


def path_checks(rig: Rig, resolved: ResolvedScenario, observed: Observed) -> Iterator[Check]:
    """Judge how the path lies in the lot, and where on it the car stands.

    Raises ConfigError for an alignment that was made for another network.
    """
    stored, standing = meaning.alignment_of(rig, resolved.scenario.road.network), observed.standing
    frame, mounting = meaning.frame_of(rig), meaning.mounting_of(rig)
    epoch = observed.dater.measured_epoch
    begin = resolved.path.at(0.0)
    if stored is None:
        if not standing or standing[-1].time - standing[0].time < AVERAGING_TIME:
            advice = (
                f"where it lies follows from where the car stands: {AVERAGING_TIME:g} s of fixes to trust are needed"
            )
            yield Check("path in the lot", "not known", CheckResult.NO_GO, advice)
            return
        place = pose_at_rest(begin.x, begin.y, begin.heading)
        stored = lot_alignment(average_fixes(epoch, standing), frame, mounting, place, None).alignment
    elif standing:
        yield _at_the_start(resolved, Placement(frame, stored, mounting, epoch), epoch, standing)
    yield _in_the_lot(rig, resolved, stored)


def _in_the_lot(rig: Rig, resolved: ResolvedScenario, alignment: Alignment) -> Check:
    geofence, path, speed = meaning.geofence_of(rig, Alignment()), resolved.path, resolved.scenario.ego.speed_mps
    found = measured(path, geofence, speed, alignment, resolved.corridor)
    advice = "vve-sumo align --fit looks for a place where it fits, or where to cut it short"
    if found is not None and found.whole:
        what = "fits with its corridor" if resolved.corridor else "fits"
        return Check("path in the lot", f"{what}, {found.clearance:.1f} m clear of every edge beyond the margin")
    excess = corridor_excess(path, geofence, speed, alignment, resolved.corridor) if resolved.corridor else None
    if excess is not None:
        return Check("path in the lot", excess.text(), CheckResult.NO_GO, f"{advice}; or declare a narrower corridor")
    if found is None:
        return Check("path in the lot", "not even its start is inside", CheckResult.NO_GO, advice)
    message = f"from {found.last_s:.0f} m of {path.length:.0f} m on, the car could not stop inside"
    return Check("path in the lot", message, CheckResult.NO_GO, advice)


def _at_the_start(resolved: ResolvedScenario, placement: Placement, epoch: float, standing: list[Fix]) -> Check:
    """Check where the car stands on a path whose place in the lot is fixed."""
    stands = start_pose.start_pose_of(placement.place(average_fixes(epoch, standing).fix), resolved.path)
    found = f"the car stands {stands.place_text()}, {stands.turn_text()}"
    advice = (
        f"drive it there, within {start_pose.MAX_START_DISTANCE:g} m and "
        f"{math.degrees(start_pose.MAX_START_TURN):g} deg, facing along the path; "
        "or, where it is to start here, vve-sumo align"
    )
    return judged("start", found, not stands.faults(), advice)
