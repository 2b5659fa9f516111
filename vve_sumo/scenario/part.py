"""Lays a scenario onto a part of its ego's path: every distance along the path then counts from the part's start.

Knows tables as TOML gives them, with quantities in the units of their keys; no files, no lot and no car.
"""

from __future__ import annotations

import copy
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

from vve_sumo.errors import ConfigError
from vve_sumo.scenario.road_users import Actor
from vve_sumo.scenario.schema import Scenario


class ScenarioPart(NamedTuple):
    """A scenario on a part of its path."""

    table: dict[str, Any]  #: of the scenario's file
    left_out: tuple[str, ...]  #: whoever is placed outside the part, one each, for people to read


def bound_to_the_start(actor: Actor) -> bool:
    """Return whether an actor's motion counts from the drive's start, not from where the ego is.

    Such a motion meets the ego elsewhere where the ego starts later on its path.
    """
    enters = actor.enters
    if (
        enters.drive_s is not None
        or enters.after_s is not None
        or any(e.when.drive_s is not None for e in actor.events)
    ):
        return True
    waits = enters.model_fields_set or (actor.speed_mps == 0.0 and all(e.when.model_fields_set for e in actor.events))
    after_entering = bool(actor.events) and actor.events[0].when.after_s is not None
    return not waits or (after_entering and not enters.model_fields_set)


def on_part(
    scenario: Scenario, table: Mapping[str, Any], begin: float, end: float, path: str, bumper: float
) -> ScenarioPart:
    """Return a scenario's table on the part of its path between two distances along it [m], named `path`.

    Whoever is placed outside the part is left out. An end trigger beyond the part comes where the front bumper, which
    is `bumper` [m] ahead of the rear axle, is at the part's end. Raises ConfigError for a parameter that sets places
    along the path and other keys at once.
    """
    changed: dict[str, Any] = copy.deepcopy(dict(table))
    left_out = tuple(_leave_out(changed, scenario, begin, end))
    for row, key in _places(changed):
        row[key] = round(max(row[key] - begin, 0.0), 6)
    changed["ego"]["path"] = path
    for stretch in changed["ego"].get("corridor", ()):
        if stretch.get("to_m", 0.0) >= end - begin:
            stretch.pop("to_m")
    trigger = changed.get("end_trigger", {})
    if trigger.get("ego_at_m", 0.0) > end - begin + bumper:
        trigger["ego_at_m"] = round(end - begin, 6)
    changed["parameters"] = dict(_parameters(changed, begin))
    if not changed["parameters"]:
        del changed["parameters"]
    return ScenarioPart(changed, left_out)


def _leave_out(table: dict[str, Any], scenario: Scenario, begin: float, end: float) -> Iterator[str]:
    """Take out whoever is placed outside the part; yield a line for each."""
    elsewhere = {actor.id for actor in scenario.actors if actor.path is not None}
    for kind in ("obstacles", "actors", "people"):
        kept = []
        for row in table.get(kind, ()):
            at = row.get("at_m")
            if at is None or row["id"] in elsewhere or begin <= at <= end:
                kept.append(row)
            else:
                yield f"{row['id']}, at {at:g} m of the path"
        if kind in table:
            table[kind] = kept
    rows = table.get("ego", {}).get("corridor", [])
    inside = [one for one in rows if one.get("from_m", 0.0) < end and one.get("to_m", end) > begin]
    if len(inside) < len(rows):
        yield f"{len(rows) - len(inside)} of the corridor's stretches"
    if rows:
        table["ego"]["corridor"] = inside


def _places(table: dict[str, Any]) -> Iterator[tuple[dict[str, Any], str]]:
    """Yield every table with the key of a distance along the ego's path that it states."""
    rows = [(row, "at_m") for kind in ("obstacles", "people") for row in table.get(kind, ())]
    for actor in table.get("actors", ()):
        rows += [(actor, "at_m")] if actor.get("path") is None else []
        rows.append((actor.get("enters", {}), "ego_at_m"))
        rows += [(event.get("when", {}), "ego_at_m") for event in actor.get("events", ())]
    rows += [(one, key) for one in table.get("ego", {}).get("corridor", ()) for key in ("from_m", "to_m")]
    rows.append((table.get("end_trigger", {}), "ego_at_m"))
    yield from ((row, key) for row, key in rows if row.get(key) is not None)


def _parameters(table: dict[str, Any], begin: float) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield the parameters whose keys are still there, the bounds of places along the path counted anew."""
    named = {kind: {row["id"] for row in table.get(kind, ())} for kind in ("obstacles", "actors", "people")}
    along = {actor["id"] for actor in table.get("actors", ()) if actor.get("path") is None}
    for name, parameter in table.get("parameters", {}).items():
        if any(not _is_there(place, named) for place in parameter["sets"]):
            continue
        placed = [_is_place(place, along) for place in parameter["sets"]]
        if any(placed) and not all(placed):
            raise ConfigError(
                f"parameters.{name}.sets: expected only distances along the path or none, got {parameter['sets']}"
            )
        counted = {key: parameter[key] - begin for key in ("min", "max") if any(placed) and key in parameter}
        yield name, {**parameter, **counted}


def _is_there(place: str, named: Mapping[str, set[str]]) -> bool:
    kind, _, rest = place.partition(".")
    return kind not in named or rest.partition(".")[0] in named[kind]


def _is_place(place: str, along: set[str]) -> bool:
    """Return whether a dotted key, such as obstacles.parked_car.at_m, is a distance along the ego's path."""
    first, *_between, last = place.split(".")
    if last == "ego_at_m":
        return True
    if last == "at_m":
        return first != "actors" or place.split(".")[1] in along
    return place.startswith("ego.corridor.") and last in ("from_m", "to_m")
