"""Conflicts by predicted paths: against closed forms, and against both bodies moved on in small steps."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from tests.metrics.tables import CAR, actors_of, drive_of, straight, ticks_of
from vve_sumo.metrics.conflict import HORIZON, yielding
from vve_sumo.metrics.drive_data import DriveData
from vve_sumo.metrics.following import MAX_DECELERATION
from vve_sumo.path import ReferencePath

START = 20.0  #: s of the ego's rear axle at the tick that is judged [m]
BUMPER = START + CAR.rear_axle_to_bumper
LENGTH, WIDTH = 4.0, 2.0  #: of the actor [m]
LORRY = (18.75, 2.55)  #: length and width with a trailer [m]
STEP = 0.01  #: of the small steps [s]


def driven(
    speed: float,
    track: list[tuple[float, float, float]],
    other: float,
    path: ReferencePath | None = None,
    size: tuple[float, float] = (LENGTH, WIDTH),
) -> DriveData:
    """A drive whose first tick is judged: the ego at START, an actor along a track (x, y, heading) from then on."""
    ego = [{"time_s": 0.02 * i, "true_x_m": math.nan, "x_m": math.nan, "s_m": math.nan} for i in range(len(track))]
    place = (straight() if path is None else path).at(START)
    ego[0] = {"true_x_m": place.x, "true_y_m": place.y, "true_heading_rad": place.heading, "s_m": START}
    ego[0] |= {"true_speed_mps": speed}
    actors = [
        {"tick": i, "actor": "other", "x_m": x, "y_m": y, "heading_rad": heading, "speed_mps": other}
        | dict(zip(("length_m", "width_m"), size, strict=True))
        for i, (x, y, heading) in enumerate(track)
    ]
    return drive_of(ticks_of(ego), actors_of(actors), path)


def body(x: float, y: float, heading: float, length: float, width: float) -> shapely.Polygon:
    box = shapely.box(-length / 2, -width / 2, length / 2, width / 2)
    return shapely.affinity.translate(shapely.affinity.rotate(box, heading, (0, 0), use_radians=True), x, y)


def ego_body(path: ReferencePath, s: float) -> shapely.Polygon:
    point = path.at(s)
    ahead = CAR.rear_axle_to_bumper - CAR.length / 2.0
    x, y = point.x + ahead * math.cos(point.heading), point.y + ahead * math.sin(point.heading)
    return body(x, y, point.heading, CAR.length, CAR.width)


def steps(
    path: ReferencePath,
    speed: float,
    x: float,
    y: float,
    heading: float,
    other: float,
    braking: float = 0.0,
    size: tuple[float, float] = (LENGTH, WIDTH),
) -> tuple[float, float]:
    """Move both bodies on in small steps: when they meet (inf for never), and the least distance between them."""
    least = math.inf
    for now in np.arange(0.0, HORIZON, STEP).tolist():
        rolling = min(now, speed / braking) if braking > 0.0 else now
        gone = speed * rolling - 0.5 * braking * rolling**2
        if START + gone > path.length:
            break
        they = body(x + other * now * math.cos(heading), y + other * now * math.sin(heading), heading, *size)
        apart = shapely.distance(ego_body(path, START + gone), they)
        least = min(least, apart)
        if apart == 0.0:
            return now, 0.0
    return math.inf, least


def bend(radius: float = 15.0) -> ReferencePath:
    """A quarter turn to the left after 30 m."""
    angle = np.linspace(0.0, math.pi / 2, 13)[1:]
    x = np.concatenate((np.arange(0.0, 31.0, 2.0), 30.0 + radius * np.sin(angle), np.full(40, 30.0 + radius)))
    y = np.concatenate((np.zeros(16), radius - radius * np.cos(angle), radius + 2.0 * np.arange(1, 41)))
    return ReferencePath.from_points(x, y)


PLACES = st.tuples(st.floats(-15.0, 60.0), st.floats(-40.0, 40.0), st.floats(-math.pi, math.pi))


@pytest.mark.thorough
@settings(max_examples=40, deadline=None)
@given(place=PLACES, speed=st.floats(1.0, 18.0), other=st.floats(0.3, 15.0), bent=st.booleans())
def test_the_time_to_collision_is_that_of_two_bodies_in_small_steps(
    place: tuple[float, float, float], speed: float, other: float, bent: bool
) -> None:
    path = bend() if bent else straight()
    x, y, heading = START + CAR.rear_axle_to_bumper / 2.0 + place[0], place[1], place[2]
    drive = driven(speed, [(x, y, heading)], other, path)
    found = float(drive.conflict.time[0])
    met, least = steps(path, speed, x, y, heading, other)
    if 0.0 < met < math.inf:
        ego, they = (
            path.at(START + speed * met),
            (x + other * met * math.cos(heading), y + other * met * math.sin(heading)),
        )
        middle = CAR.rear_axle_to_bumper - CAR.length / 2.0
        dx, dy = they[0] - ego.x - middle * math.cos(ego.heading), they[1] - ego.y - middle * math.sin(ego.heading)
        forward = dx * math.cos(ego.heading) + dy * math.sin(ego.heading)
        assume(abs(forward + CAR.length / 2.0) > 0.5)
        if forward < -CAR.length / 2.0:  # it runs into the ego's rear
            assert math.isnan(found)
            return
        # A touch shorter than the search's least step may go unseen.
        again = shapely.distance(
            ego_body(path, START + speed * (met + 0.06)),
            body(
                x + other * (met + 0.06) * math.cos(heading),
                y + other * (met + 0.06) * math.sin(heading),
                heading,
                LENGTH,
                WIDTH,
            ),
        )
        assume(again == 0.0)
        assert found == pytest.approx(met, abs=STEP + 0.02)
    elif met == 0.0:
        assert found == 0.0
    else:
        assert math.isnan(found) or least < 0.1


@pytest.mark.parametrize(
    ("radius", "s", "aside", "turned", "speed"),
    [
        # Its middle is 7 m from the path, but its front stands in the bend that the ego comes around.
        (24.4, 53.1, 7.0, 0.39, 7.1),
        (15.4, 40.2, 6.9, 0.32, 5.9),
        # The ego turns in before its front, and has its middle behind itself when they meet.
        (14.5, 39.7, 7.5, -0.35, 5.7),
        (12.0, 29.5, 5.0, -0.15, 4.0),
    ],
)
def test_a_lorry_that_stands_at_a_bend_is_met_with_its_ends(
    radius: float, s: float, aside: float, turned: float, speed: float
) -> None:
    path = bend(radius)
    foot = path.at(s)
    x, y = foot.x - aside * math.sin(foot.heading), foot.y + aside * math.cos(foot.heading)
    heading = foot.heading + turned
    met, _ = steps(path, speed, x, y, heading, 0.0, size=LORRY)
    assert 0.5 < met < HORIZON
    found = driven(speed, [(x, y, heading)], 0.0, path, LORRY).conflict
    assert found.time[0] == pytest.approx(met, abs=STEP + 0.02)
    assert found.deceleration[0] > 0.0


@pytest.mark.thorough
@settings(max_examples=30, deadline=None)
@given(
    radius=st.floats(8.0, 25.0), s=st.floats(25.0, 60.0), aside=st.floats(-8.0, 8.0), turned=st.floats(-0.8, 0.8),
    speed=st.floats(3.0, 9.0),
)  # fmt: skip
def test_who_stands_never_runs_into_the_ego(radius: float, s: float, aside: float, turned: float, speed: float) -> None:
    path = bend(radius)
    foot = path.at(s)
    x, y = foot.x - aside * math.sin(foot.heading), foot.y + aside * math.cos(foot.heading)
    place = (x, y, foot.heading + turned)
    met, _ = steps(path, speed, *place, 0.0, size=LORRY)
    assume(0.0 < met < HORIZON)
    later = ego_body(path, START + speed * (met + 0.06))
    assume(shapely.distance(later, body(*place, *LORRY)) == 0.0)
    found = driven(speed, [place], 0.0, path, LORRY).conflict
    assert found.time[0] == pytest.approx(met, abs=STEP + 0.02)


def test_a_lorry_that_comes_in_with_its_front_is_met_though_its_middle_is_behind() -> None:
    """It overtakes at twice the ego's speed, 10 degrees into the lane: its front corner meets the ego's front half."""
    speed, other, heading = 5.0, 10.0, -math.radians(10.0)
    middle = START + CAR.rear_axle_to_bumper - CAR.length / 2.0
    x, y = middle - 12.0, 4.8
    met, _ = steps(straight(), speed, x, y, heading, other, size=LORRY)
    assert 0.5 < met < HORIZON
    assert x + other * met * math.cos(heading) - (middle + speed * met) < -CAR.length / 2.0
    found = driven(speed, [(x, y, heading)], other, size=LORRY).conflict
    assert found.time[0] == pytest.approx(met, abs=STEP + 0.02)


@pytest.mark.thorough
@settings(max_examples=40, deadline=None)
@given(
    angle=st.floats(0.9, 2.2), left=st.booleans(), speed=st.floats(3.0, 18.0), other=st.floats(0.5, 14.0),
    ahead=st.floats(5.0, 60.0), early=st.floats(-2.0, 2.0),
)  # fmt: skip
def test_the_deceleration_needed_lets_one_that_crosses_pass(
    angle: float, left: bool, speed: float, other: float, ahead: float, early: float
) -> None:
    """Braked with it both bodies stay apart; at a right angle not with less."""
    heading = angle if left else -angle
    time = max(ahead / speed + early, 0.3)
    x, y = BUMPER + ahead - other * time * math.cos(heading), -other * time * math.sin(heading)
    drive = driven(speed, [(x, y, heading)], other)
    found = float(drive.conflict.deceleration[0])
    assume(math.isfinite(drive.conflict.time[0]) and 0.05 < found < MAX_DECELERATION)
    met, _ = steps(straight(), speed, x, y, heading, other, braking=1.02 * found + 0.05)
    assert met == math.inf


@pytest.mark.thorough(witnesses=1)
@pytest.mark.parametrize(("speed", "other", "ahead"), [(10.0, 5.0, 20.0), (14.0, 1.4, 30.0), (8.0, 8.0, 12.0)])
def test_before_one_that_crosses_at_a_right_angle_no_less_deceleration_will_do(
    speed: float, other: float, ahead: float
) -> None:
    """Closed form: the bumper reaches the crosser's side when its rear has left the ego's width, or stops there."""
    side = BUMPER + ahead
    y = -other * ahead / speed
    drive = driven(speed, [(side + WIDTH / 2.0, y, math.pi / 2)], other)
    left = (CAR.width / 2.0 + LENGTH / 2.0 - y) / other
    stop = speed**2 / (2.0 * ahead)
    expected = 2.0 * (speed * left - ahead) / left**2 if ahead > speed * left / 2.0 else stop
    found = float(drive.conflict.deceleration[0])
    assert found == pytest.approx(expected, rel=1e-2)
    assert steps(straight(), speed, side + WIDTH / 2.0, y, math.pi / 2, other, braking=1.03 * found)[0] == math.inf
    assert steps(straight(), speed, side + WIDTH / 2.0, y, math.pi / 2, other, braking=0.97 * found)[0] < math.inf


@pytest.mark.thorough
@settings(deadline=None)
@given(speed=st.floats(1.0, 25.0), other=st.floats(0.0, 20.0), gap=st.floats(0.5, 100.0))
def test_behind_a_leader_it_is_gap_over_closing_speed(speed: float, other: float, gap: float) -> None:
    drive = driven(speed, [(BUMPER + gap + LENGTH / 2.0, 0.0, 0.0)], other)
    closing = speed - other
    assume(abs(closing) > 0.1 and (closing < 0.0 or abs(gap / closing - HORIZON) > 0.1))
    if closing < 0.0 or gap / closing > HORIZON:
        assert math.isnan(drive.conflict.time[0])
        assert math.isnan(drive.conflict.deceleration[0])
    else:
        assert drive.conflict.time[0] == pytest.approx(gap / closing, rel=1e-6)
        assert drive.conflict.deceleration[0] == pytest.approx(
            min(closing**2 / (2.0 * gap), MAX_DECELERATION), rel=1e-6
        )
        assert drive.conflict.actor[0] == "other"
        np.testing.assert_allclose(drive.conflict.time[0], drive.strip_lead.time_to_collision[0], rtol=1e-6)


def test_oncoming_traffic_in_a_lane_of_its_own_that_the_path_bends_across_is_no_conflict() -> None:
    """The ego turns left behind it: the strip shows a car ahead that closes in, and the bodies never meet."""
    angle = np.linspace(0.0, math.pi / 2, 13)[1:]
    x = np.concatenate((np.arange(0.0, 51.0, 2.0), 50.0 + 10.0 * np.sin(angle), np.full(20, 60.0)))
    y = np.concatenate((np.zeros(26), 10.0 - 10.0 * np.cos(angle), 10.0 + 2.0 * np.arange(1, 21)))
    path = ReferencePath.from_points(x, y)
    for oncoming, meets in ((58.0, False), (100.0, True)):
        drive = driven(8.0, [(oncoming, 3.5, math.pi)], 10.0, path)
        assert np.isfinite(drive.conflict.time[0]) == meets
        if not meets:
            assert drive.strip_lead.time_to_collision[0] < 3.0
            assert drive.strip_lead.actor == ["other"]
            assert drive.lead.actor == [""]


def test_nothing_beyond_the_paths_end_counts() -> None:
    end = straight().length - START
    for x, counts in ((START + end - 5.0, True), (START + end + CAR.rear_axle_to_bumper + LENGTH, False)):
        drive = driven(40.0, [(x, 0.0, 0.0)], 0.0)
        assert np.isfinite(drive.conflict.time[0]) == counts
        drive = driven(
            40.0, [(x - 150.0, 0.0, 0.0)], 0.0, ReferencePath.from_points([0.0, end + START - 150.0], [0.0, 0.0])
        )
        assert np.isfinite(drive.lead.gap[0]) == counts
        assert np.isfinite(drive.strip_lead.gap[0])


def test_an_actor_goes_the_way_that_it_drove_later_and_straight_on_after_the_record() -> None:
    """It comes towards the ego's path and turns away before it; cut off before the turn it is expected to come on."""
    towards = [(BUMPER + 20.0, -20.0 + 0.2 * i, math.pi / 2) for i in range(70)]
    away = [(BUMPER + 20.0 + 0.2 * i, -6.0, 0.0) for i in range(1, 60)]
    assert math.isnan(driven(10.0, towards + away, 10.0).conflict.time[0])
    assert math.isfinite(driven(10.0, towards, 10.0).conflict.time[0])


def test_who_was_in_conflict_keeps_a_gap_after_the_ego_has_braked_for_it() -> None:
    """A crosser that the ego would have met counts while it is in the strip, also once the ego stands before it."""
    track = [(BUMPER + 10.0, -4.0 + 2.0 * 0.02 * i, math.pi / 2) for i in range(150)]
    for first_speed, counts in ((5.0, True), (0.0, False)):
        rows = [
            {"time_s": 0.02 * i, "true_x_m": START, "s_m": START, "true_speed_mps": first_speed if i == 0 else 0.0}
            for i in range(150)
        ]
        actors = [
            {"tick": i, "actor": "walker", "x_m": x, "y_m": y, "heading_rad": heading, "speed_mps": 2.0}
            for i, (x, y, heading) in enumerate(track)
        ]
        drive = drive_of(ticks_of(rows), actors_of(actors))
        assert np.isfinite(drive.strip_lead.gap).any()
        assert np.isfinite(drive.lead.gap).any() == counts
        if counts:
            assert np.nanmin(drive.lead.gap) == pytest.approx(10.0 - WIDTH / 2.0, abs=1e-6)


def test_in_contact_the_time_is_zero_and_no_braking_avoids_it() -> None:
    drive = driven(5.0, [(BUMPER + LENGTH / 2.0 - 0.1, 0.0, 0.0)], 1.0)
    assert drive.conflict.time[0] == 0.0
    assert drive.conflict.deceleration[0] == MAX_DECELERATION


@given(speed=st.floats(1.0, 30.0), distance=st.floats(0.5, 100.0), time=st.floats(0.1, 20.0))
def test_yielding_is_the_least_deceleration(speed: float, distance: float, time: float) -> None:
    """Moved on with it, it is not beyond the distance before the time; with a hundredth less it is."""
    needed = float(yielding(np.array(speed), np.array(distance), np.array(time)))

    def gone(braking: float) -> float:
        rolling = min(time, speed / braking) if braking > 0.0 else time
        return speed * rolling - 0.5 * braking * rolling**2

    assert gone(needed) <= distance * (1.0 + 1e-9)
    if needed > 1e-6:
        assert gone(0.99 * needed) > distance * (1.0 - 1e-9)
    assert yielding(np.array(speed), np.array(-0.1), np.array(time)) == math.inf
    assert yielding(np.array(speed), np.array(distance), np.array(0.0)) == 0.0
