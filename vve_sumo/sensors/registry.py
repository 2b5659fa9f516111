"""Which sensors there are: a row each, by the name that the scenario's table, the observation and the seeds have."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final, NamedTuple

import numpy as np
from pydantic import BaseModel

from vve_sumo.sensors.port import Sensor, SensorTable
from vve_sumo.sensors.radar import TABLE, Radar
from vve_sumo.sensors.radar_settings import RadarSettings
from vve_sumo.values import Vehicle


class SensorKind(NamedTuple):
    """What the core knows of a sensor."""

    settings: type[BaseModel]  #: of the scenario's table
    table: SensorTable  #: of the record
    make: Callable[[Any, Vehicle, np.random.Generator], Sensor]  #: from such settings


def _radar(settings: RadarSettings, vehicle: Vehicle, generator: np.random.Generator) -> Sensor:
    return Radar(settings.config(), vehicle, generator)


SENSORS: Final[dict[str, SensorKind]] = {"radar": SensorKind(RadarSettings, TABLE, _radar)}
