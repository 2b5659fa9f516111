"""FMVSS 127: braking for a pedestrian who crosses, stands or walks along the path."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from vve_sumo.body_kinds import TYPICAL
from vve_sumo.suite import requirements
from vve_sumo.suite.fmvss127 import STEP, no_contact_row, steady
from vve_sumo.suite.physics import BrakedMotion, Need, first_sight_distance, full_braking, gap_used
from vve_sumo.suite.row import SuiteRow
from vve_sumo.suite.track import KMH, WIDTH, end_when_passed, requirement_text, target
from vve_sumo.values import Vehicle
from vve_sumo.vehicle.model import VehicleModel

PARKED_LENGTH = 4.5  #: of the cars that hide a pedestrian [m]
DARK = "the radar model does not depend on light: the rows above hold in darkness too"


def rows(car: VehicleModel) -> Iterator[SuiteRow]:
    """Return the suite's rows."""
    for walk in requirements.FMVSS_127_WALKS:
        for kmh in speeds(walk.subject):
            yield (_crossing if walk.kind == "crossing" else _on_the_way)(car.vehicle, walk, kmh)
    for beam in ("lower", "upper"):
        description = f"every row in darkness, {beam} beam"
        yield SuiteRow(f"dark_{beam}_beam", description, requirement_text(0.0), None, not_applicable=DARK)


def speeds(ends: tuple[float, float]) -> list[float]:
    """Return the speeds that are driven of a range: its ends, and between them every STEP [km/h]."""
    low, high = ends
    steps = [low + number * STEP for number in range(int((high - low) / STEP) + 1)]
    return steps if steps[-1] == high else [*steps, high]


def _crossing(car: Vehicle, walk: requirements.Walk, kmh: float) -> SuiteRow:
    """Return the row of a pedestrian who starts from the kerb in time for an impact at the overlap."""
    speed = kmh * KMH
    actors, available = crossing(car, walk, speed)
    end = end_when_passed(speed, requirements.FMVSS_127_WALK_START * speed)
    return _row(walk, kmh, actors, Need(_needed(car, speed, 0.0), available), end)


def crossing(car: Vehicle, walk: requirements.Walk, speed: float) -> tuple[list[dict[str, Any]], float]:
    """Return the pedestrian who starts from the kerb, then the cars that hide him, and the way that is available [m].

    The need to act begins when the pedestrian starts to walk, or becomes visible; `speed` is the car's [m/s].
    """
    pace, kerb = walk.speed * KMH, requirements.KERBS[walk.side]
    ahead = requirements.FMVSS_127_WALK_START * speed
    side = -1.0 if walk.side == "right" else 1.0
    walked = kerb.offset - side * overlap_offset(walk, car.width)
    walking = (walked + kerb.speeding_up) / pace
    sets_out = {
        "when": {"after_s": requirements.FMVSS_127_WALK_START - walking},
        "speed_mps": pace,
        "acceleration_mps2": pace * pace / (2.0 * kerb.speeding_up),
    }
    actor = target(
        speed,
        ahead,
        kind="child" if walk.obstructed else "pedestrian",
        offset_m=side * kerb.offset,
        turned_deg=-90.0 * side,
        events=[sets_out],
    )
    parked = _parked(car, speed, ahead) if walk.obstructed else []
    available = speed * walking
    if walk.obstructed:
        corner = 0.5 * car.width + requirements.PARKED_CLEARANCE
        available = first_sight_distance(corner, requirements.PARKED_GAP, speed, pace, 0.5 * TYPICAL["child"].length)
    return [actor, *parked], available


def _on_the_way(car: Vehicle, walk: requirements.Walk, kmh: float) -> SuiteRow:
    speed, pace = kmh * KMH, walk.speed * KMH
    actor, ahead = on_the_way(car, walk, speed)
    return _row(walk, kmh, [actor], Need(_needed(car, speed, pace), ahead), {"contact": True})


def on_the_way(car: Vehicle, walk: requirements.Walk, speed: float) -> tuple[dict[str, Any], float]:
    """Return a pedestrian who stands or walks along the path, and how far ahead he enters [m]."""
    pace = walk.speed * KMH
    ahead = requirements.FMVSS_127_WALK_START * (speed - pace)
    return target(speed, ahead, kind="pedestrian", speed_mps=pace, offset_m=overlap_offset(walk, car.width)), ahead


def overlap_offset(walk: requirements.Walk, width: float) -> float:
    """Return the lateral offset of the impact point from the path [m], left positive, for a car of a `width` [m]."""
    from_side = walk.overlap / 100.0 * width
    return from_side - 0.5 * width if walk.side == "right" else 0.5 * width - from_side


def _needed(car: Vehicle, speed: float, pace: float) -> float:
    return gap_used(full_braking(car, speed), BrakedMotion(pace))


def _parked(car: Vehicle, speed: float, ahead: float) -> list[dict[str, Any]]:
    """Return the two parked cars that hide a pedestrian."""
    offset = -(0.5 * car.width + requirements.PARKED_CLEARANCE + 0.5 * WIDTH)
    size = {"length_m": PARKED_LENGTH, "width_m": WIDTH}
    rear = [ahead - number * (requirements.PARKED_GAP + PARKED_LENGTH) for number in (1, 2)]
    return [
        target(speed, back, offset_m=offset, **size) | {"id": id}
        for id, back in zip(("nearer", "farther"), rear, strict=True)
    ]


def _row(
    walk: requirements.Walk, kmh: float, actors: list[dict[str, Any]], need: Need, end: dict[str, Any]
) -> SuiteRow:
    id = f"{walk.kind}_{walk.side}_{walk.overlap:g}_{kmh:g}".replace(" ", "_")
    description = f"{walk.kind}" + (f" at {walk.speed:g} km/h" if walk.speed else "")
    description += f", {walk.side} {walk.overlap:g} %, {kmh:g} km/h"
    if walk.obstructed:
        id, description = f"obstructed_{id}", f"child behind parked cars, {description}"
    title, start = f"FMVSS 127: pedestrian {description}", requirements.FMVSS_127_WALK_START
    return no_contact_row(id, description, title, steady(kmh * KMH), start, actors, need, end)
