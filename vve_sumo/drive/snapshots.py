"""Reads what stood on the virtual road at each tick out of a record's table of actors."""

from __future__ import annotations

import numpy as np
import pyarrow as pa

from vve_sumo.record.layout import ACTOR_COLUMNS
from vve_sumo.timing import PERIOD
from vve_sumo.values import Actors

#: of a tick at which nobody was near
NO_ACTORS = Actors.none(0.0)


def snapshots(table: pa.Table) -> dict[int, Actors]:
    """Return the actors of every tick at which there were any, by the tick's number."""
    numbers = [table[name].to_numpy() for name in ACTOR_COLUMNS]
    names, tick = table["actor"].to_pylist(), table["tick"].to_numpy()
    edges = np.flatnonzero(np.diff(tick)) + 1
    found = {}
    for start, end in zip([0, *edges.tolist()], [*edges.tolist(), len(tick)], strict=True):
        if end > start:
            at = int(tick[start])
            found[at] = Actors(at * PERIOD, tuple(names[start:end]), *(column[start:end] for column in numbers))
    return found
