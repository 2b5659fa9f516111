"""Encoder of ASAM OSI 3.8 messages: the virtual road as SensorView with ground truth, radar detections as SensorData.

OSI's global frame is the virtual road's map, x east, y north; the origin of its vehicle frame is the middle of the rear
axle, its sensor frame here in the middle of the front bumper, where a scan counts from. Angles are counter-clockwise in
both. Needs the packages of the extra `osi`; it must not know where messages go.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Final

from vve_sumo.errors import ConfigError
from vve_sumo.values import Actors, Detections, Pose, Vehicle

if TYPE_CHECKING:
    from osi3.osi_groundtruth_pb2 import GroundTruth
    from osi3.osi_object_pb2 import MovingObject
    from osi3.osi_sensordata_pb2 import SensorData
    from osi3.osi_sensorview_pb2 import SensorView

VERSION: Final = (3, 8, 0)
HOST, RADAR = 0, 1  #: identifiers of the ego and of the radar; those of actors begin at FIRST_ACTOR
FIRST_ACTOR: Final = 100
#: height of what is drawn in one plane only: an assumption [m]
HEIGHT: Final = 1.5
#: a box shorter than these is a pedestrian, a two-wheeler, a car; a longer one a truck [m]: an assumption by size
PEDESTRIAN, TWO_WHEELER, CAR = 1.2, 2.4, 6.5
NANOSECONDS: Final = 1_000_000_000


class Encoder:
    """Makes the messages of one drive; an actor keeps its identifier for as long as the encoder lives."""

    def __init__(self, vehicle: Vehicle, projection: str, map_offset: tuple[float, float] = (0.0, 0.0)) -> None:
        """`projection` is the PROJ string of the virtual road's map, empty where nobody knows it.

        Raises ConfigError where the packages are missing.
        """
        try:
            import osi3.osi_sensordata_pb2 as sensor_data
            import osi3.osi_sensorview_pb2 as sensor_view
        except ImportError:
            raise ConfigError("OSI needs osi-python: pip install 'vve-sumo[osi]'") from None
        self._data, self._view = sensor_data, sensor_view
        self._vehicle, self._projection, self._map_offset = vehicle, projection, map_offset
        self._numbers: dict[str, int] = {}
        self._cycle = 0

    def sensor_view(self, time: float, pose: Pose, actors: Actors) -> SensorView:
        """Return the virtual road at a time [s]: the ego from the rear axle's pose, and every actor, in the map."""
        message = self._view.SensorView()
        _head(message, time)
        message.sensor_id.value = RADAR
        message.host_vehicle_id.value = HOST
        self._mount(message.mounting_position)
        truth = message.global_ground_truth
        _head(truth, time)
        truth.host_vehicle_id.value = HOST
        if self._projection:
            truth.proj_string = self._projection
            # OSI adds its offset to a message's coordinates before it applies the projection's inverse.
            x, y = self._map_offset
            offset = truth.proj_frame_offset.position
            offset.x, offset.y, offset.z = -x, -y, 0.0
        self._ego(truth, pose)
        for row, name in enumerate(actors.ids):
            self._actor(truth.moving_object.add(), name, actors, row)
        return message

    def sensor_data(self, time: float, scan: Detections, delay: float, valid: bool = True) -> SensorData:
        """Return the radar's newest scan as it stands at a time [s]; `delay` [s] is from its measuring until then.

        A message that is not valid has no detection and says that the sensor is not available.
        """
        message = self._data.SensorData()
        _head(message, time)
        message.sensor_id.value = RADAR
        self._mount(message.mounting_position)
        radar = message.feature_data.radar_sensor.add()
        header = radar.header
        header.sensor_id.value = RADAR
        header.cycle_counter = self._cycle
        self._cycle += 1
        self._mount(header.mounting_position)
        if not valid:
            header.data_qualifier = header.DATA_QUALIFIER_NOT_AVAILABLE
            return message
        for stamp in (header.measurement_time, message.last_measurement_time):
            _stamp(stamp, time - delay)
        header.data_qualifier = header.DATA_QUALIFIER_AVAILABLE
        header.number_of_valid_detections = len(scan.range)
        columns = (scan.range.tolist(), scan.azimuth.tolist(), scan.range_rate.tolist())
        for number, (distance, azimuth, range_rate) in enumerate(zip(*columns, strict=True)):
            found = radar.detection.add()
            found.object_id.value = number
            found.existence_probability = 1.0
            found.position.distance, found.position.azimuth, found.position.elevation = distance, azimuth, 0.0
            found.radial_velocity = range_rate
        return message

    def _mount(self, position: Any) -> None:
        position.position.x = self._vehicle.rear_axle_to_bumper
        position.position.y = position.position.z = 0.0
        position.orientation.yaw = position.orientation.pitch = position.orientation.roll = 0.0

    def _ego(self, truth: GroundTruth, pose: Pose) -> None:
        vehicle, ego = self._vehicle, truth.moving_object.add()
        back = vehicle.length / 2.0 - vehicle.rear_overhang  # from the box's centre back to the rear axle
        cos, sin = math.cos(pose.heading), math.sin(pose.heading)
        ego.id.value = HOST
        ego.type = ego.TYPE_VEHICLE
        ego.vehicle_classification.type = ego.vehicle_classification.TYPE_MEDIUM_CAR
        # The centre lies ahead of the axle, and a yawing car carries it to the side.
        aside = pose.lateral_speed + pose.yaw_rate * back
        _body(ego, pose.x + back * cos, pose.y + back * sin, pose.heading, (vehicle.length, vehicle.width))
        _velocity(ego, pose.speed, aside, pose.heading)
        ego.base.orientation_rate.yaw = pose.yaw_rate
        attributes = ego.vehicle_attributes
        attributes.bbcenter_to_rear.x = -back
        attributes.bbcenter_to_rear.y, attributes.bbcenter_to_rear.z = 0.0, -HEIGHT / 2.0

    def _actor(self, other: MovingObject, name: str, actors: Actors, row: int) -> None:
        other.id.value = self._numbers.setdefault(name, FIRST_ACTOR + len(self._numbers))
        length, width = float(actors.length[row]), float(actors.width[row])
        heading = float(actors.heading[row])
        _body(other, float(actors.x[row]), float(actors.y[row]), heading, (length, width))
        _velocity(other, float(actors.speed[row]), float(actors.lateral_speed[row]), heading)
        if length < PEDESTRIAN:
            other.type = other.TYPE_PEDESTRIAN
            return
        other.type = other.TYPE_VEHICLE
        kinds = other.vehicle_classification
        kinds.type = (
            kinds.TYPE_BICYCLE
            if length < TWO_WHEELER
            else kinds.TYPE_MEDIUM_CAR
            if length < CAR
            else kinds.TYPE_HEAVY_TRUCK
        )


def _head(message: Any, time: float) -> None:
    message.version.version_major, message.version.version_minor, message.version.version_patch = VERSION
    _stamp(message.timestamp, time)


def _stamp(stamp: Any, time: float) -> None:
    stamp.seconds, stamp.nanos = divmod(round(time * NANOSECONDS), NANOSECONDS)


def _body(body: MovingObject, x: float, y: float, heading: float, size: tuple[float, float]) -> None:
    base = body.base
    base.dimension.length, base.dimension.width = size
    base.dimension.height = HEIGHT
    base.position.x, base.position.y, base.position.z = x, y, HEIGHT / 2.0
    base.orientation.yaw, base.orientation.pitch, base.orientation.roll = heading, 0.0, 0.0


def _velocity(body: MovingObject, speed: float, lateral: float, heading: float) -> None:
    cos, sin = math.cos(heading), math.sin(heading)
    velocity = body.base.velocity
    velocity.x, velocity.y, velocity.z = speed * cos - lateral * sin, speed * sin + lateral * cos, 0.0
