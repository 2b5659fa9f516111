"""Encodes what a V2X receiver heard as packets: messages with their headers.

It must not know what the packets travel on.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Final

from vve_sumo.body_kinds import BODY_KINDS
from vve_sumo.frames import MapFrame, local_frame
from vve_sumo.sensors.v2x_senders import NORMAL_95, SEMI_AXIS_95, SENSOR_ID, STATION_TYPES
from vve_sumo.v2x import cam, cpm, its_time, uper, vam
from vve_sumo.v2x.cam import Cam
from vve_sumo.v2x.cpm import Cpm, Sensor, SensorType
from vve_sumo.v2x.data_elements import StationType
from vve_sumo.v2x.denm import Cause
from vve_sumo.v2x.events import KINDS, SEQUENCES, Notice, Warner, notification
from vve_sumo.v2x.pdu_header import MessageId
from vve_sumo.v2x.perceived_object import PerceivedObject
from vve_sumo.v2x.reference_position import ConfidenceEllipse
from vve_sumo.v2x.vam import Vam
from vve_sumo.values import Floats, ReportedObjects, RoadEvents, Stations
from vve_sumo.wire.v2x_packets import LowFrequency, area_packet, awareness_packet, single_hop, vector_of

MICROSECONDS: Final = 1_000_000


class HeardEncoder:
    """Encodes each message that a receiver heard, once."""

    def __init__(self) -> None:
        """Make the encoder; raises ConfigError where the package for it is missing."""
        for message in ("CAM", "VAM", "DENM", cpm.MESSAGE):
            uper.specification(message)
        self._sent: dict[tuple[int, ...], float] = {}  # drive time that the last message of each told of [s]
        self._low = LowFrequency()
        self._sequence = 0  # of the packets to an area

    def encode(self, heard: Stations, offset: float) -> Sequence[bytes]:
        """Return the packets of the messages that are new; `offset` is GNSS time less drive time [s]."""
        known: dict[tuple[int, ...], float] = {}
        stations = [(number,) for number in heard.number.tolist()]
        packets = [
            self._packet(heard, row, time + offset) for row, time in self._new(stations, heard, heard.age, known)
        ]
        if heard.objects is not None:
            packets += self._of_objects(heard, heard.objects, offset, known)
        if heard.events is not None:
            events = heard.events
            keys = [(1, *key) for key in zip(events.sender.tolist(), events.number.tolist(), strict=True)]
            packets += [
                self._of_event(events, row, heard.time + offset)
                for row, _time in self._new(keys, heard, events.age, known)
            ]
        self._sent = known
        return packets

    def _new(
        self, keys: Sequence[tuple[int, ...]], heard: Stations, age: Floats, known: dict[tuple[int, ...], float]
    ) -> Iterator[tuple[int, float]]:
        """Yield rows of new messages with the drive times that they tell of [s]; what is not heard of is forgotten."""
        for row, key in enumerate(keys):
            time = heard.time - float(age[row])
            known[key] = self._sent.get(key, -math.inf)
            if time > known[key] + 0.5 / MICROSECONDS:
                known[key] = time
                yield row, time

    def _of_objects(
        self, heard: Stations, objects: ReportedObjects, offset: float, known: dict[tuple[int, ...], float]
    ) -> list[bytes]:
        """Return a packet for all objects that one message of a station tells of."""
        keys = [(2, *key) for key in zip(objects.sender.tolist(), objects.number.tolist(), strict=True)]
        rows: dict[tuple[int, int], list[int]] = {}
        for row, time in self._new(keys, heard, objects.age, known):
            rows.setdefault((int(objects.sender[row]), round(time * MICROSECONDS)), []).append(row)
        return [_perception(objects, those, time / MICROSECONDS + offset) for (_, time), those in rows.items()]

    def _of_event(self, events: RoadEvents, row: int, now: float) -> bytes:
        """Return the packet of an event, to everyone near it; `now` is the GNSS time of the output [s]."""
        sender, ended = int(events.sender[row]), bool(events.ended[row])
        cause = next((one for one in KINDS if one == events.cause[row]), Cause.STATIONARY_VEHICLE)
        radius = float(events.uncertainty[row])
        said = notification(
            Notice(cause, int(events.number[row]), 0, ended),
            Warner(
                sender,
                STATION_TYPES[BODY_KINDS[events.kind[row]]],
                its_time.from_gnss(now - float(events.age[row])),
                math.degrees(events.latitude[row]),
                math.degrees(events.longitude[row]),
                ConfidenceEllipse(radius, radius, 0.0) if radius else None,
                float(events.true_heading[row]),
                float(events.speed[row]),
            ),
            its_time.from_gnss(now - float(events.detected[row])),
        )
        self._sequence = (self._sequence + 1) % SEQUENCES
        return area_packet(said, cause, self._sequence)

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
            return awareness_packet(MessageId.VAM, of_person, vam.encode(of_person))
        size, lights = (float(heard.length[row]), float(heard.width[row])), self._low.lights(own[0], time_ms)
        of_vehicle = Cam(*own, False, *change, None, *size, lights)
        return awareness_packet(MessageId.CAM, of_vehicle, cam.encode(of_vehicle))


def _perception(objects: ReportedObjects, rows: Sequence[int], time: float) -> bytes:
    """Return the packet of what a station perceives at a GNSS time [s]: some rows, all of one message."""
    first, time_ms = rows[0], its_time.from_gnss(time)
    place = float(objects.sender_latitude[first]), float(objects.sender_longitude[first])
    heading, station = float(objects.sender_heading[first]), int(objects.sender[first])
    # True north is +y at the sender, as it is in the message.
    frame = local_frame(*place)
    said = Cpm(
        station,
        time_ms,
        math.degrees(place[0]),
        math.degrees(place[1]),
        orientation=heading,
        sensors=(Sensor(SENSOR_ID, SensorType.LOCAL_AGGREGATION),),
        objects=tuple(_perceived_object(objects, row, frame) for row in rows),
    )
    where = said.latitude_deg, said.longitude_deg
    vector = vector_of(station, StationType.PASSENGER_CAR, time_ms, *where, 0.0, heading)
    return single_hop(MessageId.CPM, vector, cpm.encode(said))


def _perceived_object(objects: ReportedObjects, row: int, frame: MapFrame) -> PerceivedObject:
    east, north = frame.to_map(float(objects.latitude[row]), float(objects.longitude[row]))
    heading, speed = float(objects.true_heading[row]), float(objects.speed[row])
    radius = float(objects.uncertainty[row]) * NORMAL_95 / SEMI_AXIS_95
    return PerceivedObject(
        int(objects.number[row]),
        0.0,
        east,
        north,
        radius or None,
        radius or None,
        speed * math.cos(heading),
        speed * math.sin(heading),
        heading,
        float(objects.length[row]),
        float(objects.width[row]),
        sensors=(SENSOR_ID,),
        kind=STATION_TYPES[BODY_KINDS[objects.kind[row]]],
    )
