"""Encodes what the ego itself says as packets: its CAMs, its DENMs, and what its camera sees as CPMs.

It must not know what the packets travel on.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

from vve_sumo.body_kinds import BODY_KINDS
from vve_sumo.frames import MapFrame
from vve_sumo.sensors.v2x_senders import SEMI_AXIS_95, STATION_TYPES
from vve_sumo.v2x import cam, cpm, its_time, uper
from vve_sumo.v2x.cam import Cam
from vve_sumo.v2x.cpm import Cpm, Sensor, SensorType
from vve_sumo.v2x.data_elements import StationType
from vve_sumo.v2x.events import SEQUENCES, EventTrigger, Notice, Warner, notification
from vve_sumo.v2x.pdu_header import MessageId
from vve_sumo.v2x.perceived_object import PerceivedObject
from vve_sumo.v2x.reference_position import ConfidenceEllipse
from vve_sumo.v2x.triggering import CHECK_PERIOD, CamTrigger, Motion, PerceptionTrigger
from vve_sumo.values import CameraObjects, Pose, Vehicle
from vve_sumo.wire.sample import OwnMotion, SampleContent, earlier_pose
from vve_sumo.wire.v2x_packets import LowFrequency, area_packet, awareness_packet, single_hop, vector_of

#: of the ego: any number that no other station has will do
EGO_STATION: Final = 1
MICROSECONDS: Final = 1_000_000
#: numbers of objects in a CPM begin again after so many
OBJECT_NUMBERS: Final = 1 << 16
#: of the camera in a CPM
CAMERA_ID: Final = 1
#: kinds of bodies that a CPM includes together
PEOPLE: Final = frozenset({"pedestrian", "child"})


class EgoEncoder:
    """Encodes the ego's own CAM whenever the standard's rule says that it is due."""

    def __init__(self, vehicle: Vehicle, frame: MapFrame) -> None:
        """`frame` is that of the virtual road's map. Raises ConfigError where the package for it is missing."""
        uper.specification("CAM")
        self._vehicle, self._frame = vehicle, frame
        self._trigger, self._low = CamTrigger(), LowFrequency()
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
        return (awareness_packet(MessageId.CAM, said, cam.encode(said)),)


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
        vector = vector_of(
            EGO_STATION, StationType.PASSENGER_CAR, time_ms, *place, abs(pose.speed), pose.heading - north
        )
        return single_hop(MessageId.CPM, vector, cpm.encode(said))


class EgoWarningEncoder:
    """Encodes the ego's own DENMs: of hard braking, and of standing after a stop or a fault.

    Its hazard lights count as on while it stands and the outputs are invalid after they were valid: it knows why it
    stands, and waits no time before it tells of that.
    """

    def __init__(self, vehicle: Vehicle, frame: MapFrame) -> None:
        """`frame` is that of the virtual road's map. Raises ConfigError where the package for it is missing."""
        uper.specification("DENM")
        self._vehicle, self._frame, self._trigger = vehicle, frame, EventTrigger(standing_time=0)
        self._next = -(2**62)  # check [us]
        self._sequence = 0

    def encode(self, own: OwnMotion, time: float, *, hazard_lights: bool) -> Sequence[bytes]:
        """Return the packets that are due at a GNSS time [s]."""
        now, pose = round(time * MICROSECONDS), own.pose
        if now < self._next:
            return ()
        self._next = (now // CHECK_PERIOD + 1) * CHECK_PERIOD
        notices = self._trigger.due(now, pose.acceleration, abs(pose.speed), hazard_lights=hazard_lights)
        return [self._packet(notice, own, time) for notice in notices]

    def _packet(self, notice: Notice, own: OwnMotion, time: float) -> bytes:
        pose, sigma = own.pose, own.position_sigma
        latitude, longitude = self._frame.to_geodetic(*_front(pose, self._vehicle))
        warner = Warner(
            EGO_STATION,
            StationType.PASSENGER_CAR,
            its_time.from_gnss(time),
            math.degrees(latitude),
            math.degrees(longitude),
            ConfidenceEllipse(SEMI_AXIS_95 * sigma, SEMI_AXIS_95 * sigma, 0.0) if sigma > 0.0 else None,
            pose.heading - self._frame.convergence(latitude, longitude),
            abs(pose.speed),
        )
        self._sequence = (self._sequence + 1) % SEQUENCES
        said = notification(notice, warner, its_time.from_gnss(notice.detected / MICROSECONDS))
        return area_packet(said, notice.cause, self._sequence)


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
