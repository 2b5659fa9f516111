"""The messages that a V2X receiver on the ego has heard: their rows in the record, and what a controller knows by them.

Knows what a message says once it is read; it must not know who sends when, and no radio.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vve_sumo.body_kinds import BODY_KINDS
from vve_sumo.frames import wrap_angle
from vve_sumo.sensors.port import Column, SensorColumn
from vve_sumo.v2x.pdu_header import MessageId
from vve_sumo.values import Floats, Pose, ReportedObjects, RoadEvents, Stations

#: numbers of the messages, as their header has them
DENM, CAM, CPM, VAM = int(MessageId.DENM), int(MessageId.CAM), int(MessageId.CPM), int(MessageId.VAM)
#: a message older than twice the longest interval to the next is forgotten [s]; a warning holds as long as it says
LIFETIMES: Final = {CAM: 2.0, CPM: 2.0, VAM: 10.0}

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
#: of a receiver that hears more than awareness messages, after the others
MORE_COLUMNS: Final = (
    SensorColumn("item", "int", f"in a CPM ({CPM}) of the object that its row is of, in a DENM ({DENM}) of the event"),
    SensorColumn("cause", "int", "of a DENM's event, at whose place it is: 94 a stationary vehicle, 99 hard braking"),
    SensorColumn("sub_cause", "int", "of a DENM's event, by its cause"),
    SensorColumn("ended", "bool", "whether a DENM says that its event is over"),
)


class Origin(NamedTuple):
    """Where the sender of a CPM is, as its message has it: the middle of its front."""

    latitude_deg: float
    longitude_deg: float
    true_heading: float  #: [rad], counter-clockwise from true east


class HeardWarning(NamedTuple):
    """What a DENM says beyond where its event is."""

    cause: int  #: 0 for an event that has ended
    sub_cause: int
    ended: bool
    detected: float  #: drive time [s]
    validity: float  #: after the detection [s]


class HeardMessage(NamedTuple):
    """A message that was received, or one object of a CPM, and the truth beside it."""

    station: int  #: ID of the sender
    message: int
    kind: int
    time: float  #: drive time that it tells of [s]
    latitude_deg: float
    longitude_deg: float
    x: float  #: of the middle of the body, or of the event, map [m]
    y: float  #: likewise, map [m]
    heading: float  #: [rad], counter-clockwise from the map's +x
    true_heading: float  #: [rad], counter-clockwise from true east
    speed: float  #: [m/s]
    yaw_rate: float  #: [rad/s]; 0 where the message has none
    acceleration: float  #: [m/s2]; 0 where the message has none
    length: float  #: [m]
    width: float  #: [m]
    uncertainty: float  #: radius in which the place is with 95 % [m]
    power: float  #: [dBm]
    actor: str  #: the body that it tells of
    item: int = 0  #: of the object in a CPM, or of the event in a DENM
    origin: Origin | None = None  #: of a CPM
    warning: HeardWarning | None = None  #: of a DENM


class V2xReading(NamedTuple):
    """The messages that came out at one time."""

    time: float  #: drive time [s]
    messages: Sequence[HeardMessage]
    x: Sequence[float]  #: of each body's middle, ahead of the front bumper [m]
    y: Sequence[float]  #: of each body's middle, to the left [m]
    heading: Sequence[float]  #: from the car's axis [rad]
    more: bool = False  #: whether the table has `MORE_COLUMNS`

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
        columns: tuple[Column, ...] = (
            *numbers,
            *(np.array(column, np.float64) for column in floats),
            tuple(one.actor for one in came),
        )
        return (*columns, *self._more()) if self.more else columns

    def _more(self) -> tuple[Column, ...]:
        warnings = [one.warning or _NO_WARNING for one in self.messages]
        return (
            np.array([one.item for one in self.messages], np.int64),
            np.array([one.cause for one in warnings], np.int64),
            np.array([one.sub_cause for one in warnings], np.int64),
            np.array([one.ended for one in warnings], np.bool_),
        )


_NO_WARNING: Final = HeardWarning(0, 0, False, 0.0, 0.0)
_NOWHERE: Final = Origin(0.0, 0.0, 0.0)


@dataclass(slots=True)
class Memory:
    """The last message of every station, of every object that one tells of, and of every event."""

    objects: bool = False  #: whether stations tell of objects
    events: bool = False  #: whether stations warn of events
    _known: dict[tuple[int, int, int], HeardMessage] = field(default_factory=dict)

    def take(self, came: Iterable[HeardMessage]) -> None:
        """Take messages in the order of their coming."""
        for one in came:
            # A station sends CAMs or VAMs, never both.
            self._known[VAM if one.message == CAM else one.message, one.station, one.item] = one

    def forget(self, now: float) -> None:
        """Forget what is too old at drive time `now` [s]."""
        for key, one in list(self._known.items()):
            since, lifetime = one.time, LIFETIMES.get(one.message, 0.0)
            if one.warning is not None:
                since, lifetime = one.warning.detected, one.warning.validity
            if now - since > lifetime:
                del self._known[key]

    def output(self, time: float, pose: Pose, bumper: float) -> Stations:
        """Return what is known at drive time `time` [s], as a controller sees it from a pose of the rear axle."""
        of = {message: list[HeardMessage]() for message in (VAM, CPM, DENM)}
        for (message, _station, _item), one in self._known.items():
            of[message].append(one)
        stations = _View(of[VAM], time, pose, bumper)
        return Stations(
            time,
            number=stations.integers("station"),
            message=stations.small("message"),
            kind=stations.small("kind"),
            age=stations.age,
            latitude=stations.latitude,
            longitude=stations.longitude,
            x=stations.x,
            y=stations.y,
            heading=stations.heading,
            true_heading=stations.floats("true_heading"),
            speed=stations.floats("speed"),
            yaw_rate=stations.floats("yaw_rate"),
            acceleration=stations.floats("acceleration"),
            length=stations.floats("length"),
            width=stations.floats("width"),
            uncertainty=stations.floats("uncertainty"),
            objects=_objects(_View(of[CPM], time, pose, bumper)) if self.objects else None,
            events=_events(_View(of[DENM], time, pose, bumper), time) if self.events else None,
        )


class _View:
    """Messages as columns, seen from the car."""

    def __init__(self, known: Sequence[HeardMessage], time: float, pose: Pose, bumper: float) -> None:
        self.known = known
        columns = zip(*known, strict=True) if known else ((),) * len(HeardMessage._fields)
        self._columns: dict[str, Sequence[Any]] = dict(zip(HeardMessage._fields, columns, strict=True))
        self.age: Floats = np.array([time - then for then in self._columns["time"]], np.float64)
        self.latitude = self._radians("latitude_deg")
        self.longitude = self._radians("longitude_deg")
        seen = [seen_from(pose, bumper, one) for one in known]
        self.x: Floats = np.array([place[0] for place in seen], np.float64)
        self.y: Floats = np.array([place[1] for place in seen], np.float64)
        self.heading: Floats = np.array([place[2] for place in seen], np.float64)

    def floats(self, name: str) -> Floats:
        return np.array(self._columns[name], np.float64)

    def integers(self, name: str) -> NDArray[np.int64]:
        return np.array(self._columns[name], np.int64)

    def small(self, name: str) -> NDArray[np.int8]:
        return np.array(self._columns[name], np.int8)

    def _radians(self, name: str) -> Floats:
        return np.array([math.radians(angle) for angle in self._columns[name]], np.float64)


def _objects(view: _View) -> ReportedObjects:
    origins = [one.origin or _NOWHERE for one in view.known]
    return ReportedObjects(
        sender=view.integers("station"),
        number=view.integers("item"),
        kind=view.small("kind"),
        age=view.age,
        latitude=view.latitude,
        longitude=view.longitude,
        x=view.x,
        y=view.y,
        heading=view.heading,
        true_heading=view.floats("true_heading"),
        speed=view.floats("speed"),
        length=view.floats("length"),
        width=view.floats("width"),
        uncertainty=view.floats("uncertainty"),
        sender_latitude=np.array([math.radians(one.latitude_deg) for one in origins], np.float64),
        sender_longitude=np.array([math.radians(one.longitude_deg) for one in origins], np.float64),
        sender_heading=np.array([one.true_heading for one in origins], np.float64),
    )


def _events(view: _View, time: float) -> RoadEvents:
    warnings = [one.warning or _NO_WARNING for one in view.known]
    return RoadEvents(
        sender=view.integers("station"),
        number=view.integers("item"),
        cause=np.array([one.cause for one in warnings], np.int64),
        sub_cause=np.array([one.sub_cause for one in warnings], np.int64),
        ended=np.array([one.ended for one in warnings], np.int8),
        kind=view.small("kind"),
        age=view.age,
        detected=np.array([time - one.detected for one in warnings], np.float64),
        validity=np.array([one.validity for one in warnings], np.float64),
        latitude=view.latitude,
        longitude=view.longitude,
        x=view.x,
        y=view.y,
        heading=view.heading,
        true_heading=view.floats("true_heading"),
        speed=view.floats("speed"),
        uncertainty=view.floats("uncertainty"),
    )


def seen_from(pose: Pose, bumper: float, one: HeardMessage) -> tuple[float, float, float]:
    """Return where a body is ahead of the front bumper and to its left [m], and its heading from the axis [rad]."""
    cos, sin = math.cos(pose.heading), math.sin(pose.heading)
    east, north = one.x - pose.x, one.y - pose.y
    return east * cos + north * sin - bumper, north * cos - east * sin, wrap_angle(one.heading - pose.heading)
