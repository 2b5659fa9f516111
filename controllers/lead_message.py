"""Finds the car ahead among those that send V2X messages, and says how it accelerates.

A message's place may err by a metre and is old when it comes, so it only says which sender is meant; how far that car
is, the radar says. It must not know what is done with the acceleration.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from vve_sumo.path import PathProjection
from vve_sumo.values import Observation, Stations, Vehicle

from .sightings import Memory, output_of

CAM: Final = 2  #: `Stations.message` of a vehicle's message
BESIDE: Final = 2.0  #: who is farther beside the path drives in another lane [m]
REACH: Final = 80.0  #: who is farther ahead is not followed [m]
ALONG: Final = math.cos(math.radians(30.0))  #: who heads farther away from the path does not go the same way


class LeadMessage(NamedTuple):
    """What the newest message of the car ahead says."""

    gap: float  #: from the front bumper to its rear now, by its message [m]
    acceleration: float  #: along its heading, at the time of the message [m/s2]
    age: float  #: of the message [s]


class _Sender(NamedTuple):
    """The car ahead by its message."""

    rear: float  #: s of its rear on the path at the time of the message [m]
    speed: float  #: [m/s]
    acceleration: float  #: [m/s2]
    sent: float  #: drive time of the message [s]


class LeadMessages:
    """Keeps the newest message of the car ahead."""

    def __init__(self, vehicle: Vehicle, sensor: str) -> None:
        """`sensor` is the name of the V2X receiver; the scenario must have it."""
        self._bumper, self._sensor = vehicle.rear_axle_to_bumper, sensor
        self._memory = Memory()
        self._read = -math.inf  # time of the newest output that was read [s]
        self._sender: _Sender | None = None

    def step(self, observation: Observation, projection: PathProjection) -> LeadMessage | None:
        """Return what the car ahead said last, None where nobody ahead sends; called at every tick.

        Raises TypeError where the scenario has no such receiver.
        """
        self._memory.add(observation.pose)
        heard = output_of(observation, self._sensor, Stations, "v2x")
        if heard.time > self._read:
            self._read, self._sender = heard.time, self._ahead(heard, observation, projection.s)
        one = self._sender
        if one is None:
            return None
        age = observation.time - one.sent
        return LeadMessage(one.rear + one.speed * age - projection.s - self._bumper, one.acceleration, age)

    def _ahead(self, heard: Stations, observation: Observation, s: float) -> _Sender | None:
        """Return the nearest sender on the path ahead that goes the same way."""
        if not len(heard.number):
            return None
        path, then = observation.path, self._memory.at(heard.time)
        cos, sin = math.cos(then.heading), math.sin(then.heading)
        # Places count from the front bumper at the time of the output.
        ahead, aside = heard.x + self._bumper, heard.y
        x, y = then.x + ahead * cos - aside * sin, then.y + ahead * sin + aside * cos
        places, places_d = path.locate(np.asarray(x), np.asarray(y), s, s + self._bumper + REACH)
        nearest: _Sender | None = None
        for row, (at, d) in enumerate(zip(places.tolist(), places_d.tolist(), strict=True)):
            if heard.message[row] != CAM or not abs(d) < BESIDE or not at > s + self._bumper:
                continue
            if math.cos(float(heard.heading[row]) + then.heading - path.at(at).heading) < ALONG:
                continue
            if nearest is None or at < nearest.rear + 0.5 * float(heard.length[row]):
                nearest = _Sender(
                    at - 0.5 * float(heard.length[row]),
                    float(heard.speed[row]),
                    float(heard.acceleration[row]),
                    heard.time - float(heard.age[row]),
                )
        return nearest
