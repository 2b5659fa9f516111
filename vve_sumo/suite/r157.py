"""UN R157: a car cuts in, later than which nobody has to avoid it; and the distance kept behind a steady car.

The system that R157 judges drives by itself, so here the whole controller drives, comfort and all.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

from vve_sumo.suite import requirements
from vve_sumo.suite.physics import BrakedMotion, Need, full_braking, gap_used
from vve_sumo.suite.row import CutIn, RequiredApproach, SuiteRow
from vve_sumo.suite.track import KMH, LANE_WIDTH, TARGET, impact_at_most, said, scenario, target, time_to_brake
from vve_sumo.timing import PERIOD
from vve_sumo.vehicle.model import VehicleModel

OTHER_SPEED = 40.0  #: of the car that cuts in [km/h]; ours
LENGTH, WIDTH = 4.5, 1.8  #: of that car [m]
ASIDE = LANE_WIDTH  #: it comes from the middle of the lane on the left [m]
BESIDE, OVER = 1.5, 5.0  #: it keeps its lane about so long, then changes in so long, at 1.5 m/s at most [s]; ours
EARLIER = 0.05  #: than the rule ends, it comes in; and the drive may be so far off that [s]
EDGE = 0.5 * LANE_WIDTH  #: of the car's lane, beside its path [m]
STEP = 0.001  #: of time, in which the moment is looked for [s]
SPEED_TOLERANCE = 1.0 * KMH  #: ours [m/s]
FASTER = 1.15  #: the car wants to drive, over the speed of the steady car ahead
FOLLOWS = 20.0  #: a steady car for so long [s]


def cut_in_rows(car: VehicleModel) -> Iterator[SuiteRow]:
    """Return the rows with a car that cuts in."""
    for kmh in requirements.R157_CUT_IN_SPEEDS:
        relative, other = kmh * KMH, OTHER_SPEED * KMH
        speed, ttc = relative + other, requirements.cut_in_time(relative) + EARLIER
        changing, reach = intrusion(other)
        ahead = relative * (ttc + BESIDE + changing) + reach - 0.5 * LENGTH
        # By the time to collision and not by the clock: the car under test drives a little faster than it shall. A
        # trigger fires at a tick, on average half a tick late.
        begins = ttc + changing + (reach - 0.5 * LENGTH) / relative + 0.5 * PERIOD
        event = {"when": {"ttc_s": begins}, "offset_m": 0.0, "over_s": OVER}
        size = {"length_m": LENGTH, "width_m": WIDTH}
        what = f"cut-in, {kmh:g} km/h slower, {ttc:.2f} s before"
        yield SuiteRow(
            id=f"cut_in_{kmh:g}",
            what=what,
            required=said(0.0),
            scenario=scenario(
                f"R157: {what}",
                speed,
                lasts=BESIDE + OVER + ttc + time_to_brake(speed),
                actors=[target(speed, ahead, speed_mps=other, offset_m=ASIDE, events=[event], **size)],
                criteria=impact_at_most(0.0),
                end_trigger={"contact": True},
            ),
            approach=RequiredApproach(TARGET, speed, SPEED_TOLERANCE, SPEED_TOLERANCE),
            cut_in=CutIn(TARGET, EDGE, ttc, EARLIER),
            # It has long been seen when it comes in: nothing is lost for a detection.
            need=Need(gap_used(full_braking(car.vehicle, relative, detection=0.0), BrakedMotion(0.0)), ttc * relative),
        )


def intrusion(speed: float) -> tuple[float, float]:
    """Return when a car that changes lanes at `speed` [m/s] touches the edge of ours, and how far it reaches back.

    Time [s] from the begin of its minimum-jerk change, y = y0 (1 - 10 t^3 + 15 t^4 - 6 t^5), to the moment at which its
    near front corner is over the edge; from its centre back to its hindmost corner [m] at that moment.
    """
    steps = round(OVER / STEP)
    for number in range(steps):
        share = number / steps
        aside = ASIDE * (1.0 - share**3 * (10.0 - 15.0 * share + 6.0 * share * share))
        rate = ASIDE * 30.0 * share**2 * (1.0 - share) ** 2 / OVER
        turned = math.atan2(rate, speed)
        if aside - 0.5 * (WIDTH * math.cos(turned) + LENGTH * math.sin(turned)) < EDGE:
            return share * OVER, 0.5 * (LENGTH * math.cos(turned) + WIDTH * math.sin(turned))
    raise AssertionError("it never comes in")


def following_rows(_car: VehicleModel) -> Iterator[SuiteRow]:
    """Return the rows with a steady car ahead."""
    for entry in requirements.R157_FOLLOWING:
        lead = entry.speed * KMH
        speed = FASTER * lead
        what = f"behind a car at {entry.speed:g} km/h"
        yield SuiteRow(
            id=f"following_{entry.speed:g}",
            what=what,
            required=f"gap >= {entry.distance:g} m",
            scenario=scenario(
                f"R157: {what}",
                speed,
                lasts=FOLLOWS,
                actors=[target(speed, 5.0 + 2.5 * lead, speed_mps=lead)],
                criteria={"min_gap_m": {"min": entry.distance}},
                end_trigger={"contact": True},
            ),
            # It may slow down before the car ahead as it likes; what matters is that there was one.
            approach=RequiredApproach(TARGET, speed, speed, SPEED_TOLERANCE),
        )
