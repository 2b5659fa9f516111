"""The tick: hands over before anything else, and records under its number what it looked at."""

from __future__ import annotations

from typing import Any

import numpy as np

from tests.drive.street import REPOSITORY, altered
from tests.isolated import isolated
from vve_sumo.values import EGO
from vve_sumo.vehicle.dataspeed.layout import COMMAND_IDS

TICKS = 150
#: moves from the first pose on, so that no two ticks look at the same
LEAD = {"id": "leader", "kind": "car", "ahead_m": 20.0, "speed_mps": 5.0}


def _driven() -> dict[str, Any]:
    """Drive a few seconds in traffic and return in which order a tick was recorded, and what its table holds."""
    from vve_sumo.drive.lockstep import Lockstep
    from vve_sumo.record.layout import ACTOR_COLUMNS
    from vve_sumo.record.writer import MemoryRecorder

    class Ordered(MemoryRecorder):
        """Notes what it is asked to keep, in order."""

        def __init__(self, *arguments: Any) -> None:
            super().__init__(*arguments)
            self.order: list[str] = []

        def saw_frames(self, time: float, channel: str, frames: Any) -> None:
            self.order += ["frames"] if any(frame.id in COMMAND_IDS for frame in frames) else []
            super().saw_frames(time, channel, frames)

        def sensed(self, tick: int, sensor: str, measured: float, columns: Any) -> None:
            self.order.append(sensor)
            super().sensed(tick, sensor, measured, columns)

        def snapshot(self, tick: int, actors: Any) -> None:
            self.order.append("actors")
            super().snapshot(tick, actors)

        def ticked(self, row: Any) -> None:
            self.order.append("row")
            super().ticked(row)

    resolved = altered({"actors": [LEAD], "obstacles.0.at_m": 60.0})
    shell = Lockstep(resolved, REPOSITORY)
    record = Ordered(resolved.to_dict(REPOSITORY), shell.lot.epoch)
    looked = []
    ticks = shell.ticks(record)
    for _ in range(TICKS):
        looked.append(next(ticks)[EGO].actors)
    ticks.close()
    looked.append(shell.road.around[EGO].actors)
    shell.close()
    record.close()
    actors = record.tables["actors"].to_pandas()
    recorded = dict(list(actors.groupby("tick")))
    same = [
        np.array_equal(rows[list(ACTOR_COLUMNS)].to_numpy()[:, 0], actors.x) and rows.actor.tolist() == list(actors.ids)
        if (rows := recorded.get(number)) is not None
        else not actors.ids
        for number, actors in enumerate(looked)
    ]
    counts = record.tables["ticks"]["actors"].to_pylist()
    return {"order": record.order, "same": same, "counts": counts, "looked": [len(each.ids) for each in looked]}


def test_a_tick() -> None:
    driven = isolated(_driven)
    # A scan comes out at some ticks; whatever a tick records follows its command frames.
    ticks = " ".join(driven["order"]).split("frames ")[1:]
    assert {tuple(tick.split()) for tick in ticks[:-1]} == {("actors", "row"), ("radar", "actors", "row")}
    assert ticks[-1].split()[-2:] == ["row", "actors"]
    assert driven["same"] == [True] * (TICKS + 1)
    assert driven["counts"] == driven["looked"][1:]
    assert max(driven["looked"]) == 2
