"""The way to a brain under test and back, with a fault on some of its wires, and a log of what came at every tick.

It sits between the encoders and the outlets, so that a fault is on the wire and nowhere else. It must not know what a
fault is required to cause.
"""

from __future__ import annotations

import select
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

from vve_sumo.certify.phantoms import ScanFault
from vve_sumo.pose.sources import Source
from vve_sumo.wire.datagrams import SetpointDatagram, decode_setpoint
from vve_sumo.wire.faults import WireFault
from vve_sumo.wire.outlets import Outlet
from vve_sumo.wire.outputs import Output
from vve_sumo.wire.sample import Sample
from vve_sumo.wire.signature import without_tag

#: between two checks of whether the brain still computes [s]
POLL_INTERVAL: Final = 0.002
#: times of ticks are compared without their last bits [s]
_SLACK: Final = 1e-6


class FaultyWire(NamedTuple):
    """One outgoing wire and what may go wrong on it."""

    output: Output
    outlet: Outlet[Any]
    fault: WireFault | None  #: of its bytes or frames; None: nothing goes wrong on it
    show: ScanFault | None = None  #: of what it shows; None: what is there


class Answer(NamedTuple):
    """A setpoint of the brain as it came over the wire."""

    time: float  #: of the tick in which it came [s of drive time]
    answers: int  #: sequence of the radar datagram that it answers
    newest: int  #: sequence of the newest one that had been due by then
    steering: float  #: road-wheel angle [rad], left positive
    acceleration: float  #: [m/s2]


@dataclass(frozen=True, slots=True)
class Window:
    """When a fault is there [s of drive time]."""

    begins: float
    ends: float

    def holds(self, now: float) -> bool:
        """Whether it is there at a time."""
        return self.begins - _SLACK <= now < self.ends - _SLACK


class FaultLink:
    """`drive.brain`'s two ends: `send` on all wires, `receive` what the brain answers; `answers` is the log."""

    def __init__(
        self,
        wires: Sequence[FaultyWire],
        setpoints: Source,
        window: Window | None,
        quiet: Callable[[], bool],
        timeout: float,
        key: bytes = b"",
    ) -> None:
        """`quiet` says whether the brain will say nothing more before something new comes.

        `timeout`: how long the answer to a sample is waited for [s]. `key`: that setpoints are signed with.
        """
        self._wires, self._setpoints, self._window, self._quiet = tuple(wires), setpoints, window, quiet
        self._timeout, self._key = timeout, key
        self._sequence = 0
        self._answered = True  # false once the brain has let its whole time pass
        self.answers: list[Answer] = []

    def send(self, sample: Sample) -> None:
        """Send a sample on every wire on which something is due, altered where a fault is there."""
        active = self._window is not None and self._window.holds(sample.drive_time)
        self._sequence = sample.sequence
        for wire in self._wires:
            portions = wire.output.step(sample if wire.show is None else wire.show.step(sample, active))
            if wire.fault is not None:
                portions = wire.fault.step(sample.drive_time, portions, active)
            wire.outlet.send(portions)

    def receive(self, now: float, wait: bool) -> Sequence[tuple[float, bytes]]:
        """Return the datagrams that have come; with `wait`, those until the first.

        Before a fault is there, a brain is waited for as in any drive in lockstep. From then on silence may be what is
        right, and is waited for until the brain is quiet.
        """
        faulty = self._window is not None and now >= self._window.begins - _SLACK
        deadline = time.monotonic() + self._timeout
        while True:
            # In this order: what a brain says before it falls quiet has come when it is quiet.
            quiet = wait and (faulty or not self._answered) and self._quiet()
            came = [data for _stamp, data in self._setpoints.receive()]
            left = deadline - time.monotonic()
            if came or not wait or quiet or left <= 0.0:
                self._answered &= bool(came) or left > 0.0
                self._note(now, came)
                return [(now, data) for data in came]
            select.select([self._setpoints], [], [], POLL_INTERVAL if faulty or not self._answered else left)

    def _note(self, now: float, came: Sequence[bytes]) -> None:
        for data in came:
            body = without_tag(data, self._key)
            read = None if body is None else decode_setpoint(body)
            if isinstance(read, SetpointDatagram):
                self.answers.append(Answer(now, read.answers, self._sequence, read.steering, read.acceleration))

    def close(self) -> None:
        """Close all that is open."""
        self._setpoints.close()
        for wire in self._wires:
            wire.outlet.close()
