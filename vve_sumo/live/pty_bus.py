"""CAN buses on pseudo-terminals of this machine, found under a file name that their user chose.

`pty:FILE` is a serial CAN adapter in software (`slcan.Adapter`) with FILE as a link to its terminal: what another
program opens as python-can's interface "slcan". It knows links, ports and frames, not what a frame means.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from typing import Final, TextIO

from vve_sumo.bus import candump_lines
from vve_sumo.errors import RigError
from vve_sumo.live.slcan import Adapter
from vve_sumo.pty_link import PtyLink
from vve_sumo.values import Frame

#: lines that wait for a slow reader: two cycles of a radar's, so that nothing old is read
MAX_LINES: Final = 140
#: frames of the other end that wait to be taken
MAX_RECEIVED_FRAMES: Final = 256


class LinkedAdapter(Adapter):
    """An adapter with a link to its terminal; the link is removed when the adapter is closed."""

    def __init__(self, channel: str) -> None:
        """Make the link that `pty:FILE` names; raises RigError where FILE is something else than such a link."""
        super().__init__(MAX_LINES)
        try:
            self._link = PtyLink(channel, self.name)
        except RigError:
            super().close()
            raise

    def close(self) -> None:
        """Remove the link, and close the terminal."""
        self._link.remove()
        super().close()


class PtyOutlet:
    """Sends frames to whoever opens the link, and keeps what comes back; never waits."""

    def __init__(self, channel: str) -> None:
        self.lost = 0
        self._adapter = LinkedAdapter(channel)
        self._heard: deque[Frame] = deque(maxlen=MAX_RECEIVED_FRAMES)

    def send(self, portions: Sequence[Frame]) -> None:
        """Send each frame; called without one, too, for the adapter answers its host in between."""
        self._heard.extend(self._adapter.receive())
        self._adapter.send(portions)
        self.lost = self._adapter.dropped

    def receive(self) -> list[Frame]:
        """Return the frames that the other end has sent since the last call, in order."""
        frames = [*self._heard, *self._adapter.receive()]
        self._heard.clear()
        return frames

    def close(self) -> None:
        """Remove the link, and close the terminal."""
        self._adapter.close()


class TwoPortBus:
    """The simulated vehicle's bus with two more nodes: the gateway at one adapter, an external controller at the other.

    As on a real bus every node hears every other one. The log says for each frame whose it is, which no real bus can.
    """

    def __init__(self, channel: str, log: TextIO | None, clock: Callable[[], float]) -> None:
        """`channel` is the brain's, `pty:FILE`; `log` takes candump lines with the sender in the channel's place."""
        self._gateway, self._brain = Adapter(), LinkedAdapter(channel)
        self._log, self._clock = log, clock
        self.name: Final = self._gateway.name  #: of the gateway's terminal

    def send(self, frames: Iterable[Frame]) -> None:
        """Put the car's frames on the bus."""
        sent = list(frames)
        self._gateway.send(sent)
        self._brain.send(sent)
        self._note("car", sent)

    def receive(self) -> list[Frame]:
        """Return the frames of both other nodes since the last call, each node's in order."""
        gateway, brain = self._gateway.receive(), self._brain.receive()
        self._brain.send(gateway)
        self._gateway.send(brain)
        self._note("gateway", gateway)
        self._note("brain", brain)
        return [*gateway, *brain]

    def close(self) -> None:
        """Close both terminals."""
        self._gateway.close()
        self._brain.close()

    def _note(self, sender: str, frames: Sequence[Frame]) -> None:
        if self._log is not None and frames:
            try:
                self._log.write(candump_lines(self._clock(), sender, frames))
            except OSError:
                self._log = None  # a full disk ends the log, not the car


def monotonic_clock(t0: float) -> Callable[[], float]:
    """Return a clock of drive time [s]; `t0` is the monotonic second of drive time 0."""
    return lambda: time.monotonic() - t0
