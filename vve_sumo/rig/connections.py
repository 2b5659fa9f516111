"""What a rig is connected to besides its car and receiver: pages, outgoing wires, a brain, persons, V2X, ROS 2.

Tables of a rig file, as those of `rig.schema`. A way in that could move the car or put bodies on the virtual road is
refused where anyone on the network has it.
"""

from __future__ import annotations

import ipaddress
from typing import Annotated, Literal, Self

from pydantic import AfterValidator, Field, model_validator

from vve_sumo.config_file import Bitrate, Name, Table
from vve_sumo.pose.receivers.udp import Address, NetworkPort, Sender


class RigView(Table):
    """The page that `--view` serves to browsers."""

    address: Address = Field(
        default="127.0.0.1",
        description="of this computer, to listen on: with one on the car's network others watch",
    )
    port: Annotated[int, Field(ge=0, le=65535)] = Field(default=0, description="to listen on; 0 is any free one")
    token_file: Name | None = Field(
        default=None,
        description="file with the token in the page's address, 16 or more letters, digits, - and _; "
        "left out: a new one for every drive",
    )
    certificate_file: Name | None = Field(
        default=None,
        description="file with a certificate in PEM form: the page is served over HTTPS, which a headset asks for",
    )
    key_file: Name | None = Field(default=None, description="file with the certificate's key in PEM form")

    @model_validator(mode="after")
    def _whole(self) -> Self:
        """Refuse a certificate without its key and a key without its certificate."""
        if (self.certificate_file is None) != (self.key_file is None):
            raise ValueError("certificate_file and key_file: expected both or neither")
        return self

    @model_validator(mode="after")
    def _named(self) -> Self:
        """Refuse to listen everywhere: a browser's request could then not be told from one for another name."""
        if ipaddress.ip_address(self.address).is_unspecified:
            raise ValueError(f"address: {self.address} is every network; expected this computer's address on one")
        return self


class RigPeoplePage(RigView):
    """The page that the people of a scenario open on their phones."""

    address: Address = Field(
        default="127.0.0.1", description="of this computer, to listen on: with one on a network phones open the page"
    )
    certificate_file: Name | None = Field(
        default=None,
        description="file with a certificate in PEM form: over a network browsers say where they are to HTTPS alone",
    )

    @model_validator(mode="after")
    def _secure(self) -> Self:
        """Refuse a page over a network without HTTPS: no browser says where it is to such a page."""
        if self.certificate_file is None and not ipaddress.ip_address(self.address).is_loopback:
            raise ValueError("certificate_file is missing: over a network a browser gives its position to HTTPS alone")
        return self


class Other(Table):
    """Another device on a bus that the rig uses, so that identifiers cannot collide."""

    kind: Literal["esr", "ars408", "oxts_can"] = Field(
        description="`esr` or `ars408` (radars, real or emulated), `oxts_can` (the receiver's CAN output)"
    )
    interface: Name = Field(description="python-can's")
    channel: Name = Field(description="python-can's")


def _place(text: str) -> str:
    host, _, port = text.rpartition(":")
    try:
        address = ipaddress.IPv4Address(host)
        number = int(port)
    except ValueError:
        raise ValueError("expected an IPv4 address and a port, such as 127.0.0.1:5001") from None
    if address.is_unspecified or address.is_multicast or address.is_reserved:
        raise ValueError(f"{host} is everyone's, expected the address of one device")
    if not 1 <= number <= 65535:
        raise ValueError(f"port {number} is none, expected 1 to 65535")
    return text


def _pty_link(text: str) -> str:
    if not text.startswith("pty:") or len(text) == len("pty:"):
        raise ValueError("expected pty:FILE, such as pty:brain.pty")
    return text


#: a pseudo-terminal that is made, and the file that becomes a link to it
PtyLink = Annotated[str, AfterValidator(_pty_link)]
Place = Annotated[str, AfterValidator(_place)]


class RigOutput(Table):
    """An outgoing wire: what a virtual sensor says, for a control computer of somebody else's."""

    kind: Literal[
        "ncom",
        "nmea",
        "radar",
        "esr",
        "ars408",
        "osi_view",
        "osi_data",
        "mobileye",
        "vlp16",
        "vlp16_position",
        "v2x",
        "cam",
        "denm",
        "cpm",
        "signals",
        "scene",
        "sense",
        "stop",
    ] = Field(description="what is sent: see the table of wires")
    sensor: Name | None = Field(
        default=None,
        description="`radar`, `esr`, `ars408`, `osi_data`: name of the scenario's sensor whose detections are sent, "
        "where that is not `radar`; `vlp16`, `mobileye`, `cpm`, `v2x`: name of the lidar, camera or V2X receiver; "
        "`sense`: name of any sensor",
    )
    udp: Place | None = Field(default=None, description="send datagrams to this address and port")
    tcp: Place | None = Field(default=None, description="`ncom`, `nmea`: serve a stream on this address and port")
    device: Name | None = Field(default=None, description="`ncom`, `nmea`: write to this serial line")
    baud: Annotated[int, Field(ge=1200, le=4_000_000)] = Field(default=115_200, description="of the serial line")
    interface: Name | None = Field(
        default=None,
        description="`esr`, `ars408`, `mobileye`, `stop`: python-can's, of a bus that does not command the car",
    )
    channel: Name | None = Field(
        default=None,
        description="`esr`, `ars408`, `mobileye`, `stop`: python-can's; with `slcan` also `pty:FILE`: FILE becomes a "
        "link to a serial port of its own",
    )
    bitrate: Bitrate = Field(default=500_000, description="`esr`, `ars408`, `mobileye`, `stop`: [bit/s]")
    host: Literal["drive", "bus"] = Field(
        default="drive",
        description="`esr`: where the radar knows the car's motion from: the `drive`, or vehicle messages on its `bus`",
    )
    can_id: Annotated[int, Field(ge=0, le=0x7FF)] | None = Field(
        default=None, description="`stop`: identifier of the stop frame"
    )

    @model_validator(mode="after")
    def _one_way_out(self) -> Self:
        byte_ways = [key for key in ("udp", "tcp", "device") if getattr(self, key) is not None]
        if self.kind != "esr" and "host" in self.model_fields_set:
            raise ValueError(f"host says nothing for kind {self.kind!r}, it is for esr")
        if (self.kind == "stop") != (self.can_id is not None):
            raise ValueError("can_id is the identifier of the stop frame: kind 'stop' needs it, and no other has it")
        carried = {"vlp16": "lidar", "mobileye": "camera", "cpm": "camera", "v2x": "V2X receiver", "sense": "sensor"}
        if self.sensor is None and (what := carried.get(self.kind)):
            raise ValueError(f"kind {self.kind!r} needs sensor: name the scenario's {what}")
        if self.kind in ("esr", "ars408", "mobileye", "stop"):
            if byte_ways or self.interface is None or self.channel is None:
                raise ValueError(f"kind {self.kind!r} goes out on a CAN bus: name interface and channel, nothing else")
            return self
        ways = ("udp", "tcp", "device") if self.kind in ("ncom", "nmea") else ("udp",)
        if len(byte_ways) != 1 or self.interface is not None or self.channel is not None:
            raise ValueError(f"kind {self.kind!r} goes out one way: name one of {', '.join(ways)}")
        if byte_ways[0] not in ways:
            # Nothing in these messages says where one ends and the next begins.
            raise ValueError(f"kind {self.kind!r} goes out in datagrams: name udp, not {byte_ways[0]}")
        return self


class Brain(Table):
    """Who decides what the car does."""

    kind: Literal["own", "setpoints", "external"] = Field(
        default="own",
        description="`own`: the scenario's controller; `setpoints`: an external controller answers with setpoints, "
        "and the gateway commands the car; `external`: an external controller commands the car itself, and not one "
        "command frame is sent from here",
    )
    address: Address = Field(default="127.0.0.1", description="`setpoints`: to listen on")
    port: NetworkPort = Field(default=5003, description="`setpoints`: to listen on")
    source: Sender | None = Field(default=None, description="`setpoints`: the brain's address, where it is not on here")
    key_file: Name | None = Field(
        default=None,
        description="file with the 64 hexadecimal digits of the key that signs setpoints and radar datagrams",
    )
    deadline_s: Annotated[float, Field(gt=0.0, le=3600.0)] = Field(
        default=10.0, description="`setpoints`, in lockstep: wait so long for the answer to a radar datagram"
    )

    @model_validator(mode="after")
    def _authenticated(self) -> Self:
        """Refuse a way to move the car that anyone on the network has, and a brain that is not heard."""
        if self.kind != "setpoints":
            return self
        if not ipaddress.ip_address(self.address).is_loopback:
            missing = next((key for key in ("source", "key_file") if getattr(self, key) is None), None)
            if missing is not None:
                raise ValueError(f"{missing} is missing: anyone who reaches {self.address} could move the car")
        elif self.source is not None and not ipaddress.ip_address(self.source).is_loopback:
            raise ValueError(f"source: {self.source} cannot be heard on {self.address}, which is this machine alone")
        return self


class RigPerson(Table):
    """A real person of the scenario: where their field is, and where their positions come from."""

    id: Name = Field(description="the person's in the scenario")
    latitude_deg: Annotated[float, Field(ge=-75.0, le=75.0)] = Field(
        description="of the field's anchor, which the scenario lays onto the virtual road, WGS84"
    )
    longitude_deg: Annotated[float, Field(ge=-180.0, le=180.0)] = Field(description="of the anchor, WGS84")
    heading_deg: Annotated[float, Field(ge=0.0, lt=360.0)] = Field(
        description="of the anchor, clockwise from true north"
    )
    source: Literal["phone", "nmea_udp", "simulated"] = Field(
        description="`phone`: the page on their phone; `nmea_udp`: a receiver that they carry, beside that page; "
        "`simulated`: nobody, the scenario's `simulated` walks"
    )
    least_distance_m: Annotated[float, Field(ge=10.0, le=1000.0)] = Field(
        description="least distance of the person, the uncertainty of their place taken off, from the lot's outline"
    )
    address: Address = Field(default="127.0.0.1", description="`nmea_udp`: to listen on")
    port: NetworkPort | None = Field(default=None, description="`nmea_udp`: to listen on")
    sender: Sender | None = Field(
        default=None, description="`nmea_udp`: address of the receiver, where it is not on here"
    )

    @model_validator(mode="after")
    def _of_its_source(self) -> Self:
        """Refuse keys of another source, and a port that anyone on the network could speak to."""
        for key in ("address", "port", "sender"):
            if key in self.model_fields_set and self.source != "nmea_udp":
                raise ValueError(f"{key} says nothing for source {self.source!r}, it is for nmea_udp")
        if self.source == "nmea_udp" and self.port is None:
            raise ValueError("port is missing, source 'nmea_udp' needs it")
        if self.sender is None and not ipaddress.ip_address(self.address).is_loopback:
            raise ValueError(f"sender is missing: anyone who reaches {self.address} could be the person's receiver")
        return self


class RigV2x(Table):
    """A real on-board unit, whose stations become bodies on the virtual road."""

    listen: Place = Field(description="address and port to which the unit's packets are sent, such as 127.0.0.1:4716")
    sender: Sender | None = Field(default=None, description="address of the unit, where it is not on here")
    frame: Literal["lot", "road"] = Field(
        default="lot",
        description="`lot`: stations are around the real car, and are laid onto the virtual road as it is; `road`: "
        "they say where they are on the virtual road itself, as another simulator does",
    )
    reach_m: Annotated[float, Field(gt=0.0, le=5000.0)] = Field(
        default=500.0, description="stations farther from where the ego's path begins are not placed"
    )
    uncertainty_m: Annotated[float, Field(gt=0.0, le=40.0)] = Field(
        default=5.0, description="greatest radius, with 95 %, within which a station knows its place"
    )
    stations: Annotated[int, Field(ge=1, le=200)] = Field(default=32, description="at a time, no more")
    ignored: tuple[Annotated[int, Field(ge=0, le=2**32 - 1)], ...] = Field(
        default=(), strict=False, description="IDs of stations that are not placed: those of the car's own unit"
    )

    @model_validator(mode="after")
    def _of_one_sender(self) -> Self:
        """Refuse a port that anyone on the network could speak to."""
        host = self.listen.rpartition(":")[0]
        if self.sender is None and not ipaddress.ip_address(host).is_loopback:
            raise ValueError(f"sender is missing: anyone who reaches {host} could put bodies on the virtual road")
        return self


class RigRos2(Table):
    """The ROS 2 bridge, `vve-sumo ros2`, and the relay of a ROS 2 driver's fixes, `vve-sumo pose ros2`."""

    domain_id: Annotated[int, Field(ge=0, le=101)] = Field(default=0, description="ROS_DOMAIN_ID of the nodes")
    commands: Literal["twist_stamped", "twist", "ackermann"] = Field(
        default="twist_stamped",
        description="type of the commands: geometry_msgs/TwistStamped or Twist on `/cmd_vel`, "
        "ackermann_msgs/AckermannDriveStamped on `/ackermann_cmd`",
    )
    time_constant_s: Annotated[float, Field(ge=0.1, le=5.0)] = Field(
        default=0.5, description="a command's speed is asked for as an acceleration that reaches it in about this time"
    )
    corrections_age_s: Annotated[float, Field(gt=0.0, le=10.0)] | None = Field(
        default=None,
        description="`vve-sumo pose ros2`: how old corrections may be before the receiver no longer says that it has a "
        "fix by a base station",
    )
