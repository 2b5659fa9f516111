"""Euro NCAP AEB car-to-car rear of 2023: a car that stands (CCRs), moves (CCRm) or brakes (CCRb).

The protocol's points are in none of our sources; here a row passes without contact. The protocol drives every CCRs and
CCRm at five overlaps. The radar model detects the nearest point of a body, whose distance is the same at each overlap,
so one row, driven at the least overlap, represents all five.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

from vve_sumo.suite import requirements
from vve_sumo.suite.fmvss127 import braking_lead, braking_need, no_contact_row
from vve_sumo.suite.physics import BrakedMotion, Need, full_braking, gap_used
from vve_sumo.suite.row import RequiredApproach, SuiteRow
from vve_sumo.suite.track import KMH, TARGET, requirement_text, target
from vve_sumo.vehicle.model import VehicleModel

START = 4.0  #: time to collision at which the target enters [s]; ours
TOLERANCE = 1.0 * KMH  #: of the test speed [m/s]; ours
LENGTH = 4.0  #: of the target [m]; ours


def rows(car: VehicleModel) -> Iterator[SuiteRow]:
    """Return the suite's rows."""
    overlap = min(requirements.EURO_NCAP_OVERLAPS, key=abs)
    for kmh in requirements.EURO_NCAP_CCRS:
        yield closing(car, "CCRs", kmh, 0.0, overlap)
    for kmh in requirements.EURO_NCAP_CCRM:
        yield closing(car, "CCRm", kmh, requirements.EURO_NCAP_CCRM_TARGET, overlap)
    yield from _braking(car)
    low, high = requirements.EURO_NCAP_CCRS_FCW[0], requirements.EURO_NCAP_CCRS_FCW[-1]
    why = "the warning is judged by a driver who brakes on it: an override hands over"
    yield SuiteRow("CCRs_FCW", f"CCRs with warning, {low:g} to {high:g} km/h", "a warning", None, not_applicable=why)


def lateral_offset(overlap: float, width: float) -> float:
    """Return the lateral offset of the target [m] for a car of a width [m] at an overlap [%].

    sign(overlap) (w_target / 2 - w_car (|overlap| - 50) / 100), and 0 at 100 % [S] vectorgrp/OSC-NCAP-scenarios.
    """
    if overlap == 100.0:
        return 0.0
    offset = 0.5 * requirements.EURO_NCAP_TARGET_WIDTH - width * (abs(overlap) - 50.0) / 100.0
    return math.copysign(offset, overlap)


def closing(car: VehicleModel, kind: str, kmh: float, target_kmh: float, overlap: float) -> SuiteRow:
    """Return the row of a `kind` of test at a speed [km/h] against a target's [km/h], at an overlap [%]."""
    speed, lead = kmh * KMH, target_kmh * KMH
    ahead = START * (speed - lead)
    description = f"{kind}, {kmh:g} km/h, overlaps of 50 to 100 %"
    keys = {
        "speed_mps": lead,
        "offset_m": lateral_offset(overlap, car.vehicle.width),
        "width_m": requirements.EURO_NCAP_TARGET_WIDTH,
        "length_m": LENGTH,
    }
    id, need = f"{kind}_{kmh:g}", Need(gap_used(full_braking(car.vehicle, speed), BrakedMotion(lead)), ahead)
    approach = RequiredApproach(TARGET, speed, TOLERANCE, TOLERANCE)
    return no_contact_row(
        id, description, f"Euro NCAP: {description}", approach, START, [target(speed, ahead, **keys)], need
    )


def _braking(car: VehicleModel) -> Iterator[SuiteRow]:
    kmh = requirements.EURO_NCAP_CCRB
    speed, last = kmh * KMH, requirements.EURO_NCAP_CCRB_END * KMH
    for headway in requirements.EURO_NCAP_CCRB_HEADWAY:
        for deceleration in requirements.EURO_NCAP_CCRB_DECELERATION:
            description = f"CCRb, {kmh:g} km/h, headway {headway:g} m, -{deceleration:g} m/s2"
            yield SuiteRow(
                id=f"CCRb_{headway:g}m_{deceleration:g}",
                description=description,
                required=requirement_text(0.0),
                scenario=braking_lead(f"Euro NCAP: {description}", speed, headway, deceleration, last),
                approach=RequiredApproach(TARGET, speed, TOLERANCE, TOLERANCE),
                need=braking_need(car, speed, headway, deceleration, last),
            )
