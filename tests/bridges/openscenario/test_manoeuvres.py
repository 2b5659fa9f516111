"""What an imported file makes its entities do, against the file's own numbers in closed form."""

from __future__ import annotations

import math
from itertools import pairwise
from pathlib import Path

import pytest

from tests.bridges.openscenario.stage import (
    LANE,
    Moment,
    after,
    at,
    event,
    imported,
    lane_change,
    of_entity,
    played,
    scenario,
    shape_share,
    speed_action,
)
from vve_sumo.timing import PERIOD

#: from the rear axle, which the file places, to the centre of the box [m]
CENTRE = 1.5
#: the file's numbers are met to this [m], [m/s]; a trigger fires up to one tick late
CLOSE = 0.2


def other(moments: list[Moment], time: float) -> tuple[float, float, float]:
    """Reference point x, y [m] and speed along the road [m/s] of the other entity at a time."""
    moment = moments[round(time / PERIOD)]
    state = moment.actors["Other"]
    x = state.x - CENTRE * math.cos(state.heading)
    return x, state.y - CENTRE * math.sin(state.heading), state.speed * math.cos(state.heading)


@pytest.mark.parametrize("shape", ["linear", "cubic", "sinusoidal"])
def test_a_speed_changes_by_its_shape_over_time(tmp_path: Path, shape: str) -> None:
    moments = played(imported(tmp_path, scenario(event("e", speed_action(shape, "time", "4", "18"), after("2")))), 8.0)
    for part in (0.25, 0.5, 0.9):
        _x, _y, speed = other(moments, 2.0 + PERIOD + 4.0 * part)
        assert speed == pytest.approx(10.0 + 8.0 * shape_share(shape, part), abs=0.05)
    # The mean of every one of these shapes is half of the change.
    assert other(moments, 8.0)[0] == pytest.approx(100.0 + 10.0 * 2.0 + 14.0 * 4.0 + 18.0 * 2.0, abs=CLOSE)


@pytest.mark.parametrize(("shape", "steepest"), [("linear", 1.0), ("cubic", 1.5), ("sinusoidal", 0.5 * math.pi)])
def test_a_rate_is_the_greatest_one(tmp_path: Path, shape: str, steepest: float) -> None:
    text = scenario(event("e", speed_action(shape, "rate", "-2", "4"), after("1")))
    moments = played(imported(tmp_path, text), 8.0)
    speeds = [other(moments, tick * PERIOD)[2] for tick in range(len(moments))]
    greatest = max(abs(one - two) for one, two in pairwise(speeds)) / PERIOD
    assert greatest == pytest.approx(2.0, rel=0.01)
    lasted = sum(4.0 + 1e-6 < speed < 10.0 - 1e-6 for speed in speeds) * PERIOD
    assert lasted == pytest.approx(6.0 * steepest / 2.0, abs=3 * PERIOD)


def test_a_change_over_a_distance_ends_there(tmp_path: Path) -> None:
    text = scenario(event("e", speed_action("linear", "distance", "60", "20"), after("1")))
    moments = played(imported(tmp_path, text), 8.0)
    begun, reached = (
        other(moments, 1.0 + PERIOD)[0],
        next(
            other(moments, tick * PERIOD)[0] for tick in range(len(moments)) if other(moments, tick * PERIOD)[2] >= 20.0
        ),
    )
    assert reached - begun == pytest.approx(60.0, abs=0.5)


@pytest.mark.parametrize("shape", ["linear", "cubic", "sinusoidal"])
def test_a_lane_changes_by_its_shape(tmp_path: Path, shape: str) -> None:
    text = scenario(event("e", lane_change(shape, "time", "3", "1"), after("2")))
    moments = played(imported(tmp_path, text), 8.0)
    for part in (0.25, 0.5, 0.75):
        _x, y, _speed = other(moments, 2.0 + PERIOD + 3.0 * part)
        assert y == pytest.approx(-0.5 * LANE + LANE * shape_share(shape, part), abs=CLOSE)
    assert other(moments, 8.0)[1] == pytest.approx(0.5 * LANE, abs=1e-3)
    assert other(moments, 8.0)[0] == pytest.approx(180.0, abs=CLOSE)


def test_a_lane_changes_over_a_distance(tmp_path: Path) -> None:
    text = scenario(event("e", lane_change("sinusoidal", "distance", "40", "1"), after("2")))
    moments = played(imported(tmp_path, text), 9.0)
    assert other(moments, 4.0 + PERIOD)[1] == pytest.approx(0.0, abs=CLOSE)
    assert other(moments, 6.0 + 2 * PERIOD)[1] == pytest.approx(0.5 * LANE, abs=1e-3)


def first(moments: list[Moment]) -> float:
    """When the other entity's speed first differs from 10 m/s [s]."""
    return next((m.time for m in moments if abs(m.actors["Other"].speed - 10.0) > 1e-6), math.inf)


BRAKE = speed_action("step", "time", "0", "9")
#: condition, and when it holds beside an ego that drives 20 m/s from s 20 towards who drives 10 m/s from s 100
TRIGGERS = {
    "distance": ('<RelativeDistanceCondition entityRef="Other" relativeDistanceType="longitudinal" '
                 'coordinateSystem="road" freespace="false" rule="lessThan" value="35"/>', 4.5),
    "headway": ('<TimeHeadwayCondition entityRef="Other" relativeDistanceType="longitudinal" coordinateSystem="road" '
                'freespace="false" rule="lessThan" value="2"/>', 4.0),
    "ttc": ('<TimeToCollisionCondition relativeDistanceType="longitudinal" coordinateSystem="road" freespace="false" '
            'rule="lessThan" value="3"><TimeToCollisionConditionTarget><EntityRef entityRef="Other"/>'
            "</TimeToCollisionConditionTarget></TimeToCollisionCondition>", 5.0),
    "travelled": ('<TraveledDistanceCondition value="50"/>', 2.5),
    "reached": (f'<ReachPositionCondition tolerance="2">{at("-1", "120")}</ReachPositionCondition>', 4.9),
    "relative speed": ('<RelativeSpeedCondition entityRef="Other" rule="greaterThan" value="9"/>', 0.0),
    "speed": ('<SpeedCondition rule="greaterThan" value="19"/>', 0.0),
}  # fmt: skip


@pytest.mark.parametrize("name", TRIGGERS)
def test_a_condition_fires_when_it_holds(tmp_path: Path, name: str) -> None:
    condition, expected = TRIGGERS[name]
    moments = played(imported(tmp_path, scenario(event("e", BRAKE, of_entity(condition)))), 8.0)
    assert first(moments) == pytest.approx(expected, abs=2 * PERIOD)


@pytest.mark.parametrize(
    ("edge", "delay", "expected"), [("rising", "0", 2.0), ("none", "1.5", 3.5), ("rising", "1.5", 3.5)]
)
def test_edges_and_delays(tmp_path: Path, edge: str, delay: str, expected: float) -> None:
    text = scenario(event("e", BRAKE, after("2"), edge=edge, delay=delay))
    assert first(played(imported(tmp_path, text), 6.0)) == pytest.approx(expected, abs=2 * PERIOD)


def test_what_holds_from_the_start_rises_never(tmp_path: Path) -> None:
    condition = of_entity('<SpeedCondition rule="greaterThan" value="19"/>')
    assert first(played(imported(tmp_path, scenario(event("e", BRAKE, condition, edge="rising"))), 4.0)) == math.inf


def test_an_event_waits_for_the_end_of_another(tmp_path: Path) -> None:
    ended = """<ByValueCondition><StoryboardElementStateCondition storyboardElementType="event"
    storyboardElementRef="one" state="completeState"/></ByValueCondition>"""
    change = event("one", lane_change("linear", "time", "2", "1"), after("1"))
    moments = played(imported(tmp_path, scenario(change + event("two", BRAKE, ended, delay="1"))), 6.0)
    # The lane is reached at 3 s; while it changes, the speed along the heading is greater than 10 m/s.
    late = [m for m in moments if m.time > 3.2]
    assert first(late) == pytest.approx(4.0, abs=4 * PERIOD)


def test_a_stop_trigger_ends_the_drive(tmp_path: Path) -> None:
    condition = f'<Condition name="c" delay="1" conditionEdge="rising">{after("2")}</Condition>'
    stop = f"<ConditionGroup>{condition}</ConditionGroup>"
    moments = played(imported(tmp_path, scenario("", stop=stop)), 5.0)
    assert next(m.time for m in moments if m.ended) == pytest.approx(3.0, abs=2 * PERIOD)


def distance(more: str) -> str:
    return f"""<PrivateAction><LongitudinalAction><LongitudinalDistanceAction entityRef="Ego" freespace="true" {more}
    displacement="leadingReferencedEntity"/></LongitudinalAction></PrivateAction>"""


def gap(moment: Moment) -> float:
    """Between the ego's front and the other's back [m]."""
    return moment.actors["Other"].x - 2.25 - (moment.ego + FRONT)


#: from the ego's rear axle to its front bumper [m], of the ford_fusion
FRONT = 3.85


def test_a_distance_is_taken_up_at_once_and_kept(tmp_path: Path) -> None:
    found = imported(tmp_path, scenario(event("e", distance('continuous="true" distance="30"'), after("1"))))
    moments = played(found, 5.0)
    gaps = [gap(m) for m in moments if m.time > 1.1]
    assert max(gaps) - min(gaps) == pytest.approx(0.0, abs=1e-6)
    assert gaps[0] == pytest.approx(30.0, abs=CLOSE)


def test_a_distance_taken_up_once_is_not_kept(tmp_path: Path) -> None:
    found = imported(tmp_path, scenario(event("e", distance('continuous="false" distance="30"'), after("1"))))
    moments = played(found, 5.0)
    began = next(m for m in moments if m.time > 1.03)
    assert gap(began) == pytest.approx(30.0, abs=0.5)
    assert gap(moments[-1]) - gap(began) == pytest.approx(-10.0 * (moments[-1].time - began.time), abs=CLOSE)


SYNCHRONIZE = f"""<PrivateAction><SynchronizeAction masterEntityRef="Ego">
<TargetPositionMaster><LanePosition roadId="0" laneId="-1" s="220"/></TargetPositionMaster>
<TargetPosition><LanePosition roadId="0" laneId="-1" s="230"/></TargetPosition>
<FinalSpeed><AbsoluteSpeed value="15"/></FinalSpeed></SynchronizeAction></PrivateAction>{at("-1", "0")[:0]}"""


def test_a_meeting_is_at_the_place_at_the_time_with_the_speed(tmp_path: Path) -> None:
    moments = played(imported(tmp_path, scenario(event("e", SYNCHRONIZE, after("0")))), 10.2)
    x, _y, speed = other(moments, 10.0)  # the ego is at s 220 after 10 s
    assert x == pytest.approx(230.0, abs=CLOSE)
    assert speed == pytest.approx(15.0, abs=0.1)
    # With a steady master the way is a cubic of time: at half of the time s0 + (v0 + ...) by Hermite's formula.
    half = 100.0 * 0.5 + 230.0 * 0.5 + 10.0 * (10.0 - 15.0) / 8.0
    assert other(moments, 5.0)[0] == pytest.approx(half, abs=CLOSE)


def follow(shape: str, timing: str = "<None/>") -> str:
    return f"""<PrivateAction><RoutingAction><FollowTrajectoryAction><TrajectoryRef>
    <Trajectory name="t" closed="false"><Shape>{shape}</Shape></Trajectory></TrajectoryRef>
    <TimeReference>{timing}</TimeReference><TrajectoryFollowingMode followingMode="position"/>
    </FollowTrajectoryAction></RoutingAction></PrivateAction>"""


def vertices(*places: tuple[float, float, float]) -> str:
    rows = "".join(
        f'<Vertex time="{t}"><Position><WorldPosition x="{x}" y="{y}"/></Position></Vertex>' for t, x, y in places
    )
    return f"<Polyline>{rows}</Polyline>"


def test_a_polyline_with_times_is_kept_to_the_time(tmp_path: Path) -> None:
    timing = '<Timing domainAbsoluteRelative="relative" scale="1" offset="0"/>'
    shape = vertices((0, 120, -2), (2, 140, -2), (6, 150, -2))
    moments = played(imported(tmp_path, scenario(event("e", follow(shape, timing), after("1")))), 8.0)
    for since, x in ((1.0, 130.0), (2.0, 140.0), (4.0, 145.0)):
        assert other(moments, 1.0 + PERIOD + since)[0] == pytest.approx(x, abs=CLOSE)


def test_a_clothoid_spline_begins_where_the_entity_is(tmp_path: Path) -> None:
    shape = """<ClothoidSpline><ClothoidSplineSegment curvatureStart="0.02" curvatureEnd="0.02" length="30"/>
    <ClothoidSplineSegment curvatureStart="0" curvatureEnd="0" length="30"/></ClothoidSpline>"""
    moments = played(imported(tmp_path, scenario(event("e", follow(shape), after("1")))), 5.0)
    x0, y0, _ = other(moments, 1.0 + PERIOD)
    x, y, _ = other(moments, 3.0 + PERIOD)  # 20 m along a circle of 50 m
    assert x - x0 == pytest.approx(50.0 * math.sin(0.4), abs=CLOSE)
    assert y - y0 == pytest.approx(50.0 * (1.0 - math.cos(0.4)), abs=CLOSE)


def test_nurbs_are_the_circle_that_they_describe(tmp_path: Path) -> None:
    root = math.sqrt(0.5)
    places = ((200, -2, 1.0), (240, -2, root), (240, 38, 1.0))  # a quarter of a circle about (200, 38)
    points = "".join(
        f'<ControlPoint weight="{w}"><Position><WorldPosition x="{x}" y="{y}"/></Position></ControlPoint>'
        for x, y, w in places
    )
    knots = "".join(f'<Knot value="{value}"/>' for value in (0, 0, 0, 1, 1, 1))
    found = imported(tmp_path, scenario(event("e", follow(f'<Nurbs order="3">{points}{knots}</Nurbs>'), after("1"))))
    line = next(points for name, points in found.lines.items() if "trajectory" in name)
    quarter = [(x, y) for x, y in line if y < 37.0]
    assert all(math.dist(one, (200.0, 38.0)) == pytest.approx(40.0, abs=1e-6) for one in quarter)


def test_parameters_whose_values_stand_in_the_scenario_are_its_parameters(tmp_path: Path) -> None:
    from vve_sumo.bridges.openscenario.importer import read_scenario
    from vve_sumo.bridges.openscenario.sweepable import parameters_of

    declared = '<ParameterDeclaration name="Fast" parameterType="double" value="72"/>'
    declared += '<ParameterDeclaration name="When" parameterType="double" value="2"/>'
    text = scenario(event("e", speed_action("step", "time", "0", "${$Fast/3.6}"), after("$When")), parameters=declared)
    found = imported(tmp_path, text)
    file = tmp_path / "made.xosc"
    parameters = parameters_of(found, lambda given: read_scenario(file, "made", given=given))
    assert parameters["when"]["sets"] == ["actors.Other.story.actions.e.when.0.0.time_s"]
    assert "fast" not in parameters  # in km/h there, in m/s here
    assert found.table["actors"][0]["story"]["actions"][0]["speed"]["to_mps"] == pytest.approx(20.0)
