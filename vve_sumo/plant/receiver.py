"""The simulated vehicle's GNSS receiver: true motion in, NCOM bytes out, with the errors of a good RTK fix.

It knows the lot's place on the Earth and the receiver's mounting, and nothing of the street.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from vve_sumo.frames import Alignment, MapFrame, Mounting, Placement
from vve_sumo.plant.noise import Wander, White
from vve_sumo.pose.ncom import Encoder
from vve_sumo.values import Fix, FixQuality, Pose

PERIOD = 0.01  # between fixes [s]; NCOM's standard 100 Hz
EARTH_RADIUS = 6_371_000.0  # mean [m]; only turns centimetres of noise into angles
ALTITUDE = 220.0  # of the lot at the start, about Columbus's [m]
STREAMS = 8  # independent sources of noise


@dataclass(frozen=True, slots=True)
class ReceiverParameters:
    """How good the receiver is; the defaults are those of an RTK-fixed dual-antenna unit on open ground."""

    mounting: Mounting  #: of the output point
    delay: float = 0.01  #: from a fix's epoch to the arrival of its bytes [s]
    hidden_delay: float = 0.0  #: by which a fix is older than its epoch says [s]
    noise: float = 1.0  #: factor on the errors below; the reported accuracies are not scaled by it
    position_white: float = 0.01  #: north and east each, independent from fix to fix, 1 sigma [m]
    position_wander: float = 0.01  #: north and east each, slow, 1 sigma [m]
    wander_time: float = 30.0  #: correlation time of the slow part [s]
    velocity: float = 0.025  #: north and east each, 1 sigma [m/s]
    heading: float = math.radians(0.08)  #: 1 sigma [rad]
    yaw_rate: float = math.radians(0.03)  #: 1 sigma [rad/s]
    acceleration: float = 0.02  #: 1 sigma [m/s2]
    differential_age: float = 1.0  #: age of the corrections [s]


def unaltered(fix: Fix) -> Fix:
    """The fix as it is."""
    return fix


class Receiver:
    """Measures and sends one packet each `PERIOD`.

    `alter` sits between measuring and encoding: a fault is a function from fix to fix, or to None for a lost packet.
    `epoch` is the GNSS second of drive time 0.
    """

    def __init__(
        self,
        parameters: ReceiverParameters,
        lot: MapFrame,
        epoch: float,
        seeds: np.random.SeedSequence,
        alter: Callable[[Fix], Fix | None] = unaltered,
    ) -> None:
        self._parameters = parameters
        self._placement = Placement(lot, Alignment(), parameters.mounting, epoch)
        self._alter = alter
        self._encoder = Encoder()
        self._under_way: deque[tuple[float, bytes]] = deque()
        streams = seeds.spawn(STREAMS)
        wander = parameters.position_wander
        self._north_wander = Wander(wander, parameters.wander_time, PERIOD, streams[0])
        self._east_wander = Wander(wander, parameters.wander_time, PERIOD, streams[1])
        self._position, self._velocity, self._heading, self._yaw_rate, self._acceleration = (
            White(stream) for stream in streams[2:7]
        )
        self._position_sigma = math.hypot(parameters.position_white, wander)

    def measure(self, truth: Pose, climbed: float) -> None:
        """Measure the rear axle at lot pose `truth`, `climbed` metres above the start, and send the bytes."""
        fix = self._alter(self._observe(truth, climbed))
        if fix is not None:
            late = self._parameters.hidden_delay + self._parameters.delay
            self._under_way.append((truth.time + late, self._encoder.encode(fix)))

    def arrived(self, until: float) -> list[tuple[float, bytes]]:
        """Take out the packets that have arrived by drive time `until` [s], with their times of arrival."""
        taken, way = [], self._under_way
        while way and way[0][0] <= until + 1e-9:
            taken.append(way.popleft())
        return taken

    def _observe(self, truth: Pose, climbed: float) -> Fix:
        exact, parameters = self._placement.unplace(truth), self._parameters
        size = parameters.noise
        north = size * (self._north_wander.draw() + parameters.position_white * self._position.draw())
        east = size * (self._east_wander.draw() + parameters.position_white * self._position.draw())
        velocity = size * parameters.velocity
        return Fix(
            time=exact.time + parameters.hidden_delay,
            time_received=truth.time,
            latitude=exact.latitude + north / EARTH_RADIUS,
            longitude=exact.longitude + east / (EARTH_RADIUS * math.cos(exact.latitude)),
            altitude=ALTITUDE + climbed,
            heading=exact.heading + size * parameters.heading * self._heading.draw(),
            pitch=truth.grade,
            roll=0.0,
            velocity_north=exact.velocity_north + velocity * self._velocity.draw(),
            velocity_east=exact.velocity_east + velocity * self._velocity.draw(),
            velocity_down=-truth.speed * math.tan(truth.grade),
            yaw_rate=exact.yaw_rate + size * parameters.yaw_rate * self._yaw_rate.draw(),
            acceleration=exact.acceleration + size * parameters.acceleration * self._acceleration.draw(),
            locked=True,
            quality=FixQuality.RTK_FIXED,
            position_sigma=self._position_sigma,
            velocity_sigma=parameters.velocity,
            heading_sigma=parameters.heading,
            differential_age=parameters.differential_age,
        )
