"""The tick of two egos: both hand over before SUMO steps once, each into its own record, whatever their order."""

from __future__ import annotations

from typing import Any

from tests.drive.street import REPOSITORY, altered
from tests.isolated import isolated
from vve_sumo.vehicle.dataspeed.layout import COMMAND_IDS

TICKS = 150
#: each on a path of its own
PATHS = {"a": {}, "b": {"ego.path": "linden_loop", "road.demand": [], "obstacles": [], "seed": 5}}


def _driven(order: str) -> dict[str, Any]:
    """Drive both for a few seconds; return the hashes of their records and in which order they were recorded."""
    from vve_sumo.drive.lockstep import LockstepEgo
    from vve_sumo.drive.tick import DueTick, Tick
    from vve_sumo.drive.virtual_road import VirtualRoad, scenario_engine
    from vve_sumo.plant.receiver import unaltered
    from vve_sumo.record.writer import MemoryRecorder
    from vve_sumo.timing import PERIOD
    from vve_sumo.world.ego_sync import Ego
    from vve_sumo.world.world import World

    events: list[str] = []

    class Ordered(MemoryRecorder):
        """Notes whose frames and rows it is asked to keep."""

        ego = ""

        def saw_frames(self, time: float, channel: str, frames: Any) -> None:
            events.extend([f"{self.ego} frames"] if any(frame.id in COMMAND_IDS for frame in frames) else [])
            super().saw_frames(time, channel, frames)

        def ticked(self, row: Any) -> None:
            events.append(f"{self.ego} row")
            super().ticked(row)

    class Counted(World):
        """Notes when it steps."""

        def step(self, placements: Any) -> Any:
            events.append(f"step {len(placements)}")
            return super().step(placements)

    scenarios = {name: altered(changes) for name, changes in PATHS.items()}
    egos = {name: LockstepEgo(name, scenarios[name], REPOSITORY, unaltered, None) for name in order}
    records = {name: Ordered(scenarios[name].to_dict(REPOSITORY), egos[name].lot.epoch) for name in order}
    network = scenarios["a"].network.path
    cars = [Ego(name, scenarios[name].vehicle, scenarios[name].route) for name in order]
    world = Counted(network, egos=cars, seed=1, period=PERIOD, range_of_interest=5000.0)
    road = VirtualRoad(world, scenario_engine(scenarios["a"]))
    for name, record in records.items():
        record.ego = name
    tick = Tick([egos[name].begin(records[name]) for name in order], road)
    for number in range(TICKS):
        due = DueTick(number, number * PERIOD, (number + 1) * PERIOD)
        done = tick.step(due, {name: ego.input() for name, ego in egos.items()})
        for name, ego in egos.items():
            ego.drive(due.next_time, ego.ticked(done[name]))
    tick.finish()
    road.close()
    hashes = {name: records[name].close() for name in sorted(order)}
    tables = {name: record.tables for name, record in records.items()}
    return {
        "hashes": hashes,
        "order": events,
        "others": {name: set(each["actors"]["actor"].to_pylist()) for name, each in tables.items()},
        "faults": {name: set(each["ticks"]["ego_sync_faults"].to_pylist()) for name, each in tables.items()},
    }


def test_two_egos_in_one_tick() -> None:
    driven = isolated(_driven, "ab")
    assert driven["order"][-5:] == ["a frames", "b frames", "step 2", "a row", "b row"]
    assert driven["order"].count("step 2") > TICKS - 20
    assert driven["others"] == {"a": {"b"}, "b": {"a"}}
    # An ego whose first fix comes after the other's is no fault of the road's.
    assert driven["faults"] == {"a": {""}, "b": {""}}
    other = isolated(_driven, "ba")
    assert other["order"][-5:] == ["b frames", "a frames", "step 2", "b row", "a row"]
    assert other["hashes"] == driven["hashes"]
    assert driven["hashes"]["a"] != driven["hashes"]["b"]
