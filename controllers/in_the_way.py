"""Says which bodies the car has to do something about, and whether braking still suffices for them.

It must not know how a way around is planned, nor when the car takes one.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

from vve_sumo.laws import sideways_reach, stopping_distance, swerve_time, time_to_cover
from vve_sumo.path import PathProjection
from vve_sumo.values import Observation, Vehicle

from .emergency import FIRST_ORDER_RAMP, JERK
from .follow_and_stop import COMFORT_LIMIT, PERIOD
from .free_space import SPREAD_LIMIT, Margins, Nodes, clearances
from .lateral_plan import LateralPlan, times_at
from .outlines import Body
from .speed import SLOWING, SPEEDING_UP
from .way_around import (
    CONTACT,
    CROSSES,
    NODES,
    SPACING,
    URGENT_ACCELERATION,
    URGENT_JERK,
    WayAround,
    first_met,
)

HEAD: Final = 3  #: nodes, the first one behind the car, that a new way leaves where they were
WANTED: Final = 0.8  #: a body that is nearer than this to the car's side on its path is steered around [m]
COMFORT: Final = Margins(clearance=1.1, lengthwise=0.6, slack=1.5)
#: an urgent way keeps so far from bodies; the first that leads past is taken
URGENT: Final = tuple(Margins(away, 0.3, 0.2, 1.0) for away in (1.0, 0.7, 0.4, 0.15))
#: who comes the other way in the car's way is given way to by steering when he is so near [s]
ONCOMING: Final = 4.0
#: who is not slower than the car would be by so much [m/s], or half as fast, is not gone around in comfort, nor who
#: crosses
SLOWER: Final = 2.0
#: way that coming back takes for each metre beside the path, and what must be left before a body then [m]
BACK_SHARE, WAITS = 2.0, 4.0
LOOKS_FROM: Final = 6.0  #: places of the road beside, and who covers them, count from so far ahead on [m]


class Sight(NamedTuple):
    """What is known at a turn of the lidar."""

    vehicle: Vehicle
    observation: Observation
    here: PathProjection
    bodies: list[Body]
    nodes: Nodes
    speeds: list[float]  #: that the car would have at the nodes if nothing were in its way [m/s]
    first: int  #: number of the first node

    @property
    def heading_error(self) -> float:
        """The car's heading less that of the path [rad]."""
        return math.remainder(self.observation.pose.heading - self.here.heading, math.tau)

    @property
    def bumper(self) -> float:
        """The s of the car's front bumper [m]."""
        return self.here.s + self.vehicle.rear_axle_to_bumper


def asks_for_room(sight: Sight, times: Sequence[float], body: Body) -> bool:
    """Tell whether a body would be nearer than WANTED to the car on its path, at these times at its nodes [s]."""
    keeps = CONTACT._replace(slack=COMFORT.slack if body.along > 0.0 else 0.0)
    return min(clearances(sight.nodes, times, [0.0] * NODES, body, keeps)) < WANTED


def is_met(sight: Sight, body: Body, line: WayAround | None) -> bool:
    """Tell whether a body is in a way around, or on the path where that is None."""
    d = [0.0 if line is None else line.d_at(sight.first + node) for node in range(NODES)]
    return first_met(sight.nodes, times_at(sight.speeds, SPACING), d, body) is not None


def in_path(sight: Sight) -> list[Body]:
    """Return the bodies that stand in the scenario's path, or go along it."""
    nodes, times, path = sight.nodes, times_at(sight.speeds, SPACING), [0.0] * NODES
    reach = float(max(nodes.left.max(), nodes.right.max())) + SPREAD_LIMIT
    found = []
    for body in sight.bodies:
        along = abs(body.across) < CROSSES and not comes_nearer(body)
        # Most stand beside the road, and what follows takes a third of a millisecond.
        if along and body.d.min() < reach and body.d.max() > -reach and first_met(nodes, times, path, body) is not None:
            found.append(body)
    return found


def comes_nearer(body: Body) -> bool:
    """Tell whether a body comes the other way: it goes first, and nobody goes around it in comfort."""
    return body.along < -SLOWER


def comes_at_once(sight: Sight, plan: LateralPlan, body: Body) -> bool:
    """Tell whether who comes the other way meets the car on the first nodes of a plan, which it leaves where they were.

    So he does where the car has come to rest on them by then.
    """
    if not comes_nearer(body):
        return False
    node = first_met(sight.nodes, times_at(plan.speeds, SPACING), plan.d, body)
    return node is not None and node < HEAD


def leads_free(sight: Sight, plan: LateralPlan, keeps: Margins, away: float) -> bool:
    """Tell whether a way comes nowhere nearer than `away` to anybody [m], by the times that `keeps` leaves."""
    return not too_near(sight, plan, keeps, away, away)


def too_near(sight: Sight, plan: LateralPlan, keeps: Margins, away: float, from_oncoming: float) -> list[Body]:
    """Return the bodies to which a way comes nearer than `away` [m], or than `from_oncoming` to who comes [m]."""
    times, near = times_at(plan.speeds, SPACING), []
    for body in sight.bodies:
        least = from_oncoming if comes_nearer(body) else away
        if not min(clearances(sight.nodes, times, plan.d, body, keeps)) >= least:
            near.append(body)
    return near


def may_come_over(body: Body) -> bool:
    """Tell whether a body seems to move across the path, if not surely."""
    return abs(body.drift) > max(CROSSES, body.sigma)


def is_gone(body: Body, rear: float) -> bool:
    """Tell whether a body that came the other way is behind the car's rear, whose s this is [m]."""
    return comes_nearer(body) and float(body.s.max()) < rear


def is_slow(body: Body, sight: Sight) -> bool:
    """Tell whether a body stands or goes along slowly, so that it is worth going around."""
    desired = sight.observation.desired_speed
    return abs(body.across) < CROSSES and body.along < max(desired - SLOWER, 0.5 * desired)


def covers(body: Body, d: float, ego_s: float) -> bool:
    """Tell whether a body ahead of the car covers a line `d` beside the path, so that nobody comes along it [m]."""
    ahead = body.s > ego_s + LOOKS_FROM
    return bool((ahead & (body.d <= d)).any() and (ahead & (body.d >= d)).any())


# Braking for them.


def can_wait(sight: Sight, blocking: list[Body]) -> bool:
    """Tell whether the car can still come back to its path and slow down there in comfort behind what is there."""
    back = abs(sight.here.d) * BACK_SHARE + WAITS
    gaps = [float(body.s.min()) - sight.bumper - slowing_distance(sight, max(body.along, 0.0)) for body in blocking]
    return min(gaps, default=-math.inf) > back


def slowing_distance(sight: Sight, speed: float) -> float:
    """Return the way that the car gains on somebody of a speed [m/s] while slowing in comfort to that speed [m]."""
    delay = 2.0 * PERIOD + sight.vehicle.brake_delay
    return stopping_distance(max(sight.observation.pose.speed - speed, 0.0), -COMFORT_LIMIT, delay, 0.7)


def beside_at_rest(sight: Sight, plan: LateralPlan) -> float:
    """Return how far beside its path the car comes to rest on a way, slowing in comfort [m]."""
    rest = sight.here.s + slowing_distance(sight, 0.0)
    return abs(plan.d[min(round(rest / SPACING) - sight.first, NODES - 1)])


def comes_too_late(sight: Sight, blocking: list[Body], line: WayAround | None, brakes: bool) -> bool:
    """Tell whether the car would reach one of the bodies before it stands, and can still come to the side of it.

    Who comes the other way counts where he is in a way around, or on the path where that is None. A car that does not
    brake for anybody, `brakes` false, steers as late as it can in half a second more than the least time.
    """
    car, speed = sight.vehicle, sight.observation.pose.speed
    delay, build_up = car.brake_delay + PERIOD, FIRST_ORDER_RAMP * car.brake_lag + car.deceleration_limit / JERK
    answer = car.steering_delay + car.steering_lag + PERIOD
    for body in blocking:
        gap, closing = float(body.s.min()) - sight.bumper, speed - max(body.along, 0.0)
        if gap <= 0.0 or closing <= 0.0:
            continue
        if comes_nearer(body):
            if gap < (speed - body.along) * ONCOMING and is_met(sight, body, line):
                return True
        elif not brakes:
            needs = swerve_time(_aside(car, body.moved(gap / closing)), URGENT_ACCELERATION, URGENT_JERK, answer)
            if gap < closing * (needs + 0.5):
                return True
        elif stopping_distance(closing, car.deceleration_limit, delay, build_up) > gap:
            time = time_to_cover(gap, closing, car.deceleration_limit, delay + 0.5 * build_up)
            if sideways_reach(time - answer, URGENT_ACCELERATION, URGENT_JERK) > 0.0:
                return True
    return False


def _aside(vehicle: Vehicle, body: Body) -> float:
    """Return how far the car must go aside to pass a body that is beside it then as it would like to [m]."""
    half = 0.5 * vehicle.width + URGENT[0].clearance
    return max(min(float(body.d.max()) + half, half - float(body.d.min())), 0.0)


def braked_speeds(sight: Sight) -> list[float]:
    """Return the speeds at the nodes while the car brakes with all there is [m/s]."""
    speed, car = sight.observation.pose.speed, sight.vehicle
    late = speed * (car.brake_delay + PERIOD)
    squares = (speed * speed - 2.0 * car.deceleration_limit * max(SPACING * node - late, 0.0) for node in range(NODES))
    return [math.sqrt(max(square, 0.25)) for square in squares]


def creeping_speeds(sight: Sight, blocking: list[Body], cap: float, until: float = -math.inf) -> list[float]:
    """Return the speeds at the nodes of a car that keeps to a cap until it is beside what blocks its path [m/s]."""
    if cap == math.inf:
        return sight.speeds
    beside = min((float(body.s.min()) for body in blocking), default=-math.inf) - sight.vehicle.rear_axle_to_bumper
    beside = max(beside, until)
    speeds = [min(sight.speeds[0], max(cap, sight.observation.pose.speed))]
    for s, open_road in zip(sight.nodes.s.tolist()[1:], sight.speeds[1:], strict=True):
        faster = math.sqrt(speeds[-1] ** 2 + 2.0 * SPEEDING_UP * SPACING)
        slower = math.sqrt(max(speeds[-1] ** 2 - 2.0 * SLOWING * SPACING, 0.0))
        speeds.append(min(faster, open_road, max(cap, slower) if s < beside else math.inf))
    return speeds
