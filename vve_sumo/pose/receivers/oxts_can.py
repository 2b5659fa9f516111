"""OXTS receivers that send their default map of messages on a CAN bus of their own.

The module knows frames and no driver: the caller hands in a function that opens a bus.
"""

from __future__ import annotations

import math
import struct
import time
from typing import Any, ClassVar, Final

from pydantic import Field

from vve_sumo.config_file import Bitrate, Name
from vve_sumo.errors import RigError
from vve_sumo.pose import oxts_can
from vve_sumo.pose.receivers.port import FarBus, FrameBus, OnCan, OpenBus, OpenFarBus, Receiver, ReceiverTable
from vve_sumo.pose.sources import Source
from vve_sumo.pose.trust import OXTS_CAN, TrustProfile
from vve_sumo.pty_link import PREFIX
from vve_sumo.values import Fix, Frame

#: a frame as a portion of pose bytes: identifier, length, payload
FRAME: Final = struct.Struct("<HB8s")


class OxtsCan(ReceiverTable):
    """The CAN output of an OXTS unit."""

    profile: ClassVar[TrustProfile] = OXTS_CAN
    silent_hint: ClassVar[str] = "see pose.interface, pose.channel and pose.bitrate, and the receiver's CAN output"

    far_end_first: ClassVar[bool] = True
    settling_time: ClassVar[float] = 1e-3 * oxts_can.LOCKING

    interface: Name = Field(description="python-can's")
    channel: Name = Field(
        description="python-can's; of the simulated vehicle, with `slcan`, `pty:FILE`: FILE becomes a link to a serial "
        "adapter of its own"
    )
    bitrate: Bitrate = Field(default=500_000, description="bit/s")

    def open(self, open_bus: OpenBus) -> Source:
        """Open the bus; raises RigError naming bus or key."""
        return FrameSource(open_bus(self.interface, self.channel.removeprefix(PREFIX), self.bitrate))

    def far_end(self, open_far_bus: OpenFarBus) -> FrameFarEnd:
        """Emulate the adapter that the channel is a link to."""
        return FrameFarEnd(open_far_bus(self.channel))

    def not_simulated(self) -> str:
        """Return why the simulated vehicle cannot send as this receiver: it sends on no CAN card."""
        if why := super().not_simulated():
            return why
        expected = f"channel: the simulated vehicle emulates its adapter, expected '{PREFIX}FILE' of interface 'slcan'"
        emulated = self.interface == "slcan" and self.channel.startswith(PREFIX)
        return "" if emulated else f"{expected}, got {self.place()}"

    def decoder(self) -> FrameDecoder:
        """Return a fresh decoder."""
        return FrameDecoder()

    def encoder(self) -> FrameEncoder:
        """Return a fresh encoder."""
        return FrameEncoder()

    def place(self) -> str:
        """Return interface and channel."""
        return f"{self.interface}:{self.channel}"

    def on_can(self) -> OnCan:
        """Return the bus and the identifiers of OXTS's default map."""
        return OnCan(self.interface, self.channel, oxts_can.IDENTIFIERS)


class FrameSource:
    """A receiver on a CAN bus as a source of portions, one for each frame; the arrival is the time of reading."""

    def __init__(self, bus: FrameBus) -> None:
        number = bus.fileno()
        if number is None:
            bus.close()
            raise RigError("pose.interface: this driver cannot be waited on, take socketcan or slcan")
        self._bus, self._number = bus, number
        self.lost = False

    def fileno(self) -> int:
        """Return the file descriptor to wait on."""
        return self._number

    def next_due(self) -> float:
        """Return inf: `fileno` signals every frame."""
        return math.inf

    def receive(self) -> list[tuple[float, bytes]]:
        """Return the waiting frames; none, and the source is `lost`, where the bus is down."""
        try:
            frames = self._bus.drain()
        except RigError:
            self.lost = True
            return []
        now = time.monotonic()
        return [(now, FRAME.pack(frame.id, len(frame.data), frame.data)) for frame in frames]

    def sender_faults(self) -> tuple[str, ...]:
        """Return nothing: a frame does not name its sender."""
        return ()

    def sender_report(self) -> dict[str, Any]:
        """Return nothing: a frame does not name its sender."""
        return {}

    def close(self) -> None:
        """Close the bus."""
        self._bus.close()


class FrameDecoder:
    """Decodes the portions of `FrameSource`."""

    def __init__(self) -> None:
        self._decoder = oxts_can.Decoder()

    def feed(self, data: bytes, time_received: float) -> list[Fix]:
        """Return the fixes that these frames complete; an incomplete frame is left out."""
        return self._decoder.feed_frames(_frames(data), time_received)


class FrameEncoder:
    """Encodes fixes as portions of `FrameSource`."""

    def __init__(self) -> None:
        self._encoder = oxts_can.Encoder()

    def encode(self, fix: Fix) -> bytes:
        """Return the frames of a fix."""
        frames = self._encoder.encode(fix)
        return b"".join(FRAME.pack(frame.id, len(frame.data), frame.data) for frame in frames)


class FrameFarEnd:
    """The simulated vehicle's end of a receiver's CAN bus, which takes what `FrameEncoder` returns."""

    def __init__(self, bus: FarBus) -> None:
        self._bus = bus

    def send(self, data: bytes) -> None:
        """Send the frames; those that nobody reads are lost."""
        self._bus.receive()
        self._bus.send(_frames(data))

    def close(self) -> None:
        """Close the bus."""
        self._bus.close()


def _frames(data: bytes) -> list[Frame]:
    """Return the whole frames in a portion."""
    whole = len(data) - len(data) % FRAME.size
    return [Frame(number, payload[:size]) for number, size, payload in FRAME.iter_unpack(data[:whole])]


def make() -> type[Receiver]:
    """Return the kind's class."""
    return OxtsCan
