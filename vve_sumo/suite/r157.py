"""UN R157: a cut-in at the latest time at which contact must be avoided; and the distance behind a steady car.

R157 applies to automated driving, so the whole controller drives here, its comfort functions included.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

from vve_sumo.suite import requirements
from vve_sumo.suite.physics import BrakedMotion, Need, full_braking, gap_used
from vve_sumo.suite.row import CutIn, RequiredApproach, SuiteRow
from vve_sumo.suite.track import (
    KMH,
    LANE_WIDTH,
    TARGET,
    max_impact,
    requirement_text,
    scenario,
    target,
    time_to_brake,
)
from vve_sumo.timing import PERIOD
from vve_sumo.vehicle.model import VehicleModel

OTHER_SPEED = 40.0  #: of the car that cuts in [km/h]; ours
LENGTH, WIDTH = 4.5, 1.8  #: of that car [m]
START_OFFSET = LANE_WIDTH  #: lateral start position: the middle of the left lane [m]
LANE_KEEPING_TIME = 1.5  #: it keeps its lane about so long before the change [s]; ours
LANE_CHANGE_TIME = 5.0  #: duration of the change, at 1.5 m/s of lateral speed at most [s]; ours
TTC_MARGIN = 0.05  #: added to the rule's time to collision at the cut-in, and the tolerance of a drive [s]
LANE_EDGE = 0.5 * LANE_WIDTH  #: lateral position of the lane's edge, from the path [m]
STEP = 0.001  #: time step of the search for the intrusion [s]
SPEED_TOLERANCE = 1.0 * KMH  #: ours [m/s]
SPEED_RATIO = 1.15  #: target speed over the speed of the steady car ahead
FOLLOWING_TIME = 20.0  #: duration of following [s]


def cut_in_rows(car: VehicleModel) -> Iterator[SuiteRow]:
    """Return the rows with a car that cuts in."""
    for kmh in requirements.R157_CUT_IN_SPEEDS:
        relative, other = kmh * KMH, OTHER_SPEED * KMH
        speed, ttc = relative + other, requirements.cut_in_time(relative) + TTC_MARGIN
        changing, reach = intrusion(other)
        ahead = relative * (ttc + LANE_KEEPING_TIME + changing) + reach - 0.5 * LENGTH
        # Triggered by the time to collision and not by the clock, because the car under test is slightly faster than
        # its set speed. A trigger fires at a tick, on average half a tick late.
        begins = ttc + changing + (reach - 0.5 * LENGTH) / relative + 0.5 * PERIOD
        event = {"when": {"ttc_s": begins}, "offset_m": 0.0, "over_s": LANE_CHANGE_TIME}
        size = {"length_m": LENGTH, "width_m": WIDTH}
        description = f"cut-in, {kmh:g} km/h slower, {ttc:.2f} s before"
        yield SuiteRow(
            id=f"cut_in_{kmh:g}",
            description=description,
            required=requirement_text(0.0),
            scenario=scenario(
                f"R157: {description}",
                speed,
                lasts=LANE_KEEPING_TIME + LANE_CHANGE_TIME + ttc + time_to_brake(speed),
                actors=[target(speed, ahead, speed_mps=other, offset_m=START_OFFSET, events=[event], **size)],
                criteria=max_impact(0.0),
                end_trigger={"contact": True},
            ),
            approach=RequiredApproach(TARGET, speed, SPEED_TOLERANCE, SPEED_TOLERANCE),
            cut_in=CutIn(TARGET, LANE_EDGE, ttc, TTC_MARGIN),
            # The car was detected long before it cuts in: the detection takes no time.
            need=Need(gap_used(full_braking(car.vehicle, relative, detection=0.0), BrakedMotion(0.0)), ttc * relative),
        )


def intrusion(speed: float) -> tuple[float, float]:
    """Return when a car that changes lanes at `speed` [m/s] reaches the edge of the ego's lane, and its rear extent.

    Time [s] from the begin of its minimum-jerk change, y = y0 (1 - 10 t^3 + 15 t^4 - 6 t^5), to the moment at which its
    near front corner is over the edge; from its centre back to its hindmost corner [m] at that moment.
    """
    steps = round(LANE_CHANGE_TIME / STEP)
    for number in range(steps):
        share = number / steps
        offset = START_OFFSET * (1.0 - share**3 * (10.0 - 15.0 * share + 6.0 * share * share))
        rate = START_OFFSET * 30.0 * share**2 * (1.0 - share) ** 2 / LANE_CHANGE_TIME
        turned = math.atan2(rate, speed)
        if offset - 0.5 * (WIDTH * math.cos(turned) + LENGTH * math.sin(turned)) < LANE_EDGE:
            return share * LANE_CHANGE_TIME, 0.5 * (LENGTH * math.cos(turned) + WIDTH * math.sin(turned))
    raise AssertionError("the car never reaches the lane")


def following_rows(_car: VehicleModel) -> Iterator[SuiteRow]:
    """Return the rows with a steady car ahead."""
    for entry in requirements.R157_FOLLOWING:
        lead = entry.speed * KMH
        speed = SPEED_RATIO * lead
        description = f"behind a car at {entry.speed:g} km/h"
        yield SuiteRow(
            id=f"following_{entry.speed:g}",
            description=description,
            required=f"gap >= {entry.distance:g} m",
            scenario=scenario(
                f"R157: {description}",
                speed,
                lasts=FOLLOWING_TIME,
                actors=[target(speed, 5.0 + 2.5 * lead, speed_mps=lead)],
                criteria={"min_gap_m": {"min": entry.distance}},
                end_trigger={"contact": True},
            ),
            # The car may slow down behind the car ahead; the row only needs a car ahead.
            approach=RequiredApproach(TARGET, speed, speed, SPEED_TOLERANCE),
        )
