"""What a station of the virtual road sends: an actor with a radio, by what its own receiver and sensors have.

A vehicle sends CAMs and, where it is to, DENMs of what happens to it and CPMs of what it perceives; people and cyclists
send VAMs. Each message is rounded as it is on the wire. Knows no radio and no receiver.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

from vve_sumo.body_kinds import BODY_KINDS, TYPICAL, number_of
from vve_sumo.frames import MapFrame, wrap_angle
from vve_sumo.sensors.perception import PerceivedBody, Perceiver, Sector
from vve_sumo.sensors.random_streams import CorrelatedNoise
from vve_sumo.sensors.v2x_messages import CAM, CPM, DENM, VAM, HeardMessage, HeardWarning, Origin
from vve_sumo.v2x import cam, cpm, denm, vam
from vve_sumo.v2x.cam import Cam
from vve_sumo.v2x.cpm import Cpm, SensorType
from vve_sumo.v2x.data_elements import StationType
from vve_sumo.v2x.events import EventTrigger, Notice, Warner, notification
from vve_sumo.v2x.perceived_object import PerceivedObject
from vve_sumo.v2x.reference_position import ConfidenceEllipse
from vve_sumo.v2x.triggering import CamTrigger, Motion, VamTrigger
from vve_sumo.v2x.vam import Vam
from vve_sumo.values import Actors

#: what a kind of body is to the standards
STATION_TYPES: Final[Mapping[str, StationType]] = {
    "car": StationType.PASSENGER_CAR,
    "van": StationType.LIGHT_TRUCK,
    "truck": StationType.HEAVY_TRUCK,
    "bus": StationType.BUS,
    "motorcycle": StationType.MOTORCYCLE,
    "bicycle": StationType.CYCLIST,
    "pedestrian": StationType.PEDESTRIAN,
    "child": StationType.PEDESTRIAN,
}
#: the kind of body that a receiver takes a type of station for
KINDS: Final[Mapping[StationType, str]] = {STATION_TYPES[name]: name for name in BODY_KINDS if name != "child"}
#: semi-axis of the circle in which a place is with 95 %, in sigmas of an axis
SEMI_AXIS_95: Final = math.sqrt(-2.0 * math.log(0.05))
#: kinds of bodies that are people or ride with their own muscles: they send VAMs
VULNERABLE: Final = frozenset({"pedestrian", "child", "bicycle"})
#: with 95 % a normal error is not larger [sigmas]
NORMAL_95: Final = 1.96
MICROSECONDS: Final = 1_000_000
#: of the one sensor of a station
SENSOR_ID: Final = 1


@dataclass(slots=True)
class Sender:
    """An actor with a radio."""

    number: int  #: its ID
    kind: str  #: of its body
    trigger: CamTrigger | VamTrigger
    errors: CorrelatedNoise
    position_sigma: float  #: of its own place, on each axis [m]
    speed_sigma: float  #: of its own speed [m/s]
    events: EventTrigger | None = None  #: None: it warns of nothing
    hazard_lights: bool = False  #: are on
    perceiver: Perceiver | None = None  #: None: it tells of nobody
    checked: tuple[int, float, float] | None = None  #: time [us], heading [rad] and speed [m/s] at the last check

    @property
    def vulnerable(self) -> bool:
        """Whether it is a person or a cyclist."""
        return self.kind in VULNERABLE


class Change(NamedTuple):
    """How a body's motion has changed since the last check."""

    acceleration: float = 0.0  #: along its heading [m/s2]
    yaw_rate: float = 0.0  #: [rad/s]


class Check(NamedTuple):
    """A station at one of its checks."""

    sender: Sender
    actors: Actors
    row: int  #: of the station
    time: float  #: drive time [s]
    now: int  #: the same [us]
    own: Motion  #: as its own receiver has it
    change: Change


def check_of(sender: Sender, actors: Actors, row: int, time: float) -> Check:
    """Return a station's check at drive time `time` [s]; each station's are to be in order."""
    now = round(time * MICROSECONDS)
    own, change = _own_motion(sender, actors, row, now), _change(sender, actors, row, now)
    return Check(sender, actors, row, time, now, own, change)


def _own_motion(sender: Sender, actors: Actors, row: int, now: int) -> Motion:
    """Return where a message has a body and how it moves, as its own receiver has it."""
    sigma = sender.position_sigma
    _, east, north, speed = sender.errors.at(now)
    # A CAM tells of the middle of the front, a VAM of the middle of the ground that somebody covers.
    heading, half = float(actors.heading[row]), 0.0 if sender.vulnerable else 0.5 * float(actors.length[row])
    return Motion(
        float(actors.x[row]) + half * math.cos(heading) + sigma * east,
        float(actors.y[row]) + half * math.sin(heading) + sigma * north,
        heading,
        max(float(actors.speed[row]) + sender.speed_sigma * speed, 0.0),
    )


def _change(sender: Sender, actors: Actors, row: int, now: int) -> Change:
    """Return how a body's motion has changed since the station's last check; nothing at the first."""
    heading, speed, last = float(actors.heading[row]), float(actors.speed[row]), sender.checked
    sender.checked = (now, heading, speed)
    if last is None:
        return Change()
    elapsed = (now - last[0]) / MICROSECONDS
    return Change((speed - last[2]) / elapsed, wrap_angle(heading - last[1]) / elapsed)


class _OwnState(NamedTuple):
    """What a station says of itself in any message, in the order of a CAM's and a VAM's fields."""

    station: int
    station_type: StationType
    time_ms: int
    latitude_deg: float
    longitude_deg: float
    confidence: ConfidenceEllipse
    heading: float  #: counter-clockwise from true east [rad]
    speed: float  #: [m/s]


class _Read(NamedTuple):
    """What a receiver has of an awareness message; what it does not tell is filled in."""

    latitude_deg: float
    longitude_deg: float
    heading: float  #: counter-clockwise from true east [rad]
    speed: float
    yaw_rate: float
    acceleration: float
    length: float
    width: float
    uncertainty: float


class Composer:
    """Turns a station's checks into what a receiver reads of its messages, each of which came with a power [dBm]."""

    def __init__(self, frame: MapFrame) -> None:
        """`frame` is that of the map, in which stations say where they are."""
        self._frame = frame

    def awareness(self, check: Check, power: float) -> tuple[HeardMessage]:
        """Return what a receiver reads of a station's CAM or VAM."""
        sender, actors, row = check.sender, check.actors, check.row
        own_state, turn = self._own_state(check)
        size = float(actors.length[row]), float(actors.width[row])
        vulnerable = sender.vulnerable
        read = _read_vam(own_state, check.change) if vulnerable else _read_cam(own_state, check.change, *size)
        x, y = self._frame.to_map(math.radians(read.latitude_deg), math.radians(read.longitude_deg))
        heading, half = wrap_angle(read.heading + turn), 0.0 if vulnerable else 0.5 * read.length
        read_message = HeardMessage(
            sender.number,
            VAM if vulnerable else CAM,
            number_of(KINDS[own_state.station_type]),
            check.time,
            read.latitude_deg,
            read.longitude_deg,
            x - half * math.cos(heading),
            y - half * math.sin(heading),
            heading,
            read.heading,
            read.speed,
            read.yaw_rate,
            read.acceleration,
            read.length,
            read.width,
            read.uncertainty,
            power,
            actors.ids[row],
        )
        return (read_message,)

    def warning(self, check: Check, notice: Notice, power: float) -> tuple[HeardMessage]:
        """Return what a receiver reads of a station's DENM."""
        own_state, turn = self._own_state(check)
        kind = KINDS[own_state.station_type]
        detected_ms = round(notice.detected / 1000.0)
        read = denm.rounded(notification(notice, Warner(*own_state), detected_ms))
        x, y = self._frame.to_map(math.radians(read.latitude_deg), math.radians(read.longitude_deg))
        towards = read.heading or 0.0
        usual = TYPICAL[kind]
        read_message = HeardMessage(
            check.sender.number,
            DENM,
            number_of(kind),
            check.time,
            read.latitude_deg,
            read.longitude_deg,
            x,
            y,
            wrap_angle(towards + turn) if read.heading is not None else 0.0,
            towards,
            read.speed or 0.0,
            0.0,
            0.0,
            usual.length,
            usual.width,
            _radius(read.confidence),
            power,
            check.actors.ids[check.row],
            read.sequence,
            warning=HeardWarning(
                read.cause or 0,
                read.sub_cause,
                read.termination is not None,
                notice.detected / MICROSECONDS,
                float(read.validity_s),
            ),
        )
        return (read_message,)

    def perception(
        self, check: Check, sector: Sector, bodies: Sequence[PerceivedBody], total: int, power: float
    ) -> tuple[HeardMessage, ...]:
        """Return what a receiver reads of a station's CPM, object by object; `total` bodies are seen."""
        own_state, turn = self._own_state(check)
        confidence = NORMAL_95 * sector.sigma
        read = cpm.rounded(
            Cpm(
                own_state.station,
                own_state.time_ms,
                own_state.latitude_deg,
                own_state.longitude_deg,
                own_state.confidence,
                orientation=own_state.heading,
                sensors=(_sensor(sector),),
                objects=tuple(_object(body, check.actors, turn, confidence) for body in bodies),
                total=min(total, cpm.MAX_OBJECTS),
            )
        )
        return tuple(
            self._perceived(check, read, one, body, turn, power) for one, body in zip(read.objects, bodies, strict=True)
        )

    def _perceived(
        self, check: Check, read: Cpm, one: PerceivedObject, body: PerceivedBody, turn: float, power: float
    ) -> HeardMessage:
        east, north = self._frame.to_map(math.radians(read.latitude_deg), math.radians(read.longitude_deg))
        cos, sin = math.cos(turn), math.sin(turn)
        x, y = east + cos * one.x - sin * one.y, north + sin * one.x + cos * one.y
        latitude, longitude = self._frame.to_geodetic(x, y)
        along_x, along_y = one.velocity_x or 0.0, one.velocity_y or 0.0
        heading = one.heading or 0.0
        kind = KINDS.get(one.kind or StationType.UNKNOWN, "car")
        # What a normal error exceeds in 5 % becomes what a place exceeds in 5 % in any direction.
        spread = SEMI_AXIS_95 / NORMAL_95 * (one.confidence_x or 0.0)
        return HeardMessage(
            check.sender.number,
            CPM,
            number_of(kind),
            check.time,
            math.degrees(latitude),
            math.degrees(longitude),
            x,
            y,
            wrap_angle(heading + turn),
            heading,
            math.sqrt(along_x * along_x + along_y * along_y),
            0.0,
            0.0,
            one.length or TYPICAL[kind].length,
            one.width or TYPICAL[kind].width,
            math.hypot(_radius(read.confidence), spread),
            power,
            check.actors.ids[body.row],
            one.id,
            origin=Origin(read.latitude_deg, read.longitude_deg, read.orientation or 0.0),
        )

    def _own_state(self, check: Check) -> tuple[_OwnState, float]:
        """Return what a station says of itself, and the map's convergence where it is [rad]."""
        sender, own = check.sender, check.own
        latitude, longitude = self._frame.to_geodetic(own.x, own.y)
        turn = self._frame.convergence(latitude, longitude)
        radius = SEMI_AXIS_95 * sender.position_sigma
        return _OwnState(
            sender.number,
            STATION_TYPES[sender.kind],
            round(check.time * 1000.0),
            math.degrees(latitude),
            math.degrees(longitude),
            ConfidenceEllipse(radius, radius, 0.0),
            own.heading - turn,
            own.speed,
        ), turn


def _sensor(sector: Sector) -> cpm.Sensor:
    half = 0.5 * sector.view
    return cpm.Sensor(SENSOR_ID, SensorType.LOCAL_AGGREGATION, sector.range, -half, half)


def _object(body: PerceivedBody, actors: Actors, turn: float, confidence: float) -> PerceivedObject:
    cos, sin, row = math.cos(turn), math.sin(turn), body.row
    heading, speed = float(actors.heading[row]) - turn, float(actors.speed[row])
    return PerceivedObject(
        body.number,
        0.0,
        cos * body.off_x + sin * body.off_y,
        cos * body.off_y - sin * body.off_x,
        confidence,
        confidence,
        speed * math.cos(heading),
        speed * math.sin(heading),
        heading,
        float(actors.length[row]),
        float(actors.width[row]),
        sensors=(SENSOR_ID,),
        kind=STATION_TYPES[BODY_KINDS[actors.kind[row]]],
    )


def _read_cam(own: _OwnState, change: Change, length: float, width: float) -> _Read:
    read = cam.rounded(Cam(*own, False, change.acceleration, change.yaw_rate, None, length, width))
    return _read(read, read.length or length, read.width or width)


def _read_vam(own: _OwnState, change: Change) -> _Read:
    usual = TYPICAL[KINDS[own.station_type]]
    return _read(vam.rounded(Vam(*own, change.acceleration, change.yaw_rate)), usual.length, usual.width)


def _read(message: Cam | Vam, length: float, width: float) -> _Read:
    return _Read(
        message.latitude_deg,
        message.longitude_deg,
        message.heading or 0.0,
        message.speed or 0.0,
        message.yaw_rate or 0.0,
        message.acceleration or 0.0,
        length,
        width,
        _radius(message.confidence),
    )


def _radius(confidence: ConfidenceEllipse | None) -> float:
    return (confidence.semi_major or 0.0) if confidence is not None else 0.0
