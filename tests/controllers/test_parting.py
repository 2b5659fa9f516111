"""What crosses, where it will be in the way and whether it is gone in time: closed forms, long bodies, left turns."""

from __future__ import annotations

import math

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from controllers.crossing import PREDICTION_HORIZON
from controllers.follow_and_stop import FollowAndStop, make
from controllers.parting import MAX_BODY_LENGTH, MIN_CLEARANCE, STEP, WAY_STEP, goes_past, nearest_in_way
from controllers.trend import Trend
from tests.controllers.bench import CAR, ROAD, Body, Ride, ride, steady
from vve_sumo.path import Corridor, ReferencePath

NOSE = CAR.rear_axle_to_bumper
HALF = 0.5 * CAR.width + 0.3
BUS = {"length": 12.2, "width": 2.59, "cross_section": 100.0}
SEDAN = {"length": 4.85, "width": 1.85, "cross_section": 10.0}


def corridor(path: ReferencePath) -> Corridor:
    return Corridor(path, CAR.rear_axle_to_bumper, CAR.rear_overhang, CAR.width, 0.3)


BAND = corridor(ROAD)


def surely(value: float, rate: float) -> Trend:
    """A place across the path and its speed, without doubt."""
    trend = Trend(value, 1e-12, 1e-12, 0.0)
    trend.rate = rate
    return trend


@pytest.mark.thorough
@given(st.floats(-1.0, 1.0), st.floats(4.0, 20.0), st.floats(2.5, 60.0), st.floats(1.0, 20.0), st.booleans())
def test_square_across_a_straight_road_it_is_geometry(place, rate, gap, pace, to_right):
    """Its end is out after (half + body - place) / rate, the bumper is near after (gap - clearance) / pace.

    `place` counts in the way it goes, from the middle of the path.
    """
    gone, near = (HALF + MAX_BODY_LENGTH - place) / rate, (gap - MIN_CLEARANCE) / pace
    assume(abs(gone - near) > 2.0 * STEP and abs(gone - PREDICTION_HORIZON) > 2.0 * STEP)
    side = -1.0 if to_right else 1.0
    past = goes_past(ROAD, BAND, 300.0 + gap, surely(side * place, side * rate), 0.0, 300.0, pace)
    assert past is (gone < min(near, PREDICTION_HORIZON))


@given(st.floats(-1.0, 1.0), st.floats(4.0, 20.0), st.floats(0.2, 1.5), st.booleans())
def test_who_crosses_a_straight_road_obliquely_is_in_the_way_from_where_it_leaves_it(place, rate, tangent, to_right):
    """All of it goes on one line, which leaves the band (half - place) · tangent nearer than where it is seen."""
    along = -rate * tangent
    assume((HALF - place) / rate < PREDICTION_HORIZON - STEP)
    side = -1.0 if to_right else 1.0
    found = nearest_in_way(ROAD, BAND, 400.0, surely(side * place, side * rate), along, 300.0)
    least = 400.0 + along * (HALF - place) / rate
    assert least - 1e-4 <= found <= least + WAY_STEP


def test_nothing_is_foretold_of_one_on_foot_or_of_unknown_motion():
    assert nearest_in_way(ROAD, BAND, 340.0, surely(0.0, 2.0), -2.0, 300.0) == -math.inf
    assert nearest_in_way(ROAD, BAND, 340.0, surely(0.0, math.nan), -8.0, 300.0) == -math.inf


@pytest.mark.parametrize(
    ("along", "rate"), [(-15.0, 0.0), (-15.0, 0.2), (0.0, 0.0), (10.0, 1.0), (0.0, 2.9), (-2.0, 1.5)]
)
def test_who_stays_or_walks_does_not_go_past(along, rate):
    assert not goes_past(ROAD, BAND, 340.0, surely(0.0, rate), along, 300.0, 10.0)


def test_doubt_keeps_it_in_the_way():
    """A standard deviation of 10 m/s: surely gone it is not."""
    trend = surely(0.0, 15.0)
    assert goes_past(ROAD, BAND, 330.0, trend, 0.0, 300.0, 5.0)
    trend.rate_variance = 100.0
    assert not goes_past(ROAD, BAND, 330.0, trend, 0.0, 300.0, 5.0)


def test_where_the_path_bends_it_goes_straight_on():
    """The path turns left onto a street; who comes along that street towards the car crosses the path and is gone.

    In the bend it goes at 45 degrees to the path, nearer along it as fast as across it.
    """
    quarter = [math.radians(a) for a in range(0, 91, 9)]
    x = [100.0 * i / 50 for i in range(50)] + [100.0 + 10.0 * math.sin(a) for a in quarter] + [110.0] * 60
    y = [0.0] * 50 + [10.0 - 10.0 * math.cos(a) for a in quarter] + [11.0 + i for i in range(60)]
    path = ReferencePath.from_points(x, y)
    middle = path.project(100.0 + 10.0 * math.sin(0.25 * math.pi), 10.0 - 10.0 * math.cos(0.25 * math.pi))
    pace = 19.0  # towards -y: path heading 45 degrees, so -13.4 along and -13.4 across
    trend = surely(0.0, -pace * math.sqrt(0.5))
    assert goes_past(path, corridor(path), middle.s, trend, -pace * math.sqrt(0.5), middle.s - 20.0, 5.0)
    assert not goes_past(path, corridor(path), middle.s, trend, -pace * math.sqrt(0.5), middle.s - 5.0, 5.0)


def turns_off(ahead: float, speed: float, radius: float, begins: float, length: float, width: float,
              cross_section: float) -> Body:  # fmt: skip
    """A vehicle that comes in the next lane, 3.3 m to the left, and turns off to its right, away from the ego's lane.

    Its front bumper keeps to a quarter circle that begins at x = `ahead`, its rear follows on the same line.
    """

    def lane(way: float) -> tuple[float, float]:
        if way < 0.0:
            return ahead - way, 3.3
        turned, over = min(way / radius, 0.5 * math.pi), max(way - 0.5 * math.pi * radius, 0.0)
        return ahead - radius * math.sin(turned), 3.3 + radius * (1.0 - math.cos(turned)) + over

    def place(time: float) -> tuple[float, float, float, float]:
        way = speed * (time - begins)
        (front_x, front_y), (rear_x, rear_y) = lane(way), lane(way - length)
        heading = math.atan2(front_y - rear_y, front_x - rear_x)
        x, y = front_x - 0.5 * length * math.cos(heading), front_y - 0.5 * length * math.sin(heading)
        return x, y, heading, speed

    return Body(place, length, width, cross_section)


def alone() -> FollowAndStop:
    return make(CAR, {"comfort": False})


def meets_one_who_turns_off(ego: float, speed: float, radius: float, gap: float, size: dict[str, float]) -> Ride:
    """The other begins to turn after 2 s, `gap` before the ego's bumper."""
    return ride(alone(), ego, [turns_off(NOSE + 2.0 * ego + gap, speed, radius, 2.0, **size)], 8.0, seed=0)


@pytest.mark.thorough(witnesses=6)
@pytest.mark.parametrize("ego", [8.9, 13.4])
@pytest.mark.parametrize("speed", [5.0, 7.0, 9.5])
@pytest.mark.parametrize("radius", [7.0, 10.0])
@pytest.mark.parametrize("size", [BUS, SEDAN], ids=["bus", "sedan"])
def test_who_turns_off_does_not_brake_it(ego, speed, radius, size):
    """While a long body turns, its nearest point runs along its flank, up to 17 m/s, as if something came across."""
    for gap in (6.0, 10.0, 14.0, 18.0, 22.0, 26.0, 30.0):
        done = meets_one_who_turns_off(ego, speed, radius, gap, size)
        assert math.isnan(done.began), f"gap {gap}"
        assert done.impact == 0.0


def test_who_comes_out_behind_one_that_passes_is_braked_for():
    """A walker whom a car that comes towards the ego has hidden begins beside a moving body and is no part of it."""
    pace, ego = 1.4, 8.9
    meets = NOSE + 4.0 * ego
    walker = steady(meets, 4.0 * pace, pace, -0.5 * math.pi, length=0.5, width=0.6, cross_section=0.5)
    passes = 4.0 - 3.3 / pace  # when the walker is in the middle of the car's lane
    car = steady(meets - 3.0 - 2.4 + 6.0 * passes, 3.3, 6.0, math.pi, length=4.85, width=1.85)
    assert ride(alone(), ego, [walker, car], 7.0).impact == 0.0


@pytest.mark.parametrize("pace", [3.5, 5.0, 7.0])
def test_a_car_that_crosses_is_braked_for(pace):
    ego = 10.0
    other = steady(NOSE + 4.0 * ego + 0.9, -4.0 * pace, pace, 0.5 * math.pi, length=4.5, width=1.8)
    done = ride(alone(), ego, [other], 7.0)
    assert not math.isnan(done.began)
    assert done.impact < 0.5 * ego


def left_turn(radius: float) -> ReferencePath:
    """A path that goes straight on for 60 m and turns left into a street."""
    quarter = [math.radians(a) for a in range(0, 91, 3)]
    x = [2.0 * i for i in range(30)] + [60.0 + radius * math.sin(a) for a in quarter] + [60.0 + radius] * 60
    y = [0.0] * 30 + [radius - radius * math.cos(a) for a in quarter] + [radius + 1.0 + i for i in range(60)]
    return ReferencePath.from_points(x, y)


def at_a_left_turn(ego: float, speed: float, length: float, before: float, radius: float, brakes: float = 0.0) -> Ride:
    """The car turns left across a lane, 3.3 m away, in which somebody comes.

    Its front is where the lane's middle crosses the path so long `before` the car's front is [s]; if it brakes, it
    comes to rest there.
    """
    path, lane = left_turn(radius), 3.3
    crossing = next(s for s in (55.0 + 0.1 * n for n in range(300)) if path.at(s).y >= lane)
    meets, due = path.at(crossing).x, (crossing - NOSE) / ego - before
    slows = due - speed / brakes / 2.0 if brakes else math.inf

    def place(time: float) -> tuple[float, float, float, float]:
        way, pace = speed * (due - time), speed
        if time > slows:
            braked = min(time - slows, speed / brakes)
            way, pace = speed * (due - slows) - speed * braked + 0.5 * brakes * braked**2, speed - brakes * braked
        return meets + way + 0.5 * length, lane, math.pi, pace

    return ride(alone(), ego, [Body(place, length, 1.9)], (crossing + 12.0) / ego, path=path)


@pytest.mark.parametrize("radius", [8.0, 12.0])
@pytest.mark.parametrize(
    ("ego", "speed", "length", "before"),
    [(3.0, 12.0, 4.5, 3.0), (5.0, 7.0, 4.5, 3.0), (5.0, 12.0, 4.5, 2.5), (7.0, 12.0, 4.5, 2.0), (7.0, 12.0, 12.0, 2.5)],
)
def test_who_passes_through_a_left_turn_in_time_does_not_brake_it(ego, speed, length, before, radius):
    done = at_a_left_turn(ego, speed, length, before, radius)
    assert math.isnan(done.began)
    assert done.impact == 0.0


@pytest.mark.parametrize("radius", [8.0, 12.0])
@pytest.mark.parametrize("ego", [3.0, 5.0, 7.0])
@pytest.mark.parametrize("speed", [7.0, 12.0])
@pytest.mark.parametrize("brakes", [2.0, 4.0])
def test_who_stops_in_a_left_turn_is_braked_for(ego, speed, brakes, radius):
    """It seems to go on until it brakes, and stands in the way then."""
    done = at_a_left_turn(ego, speed, 4.5, 3.0, radius, brakes)
    assert not math.isnan(done.began)
    assert done.impact == 0.0


@pytest.mark.parametrize(("beside", "speed"), [(0.0, 6.0), (0.8, 8.0), (-0.6, 5.0)])
def test_who_comes_head_on_out_of_cover_is_not_taken_for_one_who_crosses(beside, speed):
    """At its first scans how it moves across the path is noise. It is uncovered after 1 s, 26 m before the bumper."""
    meets = NOSE + 8.0 + 26.0 + 2.25

    def place(time: float) -> tuple[float, float, float, float]:
        return meets + speed * (1.0 - time), beside if time >= 1.0 else 60.0, math.pi, speed

    for seed in range(20):
        done = ride(alone(), 8.0, [Body(place)], 4.0, seed=seed)
        assert done.began < 1.7
        assert done.impact == 0.0
