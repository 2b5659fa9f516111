"""Runs a drive in simulated time, from a scenario's name to its record and summary: in lockstep, or as a playback.

The only module of this package that reads the wall clock: for the record's begin, and to name its folder.
"""

from __future__ import annotations

import datetime
import hashlib
import time
import traceback
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Protocol

from vve_sumo import workspace
from vve_sumo.config_file import read_as
from vve_sumo.drive import provenance
from vve_sumo.drive.assembly import LotAlignment
from vve_sumo.drive.brain import ExternalController
from vve_sumo.drive.lockstep import Lockstep, TickCallback
from vve_sumo.drive.playback import Playback
from vve_sumo.drive.resolved_scenario import ResolvedScenario, resolve_scenario
from vve_sumo.drive.rolling_start import require_start_from_rest
from vve_sumo.drive.several_egos import require_one_ego
from vve_sumo.drive.shared_prefix import Variants
from vve_sumo.drive.summary import EXTERNAL_CONTROLLER, measure, summary_of
from vve_sumo.drive.termination import DriveEnd, Outcome
from vve_sumo.errors import ConfigError, RigError, SimulationError
from vve_sumo.metrics.per_drive import PER_DRIVE
from vve_sumo.record.hashes import hash_files
from vve_sumo.record.layout import COMMANDED, FURTHER_EGOS, PROVENANCE, ROADS, TICK_METRICS
from vve_sumo.record.roads import roads_table
from vve_sumo.record.signals import files_of
from vve_sumo.record.tick_metrics import tick_metrics_table
from vve_sumo.record.writer import MemoryRecorder, RecordWriter, require_empty_folder, scenario_bytes
from vve_sumo.scenario import overrides
from vve_sumo.scenario.load import parse
from vve_sumo.scenario.schema import Scenario
from vve_sumo.values import EGO
from vve_sumo.world.loaded_road import LoadedRoad


class DriveHost(Protocol):
    """What lockstep and playback have in common."""

    lots: Sequence[LotAlignment]  #: how each ego's lot lies on the virtual road, and which GNSS time is drive time 0
    ended: dict[int, DriveEnd]  #: how the drives ended that are over, by the ego's place among the egos

    def run(self, records: Sequence[MemoryRecorder], on_tick: TickCallback) -> list[DriveEnd]:
        """Drive to the end and return how the drive of each ego ended; each has a record."""
        ...

    def close(self) -> None:
        """End the simulation."""
        ...


@dataclass(frozen=True, slots=True)
class Drive:
    """A drive that is over."""

    folder: Path  #: its record
    summary: dict[str, Any]  #: as in summary.json
    others: Mapping[str, Drive] = field(default_factory=dict)  #: the same of each further ego, by its id

    @property
    def passed(self) -> bool:
        """Whether all egos met the scenario's criteria; true for a playback, to which no criteria apply."""
        return self.summary["passed"] is not False


def resolve_by_name(
    name: str,
    working: Path,
    *,
    seed: int | None = None,
    controller: str | None = None,
    vehicle: str | None = None,
    rig: str | None = None,
    speed: float | str | None = None,
    values: Mapping[str, Any] | None = None,
) -> ResolvedScenario:
    """Resolve a scenario by name or file, with another seed, controller or vehicle model where one is given.

    `speed` is that of the ego, as `overrides.with_speed` sets it. `values` are those of further dotted keys, or of
    parameters that the scenario declares.

    With a `rig`, the rig's car is simulated.

    Raises ConfigError for anything that is missing or wrong.
    """
    file, table = table_by_name(
        name, working, seed=seed, controller=controller, vehicle=vehicle, speed=speed, values=values
    )
    scenario = parse(table, file)
    resolved = resolve_scenario(file.name.removesuffix(".toml"), scenario, file, working)
    if rig is not None:
        from vve_sumo.rig.load import load as load_rig

        resolved = resolved.with_rig(load_rig(workspace.find("rig", rig, working), working), working)
    return resolved


def table_by_name(
    name: str,
    working: Path,
    *,
    seed: int | None = None,
    controller: str | None = None,
    vehicle: str | None = None,
    speed: float | str | None = None,
    values: Mapping[str, Any] | None = None,
) -> tuple[Path, dict[str, Any]]:
    """Return the file and the table of a scenario, altered as `resolve_by_name` says."""
    file = workspace.find("scenario", name, working)
    table = read_as(file, "scenario", Scenario)
    parse(table, file)
    chosen = overrides.choose(table, seed=seed, controller=controller, vehicle=vehicle)
    if speed is not None:
        chosen = overrides.with_speed(chosen, speed)
    return file, overrides.checked(chosen, values or {}, "--set ")


def run(
    resolved: ResolvedScenario,
    folder: Path,
    working: Path,
    *,
    pose: Path | None = None,
    brain: ExternalController | None = None,
    keep_record: bool = True,
    on_tick: TickCallback = lambda tick, now, speed, s: None,
    loaded: LoadedRoad | None = None,
) -> Drive:
    """Drive a scenario, or play the recording `pose` in it, into a new record folder.

    The scenario's injected faults act on the simulated vehicle; a playback has none, and refuses them.

    For a wrong input it raises ConfigError and leaves no record. A later failure is recorded as the outcome `broken`,
    a keyboard interrupt as `interrupted`. An external `brain` drives in place of the scenario's controller; where it is
    not there, RigError is raised and no record is left. With `keep_record` false no folder is written, and the summary
    lacks only the hashes of the record's files. SUMO is not started where the process of which this one is a fork has
    `loaded` the scenario's road.
    """
    if pose is not None and resolved.faults:
        kinds = ", ".join(dict.fromkeys(fault.kind for fault in resolved.faults))
        raise ConfigError(
            f"faults: {kinds}: a recorded drive has no simulated vehicle to inject them into; take them out of the rig"
        )
    if pose is not None and resolved.people:
        raise ConfigError("people: nobody walked when a recording was made; take them out of the scenario")
    if pose is not None:
        require_start_from_rest(resolved, "a recorded drive begins as it was recorded")
        require_one_ego(resolved, "a recorded drive has the poses of one car")
    if keep_record:
        require_empty_folder(folder)
    shell: DriveHost
    if pose is None:
        shell = Lockstep(resolved, working, brain=brain, loaded=loaded)
    else:
        shell = Playback(resolved, pose, working, loaded)
    foreign = {} if brain is None or brain.controller is None else {"brain": "setpoints"}
    try:
        if pose is not None:
            resolved = replace(resolved, files={**resolved.files, "pose": pose})
        records = _open_records(resolved, shell.lots, folder if keep_record else None, working, foreign)
        try:
            ends = run_guarded(shell, records, on_tick)
        except (ConfigError, RigError):
            for record in reversed(records):
                record.discard()
            raise
        if keep_record:
            for done, record in zip(ends, records, strict=True):
                for name, text in files_of(done.signals).items():
                    record.attach(name, text)
    finally:
        shell.close()
    others = {
        one.ego_id: _close(one, done, record, {})
        for one, done, record in zip(resolved.others, ends[1:], records[1:], strict=True)
    }
    if others:
        ends[0] = replace(
            ends[0], extra={**ends[0].extra, "egos": {ego: verdict_in(one.summary) for ego, one in others.items()}}
        )
    more = foreign | {"controller": EXTERNAL_CONTROLLER} if foreign else {}
    return replace(_close(resolved, ends[0], records[0], more), folder=folder, others=others)


def _open_records(
    resolved: ResolvedScenario, lots: Sequence[LotAlignment], folder: Path | None, working: Path, more: dict[str, Any]
) -> list[MemoryRecorder]:
    """Open the record of every ego, in memory where there is no `folder`; raises ConfigError before any is opened.

    `more` is what the resolved scenario of the first ego holds besides.
    """
    settings = [one.to_dict(working) | lot.to_dict() for one, lot in zip(resolved.egos, lots, strict=True)]
    settings[0] |= more
    if folder is None:
        return [MemoryRecorder(one, lot.epoch) for one, lot in zip(settings, lots, strict=True)]
    now = datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds")
    records: list[MemoryRecorder] = []
    for one, content, lot in zip(resolved.egos, settings, lots, strict=True):
        own = folder if one.ego_id == EGO else folder / FURTHER_EGOS / one.ego_id
        record = RecordWriter(own, content, lot.epoch)
        record.attach_table(ROADS, roads_table(one.lanes))
        record.attach(PROVENANCE, provenance.text_of(provenance.provenance(one, now)))
        records.append(record)
    return records


def _close(resolved: ResolvedScenario, done: DriveEnd, record: MemoryRecorder, more: dict[str, Any]) -> Drive:
    """Finish an ego's record with its summary, to which `more` is added."""
    summary = _summary(resolved, done, record, record.close()) | more
    if not isinstance(record, RecordWriter):
        return Drive(Path(), summary)
    summary |= {"record_files_sha256": hash_files(record.folder)}
    record.summarise(summary)
    return Drive(record.folder, summary)


def verdict_in(summary: Mapping[str, Any]) -> dict[str, Any]:
    """Return what the summary of the first ego's drive holds of another ego's summary."""
    return {name: summary[name] for name in ("outcome", "passed", "failed", "record_sha256", *PER_DRIVE)}


def run_variants(
    variants: Variants,
    working: Path,
    *,
    on_tick: TickCallback = lambda tick, now, speed, s: None,
    loaded: LoadedRoad | None = None,
) -> dict[int, dict[str, Any]]:
    """Drive scenarios as one until they differ; return the summaries of those that this process drove to their end.

    Each summary, by the scenario's number, is that of `run` without a record that is kept. Raises as `run` does, where
    one of the scenarios is wrong.
    """
    first = variants.scenarios[0]
    shell = Lockstep(first, working, loaded=loaded, variants=variants)
    try:
        record = MemoryRecorder(first.to_dict(working) | shell.lot.to_dict(), shell.lot.epoch)
        (done,) = run_guarded(shell, [record], on_tick)
    finally:
        shell.close()
    parts, summaries = record.close(), {}
    for number in variants.together:
        scenario = variants.scenarios[number]
        own = hashlib.sha256(scenario_bytes(scenario.to_dict(working) | shell.lot.to_dict())).hexdigest()
        summaries[number] = _summary(scenario, done, record, parts | {"scenario.json": own})
    return summaries


def _summary(
    resolved: ResolvedScenario, done: DriveEnd, record: MemoryRecorder, parts: dict[str, str]
) -> dict[str, Any]:
    """Return the summary of a closed record whose parts have these hashes; attach the metrics of every tick to it."""
    tables, roads, own = record.tables, roads_table(resolved.lanes), resolved.own_metrics()
    commanded = tables.get(COMMANDED)
    measured = measure(resolved, own, tables["ticks"], tables["actors"], roads, commanded)
    if isinstance(record, RecordWriter):
        table = tick_metrics_table(own.declared.per_tick, measured.per_tick, tables["ticks"])
        if table is not None:
            record.attach_table(TICK_METRICS, table)
    return summary_of(resolved, done, tables["ticks"], tables["actors"], parts, roads, measured, commanded)


def run_guarded(shell: DriveHost, records: Sequence[MemoryRecorder], on_tick: TickCallback) -> list[DriveEnd]:
    """Drive to the end and return how the drive of each ego ended.

    A failure on the way becomes the outcome of the drives that were not over, except ConfigError and RigError.
    """
    broken = DriveEnd(Outcome.BROKEN, ())
    try:
        return shell.run(records, on_tick)
    except KeyboardInterrupt:
        broken = replace(broken, outcome=Outcome.INTERRUPTED, reasons=("interrupted",))
    except (ConfigError, RigError):
        raise
    except SimulationError as error:
        broken = replace(broken, reasons=("simulation_error",), text=str(error))
    except Exception as error:
        # An error in this program ends the drive; the record is kept, with the traceback.
        records[0].attach("traceback.txt", traceback.format_exc())
        broken = replace(broken, reasons=("internal_error",), text=f"{type(error).__name__}: {error}")
    return [shell.ended.get(place, broken) for place in range(len(records))]


def new_run_folder(name: str, working: Path) -> Path:
    """Return a folder under `runs/` that does not exist yet, named by the time and the scenario or sweep."""
    stem = f"{time.strftime('%Y%m%d-%H%M%S')}_{name}"
    names = (stem if number == 1 else f"{stem}_{number}" for number in range(1, 1000))
    return Path("runs") / next(name for name in names if not (working / "runs" / name).exists())
