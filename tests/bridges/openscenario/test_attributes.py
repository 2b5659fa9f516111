"""Attributes that change what an element means: each is heeded, or refused in the line where it stands."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from tests.bridges.openscenario.stage import (
    LANE,
    VEHICLE,
    after,
    at,
    element_state,
    event,
    first_at,
    imported,
    lane_change,
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


def said(folder: Path, text: str) -> list[str]:
    """What a text is refused for, or noted."""
    try:
        found = read_scenario(write(folder, text), "made")
    except ConfigError as error:
        return [str(error)]
    return [*found.problems, *found.notes]


def by_value(condition: str) -> str:
    return f"<ByValueCondition>{condition}</ByValueCondition>"


DECLARED = '<ParameterDeclaration name="p" parameterType="int" value="1"/>'
P = by_value('<ParameterCondition parameterRef="p" rule="equalTo" value="1"/>')
P2 = by_value('<ParameterCondition parameterRef="p" rule="equalTo" value="2"/>')
TIME = '<SimulationTimeCondition value="0" rule="{0}"/>'


@pytest.mark.parametrize(
    ("condition", "edge", "expected"),
    [
        (P, "none", 0.0),
        (P, "rising", math.inf),
        (P, "falling", math.inf),
        (by_value(TIME.format("greaterThan")), "rising", 0.0),  # it does not hold at 0 s
        (by_value(TIME.format("greaterThan")), "falling", math.inf),
        (by_value(TIME.format("greaterOrEqual")), "rising", math.inf),  # it holds when it is first looked at
        (by_value(TIME.format("greaterOrEqual")), "none", 0.0),
    ],
)
def test_what_is_so_from_the_start_on_has_no_edge(tmp_path: Path, condition: str, edge: str, expected: float) -> None:
    text = scenario(event("e", step("7"), condition, edge=edge), parameters=DECLARED)
    assert first_at(played(imported(tmp_path, text), 1.0), 7.0) == pytest.approx(expected, abs=2 * PERIOD)


def test_a_parameter_that_an_event_sets_is_compared_with_what_it_was_set_to(tmp_path: Path) -> None:
    to_two = '<GlobalAction><ParameterAction parameterRef="p"><SetAction value="2"/></ParameterAction></GlobalAction>'
    text = scenario(event("e", step("7"), P2) + event("set", to_two, after("1.5")), parameters=DECLARED)
    assert first_at(played(imported(tmp_path, text), 3.0), 7.0) == pytest.approx(1.5, abs=3 * PERIOD)


def two(condition: str, rule: str) -> str:
    return (
        of_entity(condition)
        .replace('Rule="any"', f'Rule="{rule}"')
        .replace('<EntityRef entityRef="Ego"/>', '<EntityRef entityRef="Ego"/><EntityRef entityRef="Other"/>', 1)
    )


GONE = '<TraveledDistanceCondition value="30"/>'


@pytest.mark.parametrize(("rule", "expected"), [("any", 30.0 / 20.0), ("all", 30.0 / 10.0)])
def test_any_and_all_of_the_triggering_entities(tmp_path: Path, rule: str, expected: float) -> None:
    moments = played(imported(tmp_path, scenario(event("e", step("7"), two(GONE, rule)))), 4.0)
    assert first_at(moments, 7.0) == pytest.approx(expected, abs=2 * PERIOD)


def test_a_contact_with_any_vehicle_is_one(tmp_path: Path) -> None:
    touched = of_entity('<CollisionCondition><ByType type="vehicle"/></CollisionCondition>')
    moments = played(imported(tmp_path, scenario(event("e", step("7"), touched), speed="0")), 5.0)
    # The ego's bumper is 3.85 m before its rear axle, the other's back 0.75 m behind its own at 100 m.
    assert first_at(moments, 7.0) == pytest.approx((100.0 - 0.75 - 20.0 - 3.85) / 20.0, abs=2 * PERIOD)


def test_a_speed_along_the_heading_is_the_speed(tmp_path: Path) -> None:
    fast = '<SpeedCondition direction="{0}" rule="greaterThan" value="11"/>'
    events = event("e", speed_action("linear", "rate", "1", "15"), after("1"))
    text = scenario(events + event("f", step("7"), of_entity(fast.format("longitudinal"), "Other")))
    assert first_at(played(imported(tmp_path, text), 4.0), 7.0) == pytest.approx(2.0, abs=3 * PERIOD)
    assert "<SpeedCondition>: direction: 'lateral'" in said(tmp_path, text.replace("longitudinal", "lateral"))[0]


def test_a_name_within_others_means_the_element_in_those(tmp_path: Path) -> None:
    def manoeuvre(name: str, began: str, more: str = "") -> str:
        change = event("one", speed_action("linear", "time", "1", "12"), after(began))
        return f'</Maneuver><Maneuver name="{name}">{change}{more}'

    waits = event("two", step("7"), element_state("event", "s::far::one", "endTransition"))
    text = scenario(manoeuvre("near", "1", waits) + manoeuvre("far", "4"))
    assert first_at(played(imported(tmp_path, text), 6.0), 7.0) == pytest.approx(5.0, abs=4 * PERIOD)
    assert any("no event 'one'" in one for one in said(tmp_path, text.replace("s::far::one", "s::off::one")))


def offset(more: str, dynamics: str = 'dynamicsShape="sinusoidal" maxLateralAcc="2"') -> str:
    return f"""<PrivateAction><LateralAction><LaneOffsetAction {more}><LaneOffsetActionDynamics {dynamics}/>
    <LaneOffsetTarget><AbsoluteTargetLaneOffset value="1"/></LaneOffsetTarget></LaneOffsetAction></LateralAction>
    </PrivateAction>"""


def test_an_offset_without_a_limit_is_there_at_once(tmp_path: Path) -> None:
    text = scenario(event("e", offset("", 'dynamicsShape="cubic"'), after("1")))
    moments = played(imported(tmp_path, text), 2.0)
    ys = [moments[round(time / PERIOD)].actors["Other"].y for time in (0.9, 1.1)]
    assert ys == pytest.approx([-0.5 * LANE, -0.5 * LANE + 1.0], abs=0.01)


def test_a_profile_within_its_limits_is_taken(tmp_path: Path) -> None:
    def profile(limit: str) -> str:
        return f"""<PrivateAction><LongitudinalAction><SpeedProfileAction followingMode="position">
        <DynamicConstraints maxDeceleration="{limit}" maxAcceleration="9"/><SpeedProfileEntry time="0" speed="10"/>
        <SpeedProfileEntry time="2" speed="7"/></SpeedProfileAction></LongitudinalAction></PrivateAction>"""

    text = scenario(event("e", profile("1.5"), after("1")))
    assert first_at(played(imported(tmp_path, text), 4.0), 7.0) == pytest.approx(3.0, abs=3 * PERIOD)
    assert (
        "<SpeedProfileAction>: its speeds change faster than its maxDeceleration"
        in said(tmp_path, text.replace("1.5", "1.4"))[0]
    )


INACTIVE = '<OverrideControllerValueAction><Brake active="false" value="0"/></OverrideControllerValueAction>'


def controller(name: str, value: str, *more: str) -> str:
    found = f'<Properties><Property name="c" value="{value}"/></Properties>' if value else "<Properties/>"
    assign = f'<AssignControllerAction><Controller name="{name}">{found}</Controller></AssignControllerAction>'
    return f"<PrivateAction><ControllerAction>{assign}{''.join(more)}</ControllerAction></PrivateAction>"


@pytest.mark.parametrize("given", [("Default", ""), ("c", "DefaultController")])
def test_a_controller_that_drives_as_usual_changes_nothing(tmp_path: Path, given: tuple[str, str]) -> None:
    init = controller(*given, INACTIVE)
    text = scenario(event("e", step("7"), after("1"))).replace("</Private></Actions>", f"{init}</Private></Actions>")
    assert first_at(played(imported(tmp_path, text), 2.0), 7.0) == pytest.approx(1.0, abs=2 * PERIOD)


ALLOWED = """<ParameterDeclaration name="p" parameterType="double" value="{0}">
<ConstraintGroup><ValueConstraint rule="greaterThan" value="5"/><ValueConstraint rule="lessThan" value="9"/>
</ConstraintGroup><ConstraintGroup><ValueConstraint rule="equalTo" value="20"/></ConstraintGroup>
</ParameterDeclaration>"""


@pytest.mark.parametrize(("value", "allowed"), [("7", True), ("20", True), ("5", False), ("12", False)])
def test_a_parameter_keeps_to_its_constraints(tmp_path: Path, value: str, allowed: bool) -> None:
    found = said(tmp_path, scenario("", parameters=ALLOWED.format(value)))
    assert any("<ParameterDeclaration>: its constraints do not allow" in one for one in found) != allowed
    write(tmp_path, scenario("", parameters=ALLOWED.format("7")))
    if not allowed:
        with pytest.raises(ConfigError, match="its constraints do not allow"):
            read_scenario(tmp_path / "made.xosc", "made", given={"p": value})


def waypoints(strategy: str) -> str:
    inner = "".join(f'<Waypoint routeStrategy="{strategy}">{at("-1", s)}</Waypoint>' for s in ("100", "300"))
    return f"""<PrivateAction><RoutingAction><AssignRouteAction><Route name="r" closed="false">{inner}</Route>
    </AssignRouteAction></RoutingAction></PrivateAction>"""


LIMITED = """<PrivateAction><LongitudinalAction><LongitudinalDistanceAction entityRef="Ego" freespace="false"
distance="9" continuous="true"><DynamicConstraints maxSpeed="9"/></LongitudinalDistanceAction></LongitudinalAction>
</PrivateAction>"""
SLOW = event("e", step("7"), after("1"))


@pytest.mark.parametrize(
    ("text", "why"),
    [
        (scenario(event("e", step("7"), two(GONE, "none"))), "triggeringEntitiesRule: expected any or all, got 'none'"),
        (scenario(event("e", step("7"), two(GONE, "all"), edge="rising")), "of a condition on several entities"),
        (
            scenario(event("e", lane_change("cubic", "time", "1", "1"), after("4"))
                + event("f", lane_change("cubic", "time", "1", "-1"), after("2"))),
            "<LaneChangeAction>: it stands after an action of 'Other' that begins later",
        ),
        (scenario(SLOW.replace("parallel", "skip")), "<Event>: priority: 'skip' is not taken"),
        (scenario(event("e", waypoints("fastest"), after("1"))), "routeStrategy: expected shortest, got 'fastest'"),
        (scenario(event("e", LIMITED, after("1"))), "<DynamicConstraints>: maxSpeed is taken beside"),
        (
            scenario(event("e", offset('continuous="true"'), after("1"))
                + event("f", step("7"), element_state("event", "e", "endTransition"))),
            "'e' goes on for good",
        ),
        (
            scenario(SLOW).replace("</Private></Actions>", f"{controller('c', 'own')}</Private></Actions>"),
            "an entity that a controller of its own drives",
        ),
        (
            scenario(SLOW).replace("</Private></Actions>", controller("c", "own", INACTIVE.replace("false", "true"))
                + "</Private></Actions>"),
            "<ControllerAction>: expected one action in it, got 2",
        ),
        (
            scenario(SLOW).replace(VEHICLE, VEHICLE.replace("</Vehicle>",
                '<Trailer><TrailerRef entityRef="Other"/></Trailer></Vehicle>'), 1),
            "<Trailer>: 'Ego' has no trailer here",
        ),
        (
            scenario(SLOW).replace('Shape="step" dynamicsDimension="time" value="0"',
                'Shape="linear" dynamicsDimension="time" value="5"', 1),
            "<SpeedAction>: the ego has this speed from the start on",
        ),
    ],
)  # fmt: skip
def test_what_is_not_heeded_is_said(tmp_path: Path, text: str, why: str) -> None:
    found = said(tmp_path, text)
    assert any(why in one and "made.xosc:" in one for one in found), found


def test_a_lane_by_its_border_is_refused(tmp_path: Path) -> None:
    file = write(tmp_path, scenario(""))
    road = tmp_path / "road.xodr"
    border = '<border sOffset="0" a="3.5" b="0" c="0" d="0"/>'
    text = road.read_text(encoding="utf-8")
    road.write_text(text.replace('<width sOffset="0" a="3.5" b="0" c="0" d="0"/>', border, 1), encoding="utf-8")
    with pytest.raises(ConfigError, match="a lane without a width; borders are not taken"):
        read_scenario(file, "made")


def test_a_lane_that_counts_from_who_changes_lane_is_refused(tmp_path: Path) -> None:
    other = lane_change("cubic", "time", "2", "1").replace(
        '<AbsoluteTargetLane value="1"/>', '<RelativeTargetLane entityRef="Third" value="0"/>'
    )
    third = f'<ScenarioObject name="Third">{VEHICLE}</ScenarioObject></Entities>'
    start = (
        f'<Private entityRef="Third"><PrivateAction><TeleportAction>{at("1", "60")}</TeleportAction></PrivateAction>'
    )
    act = f"""<Act name="b"><ManeuverGroup name="h" maximumExecutionCount="1"><Actors selectTriggeringEntities="false">
    <EntityRef entityRef="Third"/></Actors><Maneuver name="n">
    {event("back", lane_change("cubic", "time", "2", "-1"), after("1"))}</Maneuver></ManeuverGroup><StartTrigger/>
    </Act>"""
    text = scenario(event("e", other, after("4"))).replace("</Entities>", third, 1)
    text = text.replace("</Actions></Init>", f"{start}{step('9')}</Private></Actions></Init>")
    assert not read_scenario(write(tmp_path, text), "made").problems
    found = said(tmp_path, text.replace("</Act></Story>", f"</Act>{act}</Story>"))
    assert "<RelativeTargetLane>: what counts from 'Third', which changes lane or offset itself" in found[0]
