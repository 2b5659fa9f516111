"""Puts the actors that a scenario moves on the virtual road, so that traffic sees them on every lane that they cut.

Radar and contact tests see the actor's own box. Traffic sees proxy vehicles, as for an ego that leaves its line of
lanes: SUMO's drivers drive over persons on a lane for cars, and SUMO assumes that a vehicle lies along one lane only.
Must not know why an actor is where it is.
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
from vve_sumo.world.surroundings import ActorBody, body_of_kind

#: Half the Earth's circumference [m]: no map is larger.
MAX_COORDINATE: Final = 2e7


def box_of(actor: ActorState) -> Box:
    """Return the box of an actor."""
    return Box(actor.x, actor.y, actor.heading, actor.length, actor.width)


class ScenarioActors:
    """The scenario's actors on the virtual road, and the proxies by which SUMO's traffic sees each."""

    def __init__(self, lanes: Lanes) -> None:
        self._lanes = lanes
        self._on: tuple[ActorState, ...] = ()
        self._shadows: dict[str, ActorProxies] = {}
        self.ids: frozenset[str] = frozenset()  #: names of the actors' proxies

    def place(self, actors: Sequence[ActorState]) -> tuple[ActorState, ...]:
        """Have exactly these actors on the road at the coming step; return those that were not on it before.

        An actor whose numbers are not finite or beyond MAX_COORDINATE is left out. Raises SUMO's errors.
        """
        if not (actors or self._on or self._shadows):
            return ()
        self._on = tuple(actor for actor in actors if _somewhere(actor))
        here = {actor.id for actor in self._on}
        for name in [name for name in self._shadows if name not in here]:
            self._shadows.pop(name).leave()
        entered = tuple(actor for actor in self._on if actor.id not in self._shadows)
        for actor in entered:
            self._shadows[actor.id] = ActorProxies(actor, self._lanes)
        return entered

    def show(self) -> None:
        """Place the actors' proxies for the coming step; raises SUMO's errors."""
        if not self._on and not self.ids:
            return
        for actor in self._on:
            self._shadows[actor.id].show(actor)
        self.ids = frozenset().union(*(shadow.ids for shadow in self._shadows.values()))

    def on_road(self) -> Iterator[tuple[ActorState, ActorBody]]:
        """Yield the actors on the road, each with its body."""
        for actor in self._on:
            yield actor, body_of_kind(actor.kind, actor.length, actor.width)


class ActorProxies:
    """The proxies of one actor."""

    def __init__(self, actor: ActorState, lanes: Lanes) -> None:
        self._lanes, self._reach = lanes, box_of(actor).radius
        self._nearby = lanes.nearby(self._reach)
        self._ghosts = ProxyVehicles(lanes, f"{EGO_PROXY_TYPE}.{actor.id}")

    @property
    def ids(self) -> frozenset[str]:
        """Names of the actor's proxies."""
        return self._ghosts.ids

    def show(self, actor: ActorState) -> None:
        """Place a proxy on each lane that the actor will cut; raises SUMO's errors."""
        box = box_of(actor)
        if box.radius > self._reach:
            # The body of a person grows with the uncertainty of their place.
            self._reach = 2.0 * box.radius
            self._nearby = self._lanes.nearby(self._reach)
        self._ghosts.cover(box, min(actor.speed, MAX_SPEED), self._cut)

    def leave(self) -> None:
        """Remove the actor's proxies; raises SUMO's errors."""
        self._ghosts.leave()

    def _cut(self, box: Box) -> dict[str, Cut]:
        return cuts(box, self._nearby.close(box))


def _somewhere(actor: ActorState) -> bool:
    """Return whether heading and speed are finite and the place is within MAX_COORDINATE."""
    known = math.isfinite(actor.heading) and math.isfinite(actor.speed)
    return known and abs(actor.x) <= MAX_COORDINATE and abs(actor.y) <= MAX_COORDINATE
