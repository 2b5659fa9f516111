"""Acts that are stopped, events that repeat, states of elements: what happens when, against the file's own numbers."""

from __future__ import annotations

import math
from itertools import pairwise
from pathlib import Path

import pytest

from tests.bridges.openscenario.stage import (
    Moment,
    after,
    element_state,
    event,
    first_at,
    imported,
    of_entity,
    played,
    scenario,
    speed_action,
    step,
    write,
)
from vve_sumo.bridges.openscenario.importer import read_scenario
from vve_sumo.errors import ConfigError
from vve_sumo.timing import PERIOD


def group(condition: str, edge: str = "none", delay: str = "0") -> str:
    return f"""<ConditionGroup><Condition name="c" delay="{delay}" conditionEdge="{edge}">{condition}</Condition>
    </ConditionGroup>"""


def stopped(text: str, trigger: str) -> str:
    """The scenario with an act that a trigger stops."""
    return text.replace("<StartTrigger/></Act>", f"<StartTrigger/><StopTrigger>{trigger}</StopTrigger></Act>")


def speeds(moments: list[Moment], *times: float) -> list[float]:
    return [moments[round(time / PERIOD)].actors["Other"].speed for time in times]


def problems(folder: Path, text: str) -> list[str]:
    return read_scenario(write(folder, text), "made").problems


FASTER = speed_action("linear", "rate", "2", "20")
LONG = group(after("30"))


def test_an_act_that_is_stopped_ends_what_runs_and_begins_nothing_more(tmp_path: Path) -> None:
    events = event("faster", FASTER, after("2")) + event("slow", step("3"), after("5"))
    found = imported(tmp_path, stopped(scenario(events, stop=LONG), group(after("4"))))
    # 2 m/s2 from 2 s to 4 s, then nothing: the speed stays.
    assert speeds(played(found, 7.0), 3.0, 4.5, 7.0) == pytest.approx([12.0, 14.0, 14.0], abs=0.1)


def test_a_drive_is_over_when_its_only_act_is_stopped(tmp_path: Path) -> None:
    events = event("faster", speed_action("linear", "time", "2", "20"), after("1"))
    text = stopped(scenario(events), group(element_state("event", "faster", "endTransition"), "rising", "1.5"))
    moments = played(imported(tmp_path, text), 6.0)
    assert next(m.time for m in moments if m.ended) == pytest.approx(1.0 + 2.0 + 1.5, abs=4 * PERIOD)


def test_what_waits_for_an_act_begins_when_that_is_stopped(tmp_path: Path) -> None:
    text = stopped(scenario(event("faster", FASTER, after("20")), stop=LONG), group(after("3")))
    late = event("late", step("5"), element_state("act", "a", "completeState"), delay="1")
    act = f"""<Act name="b"><ManeuverGroup name="h" maximumExecutionCount="1"><Actors selectTriggeringEntities="false">
    <EntityRef entityRef="Other"/></Actors><Maneuver name="n">{late}</Maneuver></ManeuverGroup><StartTrigger/></Act>"""
    moments = played(imported(tmp_path, text.replace("</Act></Story>", f"</Act>{act}</Story>")), 6.0)
    assert first_at(moments, 5.0) == pytest.approx(3.0 + 1.0, abs=4 * PERIOD)


RELATIVE = """<PrivateAction><LongitudinalAction><SpeedAction><SpeedActionDynamics dynamicsShape="step"/>
<SpeedActionTarget><RelativeTargetSpeed entityRef="Other" value="1" speedTargetValueType="delta" continuous="false"/>
</SpeedActionTarget></SpeedAction></LongitudinalAction></PrivateAction>"""


@pytest.mark.parametrize("times", [1, 3])
def test_an_event_is_done_as_often_as_it_may(tmp_path: Path, times: int) -> None:
    text = scenario(event("e", RELATIVE, after("1"), more=f'maximumExecutionCount="{times}"'))
    assert speeds(played(imported(tmp_path, text), 4.0), 0.9, 4.0) == pytest.approx([10.0, 10.0 + times])


@pytest.mark.parametrize("times", [1, 4])
def test_a_group_of_one_event_is_done_as_often_as_it_may(tmp_path: Path, times: int) -> None:
    text = scenario(event("e", RELATIVE, after("1")))
    text = text.replace('name="g" maximumExecutionCount="1"', f'name="g" maximumExecutionCount="{times}"')
    assert speeds(played(imported(tmp_path, text), 4.0), 0.9, 4.0) == pytest.approx([10.0, 10.0 + times])


@pytest.mark.parametrize("more", [event("f", step("3"), after("9")), "delay"])
def test_a_group_that_repeats_more_than_one_event_is_refused(tmp_path: Path, more: str) -> None:
    events = event("e", RELATIVE, after("1"), delay="1") if more == "delay" else event("e", RELATIVE, after("1")) + more
    text = scenario(events).replace('name="g" maximumExecutionCount="1"', 'name="g" maximumExecutionCount="2"')
    assert "<ManeuverGroup>: a group that repeats is taken with one event alone" in problems(tmp_path, text)[0]


def test_events_that_repeat_take_turns(tmp_path: Path) -> None:
    def near(rule: str) -> str:
        return of_entity(f"""<RelativeDistanceCondition entityRef="Other" relativeDistanceType="longitudinal"
        value="30" freespace="false" rule="{rule}"/>""")

    often = {"edge": "rising", "more": 'maximumExecutionCount="9"'}
    events = event("go", speed_action("linear", "rate", "20", "40"), near("lessThan"), **often)
    events += event("stop", speed_action("linear", "rate", "20", "0"), near("greaterThan"), **often)
    text = scenario(events.replace('"parallel"', '"override"'), speed="0")
    moments = played(imported(tmp_path, text), 10.0)
    # The ego closes in by 20 m/s on who stands 80 m ahead. By 20 m/s2 the gap opens to 30 m again after 2 s, at
    # 40 m/s; down to rest it is there after 2 s more.
    rates = [other.actors["Other"].speed - one.actors["Other"].speed for one, other in pairwise(moments)]
    turns = [moments[n + 1].time for n, (one, other) in enumerate(pairwise(rates)) if other and one * other <= 0.0]
    # Each edge is seen a tick late, and the next trigger counts from there.
    assert turns[:4] == pytest.approx([2.5, 4.5, 6.5, 8.5], abs=8 * PERIOD)


def test_an_event_of_two_actions_that_repeats_is_refused(tmp_path: Path) -> None:
    twice = event("e", RELATIVE, after("1"), more='maximumExecutionCount="2"')
    twice = twice.replace("</Action>", f'</Action><Action name="f">{step("3")}</Action>')
    assert "<Event>: an event of several actions that repeats" in problems(tmp_path, scenario(twice))[0]


def test_what_waits_until_a_repeating_event_is_complete_is_refused(tmp_path: Path) -> None:
    events = event("e", RELATIVE, after("1"), more='maximumExecutionCount="2"')
    events += event("f", step("3"), element_state("event", "e", "completeState"))
    assert "repeats: nobody knows when that is over" in problems(tmp_path, scenario(events))[0]


@pytest.mark.parametrize(
    ("condition", "expected"),
    [
        ('<ParameterCondition parameterRef="p" rule="equalTo" value="1"/>', 2.0),
        (
            '<StoryboardElementStateCondition storyboardElementType="act" storyboardElementRef="a" '
            'state="startTransition"/>',
            2.0,
        ),
    ],
)
def test_what_holds_from_the_start_waits_for_its_delay(tmp_path: Path, condition: str, expected: float) -> None:
    declared = '<ParameterDeclaration name="p" parameterType="int" value="1"/>'
    late = event("e", step("7"), f"<ByValueCondition>{condition}</ByValueCondition>", delay="2")
    moments = played(imported(tmp_path, scenario(late, parameters=declared)), 4.0)
    assert first_at(moments, 7.0) == pytest.approx(expected, abs=2 * PERIOD)


def test_the_state_of_an_action_is_known_by_its_name(tmp_path: Path) -> None:
    change = event("one", speed_action("linear", "time", "2", "12"), after("1"))
    moments = played(
        imported(tmp_path, scenario(change + event("two", step("7"), element_state("action", "one", "endTransition")))),
        5.0,
    )
    assert first_at(moments, 7.0) == pytest.approx(3.0, abs=4 * PERIOD)


def test_of_two_elements_with_one_name_that_of_the_same_manoeuvre_is_meant(tmp_path: Path) -> None:
    def manoeuvre(began: str, speed: str) -> str:
        change = event("one", speed_action("linear", "time", "1", speed), after(began))
        return change + event(f"two{speed}", step("7"), element_state("event", "one", "endTransition"))

    text = scenario(f'{manoeuvre("1", "12")}</Maneuver><Maneuver name="n">{manoeuvre("4", "15")}')
    moments = played(imported(tmp_path, text), 6.0)
    assert speeds(moments, 2.5, 3.9, 4.9, 5.5) == pytest.approx([7.0, 7.0, 14.2, 7.0], abs=0.3)


def test_a_meeting_may_have_a_speed_that_counts_from_the_egos(tmp_path: Path) -> None:
    def place(s: str) -> str:
        return f'<LanePosition roadId="0" laneId="-1" s="{s}"/>'

    meet = f"""<PrivateAction><SynchronizeAction masterEntityRef="Ego">
    <TargetPositionMaster>{place("220")}</TargetPositionMaster><TargetPosition>{place("230")}</TargetPosition>
    <FinalSpeed><RelativeSpeedToMaster value="-5" speedTargetValueType="delta"/></FinalSpeed></SynchronizeAction>
    </PrivateAction>"""
    moments = played(imported(tmp_path, scenario(event("e", meet, after("0")))), 11.0)
    at = moments[round(10.0 / PERIOD)].actors["Other"]
    assert at.x - 1.5 == pytest.approx(230.0, abs=0.2)
    assert speeds(moments, 11.0) == pytest.approx([20.0 - 5.0])


def test_a_name_that_two_elements_have_says_nothing(tmp_path: Path) -> None:
    events = event("one", FASTER, after("1")) + event("one", step("5"), after("2"))
    events += event("two", step("7"), element_state("event", "one", "endTransition"))
    assert "several elements event 'one'" in problems(tmp_path, scenario(events))[0]


LIGHTS = """<PrivateAction><AppearanceAction><LightStateAction><LightType>
<VehicleLight vehicleLightType="lowBeam"/></LightType><LightState mode="on"/></LightStateAction></AppearanceAction>
</PrivateAction>"""
ANGLE = of_entity('<AngleCondition angleTolerance="0.1" angleType="heading" angle="1.5"/>')


def test_an_act_of_lights_alone_changes_nothing(tmp_path: Path) -> None:
    text = stopped(scenario(event("lights", LIGHTS, ANGLE), stop=LONG), group(ANGLE))
    text = text.replace('<EntityRef entityRef="Other"/></Actors>', '<EntityRef entityRef="Ego"/></Actors>')
    assert imported(tmp_path, text).table["actors"][0]["story"]["actions"] == []


def teleport(position: str) -> str:
    return f"<PrivateAction><TeleportAction><Position>{position}</Position></TeleportAction></PrivateAction>"


def test_a_place_that_counts_from_who_moves_is_refused_in_a_story(tmp_path: Path) -> None:
    beside = '<RelativeObjectPosition entityRef="Ego" dx="30" dy="0"/>'
    said = problems(tmp_path, scenario(event("e", teleport(beside), after("1"))))
    assert "<RelativeObjectPosition>: a place that counts from where 'Ego' is by then" in said[0]


def test_who_lies_down_stays_where_it_is(tmp_path: Path) -> None:
    down = """<RelativeObjectPosition entityRef="Other" dx="0.0" dy="0.0" dz="0.1">
    <Orientation type="relative" r="1.57"/></RelativeObjectPosition>"""
    moments = played(imported(tmp_path, scenario(event("e", teleport(down), after("1")))), 2.0)
    assert moments[-1].actors["Other"].x - moments[0].actors["Other"].x == pytest.approx(20.0, abs=1e-6)


def test_who_never_moves_faces_as_the_file_says(tmp_path: Path) -> None:
    text = scenario("", speed="0").replace(
        '<LanePosition roadId="0" laneId="-1" s="100"></LanePosition>',
        '<LanePosition roadId="0" laneId="-1" s="100"><Orientation type="relative" h="0.3"/></LanePosition>',
    )
    other = played(imported(tmp_path, text), 0.0)[0].actors["Other"]
    assert other.heading == pytest.approx(0.3, abs=1e-6)
    assert (other.x, other.y) == pytest.approx((100.0 + 1.5 * math.cos(0.3), -1.75 + 1.5 * math.sin(0.3)), abs=1e-3)


OFFSET = """<PrivateAction><LateralAction><LaneOffsetAction continuous="true">
<LaneOffsetActionDynamics dynamicsShape="sinusoidal" maxLateralAcc="2"/><LaneOffsetTarget>
<RelativeTargetLaneOffset entityRef="Ego" value="{0}"/></LaneOffsetTarget></LaneOffsetAction></LateralAction>
</PrivateAction>"""


def test_an_offset_counts_from_that_of_the_ego(tmp_path: Path) -> None:
    text = scenario(event("e", OFFSET.format("0.5"), after("1")))
    text = text.replace('laneId="-1" s="20"', 'laneId="-1" s="20" offset="0.3"')
    assert played(imported(tmp_path, text), 6.0)[-1].actors["Other"].y == pytest.approx(-1.75 + 0.3 + 0.5, abs=1e-3)


def test_an_offset_at_the_start_lasts_until_the_action_changes_it(tmp_path: Path) -> None:
    text = scenario(event("e", OFFSET.format("0"), after("1"))).replace(
        'laneId="-1" s="100"', 'laneId="-1" s="100" offset="3.5"'
    )
    moments = played(imported(tmp_path, text), 6.0)
    # Over the time T the sinusoidal shape has the greatest lateral acceleration pi^2 / 2 of the change over T^2.
    over = math.sqrt(0.5 * math.pi**2 * 3.5 / 2.0)
    states = [moments[round(time / PERIOD)].actors["Other"] for time in (0.5, 1.0 + 0.5 * over, 1.1 + over)]
    assert [state.y - 1.5 * math.sin(state.heading) for state in states] == pytest.approx([1.75, 0.0, -1.75], abs=0.1)


def distance(more: str, limits: str = "") -> str:
    return f"""<PrivateAction><LongitudinalAction><LongitudinalDistanceAction entityRef="Ego" freespace="false"
    continuous="true" distance="30" displacement="any" {more}>{limits}</LongitudinalDistanceAction></LongitudinalAction>
    </PrivateAction>"""


@pytest.mark.parametrize(("s", "ahead"), [("100", 30.0), ("5", -30.0)])
def test_a_distance_on_either_side_is_kept_on_that_where_it_is(tmp_path: Path, s: str, ahead: float) -> None:
    moments = played(imported(tmp_path, scenario(event("e", distance(""), after("0.5")), s=s, speed="20")), 3.0)
    assert moments[-1].actors["Other"].x - 1.5 - moments[-1].ego == pytest.approx(ahead, abs=0.1)


def test_a_limit_of_the_jerk_is_refused(tmp_path: Path) -> None:
    limits = '<DynamicConstraints maxAcceleration="3" maxDeceleration="3" maxAccelerationRate="1"/>'
    said = problems(tmp_path, scenario(event("e", distance("", limits), after("1"))))
    assert "<DynamicConstraints>: maxAccelerationRate is not taken" in said[0]


def test_an_ego_that_drives_backwards_is_refused(tmp_path: Path) -> None:
    text = scenario("").replace('<AbsoluteTargetSpeed value="20"/>', '<AbsoluteTargetSpeed value="-1.1"/>')
    with pytest.raises(ConfigError, match=r"<AbsoluteTargetSpeed>: value: expected 0 to 100 m/s, got -1.1"):
        read_scenario(write(tmp_path, text), "made")
