"""Euro NCAP AEB car-to-car rear of 2023: a car that stands (CCRs), moves (CCRm) or brakes (CCRb).

The protocol gives points, which none of our sources tells; here a row is passed where nothing is touched. It has every
CCRs and CCRm at five overlaps. The radar detects the one nearest point of a body, which is as far away at each of them,
so that all five are one drive: a row stands for them, driven at the least overlap.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

from vve_sumo.suite import requirements
from vve_sumo.suite.fmvss127 import braking_lead, braking_need, untouched
from vve_sumo.suite.physics import BrakedMotion, Need, full_braking, gap_used
from vve_sumo.suite.row import RequiredApproach, SuiteRow
from vve_sumo.suite.track import KMH, TARGET, said, target
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
    """Return how far the target stands beside the way [m] of a car of a width [m] at an overlap [%].

    sign(overlap) (w_target / 2 - w_car (|overlap| - 50) / 100), and 0 at 100 % [S] vectorgrp/OSC-NCAP-scenarios.
    """
    if overlap == 100.0:
        return 0.0
    aside = 0.5 * requirements.EURO_NCAP_TARGET_WIDTH - width * (abs(overlap) - 50.0) / 100.0
    return math.copysign(aside, overlap)


def closing(car: VehicleModel, kind: str, kmh: float, target_kmh: float, overlap: float) -> SuiteRow:
    """Return the row of a `kind` of test at a speed [km/h] against a target's [km/h], at an overlap [%]."""
    speed, lead = kmh * KMH, target_kmh * KMH
    ahead = START * (speed - lead)
    what = f"{kind}, {kmh:g} km/h, overlaps of 50 to 100 %"
    keys = {
        "speed_mps": lead,
        "offset_m": lateral_offset(overlap, car.vehicle.width),
        "width_m": requirements.EURO_NCAP_TARGET_WIDTH,
        "length_m": LENGTH,
    }
    id, need = f"{kind}_{kmh:g}", Need(gap_used(full_braking(car.vehicle, speed), BrakedMotion(lead)), ahead)
    approach = RequiredApproach(TARGET, speed, TOLERANCE, TOLERANCE)
    return untouched(id, what, f"Euro NCAP: {what}", approach, START, [target(speed, ahead, **keys)], need)


def _braking(car: VehicleModel) -> Iterator[SuiteRow]:
    kmh = requirements.EURO_NCAP_CCRB
    speed, last = kmh * KMH, requirements.EURO_NCAP_CCRB_END * KMH
    for headway in requirements.EURO_NCAP_CCRB_HEADWAY:
        for deceleration in requirements.EURO_NCAP_CCRB_DECELERATION:
            what = f"CCRb, {kmh:g} km/h, headway {headway:g} m, -{deceleration:g} m/s2"
            yield SuiteRow(
                id=f"CCRb_{headway:g}m_{deceleration:g}",
                what=what,
                required=said(0.0),
                scenario=braking_lead(f"Euro NCAP: {what}", speed, headway, deceleration, last),
                approach=RequiredApproach(TARGET, speed, TOLERANCE, TOLERANCE),
                need=braking_need(car, speed, headway, deceleration, last),
            )
