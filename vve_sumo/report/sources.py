"""Whom the page must credit for the data of a drive.

Looks at the network's file where it can be found; knows nothing of the page.
"""

from __future__ import annotations

import hashlib
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

from vve_sumo import workspace
from vve_sumo.errors import ConfigError

OPEN_STREET_MAP = (
    "Road network and path contain data © OpenStreetMap contributors, available under the Open Database Licence (ODbL) "
    "1.0: https://www.openstreetmap.org/copyright"
)
#: of a network's file, in which it states its origin [bytes]
HEAD_SIZE = 2000


def open_street_map(scenario: Mapping[str, Any], digests: Collection[str]) -> tuple[str, ...]:
    """Return the credits for the road network of a scenario; `digests` are of the networks that were used (SHA-256).

    A network that cannot be read, or is not one of those, is taken to hold data of OpenStreetMap.
    """
    name = str((scenario.get("road") or {}).get("network", ""))
    try:
        content = workspace.find("network", name, Path.cwd()).read_bytes()
        without_osm = b"OpenStreetMap" not in content[:HEAD_SIZE] and hashlib.sha256(content).hexdigest() in digests
    except (ConfigError, OSError):
        without_osm = False
    return () if without_osm else (OPEN_STREET_MAP,)
