"""The replay shell: a record's inputs through the same chain, and the first difference in what comes out.

SUMO is not started: the recorded actors are fed. Lockstep records only; their pose bytes, the car's reports and the
street's faults are all in the record, and so is everything that the chain answered.
"""

from __future__ import annotations

import json
import math
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path as FilePath
from typing import Any

import numpy as np
import pyarrow as pa

from vve_sumo import bus
from vve_sumo.drive.chain import Acted
from vve_sumo.drive.lockstep import Operator, chain_of
from vve_sumo.drive.record import hash_parts, read_pose_chunks, read_table
from vve_sumo.drive.setting import PERIOD, Setting, resolve, versions
from vve_sumo.errors import ConfigError
from vve_sumo.scenario.load import parse
from vve_sumo.values import Actors, Frame
from vve_sumo.vehicle.dbw import COMMAND_IDS

#: a candump log has microseconds; what happens lies milliseconds apart [s]
SLACK = 1e-5


@dataclass(frozen=True, slots=True)
class Difference:
    """Where a replay first departs from its record."""

    tick: int
    what: str  #: column, or "frames"
    recorded: str
    replayed: str


@dataclass(frozen=True, slots=True)
class Inputs:
    """What the chain was given and what it answered, by tick."""

    pose: dict[int, list[tuple[float, bytes]]]
    reports: dict[int, list[Frame]]
    commands: dict[int, list[Frame]]
    actors: dict[int, Actors]
    ticks: list[dict[str, Any]]


def setting_of(folder: FilePath, working: FilePath) -> tuple[Setting, list[str]]:
    """Return the setting that a record was driven in, and a line for everything that is not as it was then.

    Raises ConfigError where the record is none of a lockstep drive, or a file that it names is gone.
    """
    file = folder / "scenario.json"
    try:
        resolved = json.loads(file.read_text(encoding="utf-8"))
        settings, name = resolved["settings"], resolved["scenario"]
        hashes, then = resolved["files_sha256"], resolved["versions"]
    except (OSError, ValueError, KeyError) as error:
        raise ConfigError(f"{folder}: no record of a drive: scenario.json: {error}") from None
    if "pose" in hashes:
        raise ConfigError(f"{folder}: a playback, expected a drive with the hardware-free car")
    setting = resolve(name, parse(settings, file), file, working)
    now = setting.resolved(setting.controller(working))["files_sha256"]
    changed = [f"{role} has changed since" for role in sorted(now | hashes) if hashes.get(role) != now.get(role)]
    mine = versions()
    changed += [f"{part} was {then.get(part)}, is {mine[part]}" for part in mine if then.get(part) != mine[part]]
    return setting, changed


def altered_parts(folder: FilePath) -> list[str]:
    """Return the parts of a finished record whose hash is not the one that the drive wrote.

    Raises ConfigError where a part or the summary is missing: such a record was never finished.
    """
    try:
        summary = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
        then = summary["record_parts_sha256"]
    except (OSError, ValueError, KeyError) as error:
        raise ConfigError(f"{folder}: no finished record of a drive: summary.json: {error}") from None
    now = hash_parts(folder)
    return [part for part in now if now[part] != then.get(part)]


def read_inputs(folder: FilePath, epoch: float) -> Inputs:
    """Read a record's inputs and answers; raises ConfigError where one of its files is missing or torn."""
    pose: dict[int, list[tuple[float, bytes]]] = defaultdict(list)
    for time, data in read_pose_chunks(folder / "pose.bin"):
        pose[_heard_at(time)].append((time, data))
    reports: dict[int, list[Frame]] = defaultdict(list)
    commands: dict[int, list[Frame]] = defaultdict(list)
    for time, _channel, frame in bus.read_log(folder / "can.log"):
        if frame.id in COMMAND_IDS:
            commands[round((time - epoch) / PERIOD)].append(frame)
        else:
            reports[_heard_at(time - epoch)].append(frame)
    actors, ticks = read_table(folder, "actors"), read_table(folder, "ticks")
    return Inputs(pose, reports, commands, _snapshots(actors), ticks.to_pylist())


def _heard_at(time: float) -> int:
    """Return the tick that is the first to know of something that happened at a drive time [s]."""
    return math.ceil((time - SLACK) / PERIOD)


def _snapshots(table: pa.Table) -> dict[int, Actors]:
    columns = ("x_m", "y_m", "heading_rad", "speed_mps", "length_m", "width_m", "radar_cross_section_m2")
    numbers = [table[name].to_numpy() for name in columns]
    names, tick = table["actor"].to_pylist(), table["tick"].to_numpy()
    edges = np.flatnonzero(np.diff(tick)) + 1
    found = {}
    for start, end in zip([0, *edges.tolist()], [*edges.tolist(), len(tick)], strict=True):
        if end > start:
            at = int(tick[start])
            found[at] = Actors(at * PERIOD, tuple(names[start:end]), *(column[start:end] for column in numbers))
    return found


def replay(setting: Setting, inputs: Inputs, working: FilePath) -> Difference | None:
    """Run a record's inputs through the chain; return the first difference, None where all is bit for bit the same."""
    chain, operator = chain_of(setting, setting.controller(working)).chain, Operator()
    nothing = Actors(0.0, (), *(np.empty(0) for _ in range(7)))
    found: tuple[str, ...] = ()
    for row in inputs.ticks:
        tick = int(row["tick"])
        for time, data in inputs.pose.get(tick, ()):
            chain.receive(time, data)
        actors, reports = inputs.actors.get(tick, nothing), inputs.reports.get(tick, [])
        acted = chain.act(tick, tick * PERIOD, actors, reports, operator.act(), found)
        operator.saw(acted.verdict.state)
        if (difference := _compare(tick, row, inputs.commands.get(tick, []), acted)) is not None:
            return difference
        found = tuple(code for code in row["anchor_faults"].split("+") if code)
        found += ("virtual_contact",) if row["contacts"] else ()
    return None


def _compare(tick: int, row: dict[str, Any], commands: list[Frame], acted: Acted) -> Difference | None:
    for what, mine in _decided(acted):
        recorded = row[what]
        if recorded != mine and not (recorded != recorded and mine != mine):
            return Difference(tick, what, repr(recorded), repr(mine))
    if list(acted.frames) != commands:
        return Difference(tick, "frames", _spelt(commands), _spelt(acted.frames))
    return None


def _decided(acted: Acted) -> Iterator[tuple[str, Any]]:
    pose, setpoint, nan = acted.pose, acted.setpoint, math.nan
    yield "x_m", pose.x if pose else nan
    yield "y_m", pose.y if pose else nan
    yield "heading_rad", pose.heading if pose else nan
    yield "speed_mps", pose.speed if pose else nan
    yield "detections", len(acted.detections.range)
    yield "steering_setpoint_rad", setpoint.steering if setpoint else nan
    yield "acceleration_setpoint_mps2", setpoint.acceleration if setpoint else nan
    yield "state", acted.verdict.state.value
    yield "reasons", "+".join(acted.verdict.reasons)


def _spelt(frames: Any) -> str:
    return " ".join(f"{frame.id:03X}#{frame.data.hex().upper()}" for frame in frames)
