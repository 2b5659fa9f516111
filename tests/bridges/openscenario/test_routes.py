"""Routes over a junction, and places that count along them, against the geometry of its roads in closed form.

Road 0 runs 100 m along +x; a quarter of a circle of 15 m turns left to road 2, which runs from (115, 115) towards the
junction, and 30 m straight on lead to road 1.
"""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from tests.bridges.openscenario.stage import VEHICLE, after, event, played, step
from vve_sumo.bridges.openscenario.importer import Imported, read_scenario
from vve_sumo.bridges.openscenario.road_map import RoadMap, RoadPlace, Way
from vve_sumo.bridges.openscenario.routes import Waypoint, route_over
from vve_sumo.errors import ConfigError
from vve_sumo.path import ReferencePath
from vve_sumo.timing import PERIOD

#: radius of the turn at the middle of the road and of its right lane [m]
RADIUS, OUTER = 15.0, 16.75
#: along the reference lines from the start of road 0 to where road 2 is entered [m]
TURNED = 100.0 + 0.5 * math.pi * RADIUS
CLOSE = 0.2
#: from the rear axle to the centre of the box [m]
CENTRE = 1.5


def road(
    number: int, geometry: str, length: float, links: str = "", lanes: tuple[int, int] | None = None, rule: str = "RHT"
) -> str:
    """A road of two lanes; `lanes` are the numbers in which the right lane of a connecting road comes and goes on."""
    joined = "" if lanes is None else f'<link><predecessor id="{lanes[0]}"/><successor id="{lanes[1]}"/></link>'
    width = '<width sOffset="0" a="3.5" b="0" c="0" d="0"/>'
    junction = "-1" if lanes is None else "9"
    return f"""<road id="{number}" length="{length}" junction="{junction}" rule="{rule}"><link>{links}</link><planView>
{geometry}</planView><lanes><laneSection s="0"><left><lane id="1" type="driving">{width}</lane></left>
<center><lane id="0" type="none"/></center><right><lane id="-1" type="driving">{joined}{width}</lane></right>
</laneSection></lanes></road>"""


def line(x: float, y: float, heading: float, length: float) -> str:
    return f'<geometry s="0" x="{x}" y="{y}" hdg="{heading}" length="{length}"><line/></geometry>'


def roads(rule: str = "RHT") -> str:
    turn, to_junction = 0.5 * math.pi * RADIUS, '<{0} elementType="junction" elementId="9"/>'
    arc = f'<geometry s="0" x="100" y="0" hdg="0" length="{turn}"><arc curvature="{1.0 / RADIUS}"/></geometry>'
    ends = '<predecessor elementType="road" elementId="0" contactPoint="end"/>'
    ends += '<successor elementType="road" elementId="{0}" contactPoint="{1}"/>'
    connection = """<connection id="{0}" incomingRoad="0" connectingRoad="{0}" contactPoint="start">
    <laneLink from="-1" to="-1"/></connection>"""
    return (
        '<OpenDRIVE><header revMajor="1" revMinor="6"/>'
        + road(0, line(0, 0, 0, 100), 100, to_junction.format("successor"), rule=rule)
        + road(1, line(130, 0, 0, 100), 100, to_junction.format("predecessor"))
        + road(2, line(115, 115, -0.5 * math.pi, 100), 100, to_junction.format("successor"))
        + road(10, line(100, 0, 0, 30), 30, ends.format(1, "start"), (-1, -1))
        + road(11, arc, turn, ends.format(2, "end"), (-1, 1))
        + f'<junction id="9">{connection.format(10)}{connection.format(11)}</junction></OpenDRIVE>'
    )


def place(where: str, road_id: str = "0", lane: str = "-1") -> str:
    return f'<Position><LanePosition roadId="{road_id}" laneId="{lane}" s="{where}"/></Position>'


LEFT = f"""<Route name="left" closed="false"><Waypoint routeStrategy="shortest">{place("0")}</Waypoint>
<Waypoint routeStrategy="shortest">{place("20", "2", "1")}</Waypoint></Route>"""
ASSIGN = f"<RoutingAction><AssignRouteAction>{LEFT}</AssignRouteAction></RoutingAction>"
ACQUIRE = f"<RoutingAction><AcquirePositionAction>{place('20', '2', '1')}</AcquirePositionAction></RoutingAction>"


def on_route(stated: str, more: str = "") -> str:
    return f"""<Position><RoutePosition><RouteRef>{LEFT}</RouteRef><InRoutePosition>{stated}</InRoutePosition>{more}
    </RoutePosition></Position>"""


def private(*actions: str) -> str:
    return "".join(f"<PrivateAction>{one}</PrivateAction>" for one in actions)


def teleport(position: str) -> str:
    return f"<TeleportAction>{position}</TeleportAction>"


def scenario(other: str, ego: str = "", events: str = "") -> str:
    """The ego at s 10 of road 0 with 5 m/s, and one entity Other; both are given actions at the start."""
    return f"""<OpenSCENARIO><FileHeader revMajor="1" revMinor="2" description="routes"/><CatalogLocations/>
<RoadNetwork><LogicFile filepath="road.xodr"/></RoadNetwork><Entities>
<ScenarioObject name="Ego">{VEHICLE}</ScenarioObject><ScenarioObject name="Other">{VEHICLE}</ScenarioObject>
</Entities><Storyboard><Init><Actions>
<Private entityRef="Ego">{ego or private(teleport(place("10")))}{step("5")}</Private>
<Private entityRef="Other">{other}</Private></Actions></Init>
<Story name="s"><Act name="a"><ManeuverGroup name="g" maximumExecutionCount="1">
<Actors selectTriggeringEntities="false"><EntityRef entityRef="Other"/></Actors>
<Maneuver name="m">{events}</Maneuver></ManeuverGroup><StartTrigger/></Act></Story><StopTrigger/>
</Storyboard></OpenSCENARIO>"""


def read(folder: Path, text: str, rule: str = "RHT") -> Imported:
    (folder / "road.xodr").write_text(roads(rule), encoding="utf-8")
    (folder / "made.xosc").write_text(text, encoding="utf-8")
    return read_scenario(folder / "made.xosc", "made")


def imported(folder: Path, text: str, rule: str = "RHT") -> Imported:
    found = read(folder, text, rule)
    assert not found.problems, found.problems
    return found


def reference(found: Imported, time: float) -> tuple[float, float, float]:
    """Reference point x, y [m] and heading [rad] of the other entity at a time."""
    state = played(found, time)[round(time / PERIOD)].actors["Other"]
    cos, sin = math.cos(state.heading), math.sin(state.heading)
    return state.x - CENTRE * cos, state.y - CENTRE * sin, state.heading


@pytest.mark.parametrize("given", [ASSIGN, ACQUIRE])
def test_who_is_given_a_route_turns_where_it_says(tmp_path: Path, given: str) -> None:
    found = imported(tmp_path, scenario(private(given, teleport(place("20"))) + step("10")))
    # 80 m to the junction, a quarter of a circle, 30 m along road 2: in its right lane all the way.
    way = 80.0 + 0.5 * math.pi * OUTER + 30.0
    x, y, heading = reference(found, round(way / 10.0 / PERIOD) * PERIOD)
    assert (x, y) == pytest.approx((115.0 + 1.75, 15.0 + 30.0), abs=CLOSE)
    assert heading == pytest.approx(0.5 * math.pi, abs=0.01)


def test_a_route_of_an_event_is_taken_from_then_on(tmp_path: Path) -> None:
    events = event("turn", f"<PrivateAction>{ASSIGN}</PrivateAction>", after("2"))
    found = imported(tmp_path, scenario(private(teleport(place("20"))) + step("10"), events=events))
    way = 80.0 + 0.5 * math.pi * OUTER + 30.0
    assert reference(found, round(way / 10.0 / PERIOD) * PERIOD)[:2] == pytest.approx((116.75, 45.0), abs=CLOSE)


def test_without_a_route_it_goes_straight_on(tmp_path: Path) -> None:
    found = imported(tmp_path, scenario(private(teleport(place("20"))) + step("10")))
    assert reference(found, 12.0)[:2] == pytest.approx((140.0, -1.75), abs=CLOSE)


@pytest.mark.parametrize(
    ("stated", "x", "y"),
    [
        ('<FromLaneCoordinates pathS="30" laneId="-1" laneOffset="0.5"/>', 30.0, -1.25),
        # The route goes along road 2 against its reference line: its right lane is 1 there, -1 along the route.
        ('<FromLaneCoordinates pathS="{0}" laneId="1" laneOffset="0.5"/>', 116.75 + 0.5, 25.0),
        ('<FromLaneCoordinates pathS="{0}" laneId="-1" laneOffset="0.5"/>', 116.75 - 0.5, 25.0),
        ('<FromRoadCoordinates pathS="{0}" t="2"/>', 113.0, 25.0),
    ],
)
def test_a_place_counts_along_the_route(tmp_path: Path, stated: str, x: float, y: float) -> None:
    text = scenario(private(teleport(on_route(stated.format(TURNED + 10.0)))))
    where = reference(imported(tmp_path, text), 0.0)
    heading = 0.0 if y < 0.0 else 0.5 * math.pi
    assert where == pytest.approx((x, y, heading), abs=0.01)


def test_a_place_on_a_route_may_face_against_it(tmp_path: Path) -> None:
    back = '<Orientation type="relative" h="3.141592653589793"/>'
    text = scenario(private(teleport(on_route('<FromLaneCoordinates pathS="30" laneId="-1"/>', back))))
    assert abs(reference(imported(tmp_path, text), 0.0)[2]) == pytest.approx(math.pi, abs=0.01)


def test_the_path_of_the_ego_is_its_route(tmp_path: Path) -> None:
    found = imported(tmp_path, scenario("", private(ASSIGN, teleport(place("10")))))
    path = ReferencePath.from_points(*zip(*found.lines[found.table["ego"]["path"]], strict=True))
    assert path.at(100.0 + 0.5 * math.pi * OUTER + 50.0)[:2] == pytest.approx((116.75, 65.0), abs=0.05)


FOLLOW = """<PrivateAction><RoutingAction><FollowTrajectoryAction><Trajectory name="t" closed="False"><Shape><Polyline>
<Vertex><Position><WorldPosition x="10" y="-1.75"/></Position></Vertex>
<Vertex><Position><WorldPosition x="70" y="40"/></Position></Vertex></Polyline></Shape></Trajectory>
<TimeReference><None/></TimeReference><TrajectoryFollowingMode followingMode="follow"/></FollowTrajectoryAction>
</RoutingAction></PrivateAction>"""


def of_ego(events: str) -> str:
    return scenario("", events=events).replace('<EntityRef entityRef="Other"/>', '<EntityRef entityRef="Ego"/>', 1)


def test_a_trajectory_of_the_ego_that_begins_with_the_drive_is_its_path(tmp_path: Path) -> None:
    found = imported(tmp_path, of_ego(event("e", FOLLOW, after("0"))))
    path = ReferencePath.from_points(*zip(*found.lines[found.table["ego"]["path"]], strict=True))
    foot = path.project(70.0, 40.0)
    assert (foot.s, foot.d) == pytest.approx((math.hypot(60.0, 41.75), 0.0), abs=0.01)


def test_a_trajectory_of_the_ego_that_begins_later_is_refused(tmp_path: Path) -> None:
    found = read(tmp_path, of_ego(event("e", FOLLOW, after("2"))))
    assert "<FollowTrajectoryAction>: the ego's path is the one that it begins on" in found.problems[0]


def test_a_meeting_counts_on_the_line_that_the_story_begins_on(tmp_path: Path) -> None:
    meet = f"""<PrivateAction><SynchronizeAction masterEntityRef="Ego"><TargetPositionMaster>{place("60")[10:-11]}
    </TargetPositionMaster><TargetPosition><WorldPosition x="70" y="40"/></TargetPosition>
    <FinalSpeed><AbsoluteSpeed value="6"/></FinalSpeed></SynchronizeAction></PrivateAction>"""
    events = event("meet", meet, after("0")) + event("walk", FOLLOW, after("0"))
    found = imported(tmp_path, scenario(private(teleport(place("10"))), events=events))
    # The ego needs 10 s for its 50 m; the other is at the end of its line then.
    assert reference(found, 10.0)[:2] == pytest.approx((70.0, 40.0), abs=CLOSE)


def test_in_left_hand_traffic_a_left_lane_faces_along_the_road(tmp_path: Path) -> None:
    text = scenario(private(teleport(place("20", lane="1"))) + step("10"))
    x, _y, heading = reference(imported(tmp_path, text, "LHT"), 1.0)
    assert (x, heading) == pytest.approx((30.0, 0.0), abs=CLOSE)


@pytest.mark.parametrize(
    ("other", "why"),
    [
        (private(teleport(on_route('<FromLaneCoordinates pathS="900" laneId="-1"/>'))), "lies off the route"),
        (private(teleport(on_route('<FromLaneCoordinates pathS="9" laneId="-4"/>'))), "no lane -4 on road 0"),
        (private(teleport(on_route('<FromCurrentEntity entityRef="Ego"/>'))), "<FromCurrentEntity>: this kind"),
        (private(ASSIGN, teleport(place("20", "1"))), "not on its route at first"),
        (private(ASSIGN, teleport(place("20", lane="1"))), "lane 1 of road 0 does not lead to road 11"),
        (private(ASSIGN.replace('closed="false"', 'closed="true"'), teleport(place("9"))), "a closed route"),
        (private(ACQUIRE.replace('roadId="2"', 'roadId="1"'), teleport(place("9", "2", "1"))), "no way leads from"),
    ],
)
def test_what_is_no_route_is_named(tmp_path: Path, other: str, why: str) -> None:
    try:
        said = read(tmp_path, scenario(other)).problems
    except ConfigError as error:
        said = [str(error)]
    assert any(why in one and "made.xosc:" in one for one in said)


def test_the_shortest_way_is_taken_and_stations_add_up(tmp_path: Path) -> None:
    (tmp_path / "road.xodr").write_text(roads(), encoding="utf-8")
    found = RoadMap(tmp_path / "road.xodr")
    first, last = Waypoint(RoadPlace("0", 40.0, 0.0), 1), Waypoint(RoadPlace("2", 30.0, 0.0), 1)
    route = route_over(found, [first, Waypoint(RoadPlace("0", 70.0, 0.0), 1), last])
    assert [leg.way for leg in route.legs] == [Way("0", 1), Way("11", 1), Way("2", -1)]
    assert [leg.path_s for leg in route.legs] == pytest.approx([0.0, 60.0, 60.0 + 0.5 * math.pi * RADIUS])
    end = route.at(60.0 + 0.5 * math.pi * RADIUS + 90.0, found)  # beyond the last waypoint, on its road
    assert end is not None
    assert end.s == pytest.approx(10.0)
    assert route.at(500.0, found) is None
    # Who faces away from the only way turns round for it.
    assert route_over(found, [first._replace(sense=-1), last]).legs[0].way == Way("0", 1)
