"""Encodes what a V2X receiver heard, and what the ego itself says, as packets: messages with their headers.

A packet is what a GeoNetworking router hands on: GeoNetworking header, BTP-B header, CAM or VAM, unsecured. It must not
know what the packets travel on.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Final

from vve_sumo.body_kinds import BODY_KINDS
from vve_sumo.frames import MapFrame
from vve_sumo.sensors.v2x_senders import SEMI_AXIS_95, STATION_TYPES
from vve_sumo.v2x import cam, cpm, geonetworking, its_time, uper, vam
from vve_sumo.v2x.cam import Cam
from vve_sumo.v2x.cpm import Cpm, Sensor, SensorType
from vve_sumo.v2x.data_elements import ExteriorLights, StationType
from vve_sumo.v2x.geonetworking import PORTS, Packet, PositionVector
from vve_sumo.v2x.pdu_header import MessageId
from vve_sumo.v2x.perceived_object import PerceivedObject
from vve_sumo.v2x.reference_position import ConfidenceEllipse
from vve_sumo.v2x.triggering import CHECK_PERIOD, CamTrigger, Motion, PerceptionTrigger
from vve_sumo.v2x.vam import Vam
from vve_sumo.values import CameraObjects, Pose, Stations, Vehicle
from vve_sumo.wire.sample import SampleContent, earlier_pose

#: of the ego: any number that no other station has will do
EGO_STATION: Final = 1
#: a locally administered address ends in the station's ID
_ADDRESS: Final = b"\x02\x00"
#: of the packet of an awareness message [s]: one that is older is of no use
LIFETIME: Final = 1.0
#: profile of congestion control of awareness messages (TS 103 175: DP2)
TRAFFIC_CLASS: Final = 2
#: between two CAMs of a station with a low-frequency container [ms] (EN 302 637-2, 6.1.3)
LOW_FREQUENCY: Final = 500
MICROSECONDS: Final = 1_000_000
#: numbers of objects in a CPM begin again after so many
OBJECT_NUMBERS: Final = 1 << 16
#: of the camera in a CPM
CAMERA_ID: Final = 1
#: kinds of bodies that a CPM includes together
PEOPLE: Final = frozenset({"pedestrian", "child"})


class _LowFrequency:
    """Says which CAMs of each station have the low-frequency container."""

    def __init__(self) -> None:
        self._sent: dict[int, int] = {}

    def lights(self, station: int, time_ms: int) -> ExteriorLights | None:
        """Return the lights that a CAM tells of: none is on; None where it has no such container."""
        if time_ms - self._sent.get(station, -LOW_FREQUENCY) < LOW_FREQUENCY:
            return None
        self._sent[station] = time_ms
        return ExteriorLights(0)


class HeardEncoder:
    """Encodes each message that a receiver heard, once."""

    def __init__(self) -> None:
        """Make the encoder; raises ConfigError where the package for it is missing."""
        uper.specification("CAM"), uper.specification("VAM")
        self._sent: dict[int, float] = {}  # drive time that the last message of each station told of [s]
        self._low = _LowFrequency()

    def encode(self, heard: Stations, offset: float) -> Sequence[bytes]:
        """Return the packets of the messages that are new; `offset` is GNSS time less drive time [s]."""
        return [self._packet(heard, row, time + offset) for row, time in self._new(heard)]

    def _new(self, heard: Stations) -> Iterator[tuple[int, float]]:
        """Rows of new messages with the drive times that they tell of [s]; stations that are gone are forgotten."""
        numbers = heard.number.tolist()
        known = {number: self._sent.get(number, -math.inf) for number in numbers}
        for row, number in enumerate(numbers):
            time = heard.time - float(heard.age[row])
            if time > known[number] + 0.5 / MICROSECONDS:
                known[number] = time
                yield row, time
        self._sent = known

    def _packet(self, heard: Stations, row: int, time: float) -> bytes:
        time_ms, radius = its_time.from_gnss(time), float(heard.uncertainty[row])
        own = (
            int(heard.number[row]),
            STATION_TYPES[BODY_KINDS[heard.kind[row]]],
            time_ms,
            math.degrees(heard.latitude[row]),
            math.degrees(heard.longitude[row]),
            ConfidenceEllipse(radius, radius, 0.0) if radius else None,
            float(heard.true_heading[row]),
            float(heard.speed[row]),
        )
        change = float(heard.acceleration[row]), float(heard.yaw_rate[row])
        if heard.message[row] == MessageId.VAM:
            of_person = Vam(*own, *change)
            return _packet(MessageId.VAM, of_person, vam.encode(of_person))
        size, lights = (float(heard.length[row]), float(heard.width[row])), self._low.lights(own[0], time_ms)
        of_vehicle = Cam(*own, False, *change, None, *size, lights)
        return _packet(MessageId.CAM, of_vehicle, cam.encode(of_vehicle))


class EgoEncoder:
    """Encodes the ego's own CAM whenever the standard's rule says that it is due."""

    def __init__(self, vehicle: Vehicle, frame: MapFrame) -> None:
        """`frame` is that of the virtual road's map. Raises ConfigError where the package for it is missing."""
        uper.specification("CAM")
        self._vehicle, self._frame = vehicle, frame
        self._trigger, self._low = CamTrigger(), _LowFrequency()
        self._next = -(2**62)  # check [us]

    def encode(self, measured: SampleContent, time: float) -> Sequence[bytes]:
        """Return the packet of a sample at a GNSS time [s], where one is due."""
        now, pose, vehicle = round(time * MICROSECONDS), measured.pose, self._vehicle
        if now < self._next:
            return ()
        self._next = (now // CHECK_PERIOD + 1) * CHECK_PERIOD
        x, y = _front(pose, vehicle)
        if not self._trigger.due(now, Motion(x, y, pose.heading, pose.speed)):
            return ()
        latitude, longitude = self._frame.to_geodetic(x, y)
        heading = pose.heading - self._frame.convergence(latitude, longitude)
        sigma, time_ms = measured.fix.position_sigma, its_time.from_gnss(time)
        said = Cam(
            EGO_STATION,
            StationType.PASSENGER_CAR,
            time_ms,
            math.degrees(latitude),
            math.degrees(longitude),
            ConfidenceEllipse(SEMI_AXIS_95 * sigma, SEMI_AXIS_95 * sigma, 0.0) if sigma > 0.0 else None,
            heading,
            abs(pose.speed),
            pose.speed < 0.0,
            pose.acceleration,
            pose.yaw_rate,
            length=vehicle.length,
            width=vehicle.width,
            lights=self._low.lights(EGO_STATION, time_ms),
        )
        return (_packet(MessageId.CAM, said, cam.encode(said)),)


class PerceptionEncoder:
    """Encodes what a camera of the ego sees as CPMs, whenever something that it sees is worth one."""

    def __init__(self, vehicle: Vehicle, frame: MapFrame) -> None:
        """`frame` is that of the virtual road's map. Raises ConfigError where the package for it is missing."""
        uper.specification(cpm.MESSAGE)
        self._vehicle, self._frame, self._trigger = vehicle, frame, PerceptionTrigger()
        self._next = -(2**62)  # check [us]

    def encode(self, objects: CameraObjects, measured: SampleContent, time: float, age: float) -> Sequence[bytes]:
        """Return the packet at a GNSS time [s] for the newest list, which is `age` [s] old; none where none is due.

        An object's speed over the ground is taken to be along the car's axis, and so is its length: a list says no
        more.
        """
        now = round(time * MICROSECONDS)
        if now < self._next or not math.isfinite(age):
            return ()
        self._next = (now // CHECK_PERIOD + 1) * CHECK_PERIOD
        seen = {number: row for row, number in enumerate(objects.number.tolist())}
        then = earlier_pose(measured.pose, age)
        motions = {number: _motion_of(objects, row, then, self._vehicle) for number, row in seen.items()}
        people = {number for number, row in seen.items() if BODY_KINDS[objects.kind[row]] in PEOPLE}
        included = self._trigger.due(now, motions, people)
        if not included:
            return ()
        return (self._packet(objects, measured, time, age, [(seen[one], motions[one]) for one in sorted(included)]),)

    def _packet(
        self,
        objects: CameraObjects,
        measured: SampleContent,
        time: float,
        age: float,
        included: Sequence[tuple[int, Motion]],
    ) -> bytes:
        pose, time_ms, sigma = measured.pose, its_time.from_gnss(time), measured.fix.position_sigma
        x, y = _front(pose, self._vehicle)
        latitude, longitude = self._frame.to_geodetic(x, y)
        north = self._frame.convergence(latitude, longitude)
        cos, sin = math.cos(north), math.sin(north)
        perceived = []
        for row, motion in included:
            east, along, heading = motion.x - x, motion.y - y, motion.heading - north
            perceived.append(
                PerceivedObject(
                    int(objects.number[row]) % OBJECT_NUMBERS,
                    -age,
                    cos * east + sin * along,
                    cos * along - sin * east,
                    velocity_x=motion.speed * math.cos(heading),
                    velocity_y=motion.speed * math.sin(heading),
                    length=float(objects.length[row]),
                    width=float(objects.width[row]),
                    sensors=(CAMERA_ID,),
                    kind=STATION_TYPES[BODY_KINDS[objects.kind[row]]],
                )
            )
        said = Cpm(
            EGO_STATION,
            time_ms,
            math.degrees(latitude),
            math.degrees(longitude),
            ConfidenceEllipse(SEMI_AXIS_95 * sigma, SEMI_AXIS_95 * sigma, 0.0) if sigma > 0.0 else None,
            orientation=pose.heading - north,
            sensors=(Sensor(CAMERA_ID, SensorType.MONOVIDEO),),
            objects=tuple(perceived),
            total=len(objects.number),
        )
        place = said.latitude_deg, said.longitude_deg
        vector = _vector(EGO_STATION, StationType.PASSENGER_CAR, time_ms, *place, abs(pose.speed), pose.heading - north)
        return _single_hop(MessageId.CPM, vector, cpm.encode(said))


def _motion_of(objects: CameraObjects, row: int, then: Pose, vehicle: Vehicle) -> Motion:
    """Return where an object's middle was in the map when the picture was taken, and how it moved."""
    cos, sin = math.cos(then.heading), math.sin(then.heading)
    front_x, front_y = _front(then, vehicle)
    ahead, left = float(objects.x[row] + 0.5 * objects.length[row]), float(objects.y[row])
    speed = float(objects.relative_speed[row]) + then.speed
    heading = then.heading if speed >= 0.0 else then.heading + math.pi
    return Motion(front_x + ahead * cos - left * sin, front_y + ahead * sin + left * cos, heading, abs(speed))


def _front(pose: Pose, vehicle: Vehicle) -> tuple[float, float]:
    ahead = vehicle.rear_axle_to_bumper
    return pose.x + ahead * math.cos(pose.heading), pose.y + ahead * math.sin(pose.heading)


def _packet(message: MessageId, said: Cam | Vam, payload: bytes) -> bytes:
    """Return a message in a packet that direct neighbours hear."""
    place = said.latitude_deg, said.longitude_deg
    motion = said.speed or 0.0, said.heading or 0.0
    return _single_hop(message, _vector(said.station, said.station_type, said.time_ms, *place, *motion), payload)


def _vector(
    station: int,
    kind: StationType,
    time_ms: int,
    latitude_deg: float,
    longitude_deg: float,
    speed: float,
    heading: float,
) -> PositionVector:
    address, time = _ADDRESS + station.to_bytes(4, "big"), time_ms % geonetworking.TIME_MODULUS
    return PositionVector(address, kind, time, latitude_deg, longitude_deg, speed, heading)


def _single_hop(message: MessageId, source: PositionVector, payload: bytes) -> bytes:
    packet = Packet(source, PORTS[message], payload, lifetime=LIFETIME, traffic_class=TRAFFIC_CLASS)
    return geonetworking.encode(packet)
