"""Runs a live drive from names to its record and summary: starts the processes, waits for their end, adds the verdict.

Prints nothing: the caller hands in where messages go.
"""

from __future__ import annotations

import contextlib
import datetime
import json
import time
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final, TextIO

from vve_sumo import workspace
from vve_sumo.drive import provenance
from vve_sumo.drive.assembly import LotAlignment, sensors_of
from vve_sumo.drive.gain_region import delay_of, refuse_outside
from vve_sumo.drive.resolved_scenario import ResolvedScenario
from vve_sumo.drive.run import new_run_folder, resolve_by_name, verdict_in
from vve_sumo.drive.summary import EXTERNAL_CONTROLLER, without_verdict
from vve_sumo.drive.summary import summarise as summarise_drive
from vve_sumo.drive.termination import DriveEnd, Outcome
from vve_sumo.errors import ConfigError, RigError, VveError
from vve_sumo.live import assembly, optional_processes
from vve_sumo.live.brain_link import key_of, refuse_controller
from vve_sumo.live.console import Console, ProcessGroup
from vve_sumo.live.keys import OperatorInput
from vve_sumo.live.optional_processes import Notify
from vve_sumo.live.plan import DrivePlan
from vve_sumo.live.priority import Rights, lower_priority, rights
from vve_sumo.live.rehearsal import rehearsed
from vve_sumo.live.screen import Screen
from vve_sumo.live.simulated_ego import lockstep_ego
from vve_sumo.live.start_processes import begin_car, open_car, start_processes
from vve_sumo.live.summary import summarise
from vve_sumo.live.view_token import certificate_of, token_of
from vve_sumo.live.virtual_can import hardware_obstacle
from vve_sumo.record.hashes import hash_file
from vve_sumo.record.layout import FURTHER_EGOS
from vve_sumo.record.reader import read_table
from vve_sumo.record.summary import SUMMARY_HASH_KEY, write_summary
from vve_sumo.record.writer import require_empty_folder
from vve_sumo.rig import load as rigs
from vve_sumo.rig import resolve as meaning
from vve_sumo.rig.lock import rig_lock
from vve_sumo.rig.validation import arming_obstacle, common_ground
from vve_sumo.scenario.schema import EndTrigger
from vve_sumo.values import EGO
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
    foxglove: bool = False,
    rehearse: Path | None = None,
    further: Mapping[str, str] = MappingProxyType({}),
) -> DrivePlan:
    """Find scenario and rig by name and refuse what nobody should drive with; opens no device and writes nothing.

    With `rehearse` a real car's rig is put on simulated wires, links to which are made in that folder. `further` has
    the rigs of further egos by their ids; an ego of the scenario that has no rig is simulated.

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
    if further and rehearse is not None:
        raise ConfigError("--rehearse: one car at a time; leave out the rigs of further egos, which are then simulated")
    try:
        resolved = assembly.scenario_with_rig(resolved, loaded, working)
    except ConfigError as error:
        raise ConfigError(f"{workspace.find('scenario', scenario, working)}: {error}") from None
    if not shadow and loaded.brain.kind == "own":
        refuse_outside(resolved, working, delay_of(loaded))
    folder = (out if out is not None else new_run_folder(resolved.name, working)).absolute()
    require_empty_folder(folder)
    scenario_file = workspace.find("scenario", scenario, working).absolute()
    own = DrivePlan(
        resolved,
        scenario_file,
        loaded,
        rig_file,
        folder,
        working,
        shadow,
        time.monotonic(),
        view=view,
        foxglove=foxglove,
        rehearsal=notes,
    )
    return _with_further(own, further)


def _with_further(own: DrivePlan, rigs_by_ego: Mapping[str, str]) -> DrivePlan:
    """Return a plan with the real cars of further egos; raises as `plan` does, naming the option."""
    egos = {one.ego_id: one for one in own.resolved.others}
    if strange := [ego for ego in rigs_by_ego if ego not in egos]:
        known = ", ".join(egos) or "none"
        raise ConfigError(
            f"--rig {strange[0]}=…: expected the id of one of the scenario's [[egos]], which are: {known}"
        )
    cars = tuple(_further_plan(own, egos[ego], rigs_by_ego[ego]) for ego in sorted(rigs_by_ego))
    for file, count in Counter(one.rig_file.resolve() for one in (own, *cars)).items():
        if count > 1:
            raise ConfigError(f"--rig: {file} is given for {count} cars; expected a rig of its own for each")
    if not own.shadow and (reason := common_ground({one.rig_file: one.rig for one in (own, *cars)})) is not None:
        raise RigError(reason)
    return replace(own, resolved=assembly.with_rigs(own.resolved, [one.resolved for one in cars]), further=cars)


def _further_plan(own: DrivePlan, resolved: ResolvedScenario, rig: str) -> DrivePlan:
    """Return the plan of a further ego's real car; raises ConfigError for what only the rig of [ego] may have."""
    rig_file = workspace.find("rig", rig, own.working)
    loaded = rigs.load(rig_file, own.working)
    loaded = meaning.with_alignment_for(loaded, resolved.name)
    alone: dict[str, object] = {
        "brain.kind": loaded.brain.kind != "own",
        "outputs": loaded.outputs,
        "people": loaded.people,
        "v2x": loaded.v2x,
    }
    if wrong := next((key for key, there in alone.items() if there), None):
        raise ConfigError(
            f"{rig_file}: {wrong}: only the rig of [ego] may have it, and this one is of another ego's car"
        )
    if not own.shadow and (reason := arming_obstacle(loaded, datetime.date.today())) is not None:
        raise RigError(f"{rig_file}: {reason}; --shadow drives along with nothing enabled")
    if (reason := hardware_obstacle(loaded)) is not None:
        raise RigError(f"{rig_file}: {reason}")
    try:
        resolved = assembly.scenario_with_rig(resolved, loaded, own.working)
    except ConfigError as error:
        raise ConfigError(f"{own.scenario_file}: {error}") from None
    if not own.shadow:
        refuse_outside(resolved, own.working, delay_of(loaded))
    return replace(
        own,
        resolved=resolved,
        rig=loaded,
        rig_file=rig_file,
        folder=own.folder_of(resolved.ego_id),
        view=False,
        foxglove=False,
    )


def named(plan: DrivePlan, operator: str | None, driver: str | None) -> DrivePlan:
    """Return a plan with who is at the console and who sits behind the wheel; drive time begins now."""
    now = time.monotonic()
    further = tuple(replace(one, operator=operator, t0=now) for one in plan.further)
    return replace(plan, operator=operator, driver=driver, t0=now, further=further)


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


def run(
    plan: DrivePlan,
    doctor: Mapping[str, Any],
    terminal: TextIO,
    notify: Notify,
    doctors: Mapping[str, Mapping[str, Any]] = MappingProxyType({}),
) -> dict[str, Any]:
    """Drive a plan to its end and return its summary; raises VveError where it never began.

    `doctor` is the doctor's last result on the rig, for the record; `doctors` are those on the rigs of further egos, by
    the egos' ids. The console draws on `terminal` while the drive goes on; messages before and after it go to `notify`.
    """
    # Raises for an unusable controller or sensor before anything is started.
    for one in plan.cars:
        one.resolved.controller(plan.working)
        sensors_of(one.resolved)
    grounds = {one.ego_id: lockstep_ego(one, plan.working).lot for one in plan.simulated}
    if plan.resolved.scenario.end_trigger != EndTrigger():
        notify("the scenario's [end_trigger] does not apply to a live drive, which goes on to the end of the path")
    permitted = rights()
    if lacking := permitted.lacking():
        notify(lacking)
    with contextlib.ExitStack() as page:
        results = {EGO: doctor, **doctors}
        console = _driven(plan, results, permitted, terminal, notify, page, grounds)
        if console.refused is not None and not any(_drove(one.folder) for one in plan.cars):
            raise optional_processes.error_of(console.refused)
        others = {one.ego: _summary(one, console.why(one.ego), notify) for one in plan.further}
        others |= {one.ego_id: _simulated_summary(plan, one, notify) for one in plan.simulated}
        summary = _summary(plan, console.why(EGO), notify, others)
        console.processes.end_view(verdict_of(summary))
        return summary


def _driven(
    plan: DrivePlan,
    doctors: Mapping[str, Mapping[str, Any]],
    permitted: Rights,
    terminal: TextIO,
    notify: Notify,
    page: contextlib.ExitStack,
    grounds: Mapping[str, LotAlignment],
) -> Console:
    """Drive a plan to its end, from the rigs' locks to the end of all processes but the page's, which `page` ends."""
    with (
        contextlib.ExitStack() as held,
        contextlib.ExitStack() as stack,
        OperatorInput(listen=not all(one.rig.operator.automatic for one in plan.cars)) as keys,
    ):
        locks = {one.ego: held.enter_context(rig_lock(one.rig_file, one.rig)) for one in plan.cars}
        opened = [(one, *open_car(one, stack)) for one in plan.cars]
        begun = [
            begin_car(one, source, car, locks[one.ego], _provenance(one, doctors[one.ego], permitted), notify)
            for one, source, car in opened
        ]
        processes = start_processes(plan, begun, grounds, notify)
        page.callback(_end_page, plan, processes)
        screen = Screen(terminal)
        overridden = next((text for one in plan.cars if (text := str(doctors[one.ego].get("override", "")))), "")
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


def _end_page(plan: DrivePlan, processes: ProcessGroup) -> None:
    processes.end_view()
    # A process that was killed left the address of its page.
    with contextlib.suppress(OSError):
        (plan.folder / "view.json").unlink(missing_ok=True)
        (plan.folder / "people.json").unlink(missing_ok=True)


def _note_processes(plan: DrivePlan, processes: ProcessGroup) -> None:
    """Write process ids and start time to `processes.json`, for an engineer who has to signal a process by hand."""
    numbers: dict[str, float] = {
        "gateway": processes.gateway.pid,
        "drive": processes.drive.pid,
        "recorder": processes.recorder.pid,
    }
    for one in processes.further:
        numbers[f"recorder:{one.ego}"] = one.recorder.pid
        numbers |= {f"gateway:{one.ego}": one.gateway.pid} if one.gateway is not None else {}
        numbers |= {f"car:{one.ego}": one.car.pid} if one.car is not None else {}
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


def _summary(
    plan: DrivePlan,
    why: tuple[str, ...],
    notify: Notify,
    others: Mapping[str, Mapping[str, Any]] = MappingProxyType({}),
) -> dict[str, Any]:
    """Complete the recorder's summary by the scenario's verdict; `why` is the gateway's last reasons at the console.

    `others` are the summaries of further egos, by their ids.
    """
    extra: dict[str, Any] = {"rehearsal": True} if plan.rehearsal else {}
    extra |= {"rig": plan.rig_file.stem, "shadow": plan.shadow, "brain": plan.rig.brain.kind}
    if plan.rig.brain.kind != "own":
        extra["controller"] = EXTERNAL_CONTROLLER
    summary = _completed(plan.folder, plan.resolved, why, others) | extra
    if plan.shadow:
        summary = without_verdict(summary)
    _write(plan.folder, summary, notify)
    return summary


def _simulated_summary(plan: DrivePlan, ego: ResolvedScenario, notify: Notify) -> dict[str, Any]:
    """Complete the summary of a simulated ego."""
    folder = plan.folder_of(ego.ego_id)
    summary = _completed(folder, ego, (), {})
    _write(folder, summary, notify)
    return summary


def _completed(
    folder: Path, resolved: ResolvedScenario, why: tuple[str, ...], others: Mapping[str, Mapping[str, Any]]
) -> dict[str, Any]:
    try:
        summary: dict[str, Any] = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
    except (OSError, ValueError):
        # The recorder died, or the disk is full: summarise what the record holds.
        summary = summarise(folder, {"outcome": Outcome.FAULT.value, "reasons": [*why, "record_lost"]})
    egos = {ego: verdict_in(one) for ego, one in others.items()}
    done = DriveEnd(
        Outcome(summary["outcome"]),
        tuple(summary["reasons"]),
        tuple(summary.get("removed_at_entry", ())),
        tuple(summary.get("warnings", ())),
        summary.get("text", ""),
        tuple(summary.get("removed_after_standoff", ())),
        extra={"egos": egos} if egos else {},
    )
    parts, own = summary.get("record_parts_sha256", {}), resolved.own_metrics()
    full = summarise_drive(resolved, done, folder, parts, own)
    extra = {key: summary[key] for key in summary if key not in full and key not in ("warnings", SUMMARY_HASH_KEY)}
    return full | extra


def _write(folder: Path, summary: dict[str, Any], notify: Notify) -> None:
    try:
        write_summary(folder, summary)
    except OSError as error:
        notify(f"{folder / 'summary.json'} cannot be written: {error.strerror}; make room")


@contextlib.contextmanager
def removed_when_empty(folder: Path) -> Iterator[None]:
    """Remove the folder of a drive that was refused before its record began, with its processes' first files."""
    try:
        yield
    except VveError:
        if not (folder / "scenario.json").exists():
            for one in (*(folder / FURTHER_EGOS).glob("*"), folder / FURTHER_EGOS, folder):
                _remove_first_files(one)
        raise


def _remove_first_files(folder: Path) -> None:
    """Remove what a drive writes before its record begins, and the folder where nothing else is left."""
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
