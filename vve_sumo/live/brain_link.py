"""The way to an external controller and back over real sockets, lines and buses, from the tables of a rig.

It opens what the rig names; it must not know what a brain does, nor how a drive is run.
"""

from __future__ import annotations

import math
import select
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from vve_sumo.errors import ConfigError
from vve_sumo.live.channel import Channel
from vve_sumo.live.outputs import OutputWire
from vve_sumo.pose.sources import Source, open_udp
from vve_sumo.rig.connections import Brain as RigBrain
from vve_sumo.rig.schema import Rig
from vve_sumo.wire.outputs import KINDS
from vve_sumo.wire.sample import Sample
from vve_sumo.wire.sample_codec import encode_sample
from vve_sumo.wire.setpoints import is_setpoint

KEY_LENGTH: Final = 32  #: [bytes]
#: how long lockstep waits for a brain's answer [s]; it may be a debugger's first line
ANSWER_TIMEOUT: Final = 10.0


class ChannelLink:
    """Hands samples to the process of the outgoing wires, and hears the setpoints on one socket; never waits."""

    def __init__(self, outputs: Channel, setpoints: Source | None, t0: float, *, actors: bool) -> None:
        """`t0` is the monotonic second of drive time 0; `actors`: whether some wire tells of the actors."""
        self._outputs, self._setpoints, self._t0, self._actors = outputs, setpoints, t0, actors

    def send(self, sample: Sample) -> None:
        """Hand over a sample; one for which there is no room is lost, and the wires turn invalid by themselves."""
        self._outputs.send(encode_sample(sample, actors=self._actors))

    def receive(self, _now: float, _wait: bool) -> Sequence[tuple[float, bytes]]:
        """Return the datagrams that have come, dated by the kernel's stamps."""
        heard = () if self._setpoints is None else self._setpoints.receive()
        return [(stamp - self._t0, data) for stamp, data in heard]

    def faults(self) -> tuple[str, ...]:
        """Reason codes: the wires' process is gone, or somebody else sends setpoints."""
        gone = ("outputs_gone",) if self._outputs.closed else ()
        return gone + (
            () if self._setpoints is None else tuple(_OF_SETPOINTS[c] for c in self._setpoints.sender_faults())
        )

    def close(self) -> None:
        """Close both ends."""
        self._outputs.close()
        if self._setpoints is not None:
            self._setpoints.close()


#: reason codes of strangers on the setpoints' port, by those of the receiver's
_OF_SETPOINTS: Final = {"pose_two_senders": "setpoint_two_senders", "pose_foreign_sender": "setpoint_foreign_sender"}


def key_of(brain: RigBrain, working: Path) -> bytes:
    """Return the key that signs setpoints; empty where the rig names none. Raises ConfigError naming the key."""
    if brain.key_file is None:
        return b""
    file = working / brain.key_file
    try:
        key = bytes.fromhex(file.read_text(encoding="ascii").strip())
    except OSError as error:
        raise ConfigError(f"brain.key_file: {file}: {error.strerror}, expected a file of the key") from None
    except ValueError:
        raise ConfigError(f"brain.key_file: {file}: expected {2 * KEY_LENGTH} hexadecimal digits alone") from None
    if len(key) != KEY_LENGTH:
        raise ConfigError(f"brain.key_file: {file}: expected {2 * KEY_LENGTH} hexadecimal digits, got {2 * len(key)}")
    return key


def open_setpoints(brain: RigBrain, key: bytes) -> Source:
    """Open the port of setpoints; raises RigError naming the key of the rig.

    The brain is the first sender of which a whole setpoint comes, signed where there is a `key` of `key_of`.
    """
    return open_udp(brain.address, brain.port, brain.source, "brain", genuine=lambda data: is_setpoint(data, key))


def refuse_controller(rig: Rig, controller: str | None) -> None:
    """Raise ConfigError where a controller is named beside a brain that decides in its place."""
    if controller is not None and rig.brain.kind != "own":
        raise ConfigError(f"--controller: the rig's brain decides (brain.kind is {rig.brain.kind!r}); leave it out")


class WiredLink:
    """Sends samples on all wires of a rig, and hears the setpoints on one socket."""

    def __init__(self, wires: Sequence[OutputWire], setpoints: Source | None, timeout: float = ANSWER_TIMEOUT) -> None:
        """`timeout`: how long the answer to a sample is waited for [s]."""
        self._wires, self._setpoints, self._timeout = tuple(wires), setpoints, timeout
        self._deadline = math.inf

    def send(self, sample: Sample) -> None:
        """Send a sample on every wire on which something is due."""
        for wire in self._wires:
            wire.outlet.send(wire.output.step(sample))
        self._deadline = time.monotonic() + self._timeout

    def receive(self, now: float, wait: bool) -> Sequence[tuple[float, bytes]]:
        """Return the datagrams that have come; with `wait`, those until the first.

        They are dated `now` [s], for in lockstep no time passes while a brain thinks. Raises TimeoutError where nothing
        more came within the time-out, counted from the newest sample.
        """
        if self._setpoints is None:
            return ()
        while True:
            came = [(now, data) for _stamp, data in self._setpoints.receive()]
            if came or not wait:
                return came
            left = self._deadline - time.monotonic()
            if left <= 0.0:
                raise TimeoutError(f"no answer within {self._timeout:g} s (brain.deadline_s)")
            select.select([self._setpoints], [], [], left)

    def close(self) -> None:
        """Close all that is open."""
        if self._setpoints is not None:
            self._setpoints.close()
        for wire in self._wires:
            wire.outlet.close()


def needs_signals(rig: Rig) -> bool:
    """Return whether one of a rig's wires carries what the signals show."""
    return any(KINDS[one.kind].needs_signals for one in rig.outputs)


def needs_ego(rig: Rig) -> bool:
    """Return whether one of a rig's wires tells others of the ego, also while the outputs are invalid."""
    return any(KINDS[one.kind].needs_ego for one in rig.outputs)


def wired_sensors(rig: Rig) -> frozenset[str]:
    """Return the names of the lidars, cameras, V2X receivers and senses of signals that a rig's wires carry."""
    carried = {"points", "objects", "stations", "stop_lines"}
    return frozenset(one.sensor for one in rig.outputs if one.sensor and carried & {*KINDS[one.kind].contents})
