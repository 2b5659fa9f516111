"""Puts the actors that a scenario moves onto SUMO's street, so that its traffic sees them on every lane they cut.

The body that radar and contact tests see is the player's own box. What traffic sees are ghosts, as where the ego leaves
its line of lanes: SUMO drives over persons on a lane for cars, and takes a vehicle to lie along one lane only. Must not
know why a player is where it is.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Final

from vve_sumo.geometry import Box
from vve_sumo.values import ActorState
from vve_sumo.world.ego_sync import MAX_SPEED
from vve_sumo.world.lanes import Cut, Lanes, cuts
from vve_sumo.world.proxies import EGO_PROXY_TYPE, ProxyVehicles
from vve_sumo.world.surroundings import cross_section

#: As radar sees them, where SUMO has another word for the kind.
SUMO_CLASSES: Final = {"car": "passenger", "van": "delivery"}

#: Half way round the Earth: no map is larger [m].
MAX_COORDINATE: Final = 2e7


def box_of(actor: ActorState) -> Box:
    """Return the ground that a player covers."""
    return Box(actor.x, actor.y, actor.heading, actor.length, actor.width)


class ScenarioActors:
    """The players on the street and the ghosts by which SUMO's traffic sees each."""

    def __init__(self, lanes: Lanes) -> None:
        self._lanes = lanes
        self._on: tuple[ActorState, ...] = ()
        self._shadows: dict[str, Shadow] = {}
        self.ids: frozenset[str] = frozenset()  #: names of the vehicles that stand for players and are no actors

    def place(self, actors: Sequence[ActorState]) -> tuple[ActorState, ...]:
        """Have these on the street at the coming step and no others; return those that were not on it before.

        One whose numbers are not finite, or that is off the Earth, is left out. Raises SUMO's errors.
        """
        self._on = tuple(actor for actor in actors if _somewhere(actor))
        here = {actor.id for actor in self._on}
        for name in [name for name in self._shadows if name not in here]:
            self._shadows.pop(name).leave()
        entered = tuple(actor for actor in self._on if actor.id not in self._shadows)
        for actor in entered:
            self._shadows[actor.id] = Shadow(actor, self._lanes)
        return entered

    def show(self) -> None:
        """Have SUMO's traffic see them at the coming step; raises SUMO's errors."""
        if not self._on and not self.ids:
            return
        for actor in self._on:
            self._shadows[actor.id].show(actor)
        self.ids = frozenset().union(*(shadow.ids for shadow in self._shadows.values()))

    def seen(self) -> Iterator[tuple[ActorState, float]]:
        """Return who is on the street, each with its radar cross section [m2]."""
        for actor in self._on:
            yield actor, cross_section(SUMO_CLASSES.get(actor.kind, actor.kind))


class Shadow:
    """What traffic sees of one player."""

    def __init__(self, actor: ActorState, lanes: Lanes) -> None:
        self._nearby = lanes.nearby(box_of(actor).radius)
        self._ghosts = ProxyVehicles(lanes, f"{EGO_PROXY_TYPE}.{actor.id}")

    @property
    def ids(self) -> frozenset[str]:
        """Names of the vehicles that stand for the player."""
        return self._ghosts.ids

    def show(self, actor: ActorState) -> None:
        """Cover the lanes that the player will cut; raises SUMO's errors."""
        self._ghosts.cover(box_of(actor), min(actor.speed, MAX_SPEED), self._cut)

    def leave(self) -> None:
        """Take it off the street; raises SUMO's errors."""
        self._ghosts.leave()

    def _cut(self, box: Box) -> dict[str, Cut]:
        return cuts(box, self._nearby.close(box))


def _somewhere(actor: ActorState) -> bool:
    """Whether it is at a place on Earth, facing some way at some speed."""
    known = math.isfinite(actor.heading) and math.isfinite(actor.speed)
    return known and abs(actor.x) <= MAX_COORDINATE and abs(actor.y) <= MAX_COORDINATE
