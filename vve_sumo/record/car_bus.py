"""Tells which frames of a lockstep drive's CAN log the gateway sent.

Others may send its identifiers too: an injected fault does. It knows identifiers and times, and nothing of a gateway.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Set
from itertools import groupby

from vve_sumo.values import Frame


def with_direction(
    lines: Iterable[tuple[float, str, Frame]], commands: Set[int]
) -> Iterator[tuple[float, str, Frame, bool]]:
    """Yield time, channel and frame of each line of a log, and whether the gateway sent the frame.

    `commands` are the identifiers of command frames. The gateway's frames come last of all frames of one time, and
    whoever else sends such identifiers sends them before a report of the same time.
    """
    for _time, group in groupby(lines, lambda line: line[0]):
        moment = list(group)
        sent = len(moment)
        while sent and moment[sent - 1][2].id in commands:
            sent -= 1
        yield from ((*line, number >= sent) for number, line in enumerate(moment))
