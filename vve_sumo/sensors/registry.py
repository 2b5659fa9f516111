"""Which sensors there are: the table of the record that each of them writes, by the sensor's name."""

from __future__ import annotations

from typing import Final

from vve_sumo.sensors import radar
from vve_sumo.sensors.port import SensorTable

TABLES: Final[dict[str, SensorTable]] = {"radar": radar.TABLE}
