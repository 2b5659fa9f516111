"""The replay shell: feeds a record's inputs through the same pipeline and finds the first difference in the outputs.

SUMO is not started: the recorded actors are fed in. The record holds all inputs of the pipeline at a tick (pose bytes,
actors, the steering angle that the car had reported, the shell's faults) and all its outputs.
"""

from __future__ import annotations

from bisect import bisect_left
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass, replace
from itertools import zip_longest
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa

from vve_sumo import bus
from vve_sumo.commanded_path import by_tick
from vve_sumo.drive import plugged_in, provenance
from vve_sumo.drive.lockstep import ScriptedOperator, assemble, lone_steps
from vve_sumo.drive.people_on_road import PeopleOnRoad
from vve_sumo.drive.persons import recorded_people
from vve_sumo.drive.pipeline import Pipeline, TickResult
from vve_sumo.drive.resolved_scenario import (
    ResolvedScenario,
    recorded_faults,
    recorded_model,
    resolve_scenario,
    versions,
)
from vve_sumo.drive.several_egos import recorded_ego
from vve_sumo.drive.snapshots import NO_ACTORS, snapshots
from vve_sumo.drive.tick_rows import result_columns, status_columns
from vve_sumo.errors import ConfigError
from vve_sumo.people.person import People
from vve_sumo.record.car_bus import with_direction
from vve_sumo.record.declared import read_resolved
from vve_sumo.record.layout import (
    LIVE_SCHEMAS,
    OPTIONAL_SCHEMAS,
    PEOPLE,
    PEOPLE_REPORTS,
    SCHEMAS,
    SIGNAL_PLANS,
    recorded_brain,
    sensor_table,
)
from vve_sumo.record.reader import holds_table, read_commanded, read_pose_chunks, read_table, sensor_tables
from vve_sumo.record.rows import PersonReportRow, PersonRow
from vve_sumo.record.signals import RecordedPlans
from vve_sumo.scenario.load import parse
from vve_sumo.timing import PERIOD
from vve_sumo.values import Actors, CommandedPath, Frame
from vve_sumo.vehicle.interface import DEFAULT, InterfaceConfig, load

#: tolerance of a CAN log's times [s]: candump rounds to microseconds, and events lie milliseconds apart
TIME_TOLERANCE = 1e-5


@dataclass(frozen=True, slots=True)
class Difference:
    """The first difference between a replay and its record."""

    number: int  #: of the tick, or of the gateway's step
    item: str  #: name of the column, "frames", or the sensor and its row
    recorded: str
    replayed: str


class RecordedReading(NamedTuple):
    """A sensor's reading at a tick, as the record holds it."""

    measured: float  #: drive time of the measurement [s]
    rows: list[tuple[Any, ...]]  #: of the sensor's table, without the tick


@dataclass(frozen=True, slots=True)
class PipelineInputs:
    """The pipeline's recorded inputs and outputs."""

    pose: list[tuple[float, bytes]]  #: receive time [s] and bytes of each portion, in the order of arrival
    actors: dict[int, Actors]  #: by tick
    readings: dict[int, dict[str, RecordedReading]]  #: by tick and sensor; only readings whose rows are complete
    ticks: list[dict[str, Any]]  #: rows of the record, up to the last one whose inputs are complete
    torn: int  #: number of later rows, whose inputs did not reach the disk
    commanded: dict[int, CommandedPath]  #: paths that commands carry, by tick
    signals: RecordedPlans  #: what the sensors were handed of the signals


@dataclass(frozen=True, slots=True)
class CarFrames:
    """What the gateway received and what it sent on the car's bus, by tick of a lockstep drive."""

    reports: dict[int, list[Frame]]
    commands: dict[int, list[Frame]]


def recorded_scenario(folder: Path, working: Path) -> ResolvedScenario:
    """Return the resolved scenario that a record was driven in; no code of its controller is run.

    Raises ConfigError for the record of a playback, and where a file that the record names is gone.
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
    ego, declared = recorded_ego(scenario_content)
    return replace(
        resolved,
        ego_id=ego,
        declared=declared,
        model=recorded_model(scenario_content),
        faults=recorded_faults(scenario_content),
        people=recorded_people(scenario_content),
    )


def changed_since(folder: Path, resolved: ResolvedScenario) -> list[str]:
    """Return a line for every file and version that differs from a record's; files of plug-ins are left out."""
    scenario_content = read_resolved(folder)
    then, now = scenario_content["files_sha256"], plugged_in.digests(resolved.files)
    roles = sorted(role for role in now | then if not role.startswith(plugged_in.PREFIXES))
    changed = [f"{role} has changed since" for role in roles if then.get(role) != now.get(role)]
    mine, then = versions(), scenario_content["versions"]
    changed += [f"{part} was {then.get(part)}, is {mine[part]}" for part in mine if then.get(part) != mine[part]]
    return changed + provenance.changed_since(provenance.read(folder))


def changed_code(folder: Path, working: Path, *, controller: bool = True) -> list[str]:
    """Return a line for every file of the recorded plug-ins' code that has changed; none of that code is run.

    The plug-ins are the sensors, the drive-by-wire interface, a live drive's receiver, and the controller unless
    `controller` is false; no metric is measured again. Raises ConfigError where a plug-in no longer exists.
    """
    file, resolved = folder / "scenario.json", read_resolved(folder)
    try:
        recorded = {role: [str(digest)] for role, digest in resolved["files_sha256"].items()}
        parts = [*plugged_in.of_scenario(parse(resolved["settings"], file), working)]
        wire = InterfaceConfig(**resolved["vehicle_model"]["interface"])
        parts.append(plugged_in.vehicle_interface(wire.name))
        if "rig" in resolved:
            parts.append(plugged_in.receiver(resolved["rig"]["pose"]["kind"]))
    except (AttributeError, KeyError, TypeError) as error:
        raise ConfigError(f"{file}: it does not say what plugged in: {error!r}") from None
    foreign = recorded_brain(resolved) if controller else ""
    run = (part for part in parts if not part.role.startswith(plugged_in.METRIC))
    asked = (part for part in run if part.role != plugged_in.CONTROLLER or (controller and not foreign))
    lines = [line for part in asked for line in part.changed(recorded)]
    lines += plugged_in.changed_wire(wire, recorded)
    # An external controller's commands are in the record, as frames of the car's bus; setpoints are not.
    if foreign == "setpoints":
        lines.append("controller: an external controller decided, which cannot be asked again")
    return lines


def read_rows(folder: Path, name: str) -> pa.Table:
    """Read a table of a record with all columns that a replay needs; raises ConfigError where one is missing."""
    table = read_table(folder, name)
    wanted = (SCHEMAS | LIVE_SCHEMAS | OPTIONAL_SCHEMAS).get(name) or sensor_tables(folder)[name]
    if (missing := next((column for column in wanted.names if column not in table.column_names), None)) is not None:
        raise ConfigError(f"{folder}: {name} has no column {missing}: written by another version of vve-sumo")
    return table


def read_pipeline_inputs(folder: Path) -> PipelineInputs:
    """Read the pipeline's inputs and outputs from a record that is finished or was cut off.

    Raises ConfigError where one of the record's files is missing or unreadable.
    """
    ticks, actors = (read_rows(folder, name) for name in ("ticks", "actors"))
    pose = read_pose_chunks(folder / "pose.bin")
    inputs = PipelineInputs(
        pose,
        snapshots(actors),
        _readings(folder),
        ticks.to_pylist(),
        0,
        by_tick(read_commanded(folder)),
        RecordedPlans.of_rows(read_rows(folder, SIGNAL_PLANS).to_pylist() if holds_table(folder, SIGNAL_PLANS) else ()),
    )
    whole = _whole_ticks(inputs)
    return replace(inputs, ticks=inputs.ticks[:whole], torn=len(inputs.ticks) - whole)


def _whole_ticks(inputs: PipelineInputs) -> int:
    """Return how many ticks, from the first on, have all the inputs that their rows count."""
    expected = 0
    for number, row in enumerate(inputs.ticks):
        tick = row["tick"]
        heard = row["datagrams"] <= len(inputs.pose)
        seen = len(inputs.actors.get(tick, NO_ACTORS).ids) == expected
        sensed = len(inputs.readings.get(tick, ())) == row["readings"]
        if not (heard and seen and sensed):
            return number
        expected = row["actors"]
    return len(inputs.ticks)


def read_car_frames(folder: Path, epoch: float, interface: InterfaceConfig = DEFAULT) -> CarFrames:
    """Read a lockstep drive's CAN log; `interface` tells the gateway's command frames from what the gateway received.

    The gateway steps at the ticks' times, skipped ones included: a command is of the tick of its time, a report of the
    first tick that is not earlier. Frames after the last tick are no tick's. Raises ConfigError as `bus.read_log` does.
    """
    commands = load(interface).facts.commands
    frames = CarFrames(defaultdict(list), defaultdict(list))
    ticks, times = _steps(folder)
    for time, _channel, frame, is_sent in with_direction(bus.read_log(folder / "can.log"), commands):
        place = bisect_left(times, time - epoch - TIME_TOLERANCE)
        if place < len(ticks):
            (frames.commands if is_sent else frames.reports)[ticks[place]].append(frame)
    return frames


def _steps(folder: Path) -> tuple[list[int], list[float]]:
    """Return number and drive time [s] of every step of a lockstep drive's gateway."""
    table = read_table(folder, "ticks")
    ticks: list[int] = []
    times: list[float] = []
    for tick, time in zip(table["tick"].to_pylist(), table["time_s"].to_pylist(), strict=True):
        for number, moment in lone_steps(ticks[-1], times[-1], tick, time) if ticks else ():
            ticks.append(number)
            times.append(moment)
        ticks.append(tick)
        times.append(time)
    return ticks, times


def _readings(folder: Path) -> dict[int, dict[str, RecordedReading]]:
    rows = {name: _rows(read_rows(folder, name)) for name in sensor_tables(folder)}
    found: dict[int, dict[str, RecordedReading]] = defaultdict(dict)
    columns = (column.to_pylist() for column in read_rows(folder, "readings").select(SCHEMAS["readings"].names))
    for tick, sensor, measured, count in zip(*columns, strict=True):
        own = rows.get(sensor_table(sensor), {}).get(tick, [])
        if len(own) == count:
            found[tick][sensor] = RecordedReading(measured, own)
    return found


def _rows(table: pa.Table) -> dict[int, list[tuple[Any, ...]]]:
    found: dict[int, list[tuple[Any, ...]]] = defaultdict(list)
    for tick, *row in zip(*(column.to_pylist() for column in table), strict=True):
        found[tick].append(tuple(row))
    return found


def replayed_ticks(pipeline: Pipeline, inputs: PipelineInputs) -> Iterator[tuple[dict[str, Any], TickResult]]:
    """Run the pipeline on the recorded inputs and yield each tick's recorded row with the result computed now."""
    taken = 0
    for row in inputs.ticks:
        tick, now, steering = int(row["tick"]), row["time_s"], row["measured_steering_rad"]
        for time, data in inputs.pose[taken : row["datagrams"]]:
            pipeline.receive(time, data)
        taken = row["datagrams"]
        pipeline.see(now, inputs.actors.get(tick, NO_ACTORS), inputs.signals.phases(now))
        yield row, pipeline.decide(tick, now, steering, reason_codes(row["shell_faults"]))
        pipeline.prepare(now + PERIOD, steering)


class _Placed:
    """Takes what a replay of people would record."""

    def __init__(self) -> None:
        self.rows: list[dict[str, Any]] = []

    def person_reported(self, row: PersonReportRow) -> None:
        """Take a report, which the record holds already."""

    def person_placed(self, row: PersonRow) -> None:
        """Take a person's row."""
        self.rows.append(asdict(row))


def replay_people(folder: Path) -> Difference | None:
    """Run the recorded reports of real people through what judges and places them; return the first difference.

    Nothing where the drive had no people. Raises ConfigError where a table is unreadable or of another version.
    """
    setups = recorded_people(read_resolved(folder))
    if not setups or not holds_table(folder, PEOPLE):
        return None
    placed, steps = _Placed(), read_rows(folder, PEOPLE).to_pylist()
    people = PeopleOnRoad(People(setups), placed)
    reports = read_rows(folder, PEOPLE_REPORTS).to_pylist() if holds_table(folder, PEOPLE_REPORTS) else []
    taken = 0
    for row in steps[:: len(setups)]:
        while taken < len(reports) and reports[taken]["step"] <= row["step"]:
            people.receive(reports[taken]["received_s"], reports[taken]["datagram"])
            taken += 1
        people.step(row["time_s"])
    for row, mine in zip(steps, placed.rows, strict=False):
        if (difference := compare(row["step"], row, mine)) is not None:
            return replace(difference, item=f"person {row['person']}: {difference.item}")
    return None


def reason_codes(joined: str) -> tuple[str, ...]:
    """Return the reason codes in a record's column."""
    return tuple(code for code in joined.split("+") if code)


def replay(resolved: ResolvedScenario, inputs: PipelineInputs, frames: CarFrames, working: Path) -> Difference | None:
    """Run a lockstep record through pipeline and gateway; return the first difference, None if there is none."""
    parts, operator = assemble(resolved, working), ScriptedOperator()
    parts.roll(resolved, operator)
    before: tuple[int, float] | None = None
    for row, result in replayed_ticks(parts.pipeline, inputs):
        tick = int(row["tick"])
        for number, time in lone_steps(*before, tick, row["time_s"]) if before is not None else ():
            output = parts.gateway.step(time, None, frames.reports.get(number, []), operator.next_command())
            operator.observe(output.status)
            if difference := compare_frames(number, frames.commands.get(number, []), output.frames):
                return difference
        before = tick, row["time_s"]
        reports, commands = frames.reports.get(tick, []), frames.commands.get(tick, [])
        output = parts.gateway.step(row["time_s"], result.setpoint, reports, operator.next_command())
        operator.observe(output.status)
        difference = (
            compare_result(inputs, row, result)
            or compare(tick, row, status_columns(output.status))
            or compare_frames(tick, commands, output.frames)
        )
        if difference is not None:
            return difference
    return None


def compare(number: int, row: dict[str, Any], mine: Mapping[str, Any]) -> Difference | None:
    """Return the first column that differs from the recorded row; NaN equals NaN."""
    for what, value in mine.items():
        recorded = row[what]
        if recorded != value and not (recorded != recorded and value != value):
            return Difference(number, what, repr(recorded), repr(value))
    return None


def compare_result(inputs: PipelineInputs, row: dict[str, Any], result: TickResult) -> Difference | None:
    """Return the first difference between a tick's result and its recorded row, commanded path and readings."""
    tick = int(row["tick"])
    if (difference := compare(tick, row, result_columns(result))) is not None:
        return difference
    if (then := inputs.commanded.get(tick)) != result.commanded_path:
        return Difference(tick, "commanded path", repr(then), repr(result.commanded_path))
    recorded = inputs.readings.get(tick, {})
    for sensor, columns in result.readings.items():
        values = (column.tolist() if isinstance(column, np.ndarray) else column for column in columns)
        mine = RecordedReading(result.sensors[sensor].time, list(zip(*values, strict=True)))
        if (came := recorded.get(sensor)) is None:
            return Difference(tick, f"sensor {sensor}", "no reading", "a reading")
        if came.measured != mine.measured:
            return Difference(tick, f"sensor {sensor}: measured_s", repr(came.measured), repr(mine.measured))
        for number, (one, other) in enumerate(zip_longest(came.rows, mine.rows)):
            if one != other:
                return Difference(tick, f"sensor {sensor}: row {number}", repr(one), repr(other))
    return None


def compare_frames(number: int, recorded: list[Frame], mine: tuple[Frame, ...]) -> Difference | None:
    """Return the difference between the recorded frames and those sent now, None if there is none."""
    return None if list(mine) == recorded else Difference(number, "frames", _spelt(recorded), _spelt(mine))


def _spelt(frames: Iterable[Frame]) -> str:
    return " ".join(map(bus.frame_text, frames))
