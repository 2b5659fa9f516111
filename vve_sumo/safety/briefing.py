"""Roles and checklists of a test day as data, and which of them a rig asks for.

Reads `briefing.toml` beside it. Must not know a rig: what a rig has comes as words.
"""

from __future__ import annotations

import functools
from collections.abc import Collection
from pathlib import Path
from typing import Final

from pydantic import Field

from vve_sumo.config_file import Name, Table, read
from vve_sumo.safety.hazard_trace import Many, Names

FILE: Final = Path(__file__).parent / "briefing.toml"


class Conditional(Table):
    """What is there for some rigs alone."""

    if_: Names = Field(default=(), alias="if")
    unless: Names = ()

    def applies(self, features: Collection[str]) -> bool:
        """Return whether a rig with these features asks for it."""
        return all(one in features for one in self.if_) and not any(one in features for one in self.unless)


class Role(Conditional):
    """Who does what on a test day."""

    id: Name
    title: Name
    does: Name
    must_not: Name
    knows: Name


class Item(Conditional):
    """A line that somebody signs."""

    text: Name


class Checklist(Table):
    """Lines that are signed together."""

    id: Name
    title: Name
    items: Many[Item]


class Briefing(Table):
    """Roles and checklists of all rigs."""

    roles: Many[Role]
    checklists: Many[Checklist]

    def of(self, features: Collection[str]) -> Briefing:
        """Return what a rig with these features asks for."""
        lists = [
            one.model_copy(update={"items": tuple(item for item in one.items if item.applies(features))})
            for one in self.checklists
        ]
        roles = tuple(role for role in self.roles if role.applies(features))
        return self.model_copy(update={"roles": roles, "checklists": tuple(lists)})


@functools.cache
def briefing() -> Briefing:
    """Return the shipped roles and checklists."""
    return Briefing.model_validate(read(FILE, "briefing"))
