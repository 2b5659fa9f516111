"""What a virtual sensor is to a drive: looks at the actors once a tick, and now and then has a reading.

Knows neither SUMO nor the controller, and none of the sensors. What a sensor measured goes to the controller as its
`output`; a reading's rows, which hold the truth behind it too, go to the record's table of that sensor.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple, Protocol

from numpy.typing import NDArray

from vve_sumo.values import Actors, Pose, SensorOutput

Column = Sequence[Any] | NDArray[Any]


class SensorTable(NamedTuple):
    """The table of the record that keeps a sensor's readings."""

    name: str
    columns: tuple[tuple[str, str, str], ...]  #: name, kind ("float", "int8" or "str") and meaning, after `tick`


class Reading(Protocol):
    """What came out of a sensor at one tick, for the record."""

    def columns(self) -> tuple[Column, ...]:
        """Return the rows as the columns of the sensor's table, all of one length, which may be 0."""
        ...


class Sensor(Protocol):
    """A sensor that is fixed to the ego; its randomness comes from a generator of its own."""

    @property
    def output(self) -> SensorOutput:
        """What the sensor measured last; before the first reading empty and dated -inf."""
        ...

    @property
    def refused(self) -> int:
        """Number of actors that the last step left out, because a value of theirs is not finite."""
        ...

    def step(self, time: float, pose: Pose, actors: Actors) -> Reading | None:
        """Look at drive time `time` [s] from the rear axle's pose; return the reading that comes out, if any."""
        ...
