"""Adds to the tables of earlier layouts what later layouts hold, as far as it follows from the rest.

Works on tables alone.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np
import pyarrow as pa

from vve_sumo.body_kinds import BODY_KINDS, TYPICAL, number_of
from vve_sumo.record.layout import SCHEMAS

#: Kind of an actor by its radar cross section [m2], which a drive sets by the actor's kind. A bus has that of a truck.
_KIND_OF_CROSS_SECTION: Final = {
    0.25: "child",
    0.5: "pedestrian",
    1.0: "bicycle",
    2.0: "bicycle",
    3.0: "motorcycle",
    5.0: "motorcycle",
    30.0: "van",
    100.0: "truck",
}


def with_kinds(actors: pa.Table, settings: Mapping[str, Any]) -> pa.Table:
    """Return a table of actors of a layout before 9 with the columns of height and kind.

    The kind is the one that the scenario's settings declare, else it follows from the actor's name (`bus.15`) or its
    radar cross section; the height follows from the kind.
    """
    declared = {one["id"]: one["kind"] for one in settings.get("actors", ())}
    declared |= {one["id"]: "car" for one in settings.get("obstacles", ())}
    names, sections = actors["actor"].to_pylist(), actors["radar_cross_section_m2"].to_pylist()
    kinds = [declared.get(name) or _kind_of(name, section) for name, section in zip(names, sections, strict=True)]
    heights = np.array([TYPICAL[kind].height for kind in kinds], np.float64)
    numbers = np.array([number_of(kind) for kind in kinds], np.int8)
    schema = SCHEMAS["actors"]
    actors = actors.append_column(schema.field("height_m"), pa.array(heights))
    return actors.append_column(schema.field("kind"), pa.array(numbers))


def _kind_of(name: str, cross_section: float) -> str:
    named = name.partition(".")[0]
    return named if named in BODY_KINDS else _KIND_OF_CROSS_SECTION.get(cross_section, "car")
