"""UN R152 for cars (M1) by series of amendments: cars and a child (00), a child (01), a bicycle (02).

A later series keeps the demands of the earlier ones; its suite holds the additions and changes.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from vve_sumo.suite import requirements
from vve_sumo.suite.physics import BrakedMotion, Need, full_braking, gap_used
from vve_sumo.suite.row import RequiredApproach, SuiteRow
from vve_sumo.suite.track import (
    AEB,
    KMH,
    TARGET,
    end_when_passed,
    gate,
    loads,
    max_impact,
    requirement_text,
    scenario,
    target,
    time_to_brake,
)
from vve_sumo.vehicle.model import VehicleModel

#: driven below the stated speed, which the standard forbids to exceed [km/h]
SPEED_MARGIN = 0.2


def rows(car: VehicleModel) -> Iterator[SuiteRow]:
    """Return the rows of the 00 series."""
    moving = requirements.R152_MOVING_TARGET_SPEED
    for load in loads(car):
        for entry in requirements.R152_STATIONARY:
            yield from _car(car, entry, load, 0.0)
    for load in loads(car):
        for entry in requirements.R152_MOVING:
            yield from _car(car, entry, load, moving)
    for load in loads(car):
        for entry in requirements.R152_PEDESTRIAN:
            yield from _crossing(car, "child", requirements.R152_PEDESTRIAN_SPEED, entry, load)
    yield from _false_reaction()


def rows_01(car: VehicleModel) -> Iterator[SuiteRow]:
    """Return the rows that the 01 series changes."""
    for load in loads(car):
        for entry in requirements.R152_PEDESTRIAN_01:
            yield from _crossing(car, "child", requirements.R152_PEDESTRIAN_SPEED, entry, load)


def rows_02(car: VehicleModel) -> Iterator[SuiteRow]:
    """Return the rows that the 02 series adds."""
    for load in loads(car):
        for entry in requirements.R152_BICYCLE:
            yield from _crossing(car, "bicycle", requirements.R152_BICYCLE_SPEED, entry, load)


def _car(car: VehicleModel, entry: requirements.Impact, load: str, target_kmh: float) -> Iterator[SuiteRow]:
    ahead = requirements.R152_MIN_TTC * entry.speed * KMH
    actor = {"speed_mps": target_kmh * KMH}
    kind, description = "stationary", f"car stationary, {entry.speed:g} km/h"
    if target_kmh:
        kind, description = "moving", f"car moving at {target_kmh:g} km/h, {entry.speed:g} km/h faster"
    yield from _row(car, kind, description, entry, load, ahead, actor, lead=target_kmh * KMH)


def _crossing(car: VehicleModel, kind: str, kmh: float, entry: requirements.Impact, load: str) -> Iterator[SuiteRow]:
    time, pace = requirements.R152_MIN_TTC, kmh * KMH
    ahead = time * entry.speed * KMH
    # From the right, timed to reach the middle of the car's path together with the car.
    actor = {"kind": kind, "speed_mps": pace, "offset_m": -time * pace, "turned_deg": 90.0}
    description = f"{kind} crossing at {kmh:g} km/h, {entry.speed:g} km/h"
    yield from _row(
        car, kind, description, entry, load, ahead, actor, end_trigger=end_when_passed(entry.speed * KMH, ahead)
    )


def _false_reaction() -> Iterator[SuiteRow]:
    """Return the rows with nothing on the path; the two cars stand as in FMVSS 127."""
    required = "no emergency braking"
    for kmh in requirements.R152_TEST_SPEEDS:
        speed = kmh * KMH
        ahead = requirements.R152_MIN_TTC * speed
        description = f"between two cars {requirements.FMVSS_127_PASS_GAP:g} m apart, {kmh:g} km/h"
        yield SuiteRow(
            id=f"between_two_cars_{kmh:g}",
            description=description,
            required=required,
            scenario=scenario(
                f"R152: {description}",
                speed - SPEED_MARGIN * KMH,
                lasts=requirements.R152_MIN_TTC + time_to_brake(speed),
                controller={"tuning": AEB},
                actors=gate(speed - SPEED_MARGIN * KMH, ahead, requirements.FMVSS_127_PASS_GAP),
                criteria={"emergency_used": False},
                end_trigger=end_when_passed(speed - SPEED_MARGIN * KMH, ahead),
            ),
            approach=_approach(speed),
        )
    plate = "the radar is geometric: it sees boxes of road users, and a plate in the road is none"
    yield SuiteRow("steel_plate", "over a steel plate in the road", required, None, not_applicable=plate)
    unknown = "the positions and motions of its road users are in none of our sources"
    yield SuiteRow("false_reaction", "the other scenes of annex 3, appendix 2", required, None, not_applicable=unknown)


def _approach(speed: float) -> RequiredApproach:
    return RequiredApproach(TARGET, speed, *(limit * KMH for limit in requirements.R152_SPEED_TOLERANCE))


def _row(
    car: VehicleModel,
    kind: str,
    description: str,
    entry: requirements.Impact,
    load: str,
    ahead: float,
    actor: dict[str, Any],
    *,
    lead: float = 0.0,
    end_trigger: dict[str, Any] | None = None,
) -> Iterator[SuiteRow]:
    """Return the row of an entry at a load, or none; `lead` is the target's speed [m/s]."""
    allowed = entry.laden if load == "laden" else entry.unladen
    if allowed is None:
        return
    relative, speed = entry.speed * KMH, entry.speed * KMH + lead
    driven = speed - SPEED_MARGIN * KMH
    mass = loads(car)[load]
    needed = gap_used(full_braking(car.vehicle, speed, mass), BrakedMotion(lead), allowed * KMH)
    yield SuiteRow(
        id=f"{kind}_{entry.speed:g}_{load}",
        description=f"{description}, {load}",
        required=requirement_text(allowed, requirements.R152_BRAKING_DEMAND),
        scenario=scenario(
            f"R152: {description}, {load}",
            driven,
            lasts=ahead / relative + time_to_brake(speed),
            car={"mass_factor": mass},
            controller={"tuning": AEB},
            actors=[target(driven, ahead, **actor)],
            criteria=max_impact(allowed * KMH),
            end_trigger=end_trigger or {"contact": True},
        ),
        approach=_approach(speed),
        need=Need(needed, ahead),
        demand=requirements.R152_BRAKING_DEMAND,
    )
