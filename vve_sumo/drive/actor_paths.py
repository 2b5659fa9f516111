"""Finds and reads the paths and recorded speeds that a scenario's actors follow.

Reads files and moves no actor; must not know SUMO.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from vve_sumo.csv_numbers import CsvNumbers
from vve_sumo.errors import ConfigError
from vve_sumo.path import ReferencePath
from vve_sumo.scenario.road_users import Actor

SPEED_COLUMNS: Final = ("time_s", "speed_mps")

#: No road user is faster [m/s]: a greater number in a file is not a speed in metres per second.
MAX_SPEED: Final = 100.0

#: Returns the file for a kind of file, its name, and the scenario's key that names it.
Find = Callable[[str, str, str], Path]

Speeds = tuple[tuple[float, ...], tuple[float, ...]]  #: times [s], speeds [m/s]


@dataclass(frozen=True, slots=True)
class ActorPaths:
    """What the actors follow, by the names that the scenario uses."""

    lines: dict[str, ReferencePath]  #: in the virtual road's map
    recordings: dict[str, Speeds]
    files: dict[str, Path]  #: what was read, by role


def find_actor_paths(
    actors: tuple[Actor, ...], file: Path, ego_path: ReferencePath, find: Find, read: Callable[[Path], ReferencePath]
) -> ActorPaths:
    """Find and read what the actors follow; `read` reads a path's file.

    Raises ConfigError. It names the scenario's `file` and key where a file is missing or `at_m` lies beyond the path,
    and the file and line where a file's content is wrong.
    """
    found = ActorPaths({}, {}, {})
    for actor in actors:
        where = f"actors.{actor.id}"
        if actor.path is not None:
            found.files[f"{where}.path"] = source = find("path", actor.path, f"{where}.path")
            if actor.path not in found.lines:
                found.lines[actor.path] = read(source)
        path = ego_path if actor.path is None else found.lines[actor.path]
        if actor.at_m is not None and actor.at_m > path.length:
            raise ConfigError(f"{file}: {where}: at_m {actor.at_m:g} lies beyond the path's {path.length:.1f} m")
        for action in actor.story.actions if actor.story is not None else ():
            if action.line is not None and (name := action.line.path) is not None:
                key = f"{where}.story.actions.{action.name}.line.path"
                found.files[key] = source = find("path", name, key)
                if name not in found.lines:
                    found.lines[name] = read(source)
        for number, event in enumerate(actor.events):
            if event.speeds is not None:
                key = f"{where}.events.{number}.speeds"
                found.files[key] = source = find("speeds", event.speeds, key)
                found.recordings[event.speeds] = read_speeds(source)
    return found


def read_speeds(file: Path) -> Speeds:
    """Return times [s] and speeds [m/s] of a CSV file whose header names them; lines that begin with `#` are skipped.

    Raises ConfigError naming file and line for a value that is not a number, a speed outside 0 to MAX_SPEED, and a time
    that is not later than the one before it.
    """
    table = CsvNumbers(file, "speeds")
    times, speeds = [-math.inf], [0.0]
    for where, (time, speed) in table.numbers(SPEED_COLUMNS):
        if not (math.isfinite(time) and 0.0 <= speed <= MAX_SPEED):
            raise ConfigError(
                f"{where}: expected a time and a speed of 0 to {MAX_SPEED:g} m/s, got {time:g}, {speed:g}"
            )
        if not time > times[-1]:
            raise ConfigError(f"{where}: expected a time after {times[-1]:g} s, got {time:g}")
        times.append(time)
        speeds.append(speed)
    if len(times) < 2:
        raise ConfigError(f"{table.name}: expected at least one row of {', '.join(SPEED_COLUMNS)}, got none")
    return tuple(times[1:]), tuple(speeds[1:])
