"""FMVSS 127: braking for a vehicle ahead, and not braking between two cars beside the path."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from vve_sumo.physical_constants import GRAVITY
from vve_sumo.scenario.schema import Scenario
from vve_sumo.suite import requirements
from vve_sumo.suite.physics import BrakedMotion, Need, full_braking, gap_used
from vve_sumo.suite.row import RequiredApproach, SuiteRow
from vve_sumo.suite.track import (
    AEB,
    KMH,
    TARGET,
    end_when_passed,
    gate,
    max_impact,
    requirement_text,
    scenario,
    target,
    time_to_brake,
)
from vve_sumo.vehicle.model import VehicleModel

STEP = 10.0  #: between the driven speeds of a range [km/h]; the standard allows any speed in it
STEADY = 3.0  #: time of constant speed of the car ahead before it brakes [s]
RAMP = 0.5  #: build-up time of its braking, within the standard's 1.5 s [s]
NO_OVERRIDE = "a braking driver overrides: the gateway releases the car to the driver"
TOLERANCE = requirements.FMVSS_127_SPEED_TOLERANCE * KMH


def lead_rows(car: VehicleModel) -> Iterator[SuiteRow]:
    """Return the rows with a vehicle ahead."""
    for entry in requirements.FMVSS_127_LEAD:
        if entry.manual_brake:
            low, high = entry.subject
            speeds = f"{low:g}" if low == high else f"{low:g} to {high:g}"
            id = f"{entry.kind}_{low:g}_manual_brake"
            description = f"lead {entry.kind}, {speeds} km/h, driver brakes"
            yield SuiteRow(id, description, requirement_text(0.0), None, not_applicable=NO_OVERRIDE)
        elif entry.headway is None or entry.deceleration is None:
            yield from _closing(car, entry)
        else:
            yield from _decelerating(car, entry.lead, entry.headway, entry.deceleration)


def _closing(car: VehicleModel, entry: requirements.Lead) -> Iterator[SuiteRow]:
    low, high = entry.subject
    for number in range(round((high - low) / STEP) + 1):
        kmh = low + number * STEP
        speed, lead = kmh * KMH, entry.lead * KMH
        ahead = requirements.FMVSS_127_START * (speed - lead)
        description = f"lead {entry.kind}, {kmh:g} km/h" + (f" against {entry.lead:g}" if lead else "")
        need = Need(gap_used(full_braking(car.vehicle, speed), BrakedMotion(lead)), ahead)
        actors = [target(speed, ahead, speed_mps=lead)]
        id, start = f"{entry.kind}_{kmh:g}", requirements.FMVSS_127_START
        yield no_contact_row(id, description, f"FMVSS 127: {description}", steady(speed), start, actors, need)


def steady(speed: float) -> RequiredApproach:
    """Return the approach at `speed` [m/s] that the standard requires."""
    return RequiredApproach(TARGET, speed, TOLERANCE, TOLERANCE)


def no_contact_row(
    id: str,
    description: str,
    title: str,
    approach: RequiredApproach,
    start: float,
    actors: list[dict[str, Any]],
    need: Need,
    end_trigger: dict[str, Any] | None = None,
) -> SuiteRow:
    """Return a row that allows no contact: emergency braking alone, `start` [s] from the target."""
    return SuiteRow(
        id=id,
        description=description,
        required=requirement_text(0.0),
        scenario=scenario(
            title,
            approach.speed,
            lasts=start + time_to_brake(approach.speed),
            controller={"tuning": AEB},
            actors=actors,
            criteria=max_impact(0.0),
            end_trigger=end_trigger or {"contact": True},
        ),
        approach=approach,
        need=need,
    )


def _decelerating(
    car: VehicleModel, kmh: float, headways: tuple[float, ...], decelerations: tuple[float, ...]
) -> Iterator[SuiteRow]:
    speed = kmh * KMH
    for headway in headways:
        for share in decelerations:
            description = f"lead decelerating at {share:g} g, {kmh:g} km/h, headway {headway:g} m"
            yield SuiteRow(
                id=f"decelerating_{kmh:g}_{headway:g}m_{share:g}g",
                description=description,
                required=requirement_text(0.0),
                scenario=braking_lead(f"FMVSS 127: {description}", speed, headway, share * GRAVITY, 0.0),
                approach=steady(speed),
                need=braking_need(car, speed, headway, share * GRAVITY, 0.0),
            )


def braking_lead(title: str, speed: float, headway: float, deceleration: float, last: float) -> Scenario:
    """Return the scenario of a car ahead that brakes down to a `last` speed; SI units."""
    event = {"when": {"after_s": STEADY}, "speed_mps": last, "acceleration_mps2": deceleration, "build_up_s": RAMP}
    return scenario(
        title,
        speed,
        lasts=STEADY + speed / deceleration + headway / speed + time_to_brake(speed),
        controller={"tuning": AEB},
        actors=[target(speed, headway, speed_mps=speed, events=[event])],
        criteria=max_impact(0.0),
        end_trigger={"contact": True},
    )


def braking_need(car: VehicleModel, speed: float, headway: float, deceleration: float, last: float) -> Need:
    """Return the braking that `braking_lead` demands; detecting that the car ahead brakes takes the detection time."""
    lead = BrakedMotion(speed, deceleration, build_up=RAMP, last_speed=last)
    return Need(gap_used(full_braking(car.vehicle, speed), lead), headway)


def pass_through_rows(_car: VehicleModel) -> Iterator[SuiteRow]:
    """Return the rows of the tests for false activation."""
    speed, limit = requirements.FMVSS_127_PASS_SPEED * KMH, requirements.FMVSS_127_FALSE_ACTIVATION * GRAVITY
    ahead = requirements.FMVSS_127_START * speed
    pair = gate(speed, ahead, requirements.FMVSS_127_PASS_GAP)
    required = f"deceleration <= {requirements.FMVSS_127_FALSE_ACTIVATION:g} g"
    # The whole controller may drive slower; the requirement is that it does not brake.
    drivers: tuple[tuple[str, str, dict[str, bool], float], ...] = (
        ("aeb", "emergency braking alone", AEB, TOLERANCE),
        ("whole", "the whole controller", {}, speed),
    )
    for id, description, tuning, below in drivers:
        yield SuiteRow(
            id=f"between_two_cars_{id}",
            description=f"between two cars {requirements.FMVSS_127_PASS_GAP:g} m apart, 80 km/h, {description}",
            required=required,
            scenario=scenario(
                f"FMVSS 127: between two cars, {description}",
                speed,
                lasts=requirements.FMVSS_127_START + time_to_brake(speed),
                controller={"tuning": tuning},
                actors=pair,
                criteria={"max_deceleration_mps2": {"max": limit}},
                end_trigger=end_when_passed(speed, ahead),
            ),
            approach=RequiredApproach(TARGET, speed, below, TOLERANCE),
        )
    plate = "the radar is geometric: it sees boxes of road users, and a plate in the road is none"
    yield SuiteRow("steel_plate", "over a steel plate in the road, 80 km/h", required, None, not_applicable=plate)
