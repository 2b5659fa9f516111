"""The simulated vehicle's GNSS receiver: true motion in, its bytes out, with the errors of a good RTK fix.

It knows the lot's place on the Earth and the receiver's mounting, nothing of the virtual road, and no format: it is
handed an encoder.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from vve_sumo.frames import Alignment, MapFrame, Mounting, Placement
from vve_sumo.physical_constants import EARTH_RADIUS
from vve_sumo.plant.arrivals import Bursts, FloatSpells
from vve_sumo.plant.noise import wander, white
from vve_sumo.pose.receivers.port import FixEncoder, standard
from vve_sumo.values import Fix, FixQuality, Pose
from vve_sumo.vehicle.model import FIX_PERIOD, IDEAL, Imperfections

PERIOD = FIX_PERIOD  # between measurements, each of which is a fix at the highest rate [s]
MAX_RATE: Final = 1.0 / PERIOD  # of fixes [1/s]
ALTITUDE: Final = 220.0  # of the lot at the start, about Columbus's [m]
_RTK_FIXED = FixQuality.RTK_FIXED
STREAMS: Final = 8  # independent sources of noise


@dataclass(frozen=True, slots=True)
class ReceiverParameters:
    """How good the receiver is; the defaults are those of an RTK-fixed dual-antenna unit on open ground."""

    mounting: Mounting  #: of the output point
    rate: float = MAX_RATE  #: of fixes [1/s]; of more than `MAX_RATE`, that many are sent
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
    imperfections: Imperfections = IDEAL  #: of which those of the receiver count here


def unaltered(fix: Fix) -> Fix:
    """The fix as it is."""
    return fix


class SimulatedReceiver:
    """Measures each `PERIOD` and sends as many packets a second as its `rate`, evenly.

    `alter` sits between measuring and encoding: a fault is a function from fix to fix, or to None for a lost packet.
    `epoch` is the GNSS second of drive time 0. The `encoder` is the standard receiver's without another. The first
    measurement is taken soon after drive time `begin` [s].
    """

    def __init__(
        self,
        parameters: ReceiverParameters,
        lot: MapFrame,
        epoch: float,
        seeds: np.random.SeedSequence,
        alter: Callable[[Fix], Fix | None] = unaltered,
        encoder: FixEncoder | None = None,
        begin: float = 0.0,
    ) -> None:
        self._parameters, self._epoch = parameters, epoch
        self._placement = Placement(lot, Alignment(), parameters.mounting, epoch)
        self._alter = alter
        encoder = standard().encoder() if encoder is None else encoder
        assert encoder is not None  # of the standard receiver
        self._encoder = encoder
        self._under_way: deque[tuple[float, bytes]] = deque()
        streams = seeds.spawn(STREAMS)
        slow, correlation = parameters.position_wander, parameters.wander_time
        position, velocity, heading, yaw_rate, acceleration = (white(stream) for stream in streams[2:7])
        # Share of the time between fixes that a measurement takes, and the share that has gone by since the last fix.
        self._share, self._gone_by = min(parameters.rate * PERIOD, 1.0), 0.0
        period = PERIOD / self._share
        # Of each fix: the slow error north and east, then draws for position and velocity, north and east each.
        self._draws = zip(
            wander(slow, correlation, period, streams[0]), wander(slow, correlation, period, streams[1]),
            position, position, velocity, velocity, heading, yaw_rate, acceleration,
            strict=True,
        )  # fmt: skip
        size = parameters.noise
        self._size, self._position_white = size, parameters.position_white
        # Standard deviations of the errors.
        self._velocity_error, self._heading_error = size * parameters.velocity, size * parameters.heading
        self._yaw_rate_error, self._acceleration_error = size * parameters.yaw_rate, size * parameters.acceleration
        self._position_sigma = math.hypot(parameters.position_white, slow)
        self._late = parameters.hidden_delay + parameters.delay
        of, (bursts, floats) = parameters.imperfections, seeds.spawn(2)
        self._bursts = Bursts(of, bursts, begin) if size > 0.0 and of.receiver_short_gaps > 0.0 else None
        self._floats = FloatSpells(of, floats, begin) if size > 0.0 and of.receiver_float_every > 0.0 else None

    def measure(self, truth: Pose, climbed: float) -> None:
        """Measure the rear axle at lot pose `truth`, `climbed` metres above the start, and send the bytes where due."""
        if not self._is_due():
            return
        fix = self._observe(truth, climbed)
        if self._floats is not None and (offset := self._floats.offset(truth.time)) is not None:
            fix = self._float(fix, *offset)
        altered = self._alter(fix)
        if altered is not None:
            ready = truth.time + self._late
            arrival = ready if self._bursts is None else self._bursts.arrival(ready)
            self._under_way.append((arrival, self._encoder.encode(altered)))

    def arrived(self, until: float) -> list[tuple[float, bytes]]:
        """Take out the packets that have arrived by drive time `until` [s], with their times of arrival."""
        taken, way = [], self._under_way
        while way and way[0][0] <= until + 1e-9:
            taken.append(way.popleft())
        return taken

    def _is_due(self) -> bool:
        """Return whether this measurement is a fix that is sent."""
        self._gone_by += self._share
        due = self._gone_by > 1.0 - 1e-9
        if due:
            self._gone_by -= 1.0
        return due

    def _float(self, fix: Fix, north: float, east: float) -> Fix:
        """Return the fix as a float solution that lies so far off [m], and says how good it is."""
        return replace(
            fix,
            latitude=fix.latitude + self._size * north / EARTH_RADIUS,
            longitude=fix.longitude + self._size * east / (EARTH_RADIUS * math.cos(fix.latitude)),
            quality=FixQuality.RTK_FLOAT,
            position_sigma=self._parameters.imperfections.receiver_float_sigma,
        )

    def _observe(self, truth: Pose, climbed: float) -> Fix:
        latitude, longitude, heading, velocity_north, velocity_east, acceleration = self._placement.output(truth)
        slow_north, slow_east, north, east, north_speed, east_speed, turn, turning, pushed = next(self._draws)
        parameters, size, fast = self._parameters, self._size, self._position_white
        north, east = size * (slow_north + fast * north), size * (slow_east + fast * east)
        # In the order of the fields: naming each costs as much as all of them.
        return Fix(
            truth.time + self._epoch + parameters.hidden_delay,
            truth.time,
            latitude + north / EARTH_RADIUS,
            longitude + east / (EARTH_RADIUS * math.cos(latitude)),
            ALTITUDE + climbed,
            heading + self._heading_error * turn,
            truth.grade,
            0.0,  # roll
            velocity_north + self._velocity_error * north_speed,
            velocity_east + self._velocity_error * east_speed,
            -truth.speed * math.tan(truth.grade),
            truth.yaw_rate + self._yaw_rate_error * turning,
            acceleration + self._acceleration_error * pushed,
            True,  # locked
            _RTK_FIXED,
            self._position_sigma,
            parameters.velocity,
            parameters.heading,
            parameters.differential_age,
        )
