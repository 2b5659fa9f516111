"""The kinds of bodies on the virtual road, and what is typical of each. Declarations alone."""

from __future__ import annotations

from typing import Final, NamedTuple

#: every kind; the row of a kind is its number in tables
BODY_KINDS: Final = ("car", "van", "truck", "bus", "motorcycle", "bicycle", "pedestrian", "child")

#: kinds that are a person on foot
PERSONS: Final = frozenset({"pedestrian", "child"})


class Typical(NamedTuple):
    """What nobody declares of a body of a kind."""

    length: float  #: along the way it faces [m]
    width: float  #: without mirrors [m]
    height: float  #: [m]
    mass: float  #: [kg]
    radar_cross_section: float  #: mean at 77 GHz [m2]


#: By kind. Cars, vans, lorries, buses and motorcycles of ordinary size, as SUMO's vehicle classes have them (a van as a
#: Sprinter or Transit). The others cover about as much ground as the dummies that Euro NCAP tests with: a bicycle with
#: its rider, an adult and a child in mid-stride, the stride along the way they go. Heights and masses are assumptions.
#: So are radar cross sections, of the usual order of magnitude: car 10, lorry 100 (Skolnik, "Introduction to Radar
#: Systems", 3rd ed., table 2.1: car 100, pickup truck 200 at microwaves; at 77 GHz and close range cars are measured
#: near 10), two-wheelers and people as in Euro NCAP's targets, a child half the surface of an adult.
TYPICAL: Final = {
    "car": Typical(4.5, 1.8, 1.5, 1500.0, 10.0),
    "van": Typical(5.9, 2.0, 2.3, 2500.0, 30.0),
    "truck": Typical(7.1, 2.4, 3.5, 8000.0, 100.0),
    "bus": Typical(12.0, 2.5, 3.2, 12000.0, 100.0),
    "motorcycle": Typical(2.2, 0.9, 1.6, 280.0, 5.0),
    "bicycle": Typical(1.9, 0.6, 1.7, 90.0, 2.0),
    "pedestrian": Typical(0.6, 0.5, 1.7, 75.0, 0.5),
    "child": Typical(0.5, 0.35, 1.2, 25.0, 0.25),
}


def number_of(kind: str) -> int:
    """Return the number of a kind in tables; raises ValueError for what is no kind."""
    return BODY_KINDS.index(kind)
