"""Runs a live drive from names to its record and summary: starts the processes, waits for their end, adds the verdict.

Prints nothing: the caller hands in where messages go.
"""

from __future__ import annotations

import contextlib
import datetime
import json
import time
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Final, TextIO

from vve_sumo import workspace
from vve_sumo.drive import plugged_in, provenance
from vve_sumo.drive.assembly import LotAlignment, sensors_of
from vve_sumo.drive.gain_region import delay_of, refuse_outside
from vve_sumo.drive.run import new_run_folder, resolve_by_name
from vve_sumo.drive.several_egos import require_one_ego
from vve_sumo.drive.summary import EXTERNAL_CONTROLLER, without_verdict
from vve_sumo.drive.summary import summarise as summarise_drive
from vve_sumo.drive.termination import DriveEnd, Outcome
from vve_sumo.drive.virtual_road import pose_at_rest
from vve_sumo.errors import ConfigError, RigError, VveError
from vve_sumo.live import assembly, optional_processes, spawn, start_simulated_vehicle
from vve_sumo.live.alignment import lot_alignment
from vve_sumo.live.brain_link import key_of, refuse_controller
from vve_sumo.live.channel import pair
from vve_sumo.live.console import Console, ProcessGroup
from vve_sumo.live.keys import OperatorInput
from vve_sumo.live.optional_processes import Notify
from vve_sumo.live.plan import DrivePlan
from vve_sumo.live.priority import Rights, lower_priority, rights
from vve_sumo.live.rehearsal import rehearsed
from vve_sumo.live.screen import Screen
from vve_sumo.live.summary import summarise
from vve_sumo.live.view_token import certificate_of, token_of
from vve_sumo.live.virtual_can import hardware_obstacle
from vve_sumo.people import consent
from vve_sumo.pose.sources import Source
from vve_sumo.record.hashes import hash_file
from vve_sumo.record.reader import read_table
from vve_sumo.record.roads import write_roads
from vve_sumo.record.summary import SUMMARY_HASH_KEY, write_summary
from vve_sumo.record.writer import claim
from vve_sumo.rig import load as rigs
from vve_sumo.rig import resolve as meaning
from vve_sumo.rig.lock import rig_lock
from vve_sumo.rig.validation import PTY, arming_obstacle
from vve_sumo.scenario.schema import EndTrigger
from vve_sumo.view.words import verdict_of

#: time for a process to end by itself after the drive [s]; the recorder writes its tables in this time
EXIT_TIMEOUT: Final = 60.0
#: characters of a person's name, at most
MAX_NAME_LENGTH: Final = 100


def plan(
    scenario: str,
    rig: str,
    working: Path,
    *,
    out: Path | None,
    seed: int | None,
    controller: str | None,
    shadow: bool,
    speed: float | None = None,
    values: Mapping[str, Any] | None = None,
    view: bool = False,
    rehearse: Path | None = None,
) -> DrivePlan:
    """Find scenario and rig by name and refuse what nobody should drive with; opens no device and writes nothing.

    With `rehearse` a real car's rig is put on simulated wires, links to which are made in that folder.

    Raises ConfigError for what is wrong in a file, RigError for a rig that may not command a car.
    """
    rig_file = workspace.find("rig", rig, working)
    loaded = rigs.load(rig_file, working)
    notes: tuple[str, ...] = ()
    if rehearse is not None:
        whole = resolve_by_name(scenario, working, speed=speed, values=values)
        loaded, notes = rehearsed(meaning.with_alignment_for(loaded, whole.name), rig_file, whole, rehearse)
    if shadow and loaded.brain.kind == "external":
        raise ConfigError(
            f"--shadow: brain.kind of {rig_file} is 'external': it alone sets the enable bits; leave it out"
        )
    if not shadow and (reason := arming_obstacle(loaded, datetime.date.today())) is not None:
        raise RigError(f"{rig_file}: {reason}; --shadow drives along with nothing enabled")
    if (reason := hardware_obstacle(loaded)) is not None:
        raise RigError(f"{rig_file}: {reason}")
    refuse_controller(loaded, controller)
    key_of(loaded.brain, working)  # raises for one that cannot be read
    if view:
        token_of(loaded.view, working)
        certificate_of(loaded.view, working)
    if loaded.people:
        token_of(loaded.people_page, working, "people_page")
        certificate_of(loaded.people_page, working)
    resolved = resolve_by_name(scenario, working, seed=seed, controller=controller, speed=speed, values=values)
    loaded = loaded if rehearse is not None else meaning.with_alignment_for(loaded, resolved.name)
    require_one_ego(resolved, "a live drive has one real car, which is [ego]'s, and no simulated ones beside it")
    try:
        resolved = assembly.scenario_with_rig(resolved, loaded, working)
    except ConfigError as error:
        raise ConfigError(f"{workspace.find('scenario', scenario, working)}: {error}") from None
    if not shadow and loaded.brain.kind == "own":
        refuse_outside(resolved, working, delay_of(loaded))
    folder = (out if out is not None else new_run_folder(resolved.name, working)).absolute()
    claim(folder)
    scenario_file = workspace.find("scenario", scenario, working).absolute()
    return DrivePlan(
        resolved, scenario_file, loaded, rig_file, folder, working, shadow, time.monotonic(), view=view, rehearsal=notes
    )


def named(plan: DrivePlan, operator: str | None, driver: str | None) -> DrivePlan:
    """Return a plan with who is at the console and who sits behind the wheel; drive time begins now."""
    return replace(plan, operator=operator, driver=driver, t0=time.monotonic())


def person_name(role: str, typed: str) -> str:
    """Return the name of a person in this role as the record keeps it; raises ConfigError for what is no name."""
    name = typed.strip()
    if not name or len(name) > MAX_NAME_LENGTH or not name.isprintable():
        raise ConfigError(
            f"--{role}: expected a name of 1 to {MAX_NAME_LENGTH} printable characters, got {name[:80]!r}"
        )
    return name


def _provenance(plan: DrivePlan, doctor: Mapping[str, Any], permitted: Rights) -> str:
    """Return the text of the record's provenance file."""
    now = datetime.datetime.now(datetime.UTC)
    document = provenance.provenance(plan.resolved, now.isoformat(timespec="seconds"))
    document |= {"rig_file_sha256": hash_file(plan.rig_file), "operator": plan.operator, "driver": plan.driver}
    return provenance.text_of(document | {"doctor": dict(doctor), "rights": permitted._asdict()})


def run(plan: DrivePlan, doctor: Mapping[str, Any], terminal: TextIO, notify: Notify) -> dict[str, Any]:
    """Drive a plan to its end and return its summary; raises VveError where it never began.

    `doctor` is the doctor's last result on the rig, for the record. The console draws on `terminal` while the drive
    goes on; messages before and after it go to `notify`.
    """
    # Raises for an unusable controller or sensor before anything is started.
    plan.resolved.controller(plan.working)
    sensors_of(plan.resolved)
    if plan.resolved.scenario.end_trigger != EndTrigger():
        notify("the scenario's [end_trigger] does not apply to a live drive: nothing lets go of a moving car")
    permitted = rights()
    if lacking := permitted.lacking():
        notify(lacking)
    with contextlib.ExitStack() as page:
        console = _driven(plan, doctor, permitted, terminal, notify, page)
        if console.refused is not None and not _drove(plan.folder):
            raise optional_processes.error_of(console.refused)
        summary = _summary(plan, console.why, notify)
        console.processes.end_view(verdict_of(summary))
        return summary


def _driven(
    plan: DrivePlan,
    doctor: Mapping[str, Any],
    permitted: Rights,
    terminal: TextIO,
    notify: Notify,
    page: contextlib.ExitStack,
) -> Console:
    """Drive a plan to its end, from the rig's lock to the end of all processes but the page's, which `page` ends."""
    with (
        rig_lock(plan.rig_file, plan.rig) as locks,
        contextlib.ExitStack() as stack,
        OperatorInput(listen=not plan.rig.operator.automatic) as keys,
    ):
        scenario = plan.resolved.scenario
        try:
            source, car = start_simulated_vehicle.open_receiver(
                plan.rig, plan.t0, scenario.seed, stack, plan.folder, scenario.weather.friction
            )
        except RigError:
            _remove_begun(plan.folder)
            raise
        plan.folder.mkdir(parents=True, exist_ok=True)
        ground = _measure_alignment(plan, source, notify)
        scenario_content = plan.resolved.to_dict(plan.working) | ground.to_dict()
        scenario_content |= assembly.to_dict(plan.resolved, plan.scenario_file, plan.rig_file.stem, plan.rig)
        scenario_content["gateway"]["shadow"] = plan.shadow
        if (stations := assembly.stations_setup(plan.resolved, plan.rig, ground)) is not None:
            scenario_content["stations"] = stations.to_dict()
        if any(person.pages for person in plan.resolved.people):
            scenario_content["people_consent"] = consent.TEXT
        scenario_content["files_sha256"] |= plugged_in.digests(plugged_in.receiver(plan.rig.pose.kind).files())
        _write_roads(plan, notify)
        processes = _processes(plan, scenario_content, _provenance(plan, doctor, permitted), ground, car, notify, locks)
        page.callback(_end_page, plan, processes)
        screen = Screen(terminal)
        overridden = str(doctor.get("override", ""))
        console = Console(processes, keys, screen, plan.rig.operator.automatic, overridden)
        try:
            lower_priority()
            _note_processes(plan, processes)
            console.run()
        finally:
            screen.close()
            processes.shutdown(EXIT_TIMEOUT)
            stack.pop_all()
    return console


def _remove_begun(folder: Path) -> None:
    """Remove the folder of a drive whose simulated vehicle or receiver cannot be had, unless it holds more."""
    with contextlib.suppress(OSError):
        (folder / "car.log").unlink(missing_ok=True)
        folder.rmdir()


def _end_page(plan: DrivePlan, processes: ProcessGroup) -> None:
    processes.end_view()
    # A process that was killed left the address of its page.
    with contextlib.suppress(OSError):
        (plan.folder / "view.json").unlink(missing_ok=True)
        (plan.folder / "people.json").unlink(missing_ok=True)


def _measure_alignment(plan: DrivePlan, source: Source, notify: Notify) -> LotAlignment:
    """Measure the alignment and GNSS time while the car stands; close `source`, for the drive's process to open it."""
    rig, resolved = plan.rig, plan.resolved
    notify("waiting for trusted fixes of the standing car")
    try:
        standing = assembly.standing_pose_of(rig, source, plan.t0)
    finally:
        source.close()
    begin = resolved.path.at(0.0)
    stored = meaning.alignment_of(rig, resolved.scenario.road.network)
    start = pose_at_rest(begin.x, begin.y, begin.heading)
    return lot_alignment(standing, meaning.frame_of(rig), meaning.mounting_of(rig), start, stored)


def _not_ready(plan: DrivePlan, ground: LotAlignment, notify: Notify) -> tuple[str, ...]:
    """Return the reason codes that keep this drive from READY for as long as it lasts."""
    geofence, resolved = meaning.geofence_of(plan.rig, ground.alignment), plan.resolved
    leaves = geofence.along(resolved.path, resolved.scenario.ego.speed_mps, resolved.corridor)
    if leaves is None:
        return ()
    what = "the path or its corridor" if resolved.corridor else "the path"
    notify(
        f"{what} leaves the lot: from {leaves:.0f} m on, the car could not stop inside it; "
        "vve-sumo align --fit proposes how to lay it"
    )
    return ("path_leaves_lot",)


def _processes(
    plan: DrivePlan,
    scenario_content: dict[str, Any],
    provenance_text: str,
    ground: LotAlignment,
    car: start_simulated_vehicle.SimulatedVehicleProcess | None,
    notify: Notify,
    locks: tuple[int, ...],
) -> ProcessGroup:
    """Start recorder, gateway and drive, each with only the channel ends that it needs.

    The gateway holds the rig's `locks` too: where the console is killed, it still commands the car until it stands.
    """
    console_gateway, gateway_console = pair()
    console_drive, drive_console = pair()
    drive_gateway, gateway_drive = pair()
    drive_recorder, recorder_drive = pair()
    gateway_recorder, recorder_gateway = pair()
    folder, rig = plan.folder, plan.rig
    common = {"folder": str(folder), "t0": plan.t0, "epoch": ground.epoch}
    # Before the recorder: where the page or a wire cannot be opened, there is no record.
    optional = optional_processes.start(plan, common, scenario_content, notify)
    recorder = spawn.start(
        "recorder",
        common | {"resolved": scenario_content, "provenance": provenance_text, "log": str(folder / "recorder.log")},
        {"drive": recorder_drive, "gateway": recorder_gateway},
        own_session=True,
    )
    interface, channel = car.bus if car is not None and rig.bus.channel == PTY else (rig.bus.interface, rig.bus.channel)
    bus = {"interface": interface, "channel": channel, "bitrate": rig.bus.bitrate}
    gateway = spawn.start(
        "gateway",
        common | scenario_content["gateway"] | {"bus": bus, "log": str(folder / "gateway.log")},
        {"drive": gateway_drive, "console": gateway_console, "recorder": gateway_recorder},
        own_session=True,
        inherited=locks,
    )
    drive = spawn.start(
        "drive",
        common
        | {
            "resolved": scenario_content,
            "working": str(plan.working),
            "not_ready": _not_ready(plan, ground, notify),
            "log": str(folder / "drive.log"),
        },
        {"gateway": drive_gateway, "console": drive_console, "recorder": drive_recorder} | optional.feeds,
        own_session=True,
    )
    process, to_car = (car.process, car.channel) if car is not None else (None, None)
    return ProcessGroup(
        gateway,
        drive,
        recorder,
        process,
        optional.outputs,
        optional.view,
        optional.people,
        optional.stations,
        console_gateway,
        console_drive,
        to_car,
        optional.to_view,
    )


def _write_roads(plan: DrivePlan, notify: Notify) -> None:
    """Write the lanes around the path; a disk that is full is the recorder's to report, and stops no drive."""
    try:
        write_roads(plan.folder, plan.resolved.lanes)
    except OSError as error:
        notify(f"{plan.folder / 'roads.parquet'} cannot be written: {error.strerror}; make room")


def _note_processes(plan: DrivePlan, processes: ProcessGroup) -> None:
    """Write process ids and start time to `processes.json`, for an engineer who has to signal a process by hand."""
    numbers: dict[str, float] = {
        "gateway": processes.gateway.pid,
        "drive": processes.drive.pid,
        "recorder": processes.recorder.pid,
    }
    numbers |= {"car": processes.car.pid} if processes.car is not None else {}
    numbers |= {"outputs": processes.outputs.pid} if processes.outputs is not None else {}
    numbers |= {"view": processes.view.pid} if processes.view is not None else {}
    numbers |= {"people": processes.people.pid} if processes.people is not None else {}
    numbers |= {"stations": processes.stations.pid} if processes.stations is not None else {}
    numbers["t0_monotonic_s"] = plan.t0
    (plan.folder / "processes.json").write_text(json.dumps(numbers) + "\n", encoding="utf-8")


def _drove(folder: Path) -> bool:
    """Whether the gateway ever commanded the car."""
    try:
        states = read_table(folder, "gateway")["state"].to_pylist()
    except VveError:
        return False
    return any(state in ("engaged", "stopping", "stopped") for state in states)


def _summary(plan: DrivePlan, why: tuple[str, ...], notify: Notify) -> dict[str, Any]:
    """Complete the recorder's summary by the scenario's verdict; `why` is the gateway's last reasons at the console."""
    try:
        summary: dict[str, Any] = json.loads((plan.folder / "summary.json").read_text(encoding="utf-8"))
    except (OSError, ValueError):
        # The recorder died, or the disk is full: summarise what the record holds.
        summary = summarise(plan.folder, {"outcome": Outcome.FAULT.value, "reasons": [*why, "record_lost"]})
    done = DriveEnd(
        Outcome(summary["outcome"]),
        tuple(summary["reasons"]),
        tuple(summary.get("removed_at_entry", ())),
        tuple(summary.get("warnings", ())),
        summary.get("text", ""),
        tuple(summary.get("removed_after_standoff", ())),
    )
    parts, own = summary.get("record_parts_sha256", {}), plan.resolved.own_metrics()
    full = summarise_drive(plan.resolved, done, plan.folder, parts, own)
    extra = {key: summary[key] for key in summary if key not in full and key not in ("warnings", SUMMARY_HASH_KEY)}
    extra |= {"rehearsal": True} if plan.rehearsal else {}
    summary = full | extra | {"rig": plan.rig_file.stem, "shadow": plan.shadow, "brain": plan.rig.brain.kind}
    if plan.rig.brain.kind != "own":
        summary["controller"] = EXTERNAL_CONTROLLER
    if plan.shadow:
        summary = without_verdict(summary)
    try:
        write_summary(plan.folder, summary)
    except OSError as error:
        notify(f"{plan.folder / 'summary.json'} cannot be written: {error.strerror}; make room")
    return summary


@contextlib.contextmanager
def removed_when_empty(folder: Path) -> Iterator[None]:
    """Remove the folder of a drive that was refused before its record began, with its processes' first files."""
    try:
        yield
    except VveError:
        if not (folder / "scenario.json").exists():
            with contextlib.suppress(OSError):
                for name in (
                    "truth.csv",
                    "car.log",
                    "bus.log",
                    "outputs.log",
                    "people.log",
                    "people.json",
                    "view.log",
                    "view.json",
                    "roads.parquet",
                ):
                    (folder / name).unlink(missing_ok=True)
                folder.rmdir()
        raise
