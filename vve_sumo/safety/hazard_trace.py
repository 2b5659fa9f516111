"""The hazard analysis as data: losses, hazards, constraints, controllers, unsafe control actions, residual risks.

Reads `hazards.toml` beside it. Must not know whether the code and the tests that it names are there: tests/safety asks.
"""

from __future__ import annotations

import functools
from pathlib import Path
from typing import Annotated, Final, Literal, TypeVar

from pydantic import Field

from vve_sumo.config_file import Name, Table, read

FILE: Final = Path(__file__).parent / "hazards.toml"
#: what stands for a person in `held`, before the role's name
PERSON: Final = "person:"
#: what an action may be shown by, besides a test of pytest, and where it is described
SHOWN_BY: Final = {"matrix:": "faults.md", "hunt:": "hunt.md", "certify:": "certify.md"}
#: the controlled process in the links of the control structure
CAR: Final = "car"

M = TypeVar("M")
#: an array of a file
Many = Annotated[tuple[M, ...], Field(strict=False)]
Names = Annotated[tuple[Name, ...], Field(strict=False)]


class Loss(Table):
    """What must not come about."""

    id: Name
    text: Name


class Hazard(Table):
    """A state of the car and its surroundings that leads to a loss in the worst case."""

    id: Name
    text: Name
    losses: Names


class Constraint(Table):
    """What the whole system has to hold so that hazards do not come about."""

    id: Name
    text: Name
    hazards: Names


class Controller(Table):
    """Who commands something in the loop."""

    id: Name
    name: Name
    kind: Name  #: person, program, or whose program
    does: Name  #: its control actions
    at: Annotated[tuple[int, int], Field(strict=False)]  #: column and row in the picture of the control structure


class Link(Table):
    """What goes from one controller to another, or to or from the car."""

    from_: Name = Field(alias="from")
    to: Name
    what: Name


class UnsafeAction(Table):
    """A control action that leads to a hazard, with what holds it and what shows that it is held."""

    id: Name
    controller: Name
    action: Name
    way: Literal["not given", "given", "wrong time", "wrong duration"]
    text: Name
    hazards: Names
    constraints: Names
    held: Names  #: `module:name` of the package, or `person:ROLE`
    shown: Names  #: a node of pytest, or a name after one of `SHOWN_BY`
    drill: Name | None = None  #: place of the documentation that has a person try it
    codes: Names  #: reason codes by which it shows


class ResidualRisk(Table):
    """What remains, with its figures."""

    id: Name
    hazards: Names
    text: Name
    source: Name  #: page that states the figures
    figures: Names  #: words that stand so in the source
    remains: Name


class HazardTrace(Table):
    """The whole analysis."""

    losses: Many[Loss]
    hazards: Many[Hazard]
    constraints: Many[Constraint]
    controllers: Many[Controller]
    links: Many[Link]
    actions: Many[UnsafeAction]
    residuals: Many[ResidualRisk]

    def name_of(self, controller: str) -> str:
        """Return a controller's name by its id."""
        return next(one.name for one in self.controllers if one.id == controller)


@functools.cache
def hazard_trace() -> HazardTrace:
    """Return the shipped analysis."""
    return HazardTrace.model_validate(read(FILE, "hazards"))
