"""Drives for the tests of this room: scenarios in code, run in a process of their own."""

from __future__ import annotations

import hashlib
import json
import shutil
import tempfile
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import pytest

    from vve_sumo.sweep.input_cache import InputCache

REPOSITORY = Path(__file__).parent.parent.parent
MPH = 0.44704


def drive_once(changes: dict[str, Any], folder: str | None = None) -> dict[str, Any]:
    """Drive `parked_car` with some of its settings changed and return the summary; call it through `isolated`."""
    from vve_sumo.drive import run as drives

    resolved = altered(changes)
    if folder is not None:
        return drives.run(resolved, Path(folder), REPOSITORY).summary
    with tempfile.TemporaryDirectory() as scratch:
        return drives.run(resolved, Path(scratch) / "record", REPOSITORY).summary


def recorded(factory: pytest.TempPathFactory, changes: dict[str, Any], folder: Path) -> Path:
    """Return the folder with a copy of the record of such a drive, which is driven once in a session."""
    from tests.isolated import isolated
    from tests.once import once

    name = f"drive_{hashlib.sha256(json.dumps(changes, sort_keys=True).encode()).hexdigest()[:16]}"
    shutil.copytree(once(factory, name, lambda record: isolated(drive_once, changes, str(record))), folder)
    return folder


def altered(changes: dict[str, Any]) -> Any:
    """Return the resolved scenario `parked_car` with dotted keys replaced, such as {"ego.speed_mps": 5.0}."""
    import tomllib

    from vve_sumo.drive.resolved_scenario import resolve_scenario
    from vve_sumo.scenario.load import parse

    file = REPOSITORY / "scenarios" / "parked_car.toml"
    table = tomllib.loads(file.read_text(encoding="utf-8"))
    table.pop("parameters", None)  # what they set may be replaced here
    for key, value in changes.items():
        *parents, last = key.split(".")
        inner: Any = table
        for parent in parents:
            inner = inner[int(parent)] if isinstance(inner, list) else inner.setdefault(parent, {})
        inner[last] = value
    read = _inputs()
    return resolve_scenario(
        "parked_car", parse(table, file), file, REPOSITORY, network_in=read.network, path_in=read.path
    )


@cache
def _inputs() -> InputCache:
    """Return what was read of networks and paths, as a sweep keeps it for its runs."""
    from vve_sumo.sweep.input_cache import InputCache

    return InputCache()


#: s of the default path where its last bend is behind the car [m]
LAST_BEND = 300.0


def obstacle_s(speed: float, begin: float = LAST_BEND + 40.0) -> float:
    """Return where on the default path an obstacle must stand to reach `speed` [m/s] after s = `begin` [m]."""
    return begin + speed * speed / 2.0 / 1.3 + speed * speed / 2.0 / 1.8 + 6.0 * speed
