"""Resolves the people of a scenario: how their fields lie on the virtual road, and the walks of those who stand in.

Reads files of walks. Must not know where positions come from in a live drive.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from vve_sumo.body_kinds import TYPICAL
from vve_sumo.csv_numbers import CsvNumbers
from vve_sumo.drive.actor_paths import Find
from vve_sumo.errors import ConfigError
from vve_sumo.frames import Alignment, local_frame
from vve_sumo.path import ReferencePath
from vve_sumo.people.setup import MAX_SPEED, PersonSetup, PresenceLimits
from vve_sumo.people.walk import WalkPoint
from vve_sumo.scenario.road_users import Person
from vve_sumo.scenario.schema import Scenario, StartPose
from vve_sumo.values import Point, Pose

if TYPE_CHECKING:
    from vve_sumo.rig.connections import RigPerson
    from vve_sumo.rig.schema import Rig

WALK_COLUMNS: Final = ("time_s", "forward_m", "left_m")


class Walks(NamedTuple):
    """The walks of those who stand in for people."""

    points: dict[str, tuple[WalkPoint, ...]]  #: by the person's id
    files: dict[str, Path]  #: what was read, by role


def find_walks(people: tuple[Person, ...], find: Find) -> Walks:
    """Find and read the walks; raises ConfigError naming the key of a missing file, or file and line."""
    found = Walks({}, {})
    for person in people:
        if person.simulated is not None:
            key = f"people.{person.id}.simulated.walk"
            found.files[key] = source = find("walk", person.simulated.walk, key)
            found.points[person.id] = read_walk(source, MAX_SPEED[person.kind])
    return found


def read_walk(file: Path, max_speed: float) -> tuple[WalkPoint, ...]:
    """Return the points of a walk's CSV file.

    Raises ConfigError naming file and line for a value that is not a finite number, a time that is not later than the
    one before it, and a stretch that is faster than `max_speed` [m/s].
    """
    table = CsvNumbers(file, "walk")
    points: list[WalkPoint] = []
    for where, row in table.numbers(WALK_COLUMNS):
        point = WalkPoint(*row)
        if not all(map(math.isfinite, point)):
            raise ConfigError(f"{where}: expected finite numbers, got {', '.join(f'{value:g}' for value in row)}")
        if points:
            step = point.time - points[-1].time
            if not step > 0.0:
                raise ConfigError(f"{where}: expected a time after {points[-1].time:g} s, got {point.time:g}")
            speed = math.dist(point[1:], points[-1][1:]) / step
            if speed > max_speed:
                raise ConfigError(f"{where}: {speed:.1f} m/s since the row before, expected at most {max_speed:g} m/s")
        points.append(point)
    if not points:
        raise ConfigError(f"{table.name}: expected at least one row of {', '.join(WALK_COLUMNS)}, got none")
    return tuple(points)


def setups_of(scenario: Scenario, path: ReferencePath, file: Path) -> tuple[PersonSetup, ...]:
    """Return a scenario's people for a drive without a rig: their fields' anchors lie where the car starts.

    There is no lot in such a drive, so no distance from one is kept. Raises ConfigError, naming the scenario's `file`
    and the key, for an anchor beyond the path.
    """
    for person in scenario.people:
        if person.at_m > path.length:
            raise ConfigError(
                f"{file}: people.{person.id}: at_m {person.at_m:g} lies beyond the path's {path.length:.1f} m"
            )
    return tuple(_setup(person, path, scenario.ego.lot) for person in scenario.people)


def setups_with_rig(scenario: Scenario, path: ReferencePath, rig: Rig, *, live: bool) -> tuple[PersonSetup, ...]:
    """Return a scenario's people for a drive with a rig, which says where their fields are.

    In a drive that is `live`, whoever is not simulated must acknowledge the start on a page. Raises ConfigError for a
    person of whom the rig says nothing. Of the rig's people, those of other scenarios play no part.
    """
    from vve_sumo.rig.resolve import outline_in

    fields = {one.id: one for one in rig.people}
    setups = []
    for person in scenario.people:
        if person.id not in fields:
            raise ConfigError(f"people: the rig has no table [[people]] with the id {person.id!r} of the scenario's")
        field = fields[person.id]
        if field.source == "simulated" and live and person.simulated is None:
            raise ConfigError(
                f"people.{person.id}: the rig's source is 'simulated', the scenario says no walk for that"
            )
        fence = outline_in(rig, local_frame(math.radians(field.latitude_deg), math.radians(field.longitude_deg)))
        pages = live and field.source != "simulated"
        setups.append(_setup(person, path, field, pages=pages, fence=fence, least_distance=field.least_distance_m))
    return tuple(setups)


def _setup(person: Person, path: ReferencePath, field: StartPose | RigPerson, **of_the_rig: Any) -> PersonSetup:
    at, size, limits = path.at(person.at_m), TYPICAL[person.kind], person.limits
    x, y = at.x - person.offset_m * math.sin(at.heading), at.y + person.offset_m * math.cos(at.heading)
    return PersonSetup(
        id=person.id,
        kind=person.kind,
        length=size.length if person.length_m is None else person.length_m,
        width=size.width if person.width_m is None else person.width_m,
        latitude=math.radians(field.latitude_deg),
        longitude=math.radians(field.longitude_deg),
        heading=anchor_heading(field),
        road_heading=at.heading,
        alignment=Alignment.from_matched_start(
            _spot(0.0, 0.0, anchor_heading(field)), _spot(x, y, at.heading + math.radians(person.turned_deg))
        ),
        limits=PresenceLimits(limits.exact_m, limits.warning_m, limits.lost_m, limits.warning_age_s, limits.lost_age_s),
        **({"pages": False} | of_the_rig),
    )


def anchor_heading(field: StartPose | RigPerson) -> float:
    """Return the heading of a field's anchor in the field's map [rad], counter-clockwise from +x, east."""
    return math.radians(90.0 - field.heading_deg)


def _spot(x: float, y: float, heading: float) -> Pose:
    return Pose(0.0, Point.REAR_AXLE, x, y, heading, 0.0, 0.0, 0.0, 0.0, 0.0)


def recorded_people(resolved: Mapping[str, Any]) -> tuple[PersonSetup, ...]:
    """Return the people in a record's `scenario.json`; raises ConfigError for what is none of this version."""
    return tuple(map(PersonSetup.from_dict, resolved.get("people", ())))
