"""How far the virtual road's vehicles move across their own heading in one step, in an hour of each shipped demand.

A vehicle that changes lanes takes seconds; one that jumps would vanish from a radar here and appear there. Every
vehicle of Linden is compared with the snapshot before: the centre's step across the mean of the two headings. The ego
stands beside the network. Three seeds of twenty minutes each.

Usage: python benchmarks/lane_changes.py [--smoke]
"""

from __future__ import annotations

import argparse
import math
import os
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import NamedTuple

import numpy as np

from vve_sumo.values import EGO, Floats, Point, Pose
from vve_sumo.vehicle.load import load
from vve_sumo.world.ego_sync import Ego
from vve_sumo.world.network import read_network
from vve_sumo.world.world import World

REPOSITORY = Path(__file__).parent.parent
NETWORK = REPOSITORY / "networks" / "linden.net.xml"
FUSION = REPOSITORY / "vehicles" / "ford_fusion.toml"
LEVELS = ("light", "moderate", "heavy")
SEEDS = (1, 2, 3)
SECONDS = 1200.0
PERIOD = 0.02
JUMP = 0.2  # a step to the side of more than this is a jump [m]
WHOLE_NETWORK = 6000.0  # from the ego to any vehicle [m]


class Steps(NamedTuple):
    """What was looked at, and the steps to the side in it."""

    number: int  #: steps of single vehicles
    jumps: int  #: of these, longer than JUMP
    longest: float  #: [m]


def looked_at(level: str, seed: int, seconds: float) -> Steps:
    """Drive some time [s] of a demand."""
    x_min, y_min, *_ = read_network(NETWORK).boundary
    demand = REPOSITORY / "routes" / f"linden_{level}.rou.xml"
    number, jumps, longest = 0, 0, 0.0
    with World(
        NETWORK, demand=[demand], seed=seed, period=PERIOD, egos=[Ego(EGO, load(FUSION).vehicle)],
        range_of_interest=WHOLE_NETWORK,
    ) as world:  # fmt: skip
        before: tuple[tuple[str, ...], Floats] = ((), np.empty((3, 0)))
        for k in range(round(seconds / PERIOD)):
            pose = Pose(k * PERIOD, Point.FRONT_BUMPER, x_min - 100.0, y_min - 100.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
            world.step({EGO: pose})
            actors = world.actors(EGO)
            now = actors.ids, np.array((actors.x, actors.y, actors.heading))
            aside = to_the_side(*before, *now)
            number, jumps = number + aside.size, jumps + int((aside > JUMP).sum())
            longest, before = max(longest, float(aside.max(initial=0.0))), now
    return Steps(number, jumps, longest)


def to_the_side(old_ids: tuple[str, ...], old: Floats, ids: tuple[str, ...], new: Floats) -> Floats:
    """Return how far [m] each vehicle of both snapshots (rows: x, y, heading) moved across its heading."""
    if ids != old_ids:
        row = {name: k for k, name in enumerate(old_ids)}
        both = [(row[name], k) for k, name in enumerate(ids) if name in row]
        old, new = old[:, [k for k, _ in both]], new[:, [k for _, k in both]]
    turn = (new[2] - old[2] + math.pi) % math.tau - math.pi
    mean = old[2] + 0.5 * turn
    return np.abs((new[1] - old[1]) * np.cos(mean) - (new[0] - old[0]) * np.sin(mean))


def main() -> None:
    """Print a line for each demand."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--smoke", action="store_true", help="some seconds of one seed, only to see that it runs")
    seeds, seconds = ((1,), 2.0) if parser.parse_args().smoke else (SEEDS, SECONDS)
    jobs = [(level, seed, seconds) for level in LEVELS for seed in seeds]
    # One run a process: a process holds one simulation, and begins it anew.
    with ProcessPoolExecutor(os.cpu_count(), get_context("spawn"), max_tasks_per_child=1) as pool:
        done = dict(zip(jobs, pool.map(looked_at, *zip(*jobs, strict=True)), strict=True))
    print("| demand | hours | steps of vehicles | longest step to the side [m] | jumps |\n|---|---|---|---|---|")
    for level in LEVELS:
        mine = [done[level, seed, seconds] for seed in seeds]
        number, jumps, longest = sum(s.number for s in mine), sum(s.jumps for s in mine), max(s.longest for s in mine)
        print(f"| {level} | {len(seeds) * seconds / 3600.0:.1f} | {number:,} | {longest:.3f} | {jumps} |")


if __name__ == "__main__":
    main()
