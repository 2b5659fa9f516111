"""Whom the data of a drive is of, so that the page can say so.

Looks at the network's file where it can be found; knows nothing of the page.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from vve_sumo import workspace
from vve_sumo.errors import ConfigError

OPEN_STREET_MAP = (
    "Street and path contain data © OpenStreetMap contributors, available under the Open Database Licence (ODbL) 1.0: "
    "https://www.openstreetmap.org/copyright"
)
#: of a network's file, in which it says where it comes from [characters]
HEAD = 2000


def open_street_map(scenario: Mapping[str, Any]) -> tuple[str, ...]:
    """Return whom to name for the street of a scenario; a network that cannot be looked at is taken to be theirs."""
    name = str((scenario.get("street") or {}).get("network", ""))
    try:
        with workspace.find("network", name, Path.cwd()).open(encoding="utf-8", errors="replace") as file:
            drawn_by_others = "OpenStreetMap" not in file.read(HEAD)
    except (ConfigError, OSError):
        drawn_by_others = False
    return () if drawn_by_others else (OPEN_STREET_MAP,)
