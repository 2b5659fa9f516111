"""Lane changes and offsets of the ego as part of its path, against the standard's shapes in closed form.

The ego begins at x 20 with 20 m/s in the lane whose middle is at y -1.75.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from pathlib import Path

import pyarrow.parquet as pq
import pytest

from tests.bridges.openscenario.stage import (
    LANE,
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
    step,
    write,
)
from tests.bridges.openscenario.test_import import damaged
from tests.isolated import command
from vve_sumo.bridges.openscenario.importer import Imported, read_scenario
from vve_sumo.bridges.openscenario.sweepable import parameters_of
from vve_sumo.errors import ConfigError
from vve_sumo.path import ReferencePath
from vve_sumo.timing import PERIOD

CLOSE = 0.2
START, SPEED, MIDDLE = 20.0, 20.0, -0.5 * LANE


def group(events: str, name: str = "Ego", stop: str = "") -> str:
    """A manoeuvre group of an entity, in an act of its own that may have a stop trigger."""
    trigger = f"<StopTrigger>{stop}</StopTrigger>" if stop else ""
    return f"""<Act name="a{name}{len(events)}"><ManeuverGroup name="g" maximumExecutionCount="1">
    <Actors selectTriggeringEntities="false"><EntityRef entityRef="{name}"/></Actors>
    <Maneuver name="m{name}">{events}</Maneuver></ManeuverGroup><StartTrigger/>{trigger}</Act>"""


def of_ego(events: str, others: str = "", stop: str = "", **more: str) -> str:
    """A scenario in which the ego has events; those of the other entity come first in the file."""
    return scenario(others, **more).replace("</Act></Story>", f"</Act>{group(events, stop=stop)}</Story>")


def path_of(found: Imported) -> ReferencePath:
    return ReferencePath.from_points(*zip(*found.lines[found.table["ego"]["path"]], strict=True))


def y_at(path: ReferencePath, x: float) -> float:
    """y [m] of a path that goes along +x, where it is at x [m]."""
    s = x
    for _ in range(20):
        s += x - path.at(s).x
    return path.at(s).y


def assert_goes_over(path: ReferencePath, begin: float, way: float, shape: str, size: float) -> None:
    """Assert that a path goes sidewards by a shape from x `begin` [m] on along a way [m]."""
    for part in (-0.3, 0.0, 0.2, 0.4, 0.5, 0.7, 0.9, 1.0, 1.4):
        x = begin + part * way
        assert y_at(path, x) == pytest.approx(MIDDLE + size * shape_share(shape, part), abs=CLOSE)


@pytest.mark.parametrize("shape", ["linear", "cubic", "sinusoidal"])
def test_a_lane_change_at_a_time_is_where_the_ego_is_then(tmp_path: Path, shape: str) -> None:
    found = imported(tmp_path, of_ego(event("e", lane_change(shape, "time", "3", "1"), after("2"))))
    assert_goes_over(path_of(found), START + SPEED * 2.0, SPEED * 3.0, shape, LANE)
    assert any("'e': the ego's path follows its LaneChangeAction, 40." in note for note in found.notes)


def test_the_ego_is_in_time_where_the_file_has_it(tmp_path: Path) -> None:
    found = imported(tmp_path, of_ego(event("e", lane_change("sinusoidal", "time", "4", "1"), after("2"))))
    path, begin = path_of(found), found.table["ego"]["initial_s_m"]
    for time in (1.0, 3.0, 4.0, 5.0, 7.0):
        here = path.at(begin + SPEED * time)
        wanted = MIDDLE + LANE * shape_share("sinusoidal", (time - 2.0) / 4.0)
        assert (here.x, here.y) == pytest.approx((START + SPEED * time, wanted), abs=CLOSE)


def test_a_rate_is_the_greatest_speed_sidewards(tmp_path: Path) -> None:
    found = imported(tmp_path, of_ego(event("e", lane_change("cubic", "rate", "1.5", "1"), after("2"))))
    assert_goes_over(path_of(found), START + SPEED * 2.0, SPEED * 1.5 * LANE / 1.5, "cubic", LANE)


TRIGGERS = {
    "way": (of_entity('<TraveledDistanceCondition value="50"/>'), START + 50.0),
    "place": (of_entity(f'<ReachPositionCondition tolerance="2">{at("-1", "90")}</ReachPositionCondition>'), 88.0),
    "who stands": (of_entity('<RelativeDistanceCondition entityRef="Other" relativeDistanceType="longitudinal" '
                   'coordinateSystem="road" freespace="false" rule="lessThan" value="70"/>'), 150.0 - 70.0),
    "its bumper": (of_entity('<RelativeDistanceCondition entityRef="Other" relativeDistanceType="longitudinal" '
                   'coordinateSystem="entity" freespace="true" rule="lessThan" value="60"/>'),
                   # Both cars reach 3.75 m forward and 0.75 m back of their rear axles.
                   150.0 - 0.75 - 60.0 - 3.75),
}  # fmt: skip


@pytest.mark.parametrize("name", TRIGGERS)
@pytest.mark.parametrize("speed", ["20", "0"])
def test_a_lane_change_over_a_distance_begins_at_a_place_whatever_the_speed(
    tmp_path: Path, name: str, speed: str
) -> None:
    condition, begin = TRIGGERS[name]
    text = of_ego(event("e", lane_change("sinusoidal", "distance", "60", "1"), condition), s="150", speed="0")
    text = text.replace('<AbsoluteTargetSpeed value="20"/>', f'<AbsoluteTargetSpeed value="{speed}"/>', 1)
    text = text.replace("</Act></Story>", f"</Act>{group(event('v', step('8'), after('0.1')))}</Story>")
    found = imported(tmp_path, text)
    path = path_of(found)
    if speed == "0":  # the path begins where the ego stands
        assert path.at(0.0).x == pytest.approx(START, abs=1e-3)
        assert y_at(path, 0.0) == pytest.approx(MIDDLE, abs=1e-3)
    assert_goes_over(path, begin, 60.0, "sinusoidal", LANE)


def offset(value: str, acceleration: str = 'maxLateralAcc="2"', more: str = "") -> str:
    return f"""<PrivateAction><LateralAction><LaneOffsetAction {more}>
    <LaneOffsetActionDynamics dynamicsShape="sinusoidal" {acceleration}/><LaneOffsetTarget>
    <AbsoluteTargetLaneOffset value="{value}"/></LaneOffsetTarget></LaneOffsetAction></LateralAction></PrivateAction>"""


def test_an_offset_has_the_greatest_lateral_acceleration_that_is_stated(tmp_path: Path) -> None:
    found = imported(tmp_path, of_ego(event("e", offset("-0.9"), after("1"))))
    over = math.sqrt(0.5 * math.pi**2 * 0.9 / 2.0)
    path = path_of(found)
    assert_goes_over(path, START + SPEED, SPEED * over, "sinusoidal", -0.9)
    # v^2 times the curvature is the lateral acceleration; by this shape it falls as a cosine.
    for part in (0.2, 0.35, 0.65):
        lateral = SPEED**2 * path.at(START + SPEED * (1.0 + part * over)).curvature
        assert lateral == pytest.approx(-2.0 * math.cos(math.pi * part), abs=0.1)


def test_in_a_bend_the_change_is_across_the_lanes(tmp_path: Path) -> None:
    change = lane_change("sinusoidal", "distance", "60", "1")
    file = write(tmp_path, of_ego(event("e", change, of_entity('<TraveledDistanceCondition value="50"/>'))))
    road = tmp_path / "road.xodr"
    text = road.read_text(encoding="utf-8").replace("<line/>", '<arc curvature="0.005"/>')
    road.write_text(text, encoding="utf-8")
    found = read_scenario(file, "made")
    assert not found.problems
    path, begin = path_of(found), found.table["ego"]["initial_s_m"]
    for part in (-0.5, 0.1, 0.3, 0.5, 0.8, 1.0, 1.5):
        here = path.at(begin + 50.0 + 60.0 * part)
        # The road is a circle of 200 m about (0, 200); the left is its inside.
        left = 200.0 - math.dist((here.x, here.y), (0.0, 200.0))
        assert left == pytest.approx(MIDDLE + LANE * shape_share("sinusoidal", part), abs=CLOSE)


def ended(name: str, state: str = "endTransition") -> str:
    return f"""<ByValueCondition><StoryboardElementStateCondition storyboardElementType="event"
    storyboardElementRef="{name}" state="{state}"/></ByValueCondition>"""


def test_one_change_follows_on_another_and_others_wait_for_both(tmp_path: Path) -> None:
    events = event("out", lane_change("sinusoidal", "time", "3", "1"), after("1"))
    events += event("back", lane_change("cubic", "time", "2", "-1"), ended("out"), delay="1.5")
    others = event("then", step("3"), ended("back", "completeState"))
    others += event("first", step("7"), ended("out", "startTransition"))
    found = imported(tmp_path, of_ego(events, others))
    path = path_of(found)
    for time, y in ((1.0, MIDDLE), (4.0, -MIDDLE), (5.5, -MIDDLE), (6.5, 0.0), (7.5, MIDDLE)):
        assert y_at(path, START + SPEED * time) == pytest.approx(y, abs=CLOSE)
    moments = played(found, 9.0)
    changes = [(m.time, m.actors["Other"].speed) for m in moments if m.actors["Other"].speed != 10.0]
    assert changes[0] == pytest.approx((1.0, 7.0), abs=3 * PERIOD)
    assert next(time for time, speed in changes if speed == 3.0) == pytest.approx(7.5, abs=4 * PERIOD)


def test_a_place_beside_the_new_lane_counts_along_the_new_path(tmp_path: Path) -> None:
    change = event("e", lane_change("sinusoidal", "distance", "40", "1"), after("1"))
    near = of_entity(f'<ReachPositionCondition tolerance="2">{at("1", "200")}</ReachPositionCondition>')
    moments = played(imported(tmp_path, of_ego(change, event("n", step("3"), near))), 10.0)
    fired = next(m for m in moments if m.actors["Other"].speed == 3.0)
    assert fired.ego == pytest.approx(198.0, abs=CLOSE + SPEED * PERIOD)


def test_a_change_at_the_start_begins_there(tmp_path: Path) -> None:
    text = scenario("").replace("</Private>", f"{lane_change('cubic', 'distance', '50', '1')}</Private>", 1)
    assert_goes_over(path_of(imported(tmp_path, text)), START, 50.0, "cubic", LANE)


def test_places_count_from_the_ego_that_begins_beside_its_lane(tmp_path: Path) -> None:
    near = of_entity(f'<ReachPositionCondition tolerance="1.6">{at("-1", "60")}</ReachPositionCondition>')
    text = scenario(event("n", step("3"), near)).replace('laneId="-1" s="20"', 'laneId="-1" s="20" offset="1.5"')
    text = text.replace('<AbsoluteTargetSpeed value="20"/>', '<AbsoluteTargetSpeed value="5"/>', 1)
    fired = next(m for m in played(imported(tmp_path, text), 12.0) if m.actors["Other"].speed == 3.0)
    assert fired.ego == pytest.approx(60.0 - math.sqrt(1.6**2 - 1.5**2), abs=CLOSE)


@pytest.mark.thorough
def test_a_drive_follows_the_lane_change(tmp_path: Path) -> None:
    pytest.importorskip("sumo", reason="eclipse-sumo (netconvert) is not installed")
    text = of_ego(event("e", lane_change("sinusoidal", "time", "4", "1"), after("2")), s="400")
    ends = f"<ConditionGroup><Condition name='c'>{after('8')}</Condition></ConditionGroup></StopTrigger></Storyboard>"
    write(tmp_path, text.replace("</StopTrigger></Storyboard>", ends))
    for words in (("scenarios", "import", "made.xosc"), ("drive", "made", "--out", "record")):
        done = command(*words, cwd=tmp_path)
        assert done.returncode == 0, done.stderr
    ticks = pq.read_table(tmp_path / "record" / "ticks.parquet").to_pandas()
    since = (ticks.true_x_m - START - SPEED * 2.0) / (SPEED * 4.0)
    wanted = [MIDDLE + LANE * shape_share("sinusoidal", part) for part in since]
    assert abs(ticks.true_y_m - wanted).max() < CLOSE


@pytest.mark.parametrize("value", ["2", "0.05"])
def test_what_says_where_the_path_changes_is_no_parameter_of_the_scenario(tmp_path: Path, value: str) -> None:
    declared = f'<ParameterDeclaration name="When" parameterType="double" value="{value}"/>'
    events = event("e", lane_change("cubic", "distance", "60", "1"), after("$When"))
    text = of_ego(events, event("o", step("7"), after("$When")), parameters=declared)
    for words, parameters in ((text, set()), (text.replace(group(events), ""), {"when"})):
        file = write(tmp_path, words)
        found = read_scenario(file, "made")

        def again(given: Mapping[str, str], file: Path = file) -> Imported:
            return read_scenario(file, "made", given=given)

        assert parameters_of(found, again).keys() == parameters


CHANGE = lane_change("sinusoidal", "time", "3", "1")
NEAR = of_entity('<TimeHeadwayCondition entityRef="Other" value="1" freespace="true" rule="lessThan"/>')
HEADWAY = event("e", CHANGE, NEAR)
LONG = event("e", CHANGE, after("2"))


@pytest.mark.parametrize(
    ("text", "why"),
    [
        (of_ego(HEADWAY), "<LaneChangeAction>: the ego's path is fixed: where this begins depends on who moves"),
        (of_ego(event("v", step("9"), after("1")) + LONG), "nobody knows where the ego is when this begins"),
        (of_ego(event("e", lane_change("step", "time", "0", "1"), after("2"))), "the ego cannot jump sidewards"),
        (of_ego(event("e", CHANGE, after("90"))), "it begins nowhere on the ego's path"),
        (of_ego(event("e", CHANGE, after("2"), more='maximumExecutionCount="2"')), "that repeats is not taken"),
        (of_ego(LONG + event("f", offset("1"), after("3"))), "begins before the one before it is over"),
        (of_ego(LONG + event("f", offset("0"), after("3")).replace("parallel", "override")), "'f' ends the ego's"),
        (
            of_ego(LONG, stop=f"<ConditionGroup><Condition name='c'>{after('4')}</Condition></ConditionGroup>"),
            "its act is stopped before the ego's change is over",
        ),
        (
            of_ego(LONG, event("o", lane_change("cubic", "time", "2", "0").replace(
                '<AbsoluteTargetLane value="0"/>', '<RelativeTargetLane entityRef="Ego" value="0"/>'), after("1"))),
            "<RelativeTargetLane>: what counts from 'Ego', which changes lane or offset itself",
        ),
        (
            of_ego(LONG, event("o", step("9"), of_entity('<RelativeDistanceCondition entityRef="Other" value="1" '
                'relativeDistanceType="lateral" coordinateSystem="lane" freespace="true" rule="lessThan"/>'))),
            "<RelativeDistanceCondition>: a distance across lanes beside an ego that changes",
        ),
        # The event that is waited for comes later in the file, and the ego's controller drives in place of it.
        (
            of_ego(event("v", speed_action("linear", "time", "2", "9"), after("1")), event("o", step("9"), ended("v"))),
            "'v': the ego's controller decides when it is over",
        ),
        (
            of_ego("<Event name='u' priority='parallel'><Action name='u'><UserDefinedAction/></Action></Event>"),
            "<UserDefinedAction>: this action is not taken",
        ),
    ],
)  # fmt: skip
def test_what_cannot_be_in_a_path_is_refused_with_its_reason(tmp_path: Path, text: str, why: str) -> None:
    problems = read_scenario(write(tmp_path, text), "made").problems
    assert any(why in problem for problem in problems), problems
    assert all("made.xosc:" in problem for problem in problems)


@pytest.mark.parametrize("every", [29, pytest.param(5, marks=pytest.mark.thorough)])
def test_a_change_of_the_ego_that_is_damaged_is_taken_or_refused_in_one_line(every: int, tmp_path: Path) -> None:
    condition, _ = TRIGGERS["place"]
    events = event("e", lane_change("sinusoidal", "distance", "60", "1"), condition)
    events += event("f", offset("0.4"), ended("e"), delay="1")
    file = write(tmp_path, of_ego(events))
    assert not read_scenario(file, "made").problems
    for changed in itertools.islice(damaged(file.read_text(encoding="utf-8")), None, None, every):
        file.write_text(changed, encoding="utf-8")
        try:
            said = read_scenario(file, "made").problems
        except ConfigError as error:
            said = [str(error)]
        assert all(line and "\n" not in line for line in said)
