"""Port of receivers: what the program needs of a kind of receiver, and how a kind is found by its name.

A kind is one class: its keys of `[pose]`, where its bytes come from, how they are decoded, how strictly its fixes are
judged, and what to check where something is wrong. Only the table of shipped kinds names a brand.
`tests/ports/receiver.py` tests any kind.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping
from typing import Annotated, Any, ClassVar, Final, Literal, NamedTuple, Protocol, Self, runtime_checkable

from pydantic import Field, model_validator

from vve_sumo.config_file import Name, Table
from vve_sumo.errors import ConfigError
from vve_sumo.ports import Port
from vve_sumo.pose.census import MessageCensus
from vve_sumo.pose.sources import Source
from vve_sumo.pose.trust import TrustProfile
from vve_sumo.values import Fix, Frame

_HERE: Final = "vve_sumo.pose.receivers"
_SHIPPED: Final = (
    "ncom_udp", "nmea_udp", "nmea_tcp", "nmea_serial", "ubx_udp", "ubx_serial", "sbf_udp", "sbf_tcp", "sbf_serial",
    "novatel_udp", "novatel_tcp", "novatel_serial", "oxts_can", "file",
)  # fmt: skip
#: A kind is found by its name in this table, as `file.py:function` or by entry point; `make()` returns its class.
PORT: Final = Port(
    "receiver",
    "vve_sumo.receivers",
    "()",
    {kind: f"{_HERE}.{kind}" for kind in _SHIPPED},
)

#: kind of the simulated vehicle's receiver in lockstep, and of recordings
STANDARD: Final = "ncom_udp"


class FixDecoder(Protocol):
    """A decoder of pose bytes; each object starts afresh, has no clock and never raises on any input."""

    def feed(self, data: bytes, time_received: float) -> list[Fix]:
        """Return the fixes that these bytes complete, stamped with `time_received` [s, the drive's clock].

        The fixes do not depend on how the stream is cut (a CAN frame never is). Time and position of a fix are finite;
        what the receiver does not report is NaN. The trust gate refuses a fix that is not newer than those before it.
        """
        ...


@runtime_checkable
class CountedDecoder(FixDecoder, Protocol):
    """A decoder of a receiver that sends several kinds of messages: it notes which came."""

    census: MessageCensus

    @property
    def counts(self) -> Mapping[Any, int]:
        """What became of messages and epochs, by outcome."""
        ...


class FixEncoder(Protocol):
    """The other direction of a decoder, for the simulated vehicle; each object starts afresh and has no clock."""

    def encode(self, fix: Fix) -> bytes:
        """Return what the receiver sends of a fix, as `FixDecoder.feed` takes it; `fix.time` is finite.

        What is NaN is sent as not known, and where the messages can tell it, a fix that is not `locked` as one that a
        car cannot be driven on.
        """
        ...


@runtime_checkable
class MinuteEncoder(FixEncoder, Protocol):
    """An encoder of messages of which some alone hold the minute, so that a fault may get it wrong."""

    def with_wrong_minute(self, data: bytes, minutes: int) -> bytes | None:
        """Return a message with a minute that is so far off; None for a message that holds none."""
        ...


class FarEnd(Protocol):
    """The receiver's end of its wire, on which the simulated vehicle sends; nothing here waits or raises."""

    def send(self, data: bytes) -> None:
        """Send what the encoder returned; what cannot be sent now is lost."""
        ...

    def close(self) -> None:
        """Let go of the wire."""
        ...


class FrameBus(Protocol):
    """The part of a CAN bus that a receiver uses."""

    def fileno(self) -> int | None:
        """Return the file descriptor that a frame makes readable; None where the driver has none."""

    def drain(self) -> list[Frame]:
        """Return the waiting frames, without blocking; raises RigError where the bus is down."""

    def close(self) -> None:
        """Close the bus."""


class FarBus(Protocol):
    """The simulated vehicle's end of a CAN bus that it emulates; nothing here waits or raises."""

    def send(self, frames: Iterable[Frame]) -> None:
        """Put frames on the bus."""

    def receive(self) -> list[Frame]:
        """Return the frames that came since the last call; an emulated adapter answers its host meanwhile."""

    def close(self) -> None:
        """Let go of the bus."""


#: emulates a CAN adapter under a name, `pty:FILE`; raises RigError
OpenFarBus = Callable[[str], FarBus]

#: opens a CAN bus from interface, channel and bitrate [bit/s]; raises ConfigError or RigError
OpenBus = Callable[[str, str, int], FrameBus]


class OnCan(NamedTuple):
    """The CAN bus of a receiver and the identifiers that it occupies there."""

    interface: str  #: python-can's
    channel: str  #: python-can's
    identifiers: frozenset[int]  #: that it may send with


@runtime_checkable
class Receiver(Protocol):
    """What the program needs of a configured receiver."""

    profile: ClassVar[TrustProfile]  #: how strictly its fixes are judged; one that is not `live` is a recording
    silent_hint: ClassVar[str]  #: what to check where nothing arrives, in one line
    not_fixed_hint: ClassVar[str]  #: what to check where a fix is not RTK-fixed, in one line
    far_end_first: ClassVar[bool]  #: whether there is nothing to `open` before the far end is there
    settling_time: ClassVar[float]  #: for which a decoder, fed from the beginning on, takes no fix to be locked [s]

    def open(self, open_bus: OpenBus, /) -> Source:
        """Open the receiver; raises RigError or ConfigError naming the key of the rig. `open_bus` is for one on CAN."""
        ...

    def decoder(self) -> FixDecoder:
        """Return a new decoder for the data of the source."""
        ...

    def place(self) -> str:
        """Return where the receiver is expected, in few words."""
        ...

    def on_can(self) -> OnCan | None:
        """Return what the receiver occupies of a CAN bus; None for a receiver that uses none."""
        ...

    def encoder(self) -> FixEncoder | None:
        """Return a new encoder, by which the simulated vehicle speaks as this receiver; None where it cannot."""
        ...

    def far_end(self, open_far_bus: OpenFarBus, /) -> FarEnd | None:
        """Open the other end of the wire on this machine; None where there is none that a program could send on.

        `open_far_bus` is for one on CAN. Raises RigError or ConfigError naming the key of the rig.
        """
        ...

    def not_simulated(self) -> str:
        """Return why the simulated vehicle cannot send as this receiver, in one line that names the key; else ""."""
        ...


class ReceiverTable(Table):
    """Where the pose comes from: the keys that every kind of receiver has; a kind's class adds its own."""

    profile: ClassVar[TrustProfile]
    far_end_first: ClassVar[bool] = False
    settling_time: ClassVar[float] = 0.0
    not_fixed_hint: ClassVar[str] = "see the receiver's antennas, its view of the sky and its link to the base station"

    kind: Name = Field(
        description=f"{', '.join(f'`{kind}`' for kind in _SHIPPED)}, a `file.py:make`, or an installed package's entry "
        "point; the keys of each are below"
    )
    rate_hz: Annotated[float, Field(ge=10.0, le=250.0)] = Field(
        default=100.0, description="fixes a second; of the simulated vehicle, too, which sends 100 at most"
    )
    clock: Literal["arrival", "absolute"] = Field(
        default="arrival",
        description="`absolute`: this machine's clock is GNSS time by PTP or PPS; `arrival`: it is estimated",
    )
    minimum_delay_ms: Annotated[float, Field(ge=0.0, le=500.0)] | None = Field(
        default=None,
        description="what a fix takes to arrive at best, which arrivals alone cannot show; needed for `arrival`, but "
        "not of a recording",
    )

    @model_validator(mode="after")
    def _delay_is_declared(self) -> Self:
        if self.clock == "arrival" and self.profile.live and self.minimum_delay_ms is None:
            raise ValueError("minimum_delay_ms is missing, clock 'arrival' needs it")
        return self

    def on_can(self) -> OnCan | None:
        """Return what the receiver occupies of a CAN bus: None, unless its kind overrides this."""
        return None

    def encoder(self) -> FixEncoder | None:
        """Return a new encoder for the simulated vehicle: None, unless its kind overrides this."""
        return None

    def far_end(self, _open_far_bus: OpenFarBus) -> FarEnd | None:
        """Open the other end of the wire: None, unless its kind overrides this."""
        return None

    def not_simulated(self) -> str:
        """Return why the simulated vehicle cannot send as this receiver: its kind brings no encoder or no far end."""
        lacking = [name for name in ("encoder", "far_end") if getattr(type(self), name) is getattr(ReceiverTable, name)]
        return f"kind: receiver {self.kind!r} has no {' and no '.join(lacking)} to be simulated by" if lacking else ""


def standard() -> Receiver:
    """Return the receiver as which the simulated vehicle speaks where no rig names one, as in lockstep."""
    return configured({"kind": STANDARD, "minimum_delay_ms": 0.0})


def configured(table: Mapping[str, Any]) -> Receiver:
    """Return the receiver of a valid table `[pose]`; raises ConfigError as `load` does."""
    made: Any = load(str(table["kind"])).model_validate_json(json.dumps(dict(table)))
    receiver: Receiver = made
    return receiver


def load(kind: str) -> type[ReceiverTable]:
    """Return the class of a kind of receiver, which is a `Receiver`; raises ConfigError, which names the kind."""
    made = PORT.make(kind, PORT.find(kind))
    if not (isinstance(made, type) and issubclass(made, ReceiverTable)):
        raise ConfigError(f"receiver {kind}: make returned {made!r}, expected a class derived from ReceiverTable")
    wanted = sorted(name for name in (*Receiver.__annotations__, *vars(Receiver)) if not name.startswith("_"))
    if missing := [name for name in wanted if not hasattr(made, name)]:
        raise ConfigError(f"receiver {kind}: {made.__name__} lacks {', '.join(missing)}")
    return made
