"""Reviews the record of a lockstep or live drive: is it unaltered, does it replay, what would another controller do?

Finds out of which kind the record is and puts the findings into words; the comparisons are other modules'.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pyarrow as pa

from vve_sumo.drive import redrive
from vve_sumo.drive import replay as lockstep
from vve_sumo.drive.lockstep import ScriptedOperator, assemble
from vve_sumo.drive.pipeline import Pipeline
from vve_sumo.drive.replay import (
    Difference,
    PipelineInputs,
    changed_code,
    changed_since,
    read_pipeline_inputs,
    replayed_ticks,
)
from vve_sumo.drive.replay_stations import replay_stations
from vve_sumo.drive.resolved_scenario import DEFAULT_EPOCH, ResolvedScenario
from vve_sumo.drive.verify import alterations
from vve_sumo.errors import ConfigError
from vve_sumo.live import replay as live
from vve_sumo.live.assembly import from_dict
from vve_sumo.record.alterations import Alteration, parts_of


@dataclass(frozen=True, slots=True)
class Inspection:
    """What is known of a record before any code that it names is run."""

    folder: Path
    altered: list[Alteration]  #: parts that are not as the drive left them
    notes: list[str]  #: other differences from then, which do not prevent a replay
    changed: list[str]  #: changes in the code of controller, sensors, interface or receiver, which must not be run then
    resolved: ResolvedScenario | None  #: None where the record was altered, or a part has changed


@dataclass(frozen=True, slots=True)
class ReplayResult:
    """The result of a replay."""

    scope: str  #: what was replayed
    notes: list[str]  #: what could not be replayed
    differences: list[str]  #: the first difference of each part


@dataclass(frozen=True, slots=True)
class RedriveResult:
    """What another controller answers to a record's inputs, beside the answers of the recorded one."""

    resolved: ResolvedScenario  #: of the record
    table: pa.Table  #: both answers, a row a tick
    comparison: redrive.ControllerComparison
    failure: str  #: the other controller's last failure, in its own words


def altered_since(folder: Path) -> list[Alteration] | None:
    """Return the parts of a record that are not as its drive left them; None for a record without hashes.

    Raises ConfigError for a folder that holds no record, or one of another layout.
    """
    altered, unreadable = alterations(folder), not _holds_json(folder / "scenario.json")
    if not (unreadable and "scenario.json" in (parts_of(altered) or ())):
        live.is_live(folder)
    return altered


def _holds_json(file: Path) -> bool:
    try:
        json.loads(file.read_bytes())
    except (OSError, ValueError):
        return False
    return True


def inspect(folder: Path, working: Path) -> Inspection:
    """Verify every hash of a record and of the code that it names; none of that code is run before.

    Raises ConfigError for a folder that holds no record.
    """
    altered = altered_since(folder)
    if altered:
        return Inspection(folder, altered, [], [], None)
    notes = ["no hashes: the drive was never finished, so the replay alone can tell"] if altered is None else []
    if changed := changed_code(folder, working):
        return Inspection(folder, [], notes, changed, None)
    if live.is_live(folder):
        resolved, _rig = from_dict(live.read_live_scenario_content(folder), working)
    else:
        resolved = lockstep.recorded_scenario(folder, working)
    return Inspection(folder, [], notes + changed_since(folder, resolved), [], resolved)


def replay(inspected: Inspection, working: Path) -> ReplayResult:
    """Replay a record that was found unaltered through the pipeline and the gateway; return where it first differs."""
    assert inspected.resolved is not None  # None only after an alteration or a change of code; then nothing is run
    if live.is_live(inspected.folder):
        return _live(inspected.folder, working)
    return _lockstep(inspected.folder, inspected.resolved, working)


def _lockstep(folder: Path, resolved: ResolvedScenario, working: Path) -> ReplayResult:
    inputs = read_pipeline_inputs(folder)
    frames = lockstep.read_car_frames(folder, DEFAULT_EPOCH, resolved.model.interface)
    difference = lockstep.replay(resolved, inputs, frames, working)
    differences = _described("tick", inputs.ticks, difference) + _of_people(folder) + _of_stations(folder)
    return ReplayResult(f"{len(inputs.ticks)} ticks", _torn(inputs), differences)


def _live(folder: Path, working: Path) -> ReplayResult:
    inputs = live.read_live_inputs(folder)
    ticks, steps = inputs.pipeline.ticks, inputs.steps
    notes = _torn(inputs.pipeline)
    if inputs.torn:
        notes.append(f"the last {inputs.torn} steps of the gateway come after a gap in gateway or can.log")
    differences = _described("tick", ticks, live.replay_drive(inputs, working))
    differences += _described("step", steps, live.replay_gateway(inputs)) + _of_people(folder) + _of_stations(folder)
    return ReplayResult(f"{len(ticks)} ticks and {len(steps)} steps of the gateway", notes, differences)


def _of_people(folder: Path) -> list[str]:
    """Return the lines on the first difference of what a drive's real people were taken for; none without one."""
    return _on_road(lockstep.replay_people(folder))


def _of_stations(folder: Path) -> list[str]:
    """Return the lines on the first difference of what a drive's real stations were taken for; none without one."""
    return _on_road(replay_stations(folder))


def _on_road(difference: Difference | None) -> list[str]:
    if difference is None:
        return []
    return [
        f"step {difference.number} of the virtual road differs in {difference.item}:",
        f"  recorded {difference.recorded}",
        f"  replayed {difference.replayed}",
    ]


def _torn(inputs: PipelineInputs) -> list[str]:
    if not inputs.torn:
        return []
    return [f"the last {inputs.torn} ticks come after a gap in pose.bin, actors or the sensors' readings"]


def _described(kind: str, rows: list[dict[str, Any]], difference: Difference | None) -> list[str]:
    """Return the lines that describe a difference; none without one."""
    if difference is None:
        return []
    when = next((f" ({row['time_s']:.2f} s)" for row in rows if row[kind] == difference.number), "")
    whose = "of the gateway " if kind == "step" else ""
    return [
        f"{kind} {difference.number}{when} {whose}differs in {difference.item}:",
        f"  recorded {difference.recorded}",
        f"  replayed {difference.replayed}",
    ]


def redrive_with(folder: Path, controller: str, working: Path) -> RedriveResult:
    """Run another controller on a record's inputs, open loop: the car moves as the recorded controller commanded.

    Raises ConfigError where a sensor, the drive-by-wire interface or the receiver is not as it was recorded.
    """
    if changed := changed_code(folder, working, controller=False):
        raise ConfigError(f"{folder}: {changed[0]}: not run")
    resolved, inputs, pipeline = _with(folder, controller, working)
    table = redrive.side_by_side(replayed_ticks(pipeline, inputs))
    return RedriveResult(resolved, table, redrive.comparison_of(table), pipeline.failure)


def _with(folder: Path, controller: str, working: Path) -> tuple[ResolvedScenario, PipelineInputs, Pipeline]:
    """Return a record's scenario and inputs, and its pipeline with another controller in it."""
    if live.is_live(folder):
        inputs = live.read_live_inputs(folder)
        resolved, _rig = from_dict(inputs.scenario_content, working)
        return resolved, inputs.pipeline, live.rebuilt_pipeline(inputs.scenario_content, working, controller)
    resolved = lockstep.recorded_scenario(folder, working)
    other = resolved.with_controller(controller)
    parts = assemble(other, working)
    parts.roll(other, ScriptedOperator())
    return resolved, read_pipeline_inputs(folder), parts.pipeline
