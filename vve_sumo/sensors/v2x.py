"""A V2X receiver on the ego: what the awareness messages of vehicles, people and cyclists tell it.

Every actor with a radio is a station: it finds its own place with the errors of its receiver, sends CAMs or VAMs by the
standards' rules (`v2x.triggering`) and is heard or not by what is in between (`radio`). What is heard comes out after a
latency, rounded as the message has it; the last message of every station stays until it is too old. All of this is done
in the slack of the tick. Every station has a random stream of its own.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import numpy as np

from vve_sumo.body_kinds import BODY_KINDS, TYPICAL, number_of
from vve_sumo.frames import MapFrame, wrap_angle
from vve_sumo.sensors.body_shapes import finite_rows
from vve_sumo.sensors.port import Column, SensorColumn
from vve_sumo.sensors.radio import Antenna, Fading, Obstacles, antenna_of, received_power
from vve_sumo.sensors.random_streams import CorrelatedNoise, stream
from vve_sumo.sensors.street import Walls
from vve_sumo.v2x import cam, vam
from vve_sumo.v2x.cam import Cam
from vve_sumo.v2x.data_elements import StationType
from vve_sumo.v2x.pdu_header import MessageId
from vve_sumo.v2x.reference_position import ConfidenceEllipse
from vve_sumo.v2x.triggering import CHECK_PERIOD, CamTrigger, Motion, VamTrigger
from vve_sumo.v2x.vam import Vam
from vve_sumo.values import Actors, Point, Pose, Stations, Vehicle

#: numbers of the messages, as their header has them
CAM, VAM = int(MessageId.CAM), int(MessageId.VAM)
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
#: a message older than twice the longest interval to the next is forgotten [s]
CAM_LIFETIME, VAM_LIFETIME = 2.0, 10.0
#: of the errors of a station's place and speed from one second to the next
ERROR_CORRELATION: Final = 0.9
#: at least so often an output comes out, also where nothing is heard [s]
HEARTBEAT: Final = 0.5
MICROSECONDS: Final = 1_000_000

COLUMNS: Final = (
    SensorColumn("station", "int", "ID of the station"),
    SensorColumn("message", "int8", f"kind of the message: {CAM} CAM, {VAM} VAM"),
    SensorColumn("kind", "int8", f"of the body: {', '.join(f'{n} {kind}' for n, kind in enumerate(BODY_KINDS))}"),
    SensorColumn("age_s", "float", "from the time that the message tells of to the reading"),
    SensorColumn("latitude_deg", "float", "in a CAM of the middle of the front, in a VAM of the body's middle"),
    SensorColumn("longitude_deg", "float", "in a CAM of the middle of the front, in a VAM of the body's middle"),
    SensorColumn("x_m", "float", "of the middle of the body, ahead of the front bumper"),
    SensorColumn("y_m", "float", "of the middle of the body, to the left"),
    SensorColumn("heading_rad", "float", "from the car's forward axis, counter-clockwise"),
    SensorColumn("speed_mps", "float", "over the ground, along the heading"),
    SensorColumn("length_m", "float", "of the body; what is usual for its kind where the message has none"),
    SensorColumn("width_m", "float", "of the body; what is usual for its kind where the message has none"),
    SensorColumn("uncertainty_m", "float", "radius in which the place is with 95 %, as the message has it"),
    SensorColumn("power_dbm", "float", "that was received: truth for the record"),
    SensorColumn("actor", "str", "name of the actor: truth for the record"),
)


@dataclass(frozen=True, slots=True)
class V2xConfig:
    """The receiver and the stations around it. The defaults are assumptions of the usual order."""

    equipped: float = 1.0  #: share of the vehicles that send
    equipped_vulnerable: float = 1.0  #: share of the people and bicycles that send
    latency: float = 0.05  #: from the time that a message tells of to its coming out [s]
    power: float = 23.0  #: radiated, gains included [dBm]
    sensitivity: float = -82.0  #: least power at which a packet is received [dBm]
    loss: float = 0.02  #: share of the packets that others' drown
    x: float = 1.0  #: of the antenna from the rear axle forward [m]
    y: float = 0.0  #: of the antenna to the left [m]
    z: float = 1.5  #: of the antenna above the ground [m]
    position_sigma: float = 0.5  #: of a vehicle's own place, on each axis [m]
    position_sigma_vulnerable: float = 1.5  #: of a person's or a cyclist's own place, on each axis [m]
    speed_sigma: float = 0.1  #: of a station's own speed [m/s]

    def ideal(self) -> V2xConfig:
        """Return the same where everybody sends, every packet comes and no station errs."""
        return replace(
            self,
            equipped=1.0,
            equipped_vulnerable=1.0,
            sensitivity=-math.inf,
            loss=0.0,
            position_sigma=0.0,
            position_sigma_vulnerable=0.0,
            speed_sigma=0.0,
        )


class _Message(NamedTuple):
    """A message that was received, and the truth beside it."""

    station: int
    message: int
    kind: int
    time: float  #: drive time that it tells of [s]
    latitude_deg: float
    longitude_deg: float
    x: float  #: of the middle of the body, map [m]
    y: float  #: of the middle of the body, map [m]
    heading: float  #: [rad], counter-clockwise from the map's +x
    true_heading: float  #: [rad], counter-clockwise from true east
    speed: float  #: [m/s]
    yaw_rate: float  #: [rad/s]; 0 where the message has none
    acceleration: float  #: [m/s2]; 0 where the message has none
    length: float  #: [m]
    width: float  #: [m]
    uncertainty: float  #: radius in which the place is with 95 % [m]
    power: float  #: [dBm]
    actor: str


class V2xReading(NamedTuple):
    """The messages that came out at one time."""

    time: float  #: drive time [s]
    messages: Sequence[_Message]
    x: Sequence[float]  #: of each body's middle, ahead of the front bumper [m]
    y: Sequence[float]  #: of each body's middle, to the left [m]
    heading: Sequence[float]  #: from the car's axis [rad]

    def columns(self) -> tuple[Column, ...]:
        """Return the rows of the record's table."""
        came = self.messages
        numbers = (
            np.array([one.station for one in came], np.int64),
            np.array([one.message for one in came], np.int8),
            np.array([one.kind for one in came], np.int8),
        )
        floats = (
            [self.time - one.time for one in came],
            [one.latitude_deg for one in came],
            [one.longitude_deg for one in came],
            self.x,
            self.y,
            self.heading,
            [one.speed for one in came],
            [one.length for one in came],
            [one.width for one in came],
            [one.uncertainty for one in came],
            [one.power for one in came],
        )
        return *numbers, *(np.array(column, np.float64) for column in floats), tuple(one.actor for one in came)


@dataclass(slots=True)
class _Station:
    """An actor with a radio."""

    number: int
    trigger: CamTrigger | VamTrigger
    errors: CorrelatedNoise
    fading: Fading
    chance: np.random.Generator
    next_check: int  # [us]
    checked: tuple[int, float, float] | None = None  # time [us], heading [rad] and speed [m/s] at the last check


_NOWHERE: Final = Pose(0.0, Point.REAR_AXLE, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


class _Look(NamedTuple):
    """What the last tick showed."""

    time: float
    pose: Pose
    actors: Actors


class V2xReceiver:
    """A receiver on the ego. Pass it every tick in order, then call `prepare` in the tick's slack."""

    def __init__(
        self, config: V2xConfig, vehicle: Vehicle, generator: np.random.Generator, walls: Walls, frame: MapFrame
    ) -> None:
        """`frame` is that of the map, in which stations say where they are."""
        self._config, self._bumper, self._walls, self._frame = config, vehicle.rear_axle_to_bumper, walls, frame
        self._seed = generator.bytes(32)
        self._look: _Look | None = None
        self._stations: dict[str, _Station | None] = {}  # by actor; None for one without a radio
        self._numbers: set[int] = set()
        self._on_the_way: list[_Message] = []  # in the order of their times
        self._known: dict[int, _Message] = {}  # by station, the last message of each
        self.output = _stations_of(-math.inf, (), _NOWHERE, 0.0)  #: for the controller
        self.refused = 0  #: actors left out at the last tick because of a value that is not finite

    def step(self, time: float, pose: Pose, actors: Actors) -> None:
        """Take the ego's pose and the actors at drive time `time` [s]; all work is left to `prepare`."""
        if pose.point is not Point.REAR_AXLE:
            raise ValueError(f"v2x: the pose must be the rear axle's, got {pose.point}")
        if not math.isfinite(pose.x + pose.y + pose.heading + pose.speed):
            raise ValueError("v2x: the pose is not finite")
        self._look = _Look(time, pose, actors)
        self.refused = len(actors.ids) - len(finite_rows(actors))

    def prepare(self) -> V2xReading | None:
        """Let the stations send; return the messages that come out at the next tick, if any do."""
        look = self._look
        if look is None:
            return None
        self._send(look)
        came = self._arrived(look.time)
        for one in came:
            self._known[one.station] = one
        if not came and look.time - self.output.time < HEARTBEAT:
            return None
        self._forget(look.time)
        self.output = _stations_of(look.time, tuple(self._known.values()), look.pose, self._bumper)
        places = [_seen_from(look.pose, self._bumper, one) for one in came]
        x, y, heading = zip(*places, strict=True) if places else ((), (), ())
        return V2xReading(look.time, came, x, y, heading)

    def _arrived(self, now: float) -> list[_Message]:
        """Take the messages that come out by now off the way."""
        count = 0
        for one in self._on_the_way:
            if one.time + self._config.latency > now + 1e-9:
                break
            count += 1
        came, self._on_the_way = self._on_the_way[:count], self._on_the_way[count:]
        return came

    def _forget(self, now: float) -> None:
        for one in list(self._known.values()):
            if now - one.time > (CAM_LIFETIME if one.message == CAM else VAM_LIFETIME):
                del self._known[one.station]

    def _send(self, look: _Look) -> None:
        """Let every station that is due send, and put what is received on its way."""
        now, obstacles = round(look.time * MICROSECONDS), None
        for row in finite_rows(look.actors).tolist():
            station = self._station(look.actors.ids[row], int(look.actors.kind[row]), now)
            if station is None or now < station.next_check:
                continue
            station.next_check += CHECK_PERIOD * ((now - station.next_check) // CHECK_PERIOD + 1)
            own, change = self._own_motion(station, look.actors, row, now), _change(station, look.actors, row, now)
            if not station.trigger.due(now, own):
                continue
            obstacles = obstacles or Obstacles(look.actors, self._walls)
            power = self._power(station, look, row, obstacles)
            lost = station.chance.random() < self._config.loss
            if power >= self._config.sensitivity and not lost:
                self._on_the_way.append(self._message(station, look, row, own, change, power))

    def _station(self, name: str, kind: int, now: int) -> _Station | None:
        """Return an actor's station; None where it has no radio."""
        if name not in self._stations:
            chance = stream(self._seed, name)
            vulnerable = BODY_KINDS[kind] in VULNERABLE
            share = self._config.equipped_vulnerable if vulnerable else self._config.equipped
            equipped, phase = chance.random() < share, int(chance.integers(CHECK_PERIOD))
            self._stations[name] = None
            if equipped:
                self._stations[name] = _Station(
                    self._number(name),
                    VamTrigger() if vulnerable else CamTrigger(),
                    CorrelatedNoise(stream(self._seed, f"{name} errors"), ERROR_CORRELATION, MICROSECONDS),
                    Fading(stream(self._seed, f"{name} fading")),
                    chance,
                    now + phase,
                )
        return self._stations[name]

    def _number(self, name: str) -> int:
        """Give a station an ID that no other has."""
        digest = hashlib.blake2b(name.encode(), key=self._seed, digest_size=4).digest()
        number = int.from_bytes(digest, "little")
        while number in self._numbers:
            number = (number + 1) % 2**32
        self._numbers.add(number)
        return number

    def _own_motion(self, station: _Station, actors: Actors, row: int, now: int) -> Motion:
        """Return where a message has a body and how it moves, as its own receiver has it."""
        config = self._config
        vulnerable = BODY_KINDS[actors.kind[row]] in VULNERABLE
        sigma = config.position_sigma_vulnerable if vulnerable else config.position_sigma
        _, east, north, speed = station.errors.at(now)
        # A CAM tells of the middle of the front, a VAM of the middle of the ground that somebody covers.
        heading, half = float(actors.heading[row]), 0.0 if vulnerable else 0.5 * float(actors.length[row])
        return Motion(
            float(actors.x[row]) + half * math.cos(heading) + sigma * east,
            float(actors.y[row]) + half * math.sin(heading) + sigma * north,
            heading,
            max(float(actors.speed[row]) + config.speed_sigma * speed, 0.0),
        )

    def _power(self, station: _Station, look: _Look, row: int, obstacles: Obstacles) -> float:
        config, pose = self._config, look.pose
        cos, sin = math.cos(pose.heading), math.sin(pose.heading)
        x, y = pose.x + config.x * cos - config.y * sin, pose.y + config.x * sin + config.y * cos
        receiver, sender = Antenna(x, y, config.z), antenna_of(look.actors, row)
        found = obstacles.between(receiver, sender, row)
        return received_power(config.power, receiver, sender, found, station.fading)

    def _message(
        self, station: _Station, look: _Look, row: int, own: Motion, change: _Change, power: float
    ) -> _Message:
        """Return what a receiver reads of a station's message."""
        actors, kind = look.actors, BODY_KINDS[look.actors.kind[row]]
        latitude, longitude = self._frame.to_geodetic(own.x, own.y)
        turn = self._frame.convergence(latitude, longitude)
        vulnerable, size = kind in VULNERABLE, (float(actors.length[row]), float(actors.width[row]))
        sigma = self._config.position_sigma_vulnerable if vulnerable else self._config.position_sigma
        own_state = _OwnState(
            station.number,
            STATION_TYPES[kind],
            round(look.time * 1000.0),
            math.degrees(latitude),
            math.degrees(longitude),
            ConfidenceEllipse(SEMI_AXIS_95 * sigma, SEMI_AXIS_95 * sigma, 0.0),
            own.heading - turn,
            own.speed,
        )
        read = _read_vam(own_state, change) if vulnerable else _read_cam(own_state, change, *size)
        x, y = self._frame.to_map(math.radians(read.latitude_deg), math.radians(read.longitude_deg))
        heading, half = wrap_angle(read.heading + turn), 0.0 if vulnerable else 0.5 * read.length
        middle = (x - half * math.cos(heading), y - half * math.sin(heading))
        return _Message(
            station.number,
            VAM if vulnerable else CAM,
            number_of(KINDS[STATION_TYPES[kind]]),
            look.time,
            read.latitude_deg,
            read.longitude_deg,
            *middle,
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


class _OwnState(NamedTuple):
    """What a station says of itself in either message, in the order of their fields."""

    station: int
    station_type: StationType
    time_ms: int
    latitude_deg: float
    longitude_deg: float
    confidence: ConfidenceEllipse
    heading: float  #: counter-clockwise from true east [rad]
    speed: float  #: [m/s]


class _Read(NamedTuple):
    """What a receiver has of a message; what it does not tell is filled in."""

    latitude_deg: float
    longitude_deg: float
    heading: float  #: counter-clockwise from true east [rad]
    speed: float
    yaw_rate: float
    acceleration: float
    length: float
    width: float
    uncertainty: float


class _Change(NamedTuple):
    """How a body's motion has changed since the last check."""

    acceleration: float = 0.0  #: along its heading [m/s2]
    yaw_rate: float = 0.0  #: [rad/s]


def _change(station: _Station, actors: Actors, row: int, now: int) -> _Change:
    """Return how a body's motion has changed since the station's last check; nothing at the first."""
    heading, speed, last = float(actors.heading[row]), float(actors.speed[row]), station.checked
    station.checked = (now, heading, speed)
    if last is None:
        return _Change()
    elapsed = (now - last[0]) / MICROSECONDS
    return _Change((speed - last[2]) / elapsed, wrap_angle(heading - last[1]) / elapsed)


def _read_cam(own: _OwnState, change: _Change, length: float, width: float) -> _Read:
    read = cam.rounded(Cam(*own, False, change.acceleration, change.yaw_rate, None, length, width))
    return _read(read, read.length or length, read.width or width)


def _read_vam(own: _OwnState, change: _Change) -> _Read:
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


def _seen_from(pose: Pose, bumper: float, one: _Message) -> tuple[float, float, float]:
    """Return where a body is ahead of the front bumper and to its left [m], and its heading from the axis [rad]."""
    cos, sin = math.cos(pose.heading), math.sin(pose.heading)
    east, north = one.x - pose.x, one.y - pose.y
    return east * cos + north * sin - bumper, north * cos - east * sin, wrap_angle(one.heading - pose.heading)


def _stations_of(time: float, known: Sequence[_Message], pose: Pose, bumper: float) -> Stations:
    """Return what is known of stations, as a controller sees it."""
    places = [_seen_from(pose, bumper, one) for one in known]
    columns = (
        [time - one.time for one in known],
        [math.radians(one.latitude_deg) for one in known],
        [math.radians(one.longitude_deg) for one in known],
        [place[0] for place in places],
        [place[1] for place in places],
        [place[2] for place in places],
        [one.true_heading for one in known],
        [one.speed for one in known],
        [one.yaw_rate for one in known],
        [one.acceleration for one in known],
        [one.length for one in known],
        [one.width for one in known],
        [one.uncertainty for one in known],
    )
    return Stations(
        time,
        np.array([one.station for one in known], np.int64),
        np.array([one.message for one in known], np.int8),
        np.array([one.kind for one in known], np.int8),
        *(np.array(column, np.float64) for column in columns),
    )
