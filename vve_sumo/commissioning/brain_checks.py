"""The doctor's checks of an external controller: the port and the key of its setpoints, and the outgoing wires.

What is opened is closed at once, and nothing is sent.
"""

from __future__ import annotations

from pathlib import Path

from vve_sumo.commissioning.findings import Check
from vve_sumo.live.brain_link import key_of, open_setpoints
from vve_sumo.live.outputs import opened
from vve_sumo.rig.resolve import vehicle_of
from vve_sumo.rig.schema import Rig
from vve_sumo.wire.outputs import Context


def setpoints(rig: Rig, working: Path) -> Check:
    """Return where setpoints are heard, and of whom; raises VveError naming the key that is wrong."""
    brain = rig.brain
    key = key_of(brain, working)
    signed = ", signed" if key else ""
    open_setpoints(brain, key).close()
    return Check("setpoints", f"{brain.address} port {brain.port}, of {brain.source or 'this machine'}{signed}")


def outputs(rig: Rig) -> Check:
    """Return which wires go out; raises VveError naming the one that cannot be opened."""
    for wire in opened([output.model_dump(mode="json") for output in rig.outputs], Context(vehicle_of(rig), "")):
        wire.outlet.close()
    return Check("outputs", ", ".join(output.kind for output in rig.outputs))
