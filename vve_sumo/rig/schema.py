"""What a rig file may say: pydantic models, the edge where units are in the names.

A rig is whole only with its vehicle model: `rig.load` lays what the rig says over the model's tables.
Knows nothing of files' places, buses or how a drive is run; what a rig means to the rest is `rig.resolve`.
"""

from __future__ import annotations

import datetime
import functools
import ipaddress
from collections.abc import Mapping
from typing import Annotated, ClassVar, Final, Literal, Self

from pydantic import AfterValidator, Field, create_model, model_validator

from vve_sumo.config_file import Bitrate, Finite, Name, NotNegative, Positive, Short, Table
from vve_sumo.pose.receivers.port import ReceiverTable
from vve_sumo.pose.receivers.udp import Address, NetworkPort, Sender
from vve_sumo.scenario.schema import DEFAULT_VEHICLE, CarDifferences, StartPose, Weather
from vve_sumo.vehicle.schema import Declared, DriveByWire, MeasuredImperfections, PedalCalibration, Simulated

Date = datetime.date

#: of tyre on a dry road, that of a scenario's weather where it says none
DRY_FRICTION = Weather().friction


def _latitude_first(corner: tuple[float, float]) -> tuple[float, float]:
    latitude, longitude = corner
    if abs(latitude) > 75.0:
        swapped = " (are latitude and longitude swapped?)" if abs(longitude) <= 75.0 else ""
        raise ValueError(f"latitude {latitude:g} is where no lot is, expected -75 to 75 deg{swapped}")
    if not abs(longitude) <= 180.0:
        raise ValueError(f"longitude {longitude:g} is no place on Earth, expected -180 to 180 deg")
    return corner


#: one place: latitude and longitude [deg], WGS84
Corner = Annotated[tuple[Finite, Finite], Field(strict=False), AfterValidator(_latitude_first)]
Corners = Annotated[tuple[Corner, ...], Field(strict=False)]
Outline = Annotated[tuple[Corner, ...], Field(strict=False, min_length=3)]
#: An acceleration that tyres have to pass on [m/s2]: at most friction 1.0 of clean dry asphalt, times g.
Grip = Annotated[float, Field(gt=0.0, le=9.81, allow_inf_nan=False)]
#: how fast an acceleration may change [m/s3]; 100 is full braking in a tenth of a second, as fast as brakes bite
Jerk = Annotated[float, Field(gt=0.0, le=100.0, allow_inf_nan=False)]
#: for how long what was measured holds
Days = Annotated[int, Field(ge=1, le=3650)]
#: largest deceleration of a car that rolls freely in drive [m/s2]: rolling, air and engine drag at 5 m/s
MAX_ROLLING_DECELERATION: Final = 0.6
#: where a car stands: latitude, longitude [deg], WGS84, and heading [deg], clockwise from true north
CarPlace = Annotated[
    tuple[
        Annotated[float, Field(ge=-75.0, le=75.0)],
        Annotated[float, Field(ge=-180.0, le=180.0)],
        Annotated[float, Field(ge=0.0, lt=360.0)],
    ],
    Field(strict=False),
]
MapPoint = Annotated[tuple[Finite, Finite], Field(strict=False)]


def _only(table: Table, kind: str, keys: dict[str, tuple[str, ...]]) -> None:
    """Refuse keys that say nothing for this kind, and miss those that it needs; `keys`: key to kinds it is for."""
    for key, kinds in keys.items():
        if key in table.model_fields_set and kind not in kinds:
            raise ValueError(f"{key} says nothing for kind {kind!r}, it is for {' and '.join(kinds)}")
        if kind in kinds and getattr(table, key) is None:
            raise ValueError(f"{key} is missing, kind {kind!r} needs it")


class RigMounting(Table):
    """Where the receiver's output point sits on the car."""

    forward_m: Annotated[float, Field(ge=-5.0, le=8.0)] = Field(description="output point ahead of the rear axle")
    left_m: Annotated[float, Field(ge=-2.0, le=2.0)] = Field(description="output point left of the rear axle")
    heading_misalignment_deg: Annotated[float, Field(ge=-10.0, le=10.0)] = Field(
        default=0.0, description="receiver's heading minus the car's, clockwise positive"
    )
    calibrated: Date | None = Field(default=None, description="day of the calibration")


class RigBus(Table):
    """The bus that the car is commanded over."""

    interface: Name = Field(description="python-can's: `socketcan`, `pcan`, `kvaser`, `slcan`, …")
    channel: Name = Field(description="python-can's: `can0`, …; `pty` is made by the simulated vehicle")
    bitrate: Bitrate = Field(default=500_000, description="bit/s")

    FORMER: ClassVar[Mapping[str, str]] = {"variant": "drive_by_wire.settings.variant"}


class RigVehicle(Declared):
    """The car: a vehicle model, and what was measured of this car in place of the model's numbers."""

    model: Name = Field(default=DEFAULT_VEHICLE, description="vehicle model: a name under vehicles/ or a file")


class RigCalibration(PedalCalibration):
    """What was measured of the car's pedals and steering in place of the model's numbers."""

    date: Date | None = Field(default=None, description="day of the calibration")
    steering_wheel_bias_deg: Annotated[float, Field(ge=-20.0, le=20.0)] = Field(
        default=0.0, description="steering-wheel angle at which the wheels point straight, left positive"
    )


class RigLimits(Table):
    """What the gateway keeps to, where it differs from its defaults, and the lot's speed limit."""

    speed_mps: Annotated[float, Field(gt=0.0, le=40.0)] = Field(
        description="no drive in this lot may ask for more than this"
    )
    comfort_deceleration_mps2: Grip | None = Field(default=None, description="largest, in every drive")
    comfort_acceleration_mps2: Grip | None = Field(default=None, description="largest, in every drive")
    comfort_jerk_mps3: Jerk | None = Field(default=None, description="of a pedal pressed further")
    comfort_release_jerk_mps3: Jerk | None = Field(default=None, description="of a pedal released")
    comfort_lateral_jerk_mps3: Jerk | None = Field(default=None, description="from steering")
    emergency_deceleration_mps2: Grip | None = Field(default=None, description="largest, where asked for")
    emergency_jerk_mps3: Jerk | None = Field(default=None, description="of the brake pressed, where asked for")
    lateral_acceleration_mps2: Grip | None = Field(default=None, description="largest that steering may cause")
    stop_deceleration_mps2: Grip | None = Field(default=None, description="of the gateway's own stop")
    stop_jerk_mps3: Jerk | None = Field(default=None, description="with which it sets in")
    stop_lateral_jerk_mps3: Jerk | None = Field(default=None, description="from steering along the fallback path")
    critical_deceleration_mps2: Grip | None = Field(
        default=None, description="of the gateway's own stop after a critical fault"
    )
    critical_jerk_mps3: Jerk | None = Field(default=None, description="with which it sets in")


class RigLot(Table):
    """The ground that the car may cover, as surveyed."""

    surveyed: Date = Field(description="day of the survey; an unsurveyed lot is refused")
    outline: Outline = Field(description="`[[latitude_deg, longitude_deg], …]`, three or more, either way round")
    holes: Annotated[tuple[Outline, ...], Field(strict=False)] = Field(
        default=(), description="poles, islands: outlines inside the outline"
    )
    margin_m: Annotated[float, Field(ge=0.0, le=50.0)] = Field(
        default=1.0,
        description="kept free along every edge: mirrors, errors of survey and stopping; the receiver's drift is added",
    )
    grade_percent: Annotated[float, Field(ge=0.0, le=15.0)] = Field(description="worst slope, taken as downhill")
    valid_days: Days = Field(default=1095, description="after the survey, for a real car: then the lot is walked again")
    friction: Annotated[float, Field(ge=0.05, le=1.2)] = Field(
        default=DRY_FRICTION,
        description="lowest of tyre on ground: about 0.9 dry, 0.6 wet, 0.3 snow; no stop is taken to be stronger than "
        "it allows",
    )


class RigAlignment(Table):
    """How the lot lies on the virtual road."""

    kind: Literal["matched_start", "stored", "surveyed_pairs"] = Field(
        default="matched_start",
        description="`matched_start`: where the car stands is the start of the path; `stored`; `surveyed_pairs`",
    )
    network: Name | None = Field(default=None, description="the network that it was made for; not for `matched_start`")
    date: Date | None = Field(default=None, description="day it was made; not for `matched_start`")
    origin: Corner | None = Field(default=None, description="`stored`: the lot's place that the turn is about")
    rotation_deg: Annotated[float, Field(ge=-360.0, le=360.0)] | None = Field(
        default=None, description="`stored`: road heading minus lot heading, counter-clockwise"
    )
    x_m: Finite | None = Field(default=None, description="`stored`: of the origin on the virtual road's map")
    y_m: Finite | None = Field(default=None, description="`stored`: of the origin on the virtual road's map")
    residual_m: Annotated[float, Field(ge=0.0, le=1.0)] | None = Field(
        default=None, description="`stored`: worst error of its points; `surveyed_pairs`: the worst that is accepted"
    )
    lot_points: Corners | None = Field(
        default=None, description="`surveyed_pairs`: `[[latitude_deg, longitude_deg], …]`, two or more"
    )
    street_points_m: Annotated[tuple[MapPoint, ...], Field(strict=False)] | None = Field(
        default=None, description="`surveyed_pairs`: the same places on the virtual road's map, `[[x, y], …]`"
    )

    start: CarPlace | None = Field(
        default=None,
        description="`stored`: `[latitude_deg, longitude_deg, heading_deg]` of the rear axle at the path's start; a "
        "simulated vehicle stands there",
    )

    @model_validator(mode="after")
    def _of_its_kind(self) -> Self:
        made, stored, pairs = ("stored", "surveyed_pairs"), ("stored",), ("surveyed_pairs",)
        keys: dict[str, tuple[str, ...]] = dict.fromkeys(("network", "date", "residual_m"), made)
        keys |= dict.fromkeys(("origin", "rotation_deg", "x_m", "y_m"), stored)
        if self.start is not None and self.kind != "stored":
            raise ValueError(f"start says nothing for kind {self.kind!r}, it is for stored")
        _only(self, self.kind, keys | dict.fromkeys(("lot_points", "street_points_m"), pairs))
        return self


class WatchdogTest(Table):
    """What the DBW controller's own watchdog did when the frames stopped, tried on this car."""

    date: Date = Field(description="day of the test")
    armed: bool = Field(description="whether the DBW controller's watchdog is armed: it braked by itself")
    deceleration_mps2: Grip = Field(
        description="lowest measured, on the level; of a DBW controller that did not brake, that of rolling"
    )
    delay_s: Short = Field(description="after the last frame; the time in which the deceleration sets in counts half")
    valid_days: Days = Field(default=365, description="after the test, for a real car: then it is made again")
    records: Annotated[tuple[Name, ...], Field(strict=False)] = Field(
        default=(),
        description="records of the test's runs, seen from the folder that commands are run in: the doctor reads both "
        "figures from them again. A real car whose watchdog is armed needs one at least",
    )

    @model_validator(mode="after")
    def _braked_by_somebody(self) -> Self:
        """Refuse a deceleration that no car has by itself where nobody braked."""
        if not self.armed and self.deceleration_mps2 > MAX_ROLLING_DECELERATION:
            raise ValueError(
                f"deceleration_mps2: {self.deceleration_mps2:g} m/s2 with armed = false, where nobody brakes; expected "
                f"that of rolling, at most {MAX_ROLLING_DECELERATION:g}"
            )
        return self


class Latency(Table):
    """How late a command may be."""

    budget_ms: Annotated[float, Field(gt=0.0, le=100.0)] = Field(
        default=40.0, description="from the arrival of a fix to the last command frame of its tick"
    )
    breaches: Annotated[int, Field(ge=1, le=50)] = Field(
        default=10, description="ticks over the budget within a second that are a reason to stop"
    )
    deadline_ms: Annotated[float, Field(gt=0.0, lt=20.0)] = Field(
        default=8.0, description="how long a tick waits for the datagram that is due"
    )


class Operator(Table):
    """Who engages and stops."""

    automatic: bool = Field(
        default=False, description="engages and goes by itself; for simulated vehicles on a pty or a vcan only"
    )
    stop_can_id: Annotated[int, Field(ge=0, le=0x7FF)] | None = Field(
        default=None, description="a frame with this identifier on the car's bus asks for a stop"
    )
    when_another_car_stops: Literal["stop", "go_on"] = Field(
        default="stop",
        description="in a drive of several real cars, what this one does where another one is stopped, is no longer "
        "engaged, or has lost its gateway",
    )


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


class CarStart(StartPose, CarDifferences):
    """The simulated vehicle: where it stands and how it differs from what the rig declares."""

    channel: Name | None = Field(
        default=None, description="SocketCAN channel of the car's own end, where it is not the rig's (two cards)"
    )
    brain_channel: PtyLink | None = Field(
        default=None,
        description="`pty:FILE`: a second port on the car's bus, where that is a pty: FILE becomes a link to the "
        "serial port that an external controller opens",
    )


class RigFault(Table):
    """A fault that is injected into the simulated vehicle."""

    kind: Name = Field(description="see the fault matrix")
    at_s: NotNegative = Field(description="after the car first moves, or see `from_start`")
    for_s: Positive = Field(default=3600.0, description="how long it lasts")
    value: Finite | None = Field(default=None, description="how strong it is, where the kind knows that")
    shape: Literal["step", "ramp", "flapping"] = Field(
        default="step",
        description="`step`: its whole strength at once; `ramp`: grows linearly to `value` over `for_s`; `flapping`: "
        "in turn on and off, each for `period_s`",
    )
    period_s: Positive | None = Field(default=None, description="of `flapping`: each half's duration")
    from_start: bool = Field(default=False, description="`at_s` counts from the start of the drive")


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


class Rig(Table):
    """One car with its receiver, its bus and its lot."""

    FORMER: ClassVar[Mapping[str, str]] = {"rehearse": "faults"}

    title: Name
    car: Literal["real", "simulated"] = Field(description="`real` or `simulated`")
    pose: ReceiverTable
    mounting: RigMounting
    bus: RigBus
    drive_by_wire: DriveByWire
    vehicle: RigVehicle
    calibration: RigCalibration
    simulated: Simulated
    measured: MeasuredImperfections | None = Field(
        default=None, description="as the vehicle model's, for `car_start.fidelity`"
    )
    limits: RigLimits
    lot: RigLot
    alignment: RigAlignment = RigAlignment()
    alignments: dict[Annotated[str, Field(pattern=r"^[A-Za-z0-9_-]{1,64}$")], RigAlignment] = Field(
        default={}, description="in place of `[alignment]`, each for the scenario of its name"
    )
    watchdog_test: WatchdogTest | None = None
    latency: Latency = Latency()
    operator: Operator = Operator()
    view: RigView = RigView()
    people: tuple[RigPerson, ...] = Field(default=(), strict=False)
    people_page: RigPeoplePage = RigPeoplePage()
    v2x: RigV2x | None = None
    ros2: RigRos2 = RigRos2()
    others: tuple[Other, ...] = Field(default=(), strict=False)
    brain: Brain = Brain()
    outputs: tuple[RigOutput, ...] = Field(default=(), strict=False)
    car_start: CarStart | None = None
    faults: tuple[RigFault, ...] = Field(default=(), strict=False)


@functools.cache
def rig_with(receiver: type[ReceiverTable]) -> type[Rig]:
    """Return the model of a rig whose `[pose]` is of this kind."""
    return create_model("Rig", __base__=Rig, pose=(receiver, ...))
