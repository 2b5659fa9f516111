"""ASAM OpenSCENARIO XML 1.2 of a drive: every body follows the trajectory that it took, a polyline over time.

The file needs no OpenDRIVE road: all positions are in the virtual road's map. The ego's reference point is the middle
of its rear axle, as the standard has it of vehicles. Where others have their axles is not recorded: theirs is the
middle of the box. What the standard requires beside (heights, axles, masses, greatest speeds) is typical of the kind of
body, and no trajectory depends on it.
"""

from __future__ import annotations

import datetime
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from vve_sumo.analysis.bodies import RecordedBody, bodies, obstacles
from vve_sumo.analysis.run import Run
from vve_sumo.body_kinds import PERSONS, TYPICAL
from vve_sumo.errors import ConfigError
from vve_sumo.export.part import ExportPart
from vve_sumo.values import Vehicle

if TYPE_CHECKING:
    from scenariogeneration import xosc

MINOR_VERSION: Final = 2  #: of OpenSCENARIO XML 1
#: between two points of a trajectory [s]: at 10 m/s2 a straight line between two of them is at most 13 mm off
POINT_PERIOD: Final = 0.1
#: of a trajectory; scenariogeneration refuses fewer
MIN_POINTS: Final = 2
#: of a file whose record does not say when the drive was
NO_DATE: Final = "1980-01-06T00:00:00+00:00"
#: OpenSCENARIO's name of a kind of vehicle, where it is another
CATEGORIES: Final = {"motorcycle": "motorbike"}
MAX_SPEED: Final = 70.0  #: of any vehicle [m/s]
MAX_ACCELERATION: Final = 10.0  #: of any vehicle, also braking [m/s2]
WHEEL_DIAMETER: Final = 0.65  #: [m]
MAX_STEERING: Final = 0.6  #: [rad]
TRACK_SHARE: Final = 0.85  #: of a vehicle's width
AXLE_SHARE: Final = 0.3  #: of a vehicle's length, from its middle to either axle


@dataclass(frozen=True, slots=True)
class Entity:
    """A stretch of a body's motion: an entity that is there from its first point to its last."""

    name: str
    body: RecordedBody
    stands: bool  #: for the whole drive
    behind: float  #: from the middle of the box back to the reference point [m]


def of_drive(run: Run) -> Iterator[ExportPart]:
    """Yield the file; raises ConfigError where scenariogeneration is not installed, or for a drive of a single tick."""
    try:
        from scenariogeneration import xosc
    except ImportError:
        raise ConfigError("openscenario needs scenariogeneration: pip install 'vve-sumo[openscenario]'") from None
    entities = [*_entities(run)]
    if len(entities[0].body.at) < MIN_POINTS:
        raise ConfigError(f"{run.folder}: a drive of a single tick has no trajectory in OpenSCENARIO")
    begin, end = entities[0].body.time[[0, -1]].tolist()
    declared = xosc.Entities()
    for entity in entities:
        car = run.vehicle if entity.name == run.ego else None
        declared.add_scenario_object(entity.name, _object(xosc, entity, car))
    initial = xosc.Init()
    board = xosc.StoryBoard(initial, _at(xosc, end, "stop"))
    for entity in entities:
        _play(xosc, initial, board, entity, begin, end)
    scenario = xosc.Scenario(
        run.title,
        "vve_sumo",
        xosc.ParameterDeclarations(),
        declared,
        board,
        xosc.RoadNetwork(),
        xosc.Catalog(),
        osc_minor_version=MINOR_VERSION,
        creation_date=_began(run),
    )
    root = scenario.get_element()
    ET.indent(root)
    yield ExportPart("", ET.tostring(root, encoding="utf-8", xml_declaration=True) + b"\n")


def _entities(run: Run) -> Iterator[Entity]:
    """Yield the ego, then every stretch of every actor; the second stretch of `bus.1` is `bus.1_2`."""
    standing = obstacles(run)
    ego, *others = bodies(run)
    yield Entity(ego.name, _points(ego), False, run.vehicle.rear_axle_to_bumper - 0.5 * run.vehicle.length)
    for body in others:
        if body.name in standing:
            yield Entity(body.name, body, True, 0.0)
            continue
        stretches = [stretch for stretch in body.stretches() if len(stretch.at) > 1]
        for number, stretch in enumerate(stretches, 1):
            yield Entity(body.name if number == 1 else f"{body.name}_{number}", _points(stretch), False, 0.0)


def _points(body: RecordedBody) -> RecordedBody:
    """Return a body at the points of its trajectory: its first and its last tick, and evenly in between."""
    begin, end = body.time[[0, -1]]
    return body.sampled(np.append(np.arange(begin, end - 1e-9, POINT_PERIOD), end))


def _play(xosc: Any, initial: xosc.Init, board: xosc.StoryBoard, entity: Entity, begin: float, end: float) -> None:
    """Enter what an entity does: where it is at first, that it follows its trajectory, and that it leaves."""
    positions = _positions(xosc, entity)
    first, last = entity.body.time[[0, -1]].tolist()
    events = []
    if entity.stands or first <= begin:
        initial.add_init_action(entity.name, xosc.TeleportAction(positions[0]))
    else:
        events.append(_event(xosc, first, "enter", xosc.AddEntityAction(entity.name, positions[0])))
    if entity.stands:
        return
    trajectory = xosc.Trajectory(f"trajectory of {entity.name}", False)
    trajectory.add_shape(xosc.Polyline(entity.body.time.round(4).tolist(), positions))
    absolute = (xosc.ReferenceContext.absolute, 1, 0)
    follow = xosc.FollowTrajectoryAction(trajectory, xosc.FollowingMode.position, *absolute)
    events.append(_event(xosc, first, "follow", follow))
    if last < end:
        events.append(_event(xosc, last, "leave", xosc.DeleteEntityAction(entity.name)))
    manoeuvre = xosc.Maneuver(f"drive of {entity.name}")
    for event in events:
        manoeuvre.add_event(event)
    board.add_maneuver(manoeuvre, entity.name)


def _positions(xosc: Any, entity: Entity) -> Sequence[xosc.WorldPosition]:
    body = entity.body
    x = body.x - entity.behind * np.cos(body.heading)
    y = body.y - entity.behind * np.sin(body.heading)
    columns = (x.round(4).tolist(), y.round(4).tolist(), body.heading.round(6).tolist())
    return [xosc.WorldPosition(at_x, at_y, 0.0, heading) for at_x, at_y, heading in zip(*columns, strict=True)]


def _event(xosc: Any, time: float, name: str, action: Any) -> xosc.Event:
    event = xosc.Event(name, xosc.Priority.parallel)
    event.add_trigger(_at(xosc, time, "start"))
    return event.add_action(name, action)


def _at(xosc: Any, time: float, point: str) -> xosc.ValueTrigger:
    """Return the trigger that fires when the drive's time [s] has come."""
    condition = xosc.SimulationTimeCondition(round(time, 4), xosc.Rule.greaterOrEqual)
    return xosc.ValueTrigger("time", 0, xosc.ConditionEdge.none, condition, triggeringpoint=point)


def _object(xosc: Any, entity: Entity, car: Vehicle | None) -> xosc.Vehicle | xosc.Pedestrian:
    """Return what an entity is; `car` is what was declared of the ego, None for every other body."""
    body, typical = entity.body, TYPICAL[entity.body.kind]
    box = xosc.BoundingBox(body.width, body.length, body.height, entity.behind, 0.0, 0.5 * body.height)
    if body.kind in PERSONS:
        return xosc.Pedestrian(body.kind, typical.mass, xosc.PedestrianCategory.pedestrian, box)
    half = round(AXLE_SHARE * body.length, 3)
    axles = (half, -half) if car is None else (car.wheelbase, 0.0)
    front, rear = (
        xosc.Axle(steers, WHEEL_DIAMETER, round(TRACK_SHARE * body.width, 3), at, 0.5 * WHEEL_DIAMETER)
        for steers, at in zip((MAX_STEERING, 0.0), axles, strict=True)
    )
    limits = (MAX_SPEED, MAX_ACCELERATION, MAX_ACCELERATION)
    category = getattr(xosc.VehicleCategory, CATEGORIES.get(body.kind, body.kind))
    mass = typical.mass if car is None else car.mass
    return xosc.Vehicle(body.kind, category, box, front, rear, *limits, mass)


def _began(run: Run) -> datetime.datetime:
    began_utc = "" if run.provenance is None else run.provenance.began_utc
    try:
        return datetime.datetime.fromisoformat(began_utc)
    except ValueError:
        return datetime.datetime.fromisoformat(NO_DATE)
