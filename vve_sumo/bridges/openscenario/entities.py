"""The entities of a scenario: who is the ego, of which kind and size the others are.

Knows catalogs; it must not know places or actions.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Final

from vve_sumo.bridges.openscenario.document import Document
from vve_sumo.bridges.openscenario.parameters import Scope
from vve_sumo.bridges.scenario_import.not_taken import NotTakenError
from vve_sumo.bridges.scenario_import.xml_tree import Element
from vve_sumo.errors import ConfigError
from vve_sumo.values import EGO

#: names of the vehicle under test, in lower case, in the order of their rank
EGO_NAMES: Final = ("ego", "vut", "hero", "host", "egovehicle", "ego_vehicle")
#: kinds of actors by vehicleCategory
KINDS: Final = {
    "car": "car",
    "van": "van",
    "truck": "truck",
    "semitrailer": "truck",
    "bus": "bus",
    "motorbike": "motorcycle",
    "bicycle": "bicycle",
}
#: types of entities by the names of their elements
TYPES: Final = {"Vehicle": "vehicle", "Pedestrian": "pedestrian", "MiscObject": "miscellaneous"}
#: below this height a pedestrian is a child [m]
CHILD_HEIGHT: Final = 1.4


@dataclass(frozen=True, slots=True)
class Entity:
    """One entity of a scenario."""

    name: str  #: in the file
    id: str  #: in the scenario: `ego`, or the name with letters that an id may have
    element: Element
    kind: str
    length: float  #: [m]
    width: float  #: [m]
    reference: float  #: from its reference point forward to its centre [m]
    type: str  #: as the standard's conditions name it: vehicle, pedestrian or miscellaneous
    trailer: Element | None  #: that it pulls


def slug(name: str, fallback: str = "unnamed") -> str:
    """Return a name as an id may be."""
    text = re.sub(r"[^A-Za-z0-9_-]+", "_", name).strip("_")[:48]
    return text if re.match(r"[A-Za-z]", text) else f"{fallback}_{text}".rstrip("_")


def read_entities(document: Document, ego: str | None, notes: list[str]) -> list[Entity]:
    """Return the entities, the ego first; raises ConfigError where there is none, or none of the name that is given.

    Without a name the ego is the entity whose name says so, else the first with a controller, else the first vehicle.
    """
    holder = document.root.child("Entities")
    objects = [] if holder is None else holder.all("ScenarioObject")
    names = [document.scope.text(one, "name") for one in objects]
    if not objects:
        raise ConfigError(f"{document.file}: expected entities, found no ScenarioObject")
    chosen = _chosen(document, objects, names, ego, notes)
    taken: set[str] = {EGO}
    found = []
    for name, one in zip(names, objects, strict=True):
        own = EGO if name == chosen else slug(name)
        while own in taken and name != chosen:
            own += "_"
        taken.add(own)
        found.append(_entity(document, one, name, own))
    return sorted(found, key=lambda entity: entity.id != EGO)


def _chosen(document: Document, objects: list[Element], names: list[str], ego: str | None, notes: list[str]) -> str:
    if ego is not None:
        if ego not in names:
            raise ConfigError(f"{document.file}: --ego {ego}: no such entity, expected one of {', '.join(names)}")
        return ego
    ranked = [name for wanted in EGO_NAMES for name in names if name.lower() == wanted]
    if ranked:
        return ranked[0]
    controlled = [name for name, one in zip(names, objects, strict=True) if one.child("ObjectController") is not None]
    first = (controlled or names)[0]
    why = "the first with a controller" if controlled else "the first entity"
    notes.append(f"ego: {first!r}, {why}; --ego NAME takes another")
    return first


def _entity(document: Document, element: Element, name: str, own: str) -> Entity:
    try:
        of, scope = document.resolved(element, document.scope, *TYPES)
        kind = "car"
        box = of.child("BoundingBox")
        size, centre = (None, None) if box is None else (box.child("Dimensions"), box.child("Center"))
        if of.tag == "Vehicle":
            category = scope.text(of, "vehicleCategory", "car")
            if category not in KINDS:
                raise NotTakenError(of, f"vehicleCategory: expected {', '.join(KINDS)}, got {category!r}")
            kind = KINDS[category]
        elif of.tag == "Pedestrian":
            height = 1.8 if size is None else scope.number(size, "height", 1.8)
            kind = "child" if height < CHILD_HEIGHT else "pedestrian"
        length = 4.6 if size is None else scope.number(size, "length")
        width = 1.8 if size is None else scope.number(size, "width")
        reference = 0.0 if centre is None else scope.number(centre, "x")
        return Entity(name, own, element, kind, length, width, reference, TYPES[of.tag], _trailer(of, scope))
    except NotTakenError as error:
        raise ConfigError(str(error)) from None


def _trailer(of: Element, scope: Scope) -> Element | None:
    """Return the trailer of a vehicle; a reference to no entity, as catalogs have it for parameters, is none."""
    trailer = of.child("Trailer")
    reference = None if trailer is None else trailer.child("TrailerRef")
    return trailer if reference is None or scope.text(reference, "entityRef") else None
