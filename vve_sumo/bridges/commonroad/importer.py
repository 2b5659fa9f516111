"""Imports a CommonRoad file into a workspace: its lanelets as a network, the paths, and a scenario.

The first planning problem's ego is the car that a controller drives; its goals end the drive.
"""

from __future__ import annotations

import math
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np

from vve_sumo.bridges.commonroad.lanelets import Lanelet, build, line_of, nearest, read_lanelets, way
from vve_sumo.bridges.commonroad.numbers import interval
from vve_sumo.bridges.commonroad.obstacles import actor_of
from vve_sumo.bridges.commonroad.problems import Problem, ends, goal_lanelets, read_problem
from vve_sumo.bridges.scenario_import.lines import LineFiles, Points, reference
from vve_sumo.bridges.scenario_import.not_taken import NotTakenError, Problems
from vve_sumo.bridges.scenario_import.workspace_files import (
    LOT,
    ORIGIN,
    Written,
    check_scenario,
    copy_all,
    refuse_existing,
    refuse_left_out,
    with_road,
    write_line,
    write_scenario,
)
from vve_sumo.bridges.scenario_import.xml_tree import Element, read_xml
from vve_sumo.errors import ConfigError
from vve_sumo.frames import MapFrame
from vve_sumo.network_tools.build import projection
from vve_sumo.vehicle.load import load
from vve_sumo.workspace import find

VERSIONS: Final = ("2018b", "2020a")
OBSTACLES: Final = ("obstacle", "staticObstacle", "dynamicObstacle")
#: elements that change nothing here, or are read with others
QUIET: Final = frozenset({"location", "scenarioTags", "tags", "lanelet", "planningProblem", "intersection", *OBSTACLES})
#: those that are named in a note
NOTED: Final = {"trafficSign": "traffic signs change nothing here"}
#: model of the ego's car: where its centre is counts, because CommonRoad's positions are centres
VEHICLE: Final = "ford_fusion"
#: the ego's speeds [m/s]: slower it begins from rest, faster none is driven
SLOWEST, FASTEST = 1.0, 40.0
#: of an ego that begins from rest, where no goal says one [m/s]
USUAL_SPEED: Final = 10.0
#: a drive goes on this long after its last goal would have to be reached [s]
MARGIN: Final = 5.0
LONGEST: Final = 180.0
#: how long the ego may stand before the drive is over [s]
REST: Final = 30.0
#: the ego's line begins so far behind its place, where its lanelet does not [m]
RUN_IN: Final = 5.0


def is_commonroad(file: Path) -> bool:
    """Whether a file's root element says that it is CommonRoad's."""
    try:
        with file.open("rb") as opened:
            return b"<commonRoad" in opened.read(4096)
    except OSError:
        return False


def import_file(
    file: Path,
    folder: Path,
    name: str,
    *,
    ego: str | None = None,
    partial: bool = False,
    origin: tuple[float, float] | None = None,
) -> Written:
    """Import a CommonRoad file into a workspace's folder.

    `ego` is the number of the planning problem; without it the first is taken. Raises ConfigError and writes
    nothing where something is not taken, unless it is `partial`: then that is left out.
    """
    refuse_existing(folder, name, [name])
    found = read_scenario(file, name, ego)
    refuse_left_out(found.problems, partial)
    place = origin or ORIGIN
    with tempfile.TemporaryDirectory() as made:
        aside = Path(made)
        (x0, y0), frame = found.middle, MapFrame(projection(place))
        warnings = build(found.lanelets, found.middle, place, aside / "networks" / f"{name}.net.xml")
        write_scenario(aside, name, with_road(found.table, name), file)
        for line, points in found.lines.items():
            write_line(aside, line, [(x - x0, y - y0) for x, y in points], frame, file)
        check_scenario(aside, name)
        copy_all(aside, folder)
    return Written([name], found.problems, found.notes, warnings)


class Imported(NamedTuple):
    """What a file came to."""

    table: dict[str, Any]  #: of the scenario
    lines: dict[str, Points]  #: by the names of their files, in the file's coordinates [m]
    problems: list[str]  #: what is left out, each with file, line and element
    notes: list[str]  #: what is taken otherwise than it stands there
    lanelets: Mapping[str, Lanelet]
    middle: tuple[float, float]  #: of the lanelets [m]


def read_scenario(file: Path, name: str, ego: str | None = None) -> Imported:
    """Return what a CommonRoad file comes to; writes nothing, and builds no network.

    Raises ConfigError for what is no such file, and for an ego that cannot drive. All else that is not taken is left
    out and stands in `problems`.
    """
    try:
        reader = _Reader(file, name, ego)
        table = reader.read()
    except NotTakenError as error:
        raise ConfigError(str(error)) from None
    problems = reader.problems
    return Imported(table, reader.files.points, problems.found, problems.notes, reader.lanelets, reader.middle)


class _Reader:
    def __init__(self, file: Path, name: str, ego: str | None) -> None:
        self._root, self._file = read_xml(file, "a CommonRoad scenario"), file
        self._step = self._time_step()
        self.lanelets = read_lanelets(self._root)
        self.files, self.problems = LineFiles(name), Problems()
        self._problem = read_problem(self._root, self._step, ego)
        vehicle = load(find("vehicle", VEHICLE, Path.cwd())).vehicle
        self._ahead = 0.5 * vehicle.length - vehicle.rear_overhang
        corners = np.concatenate([one.middle for one in self.lanelets.values()])
        x, y = np.round(0.5 * (corners.min(axis=0) + corners.max(axis=0)), 3).tolist()
        self.middle: tuple[float, float] = (x, y)

    def _time_step(self) -> float:
        root = self._root
        if root.tag != "commonRoad":
            raise ConfigError(f"{root.where}: expected <commonRoad>")
        version = root.attributes.get("commonRoadVersion", "")
        if version not in VERSIONS:
            raise NotTakenError(root, f"commonRoadVersion: expected {' or '.join(VERSIONS)}, got {version[:20]!r}")
        try:
            step = float(root.attributes.get("timeStepSize", ""))
        except ValueError:
            step = math.nan
        if not 0.001 <= step <= 10.0:
            raise NotTakenError(root, "timeStepSize: expected 0.001 to 10 s")
        return step

    def read(self) -> dict[str, Any]:
        """Return the table of the scenario."""
        for one in self._root.children:
            if (said := NOTED.get(one.tag)) is not None:
                self.problems.note(f"{one.where}: {said}")
            elif one.tag not in QUIET:
                self.problems.add(NotTakenError(one, "this element is not taken"))
        ego, goals, last = self._ego()
        actors = []
        for one in self._root.children:
            if one.tag in OBSTACLES:
                try:
                    actors.append(actor_of(one, self._step, self.files, self.problems.note))
                except NotTakenError as error:
                    self.problems.add(error)
        table: dict[str, Any] = {
            "title": self._root.attributes.get("benchmarkID") or self._file.stem,
            "description": f"Imported from {self._file.name}, CommonRoad.",
            "duration_s": round(last + MARGIN, 3) if last > 0.0 else LONGEST,
            "after_stop_s": REST,
            "ego": ego,
            "actors": actors,
        }
        return table | ({"end_trigger": {"when": goals}} if goals else {})

    def _ego(self) -> tuple[dict[str, Any], list[list[dict[str, Any]]], float]:
        """Return the ego's table, the triggers of its goals, and the latest time of a goal [s]."""
        problem, start = self._problem, self._problem.initial
        if start.time != 0.0:
            raise NotTakenError(start.element, "expected a planning problem from time 0 on")
        first = nearest(self.lanelets, start.x, start.y, start.heading)
        if first is None:
            raise NotTakenError(start.element, "the ego begins on no lanelet that leads its way")
        wanted = set().union(*(self._lanelets_of(goal) for goal in problem.goals), set())
        path_line = self._beside(way(self.lanelets, first, wanted))
        path = reference(path_line, problem.element)
        rear = start.x - self._ahead * math.cos(start.heading), start.y - self._ahead * math.sin(start.heading)
        begin = round(max(path.project(*rear).s, 0.0), 4)
        speed, moving = self._speed(problem)
        if not moving:
            path_line = [path.at(begin + n)[:2] for n in range(math.floor(path.length - begin) + 1)]
            path, begin = reference(path_line, problem.element), 0.0
        table: dict[str, Any] = {"path": self.files.named("ego", path_line), "speed_mps": speed}
        if moving:
            table |= {"initial_speed_mps": speed, "initial_s_m": begin}
        self.problems.note("the ego is the car of the scenario here; its centre begins at the file's place")
        goals, last = [], 0.0
        for goal in problem.goals:
            try:
                if (time := goal.child("time")) is not None:
                    last = max(last, interval(time).high * self._step)
                goals.append(ends(goal, self._step, path, begin, self._ahead, self.lanelets))
            except NotTakenError as error:
                self.problems.add(error)
        return table | {"lot": dict(LOT)}, [goal for goal in goals if goal], last

    def _lanelets_of(self, goal: Element) -> set[str]:
        try:
            return goal_lanelets(goal, self.lanelets)
        except NotTakenError as error:
            self.problems.add(error)
            return set()

    def _speed(self, problem: Problem) -> tuple[float, bool]:
        """Return the ego's speed [m/s], and whether it begins with it."""
        if problem.speed >= SLOWEST:
            if problem.speed > FASTEST:
                raise NotTakenError(problem.initial.element, f"velocity: expected at most {FASTEST:g} m/s")
            return round(problem.speed, 4), True
        self.problems.note(f"{problem.initial.element.where}: the ego begins from rest, and drives {USUAL_SPEED:g} m/s")
        return USUAL_SPEED, False

    def _beside(self, lanelets: list[Lanelet]) -> Points:
        """Return the ego's line: the middle of lanelets, as far beside it as the ego begins, from behind it on."""
        start, line = self._problem.initial, line_of(lanelets)
        path = reference(line, self._problem.element)
        foot = path.project(start.x, start.y)
        found = []
        for n in range(math.floor(path.length) + 1):
            at = path.at(float(n))
            left = -math.sin(at.heading), math.cos(at.heading)
            found.append((at.x + foot.d * left[0], at.y + foot.d * left[1]))
        if foot.s < self._ahead + RUN_IN:
            (x, y), heading = found[0], path.at(0.0).heading
            back = math.ceil(self._ahead + RUN_IN)
            found = [(x - n * math.cos(heading), y - n * math.sin(heading)) for n in range(back, 0, -1)] + found
        return found
