"""Locks a rig for one process at a time: two drives would command the same car."""

from __future__ import annotations

import contextlib
import fcntl
from collections.abc import Iterator
from pathlib import Path

from vve_sumo.errors import RigError


@contextlib.contextmanager
def held(rig_file: Path) -> Iterator[None]:
    """Lock a rig while in the block; the system releases the lock however this process ends.

    Raises RigError where another process holds it.
    """
    with rig_file.open("rb") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise RigError(f"{rig_file}: another drive, doctor or align is using this rig; wait for its end") from None
        yield
