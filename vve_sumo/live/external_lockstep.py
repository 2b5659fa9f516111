"""An external controller in a drive in lockstep: the wires of a rig opened, and what stands in the controller's place.

It joins a rig to `drive.brain`; it must not know how a drive is run. A link of another make, such as one that alters
what is on the wires, takes the place of `open_link`'s.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from vve_sumo.drive.brain import ExternalController, Link, external_controller
from vve_sumo.drive.resolved_scenario import DEFAULT_EPOCH, ResolvedScenario
from vve_sumo.errors import ConfigError
from vve_sumo.live.brain_link import WiredLink, key_of, needs_ego, needs_signals, open_setpoints, wired_sensors
from vve_sumo.live.outputs import OutputWire, opened
from vve_sumo.pose.sources import Source
from vve_sumo.rig.schema import Rig
from vve_sumo.wire.outputs import Context
from vve_sumo.world.intersections import intersections


def open_wires(rig: Rig, resolved: ResolvedScenario, key: bytes) -> tuple[list[OutputWire], Source | None]:
    """Open all wires of a rig, and the port of setpoints if it has one; raises VveError naming what cannot be opened.

    `key` is that of `key_of`.
    """
    at_signals = intersections(resolved.network.path) if needs_signals(rig) else ()
    frame = resolved.map_frame
    context = Context(resolved.vehicle, frame.projection, frame.offset, intersections=at_signals, key=key)
    wires = opened([output.model_dump(mode="json") for output in rig.outputs], context)
    try:
        return wires, open_setpoints(rig.brain, key) if rig.brain.kind == "setpoints" else None
    except BaseException:
        for wire in wires:
            wire.outlet.close()
        raise


def open_link(rig: Rig, resolved: ResolvedScenario, key: bytes) -> WiredLink:
    """Open the link of a rig, as `open_wires` does."""
    return WiredLink(*open_wires(rig, resolved, key), rig.brain.deadline_s)


def external_controller_over(link: Link, rig: Rig, resolved: ResolvedScenario, working: Path) -> ExternalController:
    """Return the external controller at the end of a link, for `drive.run.run`; every tick waits for its answer.

    Raises ConfigError for a key file that cannot be read.
    """
    key, mounting, wired = key_of(rig.brain, working), resolved.model.mounting, wired_sensors(rig)
    return external_controller(
        rig.brain.kind,
        link,
        resolved.map_frame,
        mounting,
        DEFAULT_EPOCH,
        key,
        waits=True,
        wired=wired,
        needs_signals=needs_signals(rig),
        needs_ego=needs_ego(rig),
    )


@contextmanager
def open_external_controller(
    rig: Rig, resolved: ResolvedScenario, working: Path
) -> Iterator[ExternalController | None]:
    """Give the external controller of a rig for a drive in lockstep; None for a rig without outputs.

    Raises ConfigError where `brain.kind` is `external`: such a controller commands a car in real time. Raises VveError
    for what cannot be opened and for a key file that cannot be read.
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
        yield external_controller_over(link, rig, resolved, working)
    finally:
        link.close()
