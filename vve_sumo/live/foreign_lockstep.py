"""A foreign brain in a drive in lockstep: the wires of a rig opened, and what stands in the controller's place.

It joins a rig to `drive.brain`; it must not know how a drive is run. A link of another make, such as one that alters
what is on the wires, takes the place of `open_link`'s.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Protocol

from vve_sumo.drive.brain import ExternalController, Publisher, SetpointController, virtual_placement
from vve_sumo.drive.resolved_scenario import DEFAULT_EPOCH, ResolvedScenario
from vve_sumo.errors import ConfigError
from vve_sumo.live.brain_link import WiredLink, key_of, open_setpoints
from vve_sumo.live.outputs import opened
from vve_sumo.rig.schema import Rig
from vve_sumo.wire.outputs import Context
from vve_sumo.wire.sample import Sample
from vve_sumo.wire.setpoints import SetpointInbox


class Link(Protocol):
    """The way to a foreign brain and back."""

    def send(self, sample: Sample) -> None:
        """Send a sample on all outgoing wires; neither waits nor raises."""

    def receive(self, now: float, wait: bool) -> Sequence[tuple[float, bytes]]:
        """Return the datagrams that have come by drive time `now` [s], each with its time of arrival [s].

        With `wait`, those until the first; raises TimeoutError, with one line, for a brain that lets its time pass.
        """

    def close(self) -> None:
        """Close all that is open."""


def open_link(rig: Rig, resolved: ResolvedScenario, key: bytes) -> WiredLink:
    """Open all wires of a rig, and the port of setpoints; raises VveError naming what cannot be opened.

    `key` is that of `key_of`.
    """
    context = Context(resolved.vehicle, resolved.map_frame.projection, resolved.map_frame.offset, key=key)
    wires = opened([output.model_dump(mode="json") for output in rig.outputs], context)
    said, setpoints = rig.brain, None
    try:
        if said.kind == "setpoints":
            setpoints = open_setpoints(said, key)
    except BaseException:
        for wire in wires:
            wire.outlet.close()
        raise
    return WiredLink(wires, setpoints, said.deadline_s)


def brain_over(link: Link, rig: Rig, resolved: ResolvedScenario, working: Path) -> ExternalController:
    """Return the brain that is reached over a link, for `drive.run.run`; every tick waits for its answer.

    Raises ConfigError for a key file that cannot be read.
    """
    placement = virtual_placement(resolved.map_frame, resolved.model.mounting, DEFAULT_EPOCH)
    publisher = Publisher(link.send, placement, DEFAULT_EPOCH)
    if rig.brain.kind == "own":
        return ExternalController(publisher)
    inbox = SetpointInbox(DEFAULT_EPOCH, key_of(rig.brain, working))
    return ExternalController(publisher, SetpointController(publisher, link.receive, inbox, waits=True))


@contextmanager
def brain_of(rig: Rig, resolved: ResolvedScenario, working: Path) -> Iterator[ExternalController | None]:
    """Give the brain of a rig for a drive in lockstep; None for a rig without outputs, where nobody is told anything.

    Raises ConfigError for an external brain, which commands a car in real time; VveError for what cannot be opened
    and for a key file that cannot be read.
    """
    if rig.brain.kind == "external":
        raise ConfigError(
            "brain.kind is 'external', expected 'setpoints': in lockstep only a setpoint tells that the brain has "
            "answered; drive this rig live, without --lockstep"
        )
    if not rig.outputs:
        yield None
        return
    link = open_link(rig, resolved, key_of(rig.brain, working))
    try:
        yield brain_over(link, rig, resolved, working)
    finally:
        link.close()
