"""Port of receivers: what the program needs of a kind of receiver, and how a kind is found by its name.

A kind is one class: its keys of `[pose]`, where its bytes come from, how they are decoded, how strictly its fixes are
judged, and what to check where something is wrong. Only the table of shipped kinds names a brand.
`tests/ports/receiver.py` tests any kind.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, ClassVar, Final, Literal, NamedTuple, Protocol, Self, runtime_checkable

from pydantic import Field, model_validator

from vve_sumo.config_file import Name, Table
from vve_sumo.errors import ConfigError
from vve_sumo.ports import Port
from vve_sumo.pose.sources import Source
from vve_sumo.pose.trust import TrustProfile
from vve_sumo.values import Fix, Frame

_HERE: Final = "vve_sumo.pose.receivers"
#: A kind is found by its name in this table, as `file.py:function` or by entry point; `make()` returns its class.
PORT: Final = Port(
    "receiver",
    "vve_sumo.receivers",
    "()",
    {kind: f"{_HERE}.{kind}" for kind in ("ncom_udp", "nmea_udp", "nmea_tcp", "nmea_serial", "oxts_can", "file")},
)


class FixDecoder(Protocol):
    """A decoder of pose bytes; each object starts afresh, has no clock and never raises on any input."""

    def feed(self, data: bytes, time_received: float) -> list[Fix]:
        """Return the fixes that these bytes complete, stamped with `time_received` [s, the drive's clock].

        The fixes do not depend on how the stream is cut (a CAN frame never is). Time and position of a fix are finite;
        what the receiver does not report is NaN. The trust gate refuses a fix that is not newer than those before it.
        """
        ...


class FrameBus(Protocol):
    """The part of a CAN bus that a receiver uses."""

    def fileno(self) -> int | None:
        """Return the file descriptor that a frame makes readable; None where the driver has none."""

    def drain(self) -> list[Frame]:
        """Return the waiting frames, without blocking; raises RigError where the bus is down."""

    def close(self) -> None:
        """Close the bus."""


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


class ReceiverTable(Table):
    """Where the pose comes from: the keys that every kind of receiver has; a kind's class adds its own."""

    profile: ClassVar[TrustProfile]
    not_fixed_hint: ClassVar[str] = "see the receiver's antennas, its view of the sky and its link to the base station"

    kind: Name = Field(
        description="`ncom_udp`, `nmea_udp`, `nmea_tcp`, `nmea_serial`, `oxts_can`, `file`, a `file.py:make`, or an "
        "installed package's entry point; the keys of each are below"
    )
    rate_hz: Annotated[float, Field(ge=10.0, le=250.0)] = Field(default=100.0, description="fixes a second")
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


def load(kind: str) -> type[ReceiverTable]:
    """Return the class of a kind of receiver, which is a `Receiver`; raises ConfigError, which names the kind."""
    made = PORT.make(kind, PORT.find(kind))
    if not (isinstance(made, type) and issubclass(made, ReceiverTable)):
        raise ConfigError(f"receiver {kind}: make returned {made!r}, expected a class derived from ReceiverTable")
    wanted = sorted(name for name in (*Receiver.__annotations__, *vars(Receiver)) if not name.startswith("_"))
    if missing := [name for name in wanted if not hasattr(made, name)]:
        raise ConfigError(f"receiver {kind}: {made.__name__} lacks {', '.join(missing)}")
    return made
