"""The CAN frames of a drive, each with its time and whether this program's side sent it. Knows no format."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import chain, repeat

from vve_sumo import bus
from vve_sumo.analysis.run import Run
from vve_sumo.bus import LoggedFrame
from vve_sumo.export.unix_time import MICROSECONDS, unix_of_gnss
from vve_sumo.record.car_bus import with_direction
from vve_sumo.values import Frame
from vve_sumo.vehicle.interface import InterfaceConfig, load


def frames_of(run: Run) -> list[LoggedFrame]:
    """Return the frames of a record's CAN log in its order; of a drive that was killed, up to its last whole tick.

    Buses are numbered in the order of their names. Raises ConfigError where the log cannot be read, or where the
    drive-by-wire interface that knows the frames sent is no longer there.
    """
    epoch = float(run.resolved["epoch_gnss_s"])
    end = math.inf if run.complete else epoch + float(run.time[-1]) + 0.5 / MICROSECONDS
    rows = [row for row in _with_direction(run) if row[0] <= end]
    numbers = {name: number for number, name in enumerate(sorted({channel for _, channel, _, _ in rows}))}
    return [
        LoggedFrame(unix_of_gnss(time) / MICROSECONDS, numbers[channel], frame, sent)
        for time, channel, frame, sent in rows
    ]


def _with_direction(run: Run) -> Iterator[tuple[float, str, Frame, bool]]:
    """Yield GNSS time [s], bus and frame of every line, and whether it was sent.

    A live drive counted the frames of each of the gateway's steps: first those heard, then those sent. In
    lockstep the gateway's command frames tell.
    """
    lines = bus.read_log(run.folder / "can.log")
    if run.holds("gateway"):
        counts = run.arrow("gateway").select(["frames_received", "frames_sent"]).to_pylist()
        directions = chain.from_iterable(
            chain(repeat(False, row["frames_received"]), repeat(True, row["frames_sent"])) for row in counts
        )
        # Frames that came after the last step that the record holds belong to no step.
        yield from ((*line, sent) for line, sent in zip(lines, directions, strict=False))
        return
    commands = load(InterfaceConfig(**run.resolved["vehicle_model"]["interface"])).facts.commands
    yield from with_direction(lines, commands)
