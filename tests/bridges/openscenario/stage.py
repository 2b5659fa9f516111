"""Files of OpenSCENARIO written here, and what becomes of them beside an ego that keeps its speed: no SUMO, no network.

The road of the files written here runs 800 m along +x; its lanes -1 and 1 are 3.5 m wide.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

from vve_sumo.bridges.commonroad.importer import Imported as FromCommonRoad
from vve_sumo.bridges.openscenario.importer import Imported, read_scenario
from vve_sumo.path import ReferencePath
from vve_sumo.scenario.engine import ScenarioEngine
from vve_sumo.scenario.load import parse
from vve_sumo.timing import PERIOD
from vve_sumo.values import ActorState, Point, Pose
from vve_sumo.vehicle.load import load
from vve_sumo.workspace import find

LANE = 3.5

ROAD = """<OpenDRIVE><header revMajor="1" revMinor="6"/>
<road id="0" length="800" junction="-1"><planView><geometry s="0" x="0" y="0" hdg="0" length="800"><line/></geometry>
</planView><lanes><laneSection s="0">
<left><lane id="1" type="driving"><width sOffset="0" a="3.5" b="0" c="0" d="0"/></lane></left>
<center><lane id="0" type="none"/></center>
<right><lane id="-1" type="driving"><width sOffset="0" a="3.5" b="0" c="0" d="0"/></lane></right>
</laneSection></lanes></road></OpenDRIVE>"""

VEHICLE = """<Vehicle name="v" vehicleCategory="car"><BoundingBox><Center x="1.5" y="0" z="0.7"/>
<Dimensions length="4.5" width="1.8" height="1.4"/></BoundingBox></Vehicle>"""


def step(speed: str) -> str:
    """A speed at once."""
    return speed_action("step", "time", "0", speed)


def speed_action(shape: str, dimension: str, value: str, speed: str) -> str:
    """A change to a speed."""
    return f"""<PrivateAction><LongitudinalAction><SpeedAction>
<SpeedActionDynamics dynamicsShape="{shape}" dynamicsDimension="{dimension}" value="{value}"/>
<SpeedActionTarget><AbsoluteTargetSpeed value="{speed}"/></SpeedActionTarget>
</SpeedAction></LongitudinalAction></PrivateAction>"""


def lane_change(shape: str, dimension: str, value: str, lane: str) -> str:
    """A change to a lane."""
    return f"""<PrivateAction><LateralAction><LaneChangeAction>
<LaneChangeActionDynamics dynamicsShape="{shape}" dynamicsDimension="{dimension}" value="{value}"/>
<LaneChangeTarget><AbsoluteTargetLane value="{lane}"/></LaneChangeTarget>
</LaneChangeAction></LateralAction></PrivateAction>"""


def at(lane: str, s: str) -> str:
    """A place in a lane, which faces along +x."""
    turn = '<Orientation type="relative" h="3.141592653589793"/>' if not lane.startswith("-") else ""
    return f'<Position><LanePosition roadId="0" laneId="{lane}" s="{s}">{turn}</LanePosition></Position>'


def after(seconds: str) -> str:
    """A condition on time."""
    return f'<ByValueCondition><SimulationTimeCondition value="{seconds}" rule="greaterThan"/></ByValueCondition>'


def of_entity(condition: str, who: str = "Ego") -> str:
    """A condition on an entity."""
    return f"""<ByEntityCondition><TriggeringEntities triggeringEntitiesRule="any"><EntityRef entityRef="{who}"/>
</TriggeringEntities><EntityCondition>{condition}</EntityCondition></ByEntityCondition>"""


def event(name: str, action: str, condition: str, *, edge: str = "none", delay: str = "0", more: str = "") -> str:
    """An event of the other entity."""
    return f"""<Event name="{name}" priority="parallel" {more}><Action name="{name}">{action}</Action><StartTrigger>
<ConditionGroup><Condition name="c" delay="{delay}" conditionEdge="{edge}">{condition}</Condition></ConditionGroup>
</StartTrigger></Event>"""


def scenario(
    events: str, *, lane: str = "-1", s: str = "100", speed: str = "10", parameters: str = "", stop: str = ""
) -> str:
    """A scenario of the ego, at s 20 with 20 m/s, and one entity Other."""
    return f"""<?xml version="1.0"?><OpenSCENARIO>
<FileHeader revMajor="1" revMinor="2" date="2026-01-01T00:00:00" description="a test" author="t"/>
<ParameterDeclarations>{parameters}</ParameterDeclarations><CatalogLocations/>
<RoadNetwork><LogicFile filepath="road.xodr"/></RoadNetwork>
<Entities><ScenarioObject name="Ego">{VEHICLE}</ScenarioObject><ScenarioObject name="Other">{VEHICLE}</ScenarioObject>
</Entities><Storyboard><Init><Actions>
<Private entityRef="Ego"><PrivateAction><TeleportAction>{at("-1", "20")}</TeleportAction></PrivateAction>{step("20")}
</Private>
<Private entityRef="Other"><PrivateAction><TeleportAction>{at(lane, s)}</TeleportAction></PrivateAction>{step(speed)}
</Private></Actions></Init>
<Story name="s"><Act name="a"><ManeuverGroup name="g" maximumExecutionCount="1">
<Actors selectTriggeringEntities="false"><EntityRef entityRef="Other"/></Actors>
<Maneuver name="m">{events}</Maneuver></ManeuverGroup><StartTrigger/></Act></Story>
<StopTrigger>{stop}</StopTrigger></Storyboard></OpenSCENARIO>"""


def write(folder: Path, text: str) -> Path:
    """Write a scenario with its road; return its file."""
    (folder / "road.xodr").write_text(ROAD, encoding="utf-8")
    file = folder / "made.xosc"
    file.write_text(text, encoding="utf-8")
    return file


class Moment(NamedTuple):
    """What is known at one tick."""

    time: float
    ego: float  #: x of its rear axle [m]
    actors: Mapping[str, ActorState]
    ended: bool


def played(found: Imported | FromCommonRoad, duration: float, speed: float | None = None) -> list[Moment]:
    """Return what happens beside an ego that keeps its speed on its path [m/s]."""
    table = {**found.table, "road": {"network": "none"}}
    parsed = parse(table, Path("made.toml"))
    lines = {name: ReferencePath.from_points(*zip(*points, strict=True)) for name, points in found.lines.items()}
    vehicle = load(find("vehicle", "ford_fusion", Path.cwd())).vehicle
    path = lines[parsed.ego.path]
    engine = ScenarioEngine(parsed.actors, path, lines, {}, vehicle, parsed.end_trigger.when)
    keeps = parsed.ego.speed_mps if speed is None else speed
    moments = []
    for tick in range(round(duration / PERIOD) + 1):
        time = tick * PERIOD
        s = parsed.ego.initial_s_m + keeps * time
        here = path.at(s)
        reach = vehicle.rear_axle_to_bumper
        x, y = here.x + reach * math.cos(here.heading), here.y + reach * math.sin(here.heading)
        pose = Pose(time, Point.FRONT_BUMPER, x, y, here.heading, keeps, 0.0, 0.0, 0.0, 0.0)
        states = {one.id: one for one in engine.step(time, pose)}
        moments.append(Moment(time, here.x, states, engine.ended))
    return moments


def first_at(moments: list[Moment], speed: float) -> float:
    """When the other entity has a speed [m/s] for the first time [s]."""
    return next((m.time for m in moments if abs(m.actors["Other"].speed - speed) < 1e-6), math.inf)


def shape_share(shape: str, part: float) -> float:
    """The share of a change at a part of it, as the standard draws the shapes."""
    p = min(max(part, 0.0), 1.0)
    return {"linear": p, "cubic": 3 * p**2 - 2 * p**3, "sinusoidal": 0.5 * (1 - math.cos(math.pi * p))}[shape]


def element_state(kind: str, name: str, wanted: str) -> str:
    """A condition on the state of an element of the storyboard."""
    return f"""<ByValueCondition><StoryboardElementStateCondition storyboardElementType="{kind}"
storyboardElementRef="{name}" state="{wanted}"/></ByValueCondition>"""


def imported(folder: Path, text: str) -> Imported:
    """Return what a text comes to, of which all is taken."""
    found = read_scenario(write(folder, text), "made")
    assert not found.problems, found.problems
    return found
