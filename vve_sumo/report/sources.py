"""Whom the data of a drive is of, so that the page can say so.

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
    "Street and path contain data © OpenStreetMap contributors, available under the Open Database Licence (ODbL) 1.0: "
    "https://www.openstreetmap.org/copyright"
)
#: of a network's file, in which it says where it comes from [bytes]
HEAD = 2000


def open_street_map(scenario: Mapping[str, Any], digests: Collection[str]) -> tuple[str, ...]:
    """Return whom to name for the street of a scenario; `digests` are of the networks that were driven on (SHA-256).

    A network that cannot be looked at, or is not one of those, is taken to be theirs.
    """
    name = str((scenario.get("street") or {}).get("network", ""))
    try:
        content = workspace.find("network", name, Path.cwd()).read_bytes()
        drawn_by_others = b"OpenStreetMap" not in content[:HEAD] and hashlib.sha256(content).hexdigest() in digests
    except (ConfigError, OSError):
        drawn_by_others = False
    return () if drawn_by_others else (OPEN_STREET_MAP,)
