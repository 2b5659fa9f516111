"""The kinds of bodies on the virtual road, and what is typical of each. Declarations alone."""

from __future__ import annotations

from typing import Final, NamedTuple

#: every kind; the row of a kind is its number in tables
BODY_KINDS: Final = ("car", "van", "truck", "bus", "motorcycle", "bicycle", "pedestrian", "child")

#: kinds that are a person on foot
PERSONS: Final = frozenset({"pedestrian", "child"})


class Typical(NamedTuple):
    """What nobody declares of a body of a kind."""

    height: float  #: [m]
    mass: float  #: [kg]


#: by kind; assumptions of the usual size
TYPICAL: Final = {
    "car": Typical(1.5, 1500.0),
    "van": Typical(2.3, 2500.0),
    "truck": Typical(3.5, 8000.0),
    "bus": Typical(3.2, 12000.0),
    "motorcycle": Typical(1.6, 280.0),
    "bicycle": Typical(1.7, 90.0),
    "pedestrian": Typical(1.7, 75.0),
    "child": Typical(1.2, 25.0),
}


def number_of(kind: str) -> int:
    """Return the number of a kind in tables; raises ValueError for what is no kind."""
    return BODY_KINDS.index(kind)
