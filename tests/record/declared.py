"""What a record's `scenario.json` declares of its sensors, for records that a test writes."""

from __future__ import annotations

from typing import Any

from vve_sumo.record.layout import LIVE_SCHEMAS, SCHEMAS, sensor_schemas
from vve_sumo.sensors.radar_settings import RadarSettings

#: of a drive with the radar alone
RESOLVED: dict[str, Any] = {"sensors": {"radar": [*map(list, RadarSettings.columns)]}}
#: tables of every record with the radar alone, and of a live one
TABLES = SCHEMAS | sensor_schemas(RESOLVED)
LIVE_TABLES = TABLES | LIVE_SCHEMAS
