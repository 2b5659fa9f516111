"""The link to a brain under test and back, with faults on some of its wires, and a log of the answers.

The link lies between the encoders and the outlets, so that a fault affects the wire alone. It must not know which
reaction a fault requires.
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

#: time between two checks whether the brain still computes [s]
POLL_INTERVAL: Final = 0.002
#: times of ticks are compared without their last bits [s]
_SLACK: Final = 1e-6


class FaultyWire(NamedTuple):
    """One outgoing wire and its faults."""

    output: Output
    outlet: Outlet[Any]
    fault: WireFault | None  #: of its bytes or frames; None: no such fault
    scan_fault: ScanFault | None = None  #: of the sensor data that it carries; None: no such fault


class Answer(NamedTuple):
    """A setpoint of the brain, as received."""

    time: float  #: tick of its reception [s of drive time]
    answers: int  #: sequence of the radar datagram that it answers
    newest: int  #: sequence of the newest radar datagram at that time
    steering: float  #: road-wheel angle [rad], left positive
    acceleration: float  #: [m/s2]


@dataclass(frozen=True, slots=True)
class Window:
    """Begin and end of a fault [s of drive time]."""

    begins: float
    ends: float

    def holds(self, now: float) -> bool:
        """Whether the fault is active at a time."""
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
        """`quiet` returns whether the brain is idle and will send nothing before new input.

        `timeout`: longest wait for the answer to a sample [s]. `key`: key of the setpoints' signature.
        """
        self._wires, self._setpoints, self._window, self._quiet = tuple(wires), setpoints, window, quiet
        self._timeout, self._key = timeout, key
        self._sequence = 0
        self._answered = True  # false once the brain has exceeded the timeout
        self.answers: list[Answer] = []

    def send(self, sample: Sample) -> None:
        """Send a sample on every wire that is due, altered where a fault is active."""
        active = self._window is not None and self._window.holds(sample.drive_time)
        self._sequence = sample.sequence
        for wire in self._wires:
            portions = wire.output.step(sample if wire.scan_fault is None else wire.scan_fault.step(sample, active))
            if wire.fault is not None:
                portions = wire.fault.step(sample.drive_time, portions, active)
            wire.outlet.send(portions)

    def receive(self, now: float, wait: bool) -> Sequence[tuple[float, bytes]]:
        """Return the received datagrams; with `wait`, wait for the first.

        Before the fault begins, the link waits for the brain as in any drive in lockstep. From then on silence may be
        the right reaction, so the link waits until the brain is idle at most.
        """
        faulty = self._window is not None and now >= self._window.begins - _SLACK
        deadline = time.monotonic() + self._timeout
        while True:
            # In this order: once the brain is idle, all that it sent before can be received.
            quiet = wait and (faulty or not self._answered) and self._quiet()
            received = [data for _stamp, data in self._setpoints.receive()]
            left = deadline - time.monotonic()
            if received or not wait or quiet or left <= 0.0:
                self._answered &= bool(received) or left > 0.0
                self._log(now, received)
                return [(now, data) for data in received]
            select.select([self._setpoints], [], [], POLL_INTERVAL if faulty or not self._answered else left)

    def _log(self, now: float, received: Sequence[bytes]) -> None:
        for data in received:
            body = without_tag(data, self._key)
            decoded = None if body is None else decode_setpoint(body)
            if isinstance(decoded, SetpointDatagram):
                self.answers.append(
                    Answer(now, decoded.answers, self._sequence, decoded.steering, decoded.acceleration)
                )

    def close(self) -> None:
        """Close the outlets and the source of setpoints."""
        self._setpoints.close()
        for wire in self._wires:
            wire.outlet.close()
