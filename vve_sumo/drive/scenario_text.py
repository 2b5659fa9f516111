"""Says in lines of text all that a scenario is: road, ego, traffic, signals, controller, faults, actors, what passes.

Reads the scenario and its files; drives nothing, and runs no code of a controller.
"""

from __future__ import annotations

import ast
from pathlib import Path

from vve_sumo import workspace
from vve_sumo.controller import origin
from vve_sumo.drive.resolved_scenario import ResolvedScenario
from vve_sumo.errors import ConfigError
from vve_sumo.scenario import descriptions
from vve_sumo.scenario.road_users import Actor, ParkedObstacle
from vve_sumo.scenario.schema import Control
from vve_sumo.world.network import signals

#: a junction whose middle is this near to the path lies on it [m]
MAX_SIGNAL_DISTANCE = 12.0


def lines(resolved: ResolvedScenario, working: Path) -> list[str]:
    """Return the lines of a scenario's text, without its title."""
    scenario, ego = resolved.scenario, resolved.scenario.ego
    road = f"{scenario.road.network}, path {ego.path} of {resolved.path.length:.0f} m"
    return [
        f"{road}, ego at {descriptions.ego_speed(ego)}, seed {scenario.seed}",
        *special_conditions(resolved, working),
        *map(_standing, scenario.obstacles),
        *(line for actor in scenario.actors for line in _of_actor(actor)),
        f"passes if: {descriptions.passes(scenario.criteria)}",
    ]


def special_conditions(resolved: ResolvedScenario, working: Path) -> list[str]:
    """Return a line for everything besides actors and obstacles that makes the drive another than the usual one.

    The last are the further egos.
    """
    conditions = descriptions.special_conditions(resolved.scenario)
    manoeuvre = _manoeuvre(resolved.scenario.controller, working)
    found = ", ".join(f"{at:.0f} m" for at in signals_along_path(resolved))
    sensed = any(settings.sees_signals() for settings in resolved.sensors().values())
    shown = "a sensor shows them" if sensed else "no sensor shows them"
    return [
        *([f"manoeuvre: {manoeuvre}"] if manoeuvre else []),
        *([f"signals at {found} of the path: the traffic obeys, {shown}"] if found else []),
        *conditions,
        *(_further(resolved, other) for other in resolved.others),
    ]


def signals_along_path(resolved: ResolvedScenario) -> list[float]:
    """Return where along the path [m] junctions with signals lie on it, in order."""
    path, found = resolved.path, []
    for x, y in signals(resolved.network.path).values():
        foot = path.project(x, y)
        if abs(foot.d) <= MAX_SIGNAL_DISTANCE and 0.0 <= foot.s <= path.length:
            found.append(foot.s)
    return sorted(found)


def _manoeuvre(control: Control, working: Path) -> str:
    """Return what another controller than the usual one does, as the first sentence of its file says."""
    if control.name == type(control)().name:
        return ""
    try:
        place = origin(control.name, workspace.controller_folders(working))
        file = place.file(place.main)
        text = ast.get_docstring(ast.parse(file.read_text(encoding="utf-8"))) if file else None
    except (ConfigError, OSError, SyntaxError, ValueError):
        return ""
    return " ".join((text or "").partition("\n\n")[0].split())


def _further(first: ResolvedScenario, other: ResolvedScenario) -> str:
    """Return in what a further ego differs from the first one."""
    own, ones = _of_ego(other), _of_ego(first)
    return f"ego {other.ego_id!r}: {', '.join(part for part in own if part not in ones) or 'as the first'}"


def _of_ego(one: ResolvedScenario) -> list[str]:
    ego = one.scenario.ego
    path = f"path {ego.path} of {one.path.length:.0f} m"
    start = descriptions.rolling_start(ego) or "begins at rest"
    return [ego.vehicle, path, f"{ego.speed_mps:g} m/s", start, one.scenario.controller.name]


def _standing(one: ParkedObstacle) -> str:
    what = f"{one.id!r}" if one.kind == "car" else f"{one.kind} {one.id!r}"
    beside = f", {descriptions.beside(one.offset_m)}" if one.offset_m else ""
    return f"{what} stands at {one.at_m:g} m{beside}"


def _of_actor(actor: Actor) -> list[str]:
    """Return how an actor enters, and each of its events."""
    name, when = descriptions.name(actor), descriptions.condition(actor.enters)
    entered = f"{name} {descriptions.entrance(actor)}" + (f" when {when}" if when else "")
    events = (
        f"{name}: {descriptions.condition(event.when) or 'at once'}, {descriptions.action(event)}"
        for event in actor.events
    )
    actions = (
        f"{name}: {descriptions.trigger(action.when) or 'at once'}, {descriptions.story_action(action)}"
        for action in (actor.story.actions if actor.story is not None else ())
    )
    return [entered, *events, *actions]
