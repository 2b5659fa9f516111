"""Makes of an OpenSCENARIO file the table of a scenario, with the lines that its bodies move along.

Reads files; writes none, and builds no network.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final, NamedTuple

from vve_sumo.bridges.openscenario.actions import (
    LOOKS,
    ROUTES,
    Action,
    Stage,
    drives_as_usual,
    kind_of,
    longitudinal,
    read_action,
    route_of,
    speed_target,
)
from vve_sumo.bridges.openscenario.document import Document
from vve_sumo.bridges.openscenario.ego_path import CHANGES, EgoPath, NominalDrive, body_at
from vve_sumo.bridges.openscenario.entities import Entity, read_entities
from vve_sumo.bridges.openscenario.lines import ACROSS, Track, track_of, trajectory_track
from vve_sumo.bridges.openscenario.parameters import Scope
from vve_sumo.bridges.openscenario.places import Line, Places, Spot
from vve_sumo.bridges.openscenario.road_map import Pose2, RoadMap
from vve_sumo.bridges.openscenario.routes import Route
from vve_sumo.bridges.openscenario.storyboard import Storyboard
from vve_sumo.bridges.openscenario.triggers import Context, Groups
from vve_sumo.bridges.scenario_import.lines import LineFiles, Points, reference, straight
from vve_sumo.bridges.scenario_import.not_taken import NotTakenError, Problems
from vve_sumo.bridges.scenario_import.workspace_files import LOT
from vve_sumo.bridges.scenario_import.xml_tree import Element
from vve_sumo.errors import ConfigError
from vve_sumo.path import ReferencePath
from vve_sumo.scenario.schema import Weather
from vve_sumo.scenario.story_conditions import Body
from vve_sumo.values import EGO

#: a drive that no stop trigger ends by time ends after so long [s]
LONGEST: Final = 180.0
#: a drive goes on this long after its stop trigger would have to have fired [s]
MARGIN: Final = 10.0
#: how long the ego may stand before the drive is over, where a stop trigger ends it otherwise [s]
REST: Final = 30.0
#: who stands faces its lane's way where it is stated no farther from it than this [rad]
FACING: Final = 1e-3
#: who begins no farther than this beside its line is on it [m]
BESIDE: Final = 1e-3
#: the ego's speeds [m/s]: slower it begins from rest, faster none is driven
SLOWEST, FASTEST = 1.0, 40.0


@dataclass(slots=True)
class Imported:
    """What a file came to."""

    table: dict[str, Any]  #: of the scenario
    lines: dict[str, Points]  #: by the names of their files, in the coordinates of the roads [m]
    problems: list[str]  #: what is left out, each with file, line and element
    notes: list[str]  #: what is taken otherwise than it stands there
    roads: RoadMap
    numbers: dict[str, float] = field(default_factory=dict)  #: the file's parameters that are numbers
    decided: list[object] = field(default_factory=list)  #: what says where the ego's path changes lane or offset


def roads_file(document: Document) -> Path:
    """Return the file of a scenario's roads; raises ConfigError naming the element where there is none."""
    logic = document.root.child("RoadNetwork", "LogicFile")
    if logic is None:
        raise ConfigError(f"{document.root.where}: expected a RoadNetwork with a LogicFile")
    try:
        file = document.file.parent / document.scope.text(logic, "filepath")
    except NotTakenError as error:
        raise ConfigError(str(error)) from None
    if not file.is_file():
        raise ConfigError(f"{logic.where}: {file} does not exist")
    return file


def read_scenario(
    file: Path,
    name: str,
    *,
    ego: str | None = None,
    given: Mapping[str, str] | None = None,
    roads: RoadMap | None = None,
) -> Imported:
    """Return what a scenario file comes to; `given` are values for parameters that it declares.

    Raises ConfigError for what is no OpenSCENARIO, for an ego that cannot drive, and where roads are missing. All else
    that is not taken is left out and stands in `problems`.
    """
    document = Document(file, given or {})
    try:
        return _Reader(document, name, ego, roads or RoadMap(roads_file(document))).read()
    except NotTakenError as error:
        # What stands outside of all that can be left out.
        raise ConfigError(str(error)) from None


class _Start(NamedTuple):
    """One private action at the start."""

    who: str  #: name of the entity
    kind: Element  #: what the action does
    scope: Scope


class _Reader:
    def __init__(self, document: Document, name: str, ego: str | None, roads: RoadMap) -> None:
        self._document, self._roads, self._problems = document, roads, Problems()
        self._entities = {one.name: one for one in read_entities(document, ego, self._problems.notes)}
        self._ego = next(one for one in self._entities.values() if one.id == EGO)
        self._stage = Stage(
            Places(document, roads), LineFiles(name), {one.name: one.id for one in self._entities.values()}
        )
        self._types = {one.id: one.type for one in self._entities.values()}
        self._first: dict[str, list[Action]] = {}
        self._friction: float | None = None
        self._ramped = False  #: whether the file has the ego change to its first speed
        self._begun: set[int] = set()  #: identities of actions at the start that are no more than a first speed
        self._inits = self._init_actions()
        self._inits += self._of_story_at_once()

    def read(self) -> Imported:
        self._place_all()
        starts = dict(self._stage.tracks)
        if self._ego.name not in starts:
            why = "; ".join(["the ego has no place at the start", *self._problems.found[:1]])
            self._refuse(NotTakenError(self._ego.element, why))
        self._start_speeds()
        ego = self._ego_path(starts[self._ego.name])
        self._stage.ego_place = ego.place
        self._stage.controlled = {
            one.name
            for one in self._entities.values()
            for holder in one.element.all("ObjectController")
            if not all(map(drives_as_usual, holder.children))
        }
        self._start_all()
        self._stage.places.moving = self._moving()
        context = Context(self._stage.ids, ego.place, {}, {}, self._variables(), types=self._types)
        context.changes = bool(self._stage.path_changes)
        board = Storyboard(self._document, self._stage, context, self._problems)
        stop = board.compile()
        table = self._table(ego, starts, board.stories, stop)
        return Imported(
            table,
            self._stage.files.points,
            self._problems.found,
            self._problems.notes,
            self._roads,
            self._document.numbers,
            self._stage.decided,
        )

    def _refuse(self, error: NotTakenError) -> None:
        raise ConfigError(str(error)) from None

    def _variables(self) -> dict[str, str]:
        holder = self._document.root.child("VariableDeclarations")
        declared = [] if holder is None else holder.children
        return {one.attributes.get("name", ""): self._document.scope.text(one, "value") for one in declared}

    def _ego_path(self, track: Track) -> EgoPath:
        """Return the ego's path from where it begins, with the changes of lane and offset that the file has it make."""
        points, path, begin = track.points, reference(track.points, self._ego.element), track.path_s
        if abs(track.path_d) > BESIDE:
            start = _beside(path, begin, track.path_d)
            points = [_beside(path, float(n), track.path_d) for n in range(math.floor(path.length) + 1)]
            path = reference(points, self._ego.element)
            begin = path.project(*start).s
        context = Context(self._stage.ids, _nowhere, {}, {}, self._variables(), types=self._types)
        board = Storyboard(self._document, self._stage, context, Problems())
        for event, kind in ((event, kind) for name in self._entities for event, kind in board.doing(name)):
            for actor in event.actors:
                self._stage.sidewards.setdefault(actor, set()).add(kind.tag)
        size = self._ego.length, self._ego.width, self._ego.reference
        nominal = NominalDrive(path, begin, self._kept_speed(board), self._never_moving(board), size)
        ego = EgoPath(self._stage, self._ego.name, points, nominal)
        for one in self._inits:
            if one.who == ego.name and one.kind.tag in CHANGES:
                try:
                    ego, made = ego.with_change(one.kind, one.scope, ego.nominal.begin)
                    self._stage.path_changes[0, id(one.kind)] = 0.0, made.end - made.begin
                except NotTakenError as error:
                    self._stage.refused_changes[0, id(one.kind)] = error
        return board.change_path(ego)

    def _kept_speed(self, board: Storyboard) -> float | None:
        """Return the speed that the ego keeps in the file [m/s], None where that changes it or begins from rest."""
        of_story = [kind for _, kind in board.doing(self._ego.name)]
        of_start = [one.kind for one in self._inits if one.who == self._ego.name and id(one.kind) not in self._begun]
        speed = self._stage.speeds.get(self._ego.name, 0.0)
        if speed < SLOWEST or self._ramped or any(longitudinal(kind) for kind in (*of_story, *of_start)):
            return None
        return speed

    def _never_moving(self, board: Storyboard) -> dict[str, Body]:
        """Return the entities that never move, by id."""
        moving = {one.who for one in self._inits if one.kind.tag not in ("TeleportAction", "SpeedAction", *LOOKS)}
        moving |= {name for name, speed in self._stage.speeds.items() if speed > 0.0} | board.actors
        moving |= {one.who for one in self._inits if one.kind.tag == "SpeedAction" and id(one.kind) not in self._begun}
        found = {}
        for one in self._entities.values():
            spot = self._stage.places.entities.get(one.name)
            if one.id != EGO and one.name not in moving and spot is not None:
                found[one.id] = body_at(spot.pose, (one.length, one.width, one.reference))
        return found

    def _moving(self) -> set[str]:
        """Return the entities that may be elsewhere than at the start when an event begins."""
        found = {self._ego.name, *self._first, *(name for name, speed in self._stage.speeds.items() if speed > 0.0)}
        actors = [one for one in self._document.root.walk() if one.tag == "Actors"]
        named = {reference.attributes.get("entityRef", "") for one in actors for reference in one.children}
        # Whom a parameter names is anybody.
        return set(self._entities) if any(name.startswith("$") for name in named) else found | named

    def _of_story_at_once(self) -> list[_Start]:
        """Return what says where entities go, of events that begin with the drive."""
        context = Context(self._stage.ids, _nowhere, {}, {}, {})
        board = Storyboard(self._document, self._stage, context, Problems())
        begun = [_Start(name, kind, scope) for name in self._entities for kind, scope in board.at_once(name)]
        self._stage.begun = {id(one.kind) for one in begun}
        return begun

    def _init_actions(self) -> list[_Start]:
        """Return the private actions at the start, in the file's order."""
        found: list[_Start] = []
        holder = self._document.root.child("Storyboard", "Init", "Actions")
        for one in [] if holder is None else holder.children:
            if one.tag != "Private":
                self._global(one)
                continue
            name = self._document.scope.text(one, "entityRef")
            if name not in self._entities:
                self._refuse(NotTakenError(one, f"no entity {name!r}"))
            for action in one.all("PrivateAction"):
                try:
                    found.append(_Start(name, kind_of(action), self._document.scope))
                except NotTakenError as error:
                    self._problems.add(error)
        return found

    def _global(self, one: Element) -> None:
        holder = one.child("EnvironmentAction")
        try:
            if holder is None:
                raise NotTakenError(one.children[0] if one.children else one, "this action is not taken")
            environment, scope = self._document.resolved(holder, self._document.scope, "Environment")
            road = environment.child("RoadCondition")
            if road is not None and (scale := scope.number(road, "frictionScaleFactor", 1.0)) != 1.0:
                usual: float = Weather.model_fields["friction"].default
                self._friction = round(scale * usual, 4)
            self._problems.note(f"{one.where}: sun, clouds, fog and rain change nothing here")
        except NotTakenError as error:
            self._problems.add(error)

    def _place_all(self) -> None:
        """Place the entities, those after others whose places are relative to them."""
        waiting = [one for one in self._inits if one.kind.tag == "TeleportAction"]
        while waiting:
            left, problems = list[_Start](), list[NotTakenError]()
            for one in waiting:
                try:
                    position = one.kind.child("Position")
                    if position is None:
                        raise NotTakenError(one.kind, "expected a <Position>")
                    spot = self._stage.places.spot(position, one.scope)
                except NotTakenError as error:
                    left.append(one)
                    problems.append(error)
                    continue
                self._place(one, spot)
            if len(left) == len(waiting):
                for problem in problems:
                    self._problems.add(problem)
                break
            waiting = left
        for one in self._inits:
            if one.kind.tag == "FollowTrajectoryAction":
                self._place_on_trajectory(*one)

    def _place(self, one: _Start, spot: Spot) -> None:
        """Place an entity at the start, on its route where it has one."""
        self._stage.places.entities[one.who] = spot
        own = self._entities[one.who].id
        try:
            route = self._route(one.who, spot)
            if route is not None:
                self._stage.routes[one.who] = route
            self._stage.tracks[one.who] = track_of(self._roads, self._stage.files, own, spot, one.kind, route)
        except NotTakenError as error:
            self._problems.add(error)

    def _route(self, name: str, spot: Spot) -> Route | None:
        """Return the route that an entity is given at the start; of several the last counts."""
        given = [one for one in self._inits if one.who == name and one.kind.tag in ROUTES]
        if not given:
            return None
        sense = 1
        if spot.on is not None:
            road = self._roads.roads[spot.on.road].at(spot.on.s, 0.0)
            sense = 1 if math.cos(spot.pose.heading - road.heading) >= 0.0 else -1
        return route_of(given[-1].kind, given[-1].scope, self._stage.places, spot.on, sense)

    def _place_on_trajectory(self, name: str, kind: Element, scope: Scope) -> None:
        """Place an entity that follows a trajectory from the start on: its line is the trajectory."""
        try:
            holder = kind.child("TrajectoryRef") or kind
            line: Line = self._stage.places.trajectory(holder, scope)
            if not line.anchored and name not in self._stage.places.entities:
                raise NotTakenError(holder, "the trajectory does not say where it begins, nor is the entity placed")
            if kind.child("TimeReference", "Timing") is not None or not line.anchored:
                return  # an action of its story says the rest
            begin = scope.number(kind, "initialDistanceOffset", 0.0)
            track = trajectory_track(self._stage.files, self._entities[name].id, line, begin)
            at = reference(track.points, holder).at(begin)
            self._stage.tracks[name] = track
            self._stage.places.entities[name] = self._stage.places.at(Pose2(at.x, at.y, at.heading))
        except NotTakenError as error:
            self._problems.add(error)

    def _start_speeds(self) -> None:
        """Take the speeds that entities begin with."""
        for name, kind, _scope in self._inits:
            try:
                if kind.tag == "SpeedAction" and name in self._stage.tracks and self._speed_at_start(name, kind):
                    self._begun.add(id(kind))
            except NotTakenError as error:
                if name == self._ego.name:
                    self._refuse(error)  # such as one backwards: without a speed there is no ego
                self._problems.add(error)
                self._begun.add(id(kind))

    def _start_all(self) -> None:
        """Take what begins at once."""
        for name, kind, scope in self._inits:
            if kind.tag in ("TeleportAction", *ROUTES) or name not in self._stage.tracks or id(kind) in self._begun:
                continue
            try:
                if kind.tag == "FollowTrajectoryAction" and self._begins_on_it(name, kind):
                    continue
                if name == self._ego.name:
                    self._of_ego(kind)
                    continue
                action = read_action(kind, scope, name, self._stage)
            except NotTakenError as error:
                self._problems.add(error)
                continue
            if action is not None:
                own = self._first.setdefault(name, [])
                own.append({"name": f"start_{len(own) + 1}"} | action)

    def _begins_on_it(self, name: str, kind: Element) -> bool:
        """Whether an entity's line is the trajectory that it follows from the start on."""
        return self._stage.tracks[name].road is None and kind.child("TimeReference", "Timing") is None

    def _of_ego(self, kind: Element) -> None:
        if longitudinal(kind):
            self._problems.note(f"{kind.where}: the ego's controller drives in place of it")
        elif (0, id(kind)) in self._stage.path_changes:
            self._problems.note(f"{kind.where}: the ego's path follows it")
        elif (0, id(kind)) in self._stage.refused_changes:
            raise self._stage.refused_changes[0, id(kind)]
        elif read_action(kind, self._document.scope, self._ego.name, self._stage) is not None:
            raise NotTakenError(kind, "the ego's path is the one that it begins on")

    def _speed_at_start(self, name: str, kind: Element) -> bool:
        """Take the speed that an entity begins with; whether the action says no more than that."""
        scope = self._document.scope
        dynamics = kind.child("SpeedActionDynamics")
        target = speed_target(kind, scope, self._stage)
        speed = target.get("to_mps", 0.0)
        if "of" in target:
            other = next(one.name for one in self._entities.values() if one.id == target["of"])
            speed += target.get("factor", 1.0) * self._stage.speeds.get(other, 0.0)
        step = dynamics is None or scope.text(dynamics, "dynamicsShape") == "step" or name == self._ego.name
        if step:
            self._stage.speeds[name] = max(speed, 0.0)
        if name == self._ego.name and dynamics is not None and scope.text(dynamics, "dynamicsShape") != "step":
            self._ramped = True
            self._problems.note(f"{kind.where}: the ego has this speed from the start on, without a change to it")
        return step and not target.get("continuous")

    def _table(
        self, ego: EgoPath, starts: Mapping[str, Track], stories: Mapping[str, list[Action]], stop: Groups
    ) -> dict[str, Any]:
        header = self._document.root.child("FileHeader")
        said = "" if header is None else " ".join(header.attributes.get("description", "").split())
        times = [group[0]["time_s"] for group in stop if len(group) == 1 and "time_s" in group[0]]
        table: dict[str, Any] = {
            "title": said or self._document.file.stem,
            "description": f"Imported from {self._document.file.name}, OpenSCENARIO.",
            "duration_s": min(times) + MARGIN if times else LONGEST,
        }
        if stop:
            table["after_stop_s"] = REST
        if self._friction is not None:
            table["weather"] = {"friction": self._friction}
        table["ego"] = self._ego_table(ego, starts[self._ego.name])
        others = [one for one in self._entities.values() if one.id != EGO]
        table["actors"] = [
            self._actor(one, starts[one.name], stories[one.name]) for one in others if one.name in starts
        ]
        for one in self._entities.values():
            if one.trailer is not None:
                self._problems.add(NotTakenError(one.trailer, f"{one.name!r} has no trailer here"))
        for one in others:
            if one.name not in starts:
                self._problems.note(f"{one.element.where} {one.name!r} is never placed: it is not there")
        if stop:
            table["end_trigger"] = {"when": stop}
        return table

    def _ego_table(self, ego: EgoPath, track: Track) -> dict[str, Any]:
        initial = self._stage.speeds.get(self._ego.name, 0.0)
        speed = initial if initial >= SLOWEST else self._greatest_speed()
        if not SLOWEST <= speed <= FASTEST:
            self._refuse(
                NotTakenError(
                    self._ego.element, f"the ego's speed: expected {SLOWEST:g} to {FASTEST:g} m/s, got {speed:g}"
                )
            )
        self._problems.note(
            "the ego is the car of the scenario here; where it begins, its rear axle is at the file's place"
        )
        name = track.path
        if ego.points is not track.points:
            name = self._stage.files.named("ego_path" if self._stage.path_changes else "ego_beside", ego.points)
        table: dict[str, Any] = {"path": name, "speed_mps": speed}
        if initial >= SLOWEST:
            table |= {"initial_speed_mps": initial, "initial_s_m": max(round(ego.nominal.begin, 4), 0.0)}
        else:
            table["path"] = self._stage.files.named("ego_from_rest", _from(ego.nominal))
        return table | {"lot": dict(LOT)}

    def _greatest_speed(self) -> float:
        """Return the greatest speed that the file's own actions have the ego drive [m/s]; 0 for none."""
        found = [0.0]
        scope = self._document.scope
        for one in self._document.root.walk():
            if one.tag != "ManeuverGroup":
                continue
            actors = [reference.attributes.get("entityRef") for reference in one.walk() if reference.tag == "EntityRef"]
            if self._ego.name in actors[:1]:
                for inner in one.walk():
                    key = {"AbsoluteTargetSpeed": "value", "SpeedProfileEntry": "speed"}.get(inner.tag)
                    if key is not None:
                        found.append(scope.number(inner, key))
        return max(found)

    def _actor(self, entity: Entity, track: Track, story: list[Action]) -> dict[str, Any]:
        actions = self._first.get(entity.name, []) + story
        stands = not self._stage.speeds.get(entity.name) and all("leaves" in action for action in actions)
        if stands and entity.name in self._stage.places.entities:
            track = self._standing(entity, track, self._stage.places.entities[entity.name].pose)
        table: dict[str, Any] = {
            "id": entity.id,
            "kind": entity.kind,
            "length_m": entity.length,
            "width_m": entity.width,
            "path": track.path,
            "at_m": track.path_s,
        }
        if track.path_d:
            table["offset_m"] = track.path_d
        if speed := self._stage.speeds.get(entity.name, 0.0):
            table["speed_mps"] = speed
        table["story"] = {"reference_m": entity.reference, "actions": actions}
        return table

    def _standing(self, entity: Entity, track: Track, pose: Pose2) -> Track:
        """Return the track of an entity that never moves: it faces as the file says, whatever its lane does."""
        line = reference(track.points, entity.element).at(track.path_s)
        if abs(math.remainder(pose.heading - line.heading, math.tau)) < FACING:
            return track
        points = straight(pose.x, pose.y, pose.heading, ACROSS)
        path = self._stage.files.named(f"{entity.id}_stands", points)
        return replace(track, path=path, points=points, path_s=0.0, path_d=0.0)


def _nowhere(position: Element, _scope: Scope) -> tuple[float, float]:
    raise NotTakenError(position, "no place is known before the start")


def _beside(path: ReferencePath, s: float, d: float) -> tuple[float, float]:
    """Return the point of a path's coordinates s and d [m]."""
    at = path.at(s)
    return at.x - d * math.sin(at.heading), at.y + d * math.cos(at.heading)


def _from(nominal: NominalDrive) -> Points:
    """Return the line from where the ego is on: from rest a drive begins at its path's start."""
    return [nominal.path.at(nominal.begin + n)[:2] for n in range(math.floor(nominal.path.length - nominal.begin) + 1)]
