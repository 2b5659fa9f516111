"""Bicyclists and pedestrians who cross, go along, turn in, come the other way or stand: braked for, steered around.

The groups are those of the crash types that FARS counts; speeds, places and times are ours. Every case is driven by
braking alone, by steering alone and by both; what no manoeuvre of those means avoids is not required.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, Final, NamedTuple

import numpy as np

from vve_sumo.body_kinds import TYPICAL
from vve_sumo.scenario.road_users import Actor
from vve_sumo.suite import requirements
from vve_sumo.suite.evasion import TIMES, Body, Room, greatest_clearance
from vve_sumo.suite.fmvss127_pedestrian import crossing, on_the_way
from vve_sumo.suite.physics import Need
from vve_sumo.suite.row import RequiredApproach, RequiredEvasion, SuiteRow
from vve_sumo.suite.track import KMH, TARGET, entry_s, max_impact, scenario, target
from vve_sumo.values import Floats, Vehicle
from vve_sumo.vehicle.model import VehicleModel

SPEEDS: Final = (10.0, 20.0, 30.0, 40.0, 50.0, 60.0)  #: [km/h]
#: of the row's speed: the speed up to which physics must leave a way out
FASTER: Final = 1.1
CLEARANCE: Final = 0.8  #: from every body, where physics leaves it [m]
BACK_WITHIN: Final = 0.15  #: of the path at the end [m]
START: Final = 4.0  #: time to the meeting at which the target enters [s]
ROOM: Final = Room(left=3.4, right=2.0)  #: that the road leaves beside the path
RIDING: Final = 15.0  #: of the bicyclists, as in Euro NCAP's CBNA [km/h]
ON_THE_RIGHT: Final = -0.8  #: of who rides or comes in the car's way [m]
TURNS_FROM: Final = -2.5  #: where a bicyclist rides who turns in [m]
TURNS_AFTER, TURNS_WITHIN = 1.0, 2.5  #: from the entry to the turn, and how long it takes [s]
LASTS: Final = 60.0  #: of a drive after the target's entry at most [s]
RESTS: Final = 6.0  #: time at rest after which a drive ends: who crosses has gone by then [s]
COMES: Final = 16.0  #: the same before somebody who comes the other way, until he has come [s]
#: road beyond the meeting in which the car comes back to its path: so much [m], and the way of so long [s]
ROAD_AFTER, TIME_AFTER = 15.0, 6.0
LOST: Final = 8.0  #: that a car loses which brakes first for who goes its way, and overtakes then [s]
SPEED_TOLERANCE: Final = 1.0 * KMH  #: of a rolling start [m/s]


class Scene(NamedTuple):
    """The bodies of a case at a speed of the car."""

    actors: list[dict[str, Any]]  #: the target first
    begins: float  #: time from the target's entry to the moment at which the need to act begins [s]


class Means(NamedTuple):
    """What a car may do about somebody in its way."""

    brakes: bool
    steers: bool
    controller: dict[str, Any]  #: of the scenario


_ROOM = {"left_m": ROOM.left, "right_m": ROOM.right}
MEANS: Final = {
    "braking": Means(brakes=True, steers=False, controller={"name": "follow_and_stop"}),
    "steering": Means(
        brakes=False,
        steers=True,
        controller={"name": "elastic_band", "tuning": _ROOM | {"emergency": False, "comfort": False}},
    ),
    "both": Means(brakes=True, steers=True, controller={"name": "elastic_band", "tuning": _ROOM}),
}


def _cross(side: float, _car: Vehicle, speed: float) -> Scene:
    """Return a bicyclist who rides out from a `side`, left positive, without stopping."""
    pace, ahead = RIDING * KMH, START * speed
    keys = {"kind": "bicycle", "offset_m": side * START * pace, "turned_deg": -90.0 * side, "speed_mps": pace}
    return Scene([target(speed, ahead, **keys)], 0.0)


def _along(_car: Vehicle, speed: float) -> Scene:
    pace = RIDING * KMH
    keys = {"kind": "bicycle", "offset_m": ON_THE_RIGHT, "speed_mps": pace}
    return Scene([target(speed, START * (speed - pace), **keys)], 0.0)


def _turning(_car: Vehicle, speed: float) -> Scene:
    pace = RIDING * KMH
    turn = {"when": {"after_s": TURNS_AFTER}, "offset_m": 0.0, "over_s": TURNS_WITHIN}
    keys = {"kind": "bicycle", "offset_m": TURNS_FROM, "speed_mps": pace, "events": [turn]}
    return Scene([target(speed, START * (speed - pace), **keys)], TURNS_AFTER)


def _oncoming(_car: Vehicle, speed: float) -> Scene:
    pace = RIDING * KMH
    keys = {"kind": "bicycle", "offset_m": ON_THE_RIGHT, "turned_deg": 180.0, "speed_mps": pace}
    return Scene([target(speed, START * (speed + pace), **keys)], 0.0)


def _walk(walk: requirements.Walk, car: Vehicle, speed: float) -> Scene:
    """Return a pedestrian of FMVSS 127."""
    if walk.kind != "crossing":
        return Scene([on_the_way(car, walk, speed)[0]], 0.0)
    actors, available = crossing(car, walk, speed)
    return Scene(actors, START - available / speed)


def _walker(kind: str, side: str, *, obstructed: bool = False) -> Callable[[Vehicle, float], Scene]:
    """Return the scene of the first walk of FMVSS 127 of a kind, from a side."""
    (walk, *_others) = (
        one
        for one in requirements.FMVSS_127_WALKS
        if (one.kind, one.side, one.obstructed) == (kind, side, obstructed)
        and (one.overlap == 50.0 or kind != "crossing")
    )
    return lambda car, speed: _walk(walk, car, speed)


class Case(NamedTuple):
    """One of the cases, at any speed."""

    description: str
    scene: Callable[[Vehicle, float], Scene]
    pace: float = 0.0  #: along the path of who goes the car's way [km/h]
    rests: float = RESTS  #: time at rest after which a drive ends [s]


CASES: Final = {
    "bicyclist_from_right": Case("bicyclist crosses from the right", lambda car, speed: _cross(-1.0, car, speed)),
    "bicyclist_from_left": Case("bicyclist crosses from the left", lambda car, speed: _cross(1.0, car, speed)),
    "bicyclist_along": Case("bicyclist rides ahead", _along, RIDING),
    "bicyclist_turning": Case("bicyclist turns into the way", _turning, RIDING),
    "bicyclist_oncoming": Case("bicyclist comes the other way, head-on", _oncoming, rests=COMES),
    "pedestrian_from_right": Case("pedestrian crosses from the right", _walker("crossing", "right")),
    "pedestrian_from_left": Case("pedestrian crosses from the left", _walker("crossing", "left")),
    "child_obstructed": Case("child from behind parked cars", _walker("crossing", "right", obstructed=True)),
    "pedestrian_along": Case("pedestrian walks ahead", _walker("along path", "right"), 5.0),
    "pedestrian_standing": Case("pedestrian stands", _walker("stationary", "right")),
}


def rows(car: VehicleModel) -> Iterator[SuiteRow]:
    """Return the suite's rows."""
    for name, case in CASES.items():
        for means in MEANS:
            for kmh in SPEEDS:
                yield _row(car.vehicle, name, case, means, kmh)


def _row(car: Vehicle, name: str, case: Case, means: str, kmh: float) -> SuiteRow:
    id, description = f"{name}_{means}_{kmh:g}", f"{case.description}, {kmh:g} km/h, {means}"
    if kmh <= case.pace:
        why = "who goes ahead is no slower than the car"
        return SuiteRow(id, description, "no contact", None, not_applicable=why)
    speed = kmh * KMH
    left = max_clearance(car, case, means, FASTER * speed)
    clearance = CLEARANCE if left >= CLEARANCE else 0.0
    meets = START * speed
    if case.pace:
        meets += (car.length + LOST * case.pace * KMH) / (1.0 - case.pace / kmh)
    end = {"contact": True, "ego_at_m": entry_s(speed) + meets + ROAD_AFTER + TIME_AFTER * speed}
    sensors = [{"name": "roof", "kind": "lidar"}] if MEANS[means].steers else []
    return SuiteRow(
        id=id,
        description=description,
        required=f"clearance >= {clearance:g} m, back within {BACK_WITHIN:g} m" if clearance else "no contact, back",
        scenario=scenario(
            f"VRU: {description}",
            speed,
            lasts=LASTS,
            rolling=True,
            ego={"deviation_limit_m": 6.0},
            after_stop_s=case.rests,
            controller=MEANS[means].controller,
            sensors=sensors,
            actors=case.scene(car, speed).actors,
            criteria=max_impact(0.0),
            end_trigger=end,
        ),
        # The car may slow down before its target; the row only needs that it does not come faster.
        approach=RequiredApproach(TARGET, speed, speed, SPEED_TOLERANCE),
        need=Need(clearance, left),
        evasion=RequiredEvasion(clearance, BACK_WITHIN),
    )


def max_clearance(car: Vehicle, case: Case, means: str, speed: float) -> float:
    """Return the greatest clearance [m] that physics leaves in a case at a speed [m/s]; 0 where contact is certain."""
    actors, begins = case.scene(car, speed)
    bodies = [body(Actor.model_validate(actor), begins, speed) for actor in actors]
    given = MEANS[means]
    return greatest_clearance(car, speed, bodies, ROOM, brakes=given.brakes, steers=given.steers)


def body(actor: Actor, begins: float, speed: float) -> Body:
    """Return an actor's motion from a time after its entry on [s], for a car that came at a speed [m/s] until then.

    Knows what the actors of this suite do: one event, which changes the speed or the offset.
    """
    length, width = size(actor)
    assert actor.ahead_m is not None
    times = begins + TIMES
    covered, aside = actor.speed_mps * times, np.full_like(times, actor.offset_m)
    for event in actor.events:
        since = np.maximum(times - (event.when.after_s or 0.0), 0.0)
        if event.speed_mps is not None and event.acceleration_mps2 is not None:
            covered = _started(since, event.speed_mps, event.acceleration_mps2)
        if event.offset_m is not None and event.over_s is not None:
            share = np.minimum(since / event.over_s, 1.0)
            aside += (event.offset_m - actor.offset_m) * share**3 * (10.0 - 15.0 * share + 6.0 * share**2)
    ahead = actor.ahead_m - speed * begins
    if abs(actor.turned_deg) == 90.0:
        across = aside + np.sign(actor.turned_deg) * covered
        return Body(np.full_like(times, ahead + 0.5 * width), across, width, length)
    way = covered if actor.turned_deg == 0.0 else -covered
    return Body(ahead + 0.5 * length + way, aside, length, width)


def size(actor: Actor) -> tuple[float, float]:
    """Return an actor's length and width [m]."""
    typical = TYPICAL[actor.kind]
    return actor.length_m or typical.length, actor.width_m or typical.width


def _started(since: Floats, speed: float, acceleration: float) -> Floats:
    """Return the way of a body that sets out from rest [m], at times since then [s]."""
    ramp = np.minimum(since, speed / acceleration)
    way: Floats = 0.5 * acceleration * ramp * ramp + speed * (since - ramp)
    return way
