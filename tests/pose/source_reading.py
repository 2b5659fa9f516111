"""Waiting for what arrives at a pose receiver's source."""

from __future__ import annotations

import select
import time

from vve_sumo.pose.sources import Source


def ready(source: Source, patience: float = 5.0) -> bool:
    return bool(select.select([source.fileno()], [], [], patience)[0])


def gathered(source: Source, count: int, patience: float = 5.0) -> list[tuple[float, bytes]]:
    """All that arrives until there are `count` bytes."""
    portions: list[tuple[float, bytes]] = []
    until = time.monotonic() + patience
    while sum(len(data) for _, data in portions) < count and time.monotonic() < until:
        ready(source, 0.1)
        portions += source.receive()
    return portions
