"""The replay shell: a record's inputs through the same pipeline, and the first difference in what comes out.

SUMO is not started: the recorded actors are fed. What goes into the pipeline at a tick (bytes, actors, the
steering that the car had reported, the shell's faults) is all in the record, and so is everything that it answered.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import zip_longest
from pathlib import Path as FilePath
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa

from vve_sumo import bus
from vve_sumo.drive import provenance
from vve_sumo.drive.lockstep import ScriptedOperator, assemble
from vve_sumo.drive.pipeline import Pipeline, TickResult
from vve_sumo.drive.resolved_scenario import (
    CONTROLLER_ROLE,
    PERIOD,
    ResolvedScenario,
    changed_code,
    digests,
    read_resolved,
    recorded_model,
    resolve_scenario,
    versions,
)
from vve_sumo.drive.tick_rows import result_columns, status_columns
from vve_sumo.errors import ConfigError
from vve_sumo.record.record import ACTOR_COLUMNS, LIVE_SCHEMAS, SCHEMAS, read_pose_chunks, read_table
from vve_sumo.scenario.load import parse
from vve_sumo.values import Actors, Frame
from vve_sumo.vehicle.interface import DEFAULT, InterfaceConfig, load

#: a candump log has microseconds; what happens lies milliseconds apart [s]
TIME_TOLERANCE = 1e-5


@dataclass(frozen=True, slots=True)
class Difference:
    """Where a replay first departs from its record."""

    number: int  #: of the tick, or of the gateway's step
    what: str  #: column, or "frames"
    recorded: str
    replayed: str


class Detection(NamedTuple):
    """A row of the detections, as the record spells it."""

    range_m: float
    azimuth_rad: float
    range_rate_mps: float
    mode: int
    actor: str


NO_ACTORS = Actors(0.0, (), *(np.empty(0) for _ in range(8)))


@dataclass(frozen=True, slots=True)
class PipelineInputs:
    """What the pipeline was given and what it answered."""

    pose: list[tuple[float, bytes]]  #: in the order taken in
    actors: dict[int, Actors]  #: by tick
    scans: dict[int, list[Detection]]  #: of the radar, by tick
    ticks: list[dict[str, Any]]  #: rows of the record, as far as all that went into them is there
    torn: int  #: rows after those: their inputs did not come to the disk any more


@dataclass(frozen=True, slots=True)
class CarFrames:
    """What was heard on the car's bus and what was sent, by tick of a lockstep drive."""

    reports: dict[int, list[Frame]]
    commands: dict[int, list[Frame]]


def recorded_scenario(folder: FilePath, working: FilePath) -> ResolvedScenario:
    """Return the resolved scenario that a record was driven in; nothing of its controller is run.

    Raises ConfigError where the record is none of a lockstep drive, or a file that it names is gone.
    """
    file, scenario_content = folder / "scenario.json", read_resolved(folder)
    try:
        settings, name, hashes = (
            scenario_content["settings"],
            scenario_content["scenario"],
            scenario_content["files_sha256"],
        )
    except KeyError as error:
        raise ConfigError(f"{folder}: no record of a drive: scenario.json: {error}") from None
    if "pose" in hashes:
        raise ConfigError(f"{folder}: a playback, expected a drive with the simulated vehicle")
    resolved = resolve_scenario(name, parse(settings, file), file, working)
    return replace(resolved, model=recorded_model(scenario_content))


def changed_since(folder: FilePath, resolved: ResolvedScenario) -> list[str]:
    """Return a line for every file and every version that is not what a record says of it, but for the controller's."""
    scenario_content = read_resolved(folder)
    then, now = scenario_content["files_sha256"], digests(resolved.files)
    roles = sorted(role for role in now | then if not role.startswith(CONTROLLER_ROLE))
    changed = [f"{role} has changed since" for role in roles if then.get(role) != now.get(role)]
    mine, then = versions(), scenario_content["versions"]
    changed += [f"{part} was {then.get(part)}, is {mine[part]}" for part in mine if then.get(part) != mine[part]]
    return changed + provenance.changed_since(provenance.read(folder))


def changed_controller(folder: FilePath, resolved: ResolvedScenario, working: FilePath) -> list[str]:
    """Return a line for every file of the recorded controller's code that is not as it was; none of it is run.

    Raises ConfigError where there is no such controller any more.
    """
    recorded = {role: [str(digest)] for role, digest in read_resolved(folder)["files_sha256"].items()}
    return changed_code(resolved.scenario.controller.name, recorded, working)


def read_rows(folder: FilePath, name: str) -> pa.Table:
    """Read a table of a record with all columns that a replay needs; raises ConfigError where one is missing."""
    table = read_table(folder, name)
    wanted = (SCHEMAS | LIVE_SCHEMAS)[name]
    if (missing := next((column for column in wanted.names if column not in table.column_names), None)) is not None:
        raise ConfigError(f"{folder}: {name} has no column {missing}: written by another version of vve-sumo")
    return table


def read_pipeline_inputs(folder: FilePath) -> PipelineInputs:
    """Read what went into the pipeline and what it answered, of a record that is finished or was cut off.

    Raises ConfigError where one of the record's files is missing or unreadable.
    """
    ticks, actors, scans = (read_rows(folder, name) for name in ("ticks", "actors", "detections"))
    pose = read_pose_chunks(folder / "pose.bin")
    inputs = PipelineInputs(pose, _snapshots(actors), _scans(scans), ticks.to_pylist(), 0)
    whole = _whole_ticks(inputs)
    return replace(inputs, ticks=inputs.ticks[:whole], torn=len(inputs.ticks) - whole)


def _whole_ticks(inputs: PipelineInputs) -> int:
    """Return how many ticks from the first on have all that they say went into them."""
    expected = 0
    for number, row in enumerate(inputs.ticks):
        tick = row["tick"]
        in_time = row["datagrams"] <= len(inputs.pose)
        seen = len(inputs.actors.get(tick, NO_ACTORS).ids) == expected
        scanned = not row["scanned"] or len(inputs.scans.get(tick, ())) == row["detections"]
        if not (in_time and seen and scanned):
            return number
        expected = row["actors"]
    return len(inputs.ticks)


def read_car_frames(folder: FilePath, epoch: float, interface: InterfaceConfig = DEFAULT) -> CarFrames:
    """Read a lockstep drive's bus, on which `interface` is; raises ConfigError as `bus.read_log` does."""
    sent = load(interface).facts.commands
    frames = CarFrames(defaultdict(list), defaultdict(list))
    for time, _channel, frame in bus.read_log(folder / "can.log"):
        if frame.id in sent:
            frames.commands[round((time - epoch) / PERIOD)].append(frame)
        else:
            frames.reports[math.ceil((time - epoch - TIME_TOLERANCE) / PERIOD)].append(frame)
    return frames


def _snapshots(table: pa.Table) -> dict[int, Actors]:
    numbers = [table[name].to_numpy() for name in ACTOR_COLUMNS]
    names, tick = table["actor"].to_pylist(), table["tick"].to_numpy()
    edges = np.flatnonzero(np.diff(tick)) + 1
    found = {}
    for start, end in zip([0, *edges.tolist()], [*edges.tolist(), len(tick)], strict=True):
        if end > start:
            at = int(tick[start])
            found[at] = Actors(at * PERIOD, tuple(names[start:end]), *(column[start:end] for column in numbers))
    return found


def _scans(table: pa.Table) -> dict[int, list[Detection]]:
    found: dict[int, list[Detection]] = defaultdict(list)
    columns = (table[name].to_pylist() for name in Detection._fields)
    for tick, *detection in zip(table["tick"].to_pylist(), *columns, strict=True):
        found[tick].append(Detection(*detection))
    return found


def replayed_ticks(pipeline: Pipeline, inputs: PipelineInputs) -> Iterator[tuple[dict[str, Any], TickResult]]:
    """Ask the pipeline again, tick by tick: each recorded row with what comes out now."""
    taken = 0
    for row in inputs.ticks:
        tick, now, steering = int(row["tick"]), row["time_s"], row["measured_steering_rad"]
        for time, data in inputs.pose[taken : row["datagrams"]]:
            pipeline.receive(time, data)
        taken = row["datagrams"]
        pipeline.see(now, inputs.actors.get(tick, NO_ACTORS))
        yield row, pipeline.decide(tick, now, steering, reason_codes(row["shell_faults"]))
        pipeline.prepare(now + PERIOD, steering)


def reason_codes(joined: str) -> tuple[str, ...]:
    """Return the reason codes in a record's column."""
    return tuple(code for code in joined.split("+") if code)


def replay(
    resolved: ResolvedScenario, inputs: PipelineInputs, frames: CarFrames, working: FilePath
) -> Difference | None:
    """Run a lockstep record through pipeline and gateway; return the first difference, None where all is the same."""
    parts, operator = assemble(resolved, working), ScriptedOperator()
    for row, result in replayed_ticks(parts.pipeline, inputs):
        tick = int(row["tick"])
        reports, commands = frames.reports.get(tick, []), frames.commands.get(tick, [])
        output = parts.gateway.step(row["time_s"], result.setpoint, reports, operator.next_command())
        operator.observe(output.verdict)
        difference = (
            compare_result(inputs, row, result)
            or compare(tick, row, status_columns(output.verdict))
            or compare_frames(tick, commands, output.frames)
        )
        if difference is not None:
            return difference
    return None


def compare(number: int, row: dict[str, Any], mine: Mapping[str, Any]) -> Difference | None:
    """Return the first column that is not as it was recorded, NaN being like NaN."""
    for what, value in mine.items():
        recorded = row[what]
        if recorded != value and not (recorded != recorded and value != value):
            return Difference(number, what, repr(recorded), repr(value))
    return None


def compare_result(inputs: PipelineInputs, row: dict[str, Any], result: TickResult) -> Difference | None:
    """Return what the pipeline computed otherwise than its row and its scan say."""
    tick = int(row["tick"])
    difference = compare(tick, row, result_columns(result))
    scan = result.readings.get("radar")
    if difference is not None or scan is None:
        return difference
    columns = (column.tolist() if isinstance(column, np.ndarray) else column for column in scan.columns())
    mine = [Detection(*values) for values in zip(*columns, strict=True)]
    for number, (then, now) in enumerate(zip_longest(inputs.scans.get(tick, []), mine)):
        if then != now:
            return Difference(tick, f"detection {number}", repr(then), repr(now))
    return None


def compare_frames(number: int, recorded: list[Frame], mine: tuple[Frame, ...]) -> Difference | None:
    """Return what differs between frames as recorded and as sent now."""
    return None if list(mine) == recorded else Difference(number, "frames", _spelt(recorded), _spelt(mine))


def _spelt(frames: Iterable[Frame]) -> str:
    return " ".join(f"{frame.id:03X}#{frame.data.hex().upper()}" for frame in frames)
