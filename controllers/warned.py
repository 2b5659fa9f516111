"""Foresees by V2X messages who will cross the path as the car comes, long before a sensor of the car's own sees them.

Who crosses says so, or another vehicle that sees them does. Only who moves across the path counts: a message's place
may err by metres, and whoever stands in the way is the radar's business. It must not know what is done about them.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np

from vve_sumo.path import Corridor, PathProjection, ReferencePath
from vve_sumo.values import Observation, ReportedObjects, Stations, Vehicle

from .sightings import HORIZON, AxleMotion, Memory, output_of
from .tracks import MARGIN, Target

ACROSS: Final = 0.3  #: who goes slower across the path does not cross it [m/s]
EARLY: Final = 1.0  #: car and crosser must miss each other by so much [s]
HELD: Final = 1.0  #: and by so much more once the car waits for them [s]
SLOWEST: Final = 2.0  #: the car counts as going on at this speed at least, also while it waits [m/s]
SIGMAS_95: Final = math.sqrt(-2.0 * math.log(0.05))  #: of the radius that a message gives, in sigmas of an axis


class Crosser(NamedTuple):
    """One who moves across the path, where it is now."""

    number: int  #: of the station; negative for who is told of by another
    s: float  #: along the path [m]
    d: float  #: to the left of the path [m]
    along: float  #: speed along the path [m/s]
    across: float  #: speed across the path, to the left [m/s]
    half_along: float  #: of its body, along the path [m]
    half_across: float  #: of its body, across the path, with a sigma of its place [m]


class Warned:
    """Keeps in mind for whom the car waits."""

    def __init__(self, vehicle: Vehicle, sensor: str) -> None:
        """`sensor` is the name of the V2X receiver; the scenario must have it."""
        self._vehicle, self._sensor = vehicle, sensor
        self._memory = Memory()
        self._corridor: Corridor | None = None
        self._awaited: set[int] = set()

    def step(self, observation: Observation, projection: PathProjection) -> Target | None:
        """Return the nearest place at which somebody will cross while the car is there; None for nowhere."""
        vehicle, path = self._vehicle, observation.path
        if self._corridor is None:
            front, rear = vehicle.rear_axle_to_bumper, vehicle.rear_overhang
            self._corridor = Corridor(path, front, rear, vehicle.width, MARGIN)
        self._memory.add(observation.pose)
        heard = output_of(observation, self._sensor, Stations, "v2x")
        tables: list[tuple[Stations | ReportedObjects, list[int]]] = [(heard, heard.number.tolist())]
        if heard.objects is not None:
            numbers = zip(heard.objects.sender.tolist(), heard.objects.number.tolist(), strict=True)
            tables.append((heard.objects, [-1 - (sender << 16) - number for sender, number in numbers]))
        if not any(numbers for _table, numbers in tables):
            return None
        bumper, speed = projection.s + vehicle.rear_axle_to_bumper, observation.pose.speed
        then = self._memory.at(heard.time)
        awaited, nearest = set(), None
        since, front = observation.time - heard.time, vehicle.rear_axle_to_bumper
        crossers = (_crossers(table, numbers, then, since, path, projection.s, front) for table, numbers in tables)
        for one in itertools.chain.from_iterable(crossers):
            gap = one.s - one.half_along - bumper
            slack = EARLY + (HELD if one.number in self._awaited else 0.0)
            if gap <= 0.0 or not self._meets(one, gap, speed, slack):
                continue
            awaited.add(one.number)
            if nearest is None or gap < nearest.gap:
                nearest = Target(gap, max(one.along, 0.0), foreseen=True)
        self._awaited = awaited
        return nearest

    def _meets(self, one: Crosser, gap: float, speed: float, slack: float) -> bool:
        """Tell whether car and crosser are on the same piece of the path at times that are nearer than a slack [s]."""
        assert self._corridor is not None
        left, right = self._corridor.half_widths(one.s)
        # Counted in the way it goes: where it is, where the band begins and ends.
        sign = math.copysign(1.0, one.across)
        now, begins, ends = sign * one.d, *((-right, left) if sign > 0.0 else (-left, right))
        pace = abs(one.across)
        enters = max(begins - one.half_across - now, 0.0) / pace
        leaves = (ends + one.half_across - now) / pace
        goes = max(speed, SLOWEST)
        comes, passes = gap / goes, (gap + 2.0 * one.half_along + self._vehicle.length) / goes
        return leaves > 0.0 and enters < passes + slack and leaves > comes - slack


def _crossers(
    heard: Stations | ReportedObjects,
    numbers: Sequence[int],
    then: AxleMotion,
    since_output: float,
    path: ReferencePath,
    s: float,
    front: float,
) -> list[Crosser]:
    """Return who moves across the path ahead, each brought on from its message's time to now.

    `then` is where the rear axle was at the time of the output, which is `since_output` [s] ago; `front` is from there
    to the front bumper [m].
    """
    if not numbers:
        return []
    cos, sin = math.cos(then.heading), math.sin(then.heading)
    bumper_x, bumper_y = then.x + front * cos, then.y + front * sin
    heading, since = heard.heading + then.heading, heard.age + since_output
    directions = [(math.cos(one), math.sin(one)) for one in heading.tolist()]
    x, y, found = [], [], []
    columns = zip(heard.x.tolist(), heard.y.tolist(), heard.speed.tolist(), since.tolist(), directions, strict=True)
    for ahead, aside, speed, age, (east, north) in columns:
        x.append(bumper_x + ahead * cos - aside * sin + speed * age * east)
        y.append(bumper_y + ahead * sin + aside * cos + speed * age * north)
    places, places_d = path.locate(np.array(x), np.array(y), s, s + HORIZON)
    for row, (at_s, d) in enumerate(zip(places.tolist(), places_d.tolist(), strict=True)):
        if not (math.isfinite(at_s) and math.isfinite(d)):
            continue
        turn = float(heading[row]) - path.at(at_s).heading
        speed, length, width = float(heard.speed[row]), float(heard.length[row]), float(heard.width[row])
        across, sigma = speed * math.sin(turn), float(heard.uncertainty[row]) / SIGMAS_95
        if abs(across) < ACROSS:
            continue
        lengthwise, sideways = abs(math.cos(turn)), abs(math.sin(turn))
        found.append(
            Crosser(
                numbers[row],
                at_s,
                d,
                speed * math.cos(turn),
                across,
                0.5 * (length * lengthwise + width * sideways),
                0.5 * (length * sideways + width * lengthwise) + sigma,
            )
        )
    return found
