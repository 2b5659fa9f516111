"""Private actions of OpenSCENARIO as the actions of a scenario's stories.

Knows places, lines and the schema's keys; it must not know triggers or files.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any, Final

from vve_sumo.bridges.openscenario.lines import Track, lane_track, track_of, trajectory_track
from vve_sumo.bridges.openscenario.parameters import Scope
from vve_sumo.bridges.openscenario.places import Line, Places, neighbour
from vve_sumo.bridges.openscenario.road_map import RoadPlace
from vve_sumo.bridges.openscenario.routes import Route, Waypoint, route_over
from vve_sumo.bridges.scenario_import.lines import LineFiles, reference
from vve_sumo.bridges.scenario_import.not_taken import NotTakenError
from vve_sumo.bridges.scenario_import.xml_tree import Element

Action = dict[str, Any]

SHAPES: Final = ("linear", "cubic", "sinusoidal", "step")
#: what changes how something looks, and not what happens
LOOKS: Final = ("AppearanceAction",)
#: what says which roads an entity goes along, and what says where it goes at all
ROUTES: Final = ("AssignRouteAction", "AcquirePositionAction")
PATHS: Final = (*ROUTES, "FollowTrajectoryAction")
#: what leads an entity off the path that it is on
LATERAL: Final = ("LaneChangeAction", "LaneOffsetAction", "LateralDistanceAction")
LEADING_OFF: Final = (*PATHS, "TeleportAction", *LATERAL)


@dataclass(slots=True)
class Stage:
    """What is known of the entities while their actions are read in the file's order."""

    places: Places
    files: LineFiles
    ids: Mapping[str, str]  #: of entities, by their names
    tracks: dict[str, Track] = field(default_factory=dict)  #: where each moves, by its name, as the story goes on
    routes: dict[str, Route] = field(default_factory=dict)  #: of those that have one, by name
    speeds: dict[str, float] = field(default_factory=dict)  #: at the start [m/s], by name
    ego_place: Callable[[Element, Scope], tuple[float, float]] = lambda _element, _scope: (0.0, 0.0)
    controlled: set[str] = field(default_factory=set)  #: entities that have a controller of their own
    begun: set[int] = field(default_factory=set)  #: identities of elements of the story that are part of the start
    sidewards: dict[str, set[str]] = field(default_factory=dict)  #: what of lateral kinds a story has each entity do
    path_changes: dict[tuple[int, int], tuple[float, float]] = field(default_factory=dict)
    """Changes that the ego's path has in it, by the number of their manoeuvre and the identity of their element: the
    ways from the start to where each begins and is over [m]."""
    decided: list[object] = field(default_factory=list)  #: triggers and speeds that say where those begin
    refused_changes: dict[tuple[int, int], NotTakenError] = field(default_factory=dict)  #: why others are not in it

    def id(self, element: Element, name: str) -> str:
        """Return an entity's id; raises NotTakenError for none."""
        if name not in self.ids:
            raise NotTakenError(element, f"no entity {name!r}")
        return self.ids[name]

    def track(self, element: Element, name: str) -> Track:
        """Return where an entity moves; raises NotTakenError for one that was never placed."""
        if name not in self.tracks:
            raise NotTakenError(element, f"{name} has no place at the start")
        return self.tracks[name]


def kind_of(action: Element) -> Element:
    """Return the element that says what a private action does."""
    inner = action
    while inner.tag in ("PrivateAction", "LongitudinalAction", "LateralAction", "RoutingAction", "ControllerAction"):
        if not inner.children:
            raise NotTakenError(inner, "expected an action in it")
        if len(inner.children) > 1:
            return _idle(inner)
        inner = inner.children[0]
    return inner


def _idle(action: Element) -> Element:
    """Return the one of several controller actions that does something; raises NotTakenError where both do.

    Until version 1.1 every action that assigns a controller also says which inputs it overrides, most often none.
    """
    does = [one for one in action.children if _overrides(one)]
    if action.tag != "ControllerAction" or len(does) > 1:
        raise NotTakenError(action, f"expected one action in it, got {len(action.children)}")
    return (does or action.children)[0]


def _overrides(action: Element) -> bool:
    """Whether a controller action does more than to say of inputs that they are not overridden."""
    return any(one.attributes.get("active", "").lower() not in ("false", "0") for one in action.children)


def drives_as_usual(controller: Element) -> bool:
    """Whether a controller, or a reference to one, is the one that every entity has without any."""
    properties = [one.attributes.get("value") for one in controller.walk() if one.tag == "Property"]
    if properties:
        return all(value == "DefaultController" for value in properties)
    name = controller.attributes.get("name", controller.attributes.get("entryName", ""))
    return name.lower().startswith("default")


def longitudinal(of: Element) -> bool:
    """Whether an action is about speed alone."""
    return of.tag in ("SpeedAction", "SpeedProfileAction", "LongitudinalDistanceAction")


def looks(action: Element) -> bool:
    """Whether an action of an event changes nothing but how something looks."""
    private = action.child("PrivateAction")
    return private is not None and bool(private.children) and private.children[0].tag in LOOKS


def read_action(of: Element, scope: Scope, who: str, stage: Stage) -> Action | None:
    """Return what an entity does by an action; None where the action changes nothing that moves.

    Raises NotTakenError for an action that no story can say.
    """
    if of.tag in ("ActivateControllerAction", "AssignControllerAction", "OverrideControllerValueAction"):
        idle = who not in stage.controlled and of.tag == "ActivateControllerAction"
        off = not any(scope.flag(of, key, False) for key in ("lateral", "longitudinal")) and bool(of.attributes)
        if stage.ids[who] == "ego" or idle or (off and of.tag == "ActivateControllerAction"):
            return None
        if of.tag == "AssignControllerAction" and all(map(drives_as_usual, of.children)):
            return None
        if of.tag == "OverrideControllerValueAction" and not _overrides(of):
            return None
        raise NotTakenError(of, "an entity that a controller of its own drives is not taken")
    if of.tag in LOOKS:
        return None
    reader = {
        "SpeedAction": _speed,
        "SpeedProfileAction": _profile,
        "LongitudinalDistanceAction": _distance,
        "LaneChangeAction": _lane_change,
        "LaneOffsetAction": _lane_offset,
        "FollowTrajectoryAction": _follow_trajectory,
        "SynchronizeAction": _synchronize,
        "TeleportAction": _teleport,
        "AssignRouteAction": _route,
        "AcquirePositionAction": _route,
        "VisibilityAction": _visibility,
    }.get(of.tag)
    if reader is None:
        raise NotTakenError(of, "this action is not taken")
    return reader(of, scope, who, stage)


def _dynamics(of: Element, scope: Scope, time: str, distance: str, rate: str) -> dict[str, Any]:
    """Return shape and length of a change, by the keys that are given for its dimensions."""
    shape = scope.text(of, "dynamicsShape")
    if shape not in SHAPES:
        raise NotTakenError(of, f"dynamicsShape: expected {', '.join(SHAPES)}, got {shape!r}")
    if shape == "step" or (value := abs(scope.number(of, "value"))) == 0.0:
        return {}
    keys = {"time": time, "distance": distance, "rate": rate}
    dimension = scope.text(of, "dynamicsDimension")
    if dimension not in keys:
        raise NotTakenError(of, f"dynamicsDimension: expected {', '.join(keys)}, got {dimension!r}")
    return {"shape": shape, keys[dimension]: value}


def _needed(of: Element, *tags: str) -> Element:
    found = of.child(*tags)
    if found is None:
        raise NotTakenError(of, f"expected <{'/'.join(tags)}>")
    return found


def speed_target(of: Element, scope: Scope, stage: Stage) -> dict[str, Any]:
    """Return the target of a SpeedAction: `to_mps`, with `of` and `factor` where it is another's."""
    target = _needed(of, "SpeedActionTarget")
    absolute = target.child("AbsoluteTargetSpeed")
    if absolute is not None:
        value = scope.number(absolute, "value")
        if not 0.0 <= value <= 100.0:
            raise NotTakenError(absolute, f"value: expected 0 to 100 m/s, got {value:g}")
        return {"to_mps": value}
    relative = _needed(target, "RelativeTargetSpeed")
    other = stage.id(relative, scope.text(relative, "entityRef"))
    value, kind = scope.number(relative, "value"), scope.text(relative, "speedTargetValueType", "delta")
    found: dict[str, Any] = {"of": other} | ({"factor": value} if kind == "factor" else {"to_mps": value})
    if kind not in ("factor", "delta") or (kind == "factor" and value < 0.0):
        raise NotTakenError(relative, "expected a delta, or a factor of at least 0")
    return found | ({"continuous": True} if scope.flag(relative, "continuous", False) else {})


def _speed(of: Element, scope: Scope, who: str, stage: Stage) -> Action:
    reached = _dynamics(_needed(of, "SpeedActionDynamics"), scope, "over_s", "over_m", "acceleration_mps2")
    target = speed_target(of, scope, stage)
    if target.get("continuous") and reached:
        raise NotTakenError(of, "a continuous relative speed is taken with the shape step alone")
    return {"speed": target | reached}


def _profile(of: Element, scope: Scope, who: str, stage: Stage) -> Action:
    if scope.text(of, "followingMode", "position") != "position":
        raise NotTakenError(of, "followingMode: expected position, whose speeds are straight lines")
    if "entityRef" in of.attributes:
        raise NotTakenError(of, "a profile relative to another entity is not taken")
    entries = of.all("SpeedProfileEntry")
    if not entries or any("time" not in one.attributes for one in entries):
        raise NotTakenError(of, "expected entries, each with a time")
    points = [{"over_s": scope.number(one, "time"), "speed_mps": scope.number(one, "speed")} for one in entries]
    if any(not 0.0 <= one["speed_mps"] <= 100.0 or one["over_s"] < 0.0 for one in points):
        raise NotTakenError(of, "expected times from 0 on and speeds of 0 to 100 m/s")
    _allowed(of, scope, points)
    return {"profile": points}


def _allowed(of: Element, scope: Scope, points: list[dict[str, float]]) -> None:
    """Raise NotTakenError where a profile changes a speed faster than its limits allow."""
    limits = of.child("DynamicConstraints")
    for one, later in pairwise(points):
        change, time = later["speed_mps"] - one["speed_mps"], later["over_s"]
        name = "maxAcceleration" if change > 0.0 else "maxDeceleration"
        greatest = math.inf if limits is None or name not in limits.attributes else abs(scope.number(limits, name))
        if abs(change) > greatest * time + 1e-6:
            raise NotTakenError(of, f"its speeds change faster than its {name} allows, which is not taken")


def _distance(of: Element, scope: Scope, who: str, stage: Stage) -> Action:
    sides = {"leadingReferencedEntity": "ahead", "trailingReferencedEntity": "behind", "any": "any"}
    displacement = scope.text(of, "displacement", "trailingReferencedEntity")
    if displacement not in sides:
        raise NotTakenError(of, f"displacement: expected {', '.join(sides)}, got {displacement!r}")
    keeps: dict[str, Any] = {
        "to": stage.id(of, scope.text(of, "entityRef")),
        "side": sides[displacement],
        "freespace": scope.flag(of, "freespace", False),
    }
    stated = [key for key in ("distance", "timeGap") if key in of.attributes]
    if len(stated) != 1:
        raise NotTakenError(of, "expected one of distance and timeGap")
    keeps["gap_m" if stated[0] == "distance" else "headway_s"] = scope.number(of, stated[0])
    if not scope.flag(of, "continuous", False):
        keeps["once"] = True
    limits = of.child("DynamicConstraints")
    if limits is not None:
        rate = next(
            (name for name in ("maxAccelerationRate", "maxDecelerationRate") if name in limits.attributes), None
        )
        if rate is not None:
            raise NotTakenError(limits, f"{rate} is not taken")
        if "maxSpeed" in limits.attributes and "maxAcceleration" not in limits.attributes:
            raise NotTakenError(limits, "maxSpeed is taken beside maxAcceleration and maxDeceleration alone")
        keys = {
            "maxAcceleration": "acceleration_mps2",
            "maxDeceleration": "deceleration_mps2",
            "maxSpeed": "speed_limit_mps",
        }
        keeps |= {key: scope.number(limits, name) for name, key in keys.items() if name in limits.attributes}
        if ("acceleration_mps2" in keeps) != ("deceleration_mps2" in keeps):
            raise NotTakenError(limits, "expected both maxAcceleration and maxDeceleration")
    return {"keeps": keeps}


def _lane_change(of: Element, scope: Scope, who: str, stage: Stage) -> Action:
    reached = _dynamics(_needed(of, "LaneChangeActionDynamics"), scope, "over_s", "over_m", "rate_mps")
    track = stage.track(of, who)
    if track.road is None or track.lane is None:
        raise NotTakenError(of, f"{who} is in no lane of a road")
    target = _needed(of, "LaneChangeTarget")
    absolute, relative = target.child("AbsoluteTargetLane"), target.child("RelativeTargetLane")
    if absolute is not None:
        lane = scope.whole(absolute, "value")
    else:
        relative = relative or _needed(target, "RelativeTargetLane")
        name = scope.text(relative, "entityRef")
        other = stage.tracks.get(name)
        if other is None or other.lane is None or other.road != track.road:
            raise NotTakenError(relative, f"the lane of {name!r} on the road of {who} is not known")
        _steady(relative, name, who, stage, "LaneChangeAction", "LateralDistanceAction")
        lane = neighbour(other.lane, scope.whole(relative, "value") * other.sense)
    own = stage.ids[who]
    moved = lane_track(
        *(stage.places.roads, stage.files, own, track.road, lane, track.s, _t(track, stage), track.sense, of),
        stage.routes.get(who),
    )
    offset = scope.number(of, "targetLaneOffset", 0.0) * track.sense
    stage.tracks[who] = replace(moved, path_d=offset)
    return {"line": {"path": moved.path, "offset_m": offset} | reached}


def _steady(of: Element, name: str, who: str, stage: Stage, *tags: str) -> None:
    """Raise NotTakenError where an entity other than `who` itself does by then what one of the names says."""
    if name != who and not stage.sidewards.get(name, set()).isdisjoint(tags):
        raise NotTakenError(of, f"what counts from {name!r}, which changes lane or offset itself, is not taken")


def _t(track: Track, stage: Stage) -> float:
    """Return t of a track's lane where it began [m]."""
    assert track.road is not None
    assert track.lane is not None
    return stage.places.roads.roads[track.road].middle(track.lane, track.s) or 0.0


def _lane_offset(of: Element, scope: Scope, who: str, stage: Stage) -> Action:
    track = stage.track(of, who)
    stated = _needed(of, "LaneOffsetTarget")
    absolute, relative = stated.child("AbsoluteTargetLaneOffset"), stated.child("RelativeTargetLaneOffset")
    if absolute is not None:
        target = scope.number(absolute, "value") * track.sense
    else:
        relative = relative or _needed(stated, "RelativeTargetLaneOffset")
        target = _beside(relative, scope, track, stage)
    dynamics = _needed(of, "LaneOffsetActionDynamics")
    shape, change = scope.text(dynamics, "dynamicsShape"), abs(target - track.path_d)
    line: dict[str, Any] = {"offset_m": target}
    limited = "maxLateralAcc" in dynamics.attributes
    if shape not in SHAPES or (shape == "linear" and limited and change > 0.0):
        raise NotTakenError(dynamics, f"dynamicsShape: expected cubic, sinusoidal or step, got {shape!r}")
    # Without a limit it is done at once.
    if shape != "step" and limited and change > 0.0:
        if (limit := scope.number(dynamics, "maxLateralAcc")) <= 0.0:
            raise NotTakenError(dynamics, f"maxLateralAcc: expected more than 0, got {limit:g}")
        # The greatest lateral acceleration is the one that is stated: pi^2 / 2 or 6 of change over time squared.
        factor = 6.0 if shape == "cubic" else 0.5 * math.pi**2
        line |= {"shape": shape, "over_s": math.sqrt(factor * change / limit)}
    stage.tracks[who] = replace(track, path_d=target)
    return {"line": line}


def _beside(of: Element, scope: Scope, track: Track, stage: Stage) -> float:
    """Return the offset along a track [m] that counts from where another entity of its lane is."""
    other = stage.track(of, name := scope.text(of, "entityRef"))
    if other.road is None or other.lane is None or (other.road, other.lane) != (track.road, track.lane):
        raise NotTakenError(of, f"an offset relative to {name}, which is not in the same lane, is not taken")
    _steady(of, name, "", stage, *LATERAL)
    # Both count left of the road's reference line; the ego keeps the offset that it begins with.
    return (other.path_d * other.sense + scope.number(of, "value")) * track.sense


def _follow_trajectory(of: Element, scope: Scope, who: str, stage: Stage) -> Action:
    holder = of if of.child("Trajectory") is not None or of.child("CatalogReference") is not None else None
    line = stage.places.trajectory(holder or _needed(of, "TrajectoryRef"), scope)
    begin = scope.number(of, "initialDistanceOffset", 0.0)
    track = trajectory_track(stage.files, stage.ids[who], line, begin)
    action: dict[str, Any] = {"path": track.path}
    action |= {"at_m": begin} if line.anchored else {"from_here": True}
    action["until_m"] = round(line.vertex_s[-1], 4)
    timing = of.child("TimeReference", "Timing")
    if timing is not None:
        action["timing"] = _timing(timing, scope, line)
    stage.tracks[who] = track
    return {"line": action}


def _timing(of: Element, scope: Scope, line: Line) -> list[dict[str, float]]:
    if line.times is None:
        raise NotTakenError(of, "the trajectory's vertices have no times")
    if scope.text(of, "domainAbsoluteRelative") != "relative":
        raise NotTakenError(of, "domainAbsoluteRelative: expected relative, to when the action begins")
    scale, offset = scope.number(of, "scale"), scope.number(of, "offset")
    return [
        {"time_s": round(time * scale + offset, 6), "at_m": round(s, 4)}
        for time, s in zip(line.times, line.vertex_s, strict=True)
    ]


def _synchronize(of: Element, scope: Scope, who: str, stage: Stage) -> Action:
    master = scope.text(of, "masterEntityRef")
    if stage.id(of, master) != "ego":
        raise NotTakenError(of, f"masterEntityRef: expected the ego, got {master!r}")
    at, _offset = stage.ego_place(_needed(of, "TargetPositionMaster"), scope)
    there = stage.places.spot(_needed(of, "TargetPosition"), scope).pose
    foot = reference(stage.track(of, who).points, of).project(there.x, there.y)
    meets: dict[str, Any] = {"ego_at_m": at, "at_m": round(max(foot.s, 0.0), 4)}
    final = of.child("FinalSpeed")
    if final is not None and final.children:
        absolute = final.children[0]
        if absolute.tag not in ("AbsoluteSpeed", "RelativeSpeedToMaster"):
            raise NotTakenError(absolute, "expected an AbsoluteSpeed or a RelativeSpeedToMaster")
        relative = absolute.tag == "RelativeSpeedToMaster"
        if relative and scope.text(absolute, "speedTargetValueType", "delta") != "delta":
            raise NotTakenError(absolute, "speedTargetValueType: expected delta")
        meets["relative_mps" if relative else "speed_mps"] = scope.number(absolute, "value")
        for tag, name, key in (
            ("TargetDistanceSteadyState", "distance", "steady_m"),
            ("TargetTimeSteadyState", "time", "steady_s"),
        ):
            if (steady := absolute.child(tag)) is not None:
                meets[key] = scope.number(steady, name)
    return {"meets": meets}


def _teleport(of: Element, scope: Scope, who: str, stage: Stage) -> Action | None:
    position = _needed(of, "Position")
    if position.children and _stays(position.children[0], scope, who):
        return None
    spot = stage.places.spot(position, scope)
    track = track_of(stage.places.roads, stage.files, stage.ids[who], spot, of, stage.routes.get(who))
    stage.tracks[who] = track
    return {"line": {"path": track.path, "at_m": track.path_s, "offset_m": track.path_d}}


def _stays(position: Element, scope: Scope, who: str) -> bool:
    """Whether a position is where an entity is, and does not turn it: it may lie down or rise."""
    if position.tag != "RelativeObjectPosition" or scope.text(position, "entityRef") != who:
        return False
    turned = position.child("Orientation")
    relative = turned is None or scope.text(turned, "type", "absolute") == "relative"
    moved = [scope.number(position, key, 0.0) for key in ("dx", "dy")]
    return relative and not any(moved) and (turned is None or scope.number(turned, "h", 0.0) == 0.0)


def route_of(of: Element, scope: Scope, places: Places, on: RoadPlace | None, sense: int) -> Route:
    """Return the route that an action assigns to an entity at a place, which goes in a sense along its road there."""
    if of.tag == "AssignRouteAction":
        return places.route(of, scope)
    there = places.spot(_needed(of, "Position"), scope).on
    if on is None or there is None:
        raise NotTakenError(of, "a way from or to a place off all roads is not taken")
    try:
        return route_over(places.roads, [Waypoint(on, sense), Waypoint(there, 1)])
    except ValueError as error:
        raise NotTakenError(of, str(error)) from None


def _route(of: Element, scope: Scope, who: str, stage: Stage) -> Action:
    track = stage.track(of, who)
    if track.road is None or track.lane is None:
        raise NotTakenError(of, f"{who} is in no lane of a road")
    own, roads = stage.ids[who], stage.places.roads
    route = route_of(of, scope, stage.places, RoadPlace(track.road, track.s, _t(track, stage)), track.sense)
    way = route.way(track.road)
    if way is None or way.sense != track.sense:
        raise NotTakenError(of, "an entity that is not on its route at first is not taken")
    moved = lane_track(
        roads, stage.files, own, track.road, track.lane, track.s, _t(track, stage), track.sense, of, route
    )
    stage.routes[who], stage.tracks[who] = route, replace(moved, path_d=track.path_d)
    return {"line": {"path": moved.path, "offset_m": track.path_d}}


def _visibility(of: Element, scope: Scope, who: str, stage: Stage) -> Action | None:
    if not (scope.flag(of, "traffic", True) and scope.flag(of, "sensors", True)):
        raise NotTakenError(of, "an entity that traffic or sensors do not see is not taken")
    return None
