"""Which method finds a worst case in fewest drives: what `[search]` uses, against differential evolution and Sobol.

Closed forms stand in for drives: the gap that a cut-in leaves (4 parameters), the same with noise, and the impact on a
pedestrian who steps out (3 parameters, most of them without any impact). Costs; lower is worse for the car.

Usage: python -m benchmarks.worst_case [--smoke]
"""

from __future__ import annotations

import argparse
import math
import statistics
import zlib
from collections.abc import Callable, Iterator
from itertools import islice

import numpy as np
from scipy.optimize import differential_evolution
from scipy.stats import qmc

from vve_sumo.sweep import worst

TRIES, BATCH, SEEDS = (40, 80, 160), 8, range(8)
POPULATION = 16  #: of differential evolution, more or less
BRAKES = 5.9  #: [m/s2]
DELAY = 0.35  #: until they act [s]

Cost = Callable[[tuple[float, ...]], float]


def cut_in(shares: tuple[float, ...]) -> float:
    """Gap that is left [m]: the clear distance, the ego's speed, how long the lane change takes, the other's speed."""
    gap, speed, over, other = 2 + 38 * shares[0], 6 + 14 * shares[1], 1 + 7 * shares[2], 2 + 13 * shares[3]
    closing = max(speed - other, 0.0)
    return gap - closing * (max(0.5, 0.3 * over) + DELAY) - closing * closing / (2 * BRAKES)


def noisy_cut_in(shares: tuple[float, ...]) -> float:
    """The same with half a metre of noise, which the point decides."""
    return cut_in(shares) + float(np.random.default_rng(zlib.crc32(np.array(shares).tobytes())).normal(0.0, 0.5))


def steps_out(shares: tuple[float, ...]) -> float:
    """Minus the impact speed [m/s]: the ego's speed, the distance at which it sees, the pedestrian's speed."""
    speed, sight, walk = 3 + 12 * shares[0], 5 + 25 * shares[1], 0.5 + 2.5 * shares[2]
    way = speed * 2.0 / walk
    if way > sight + speed * speed / 8 + 6:
        return 0.0
    left = speed * speed - 2 * BRAKES * max(min(sight, way) - DELAY * speed, 0.0)
    return -math.sqrt(max(left, 0.0))


def ours(cost: Cost, dimensions: int, seed: int) -> Iterator[float]:
    """Costs in the order in which `vve_sumo.sweep.worst` asks for them."""
    course = worst.search(dimensions, TRIES[-1], BATCH, seed)
    shares = next(course)
    while True:
        costs = [cost(one) for one in shares]
        yield from costs
        try:
            shares = course.send(costs)
        except StopIteration:
            return


def evolution(cost: Cost, dimensions: int, seed: int) -> Iterator[float]:
    """Costs in the order in which scipy's differential evolution asks for them, a generation at a time."""
    costs: list[float] = []

    def reported(shares: np.ndarray) -> float:
        costs.append(cost(tuple(shares.tolist())))
        return costs[-1]

    differential_evolution(
        reported, [(0.0, 1.0)] * dimensions, popsize=math.ceil(POPULATION / dimensions),
        maxiter=TRIES[-1] // POPULATION, tol=0.0, polish=False, updating="deferred", rng=seed,
    )  # fmt: skip
    yield from costs


def sobol(cost: Cost, dimensions: int, seed: int) -> Iterator[float]:
    """Costs at the points of Sobol's sequence."""
    points = qmc.Sobol(dimensions, rng=seed).random_base2(8).tolist()
    return (cost(tuple(point)) for point in points)


def main() -> None:
    """Print the median over seeds of the lowest cost after so many tries."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--smoke", action="store_true", help="a single seed, only to see that it runs")
    seeds = SEEDS[:1] if parser.parse_args().smoke else SEEDS
    print(f"{'':34}" + "".join(f"{tries:>10}" for tries in TRIES) + "   tries")
    for cost, dimensions in ((cut_in, 4), (noisy_cut_in, 4), (steps_out, 3)):
        for method in (ours, evolution, sobol):
            runs = [list(islice(method(cost, dimensions, seed), TRIES[-1])) for seed in seeds]
            lowest = [statistics.median(min(run[:tries]) for run in runs) for tries in TRIES]
            print(f"{cost.__name__:16}{method.__name__:18}" + "".join(f"{one:10.2f}" for one in lowest), flush=True)


if __name__ == "__main__":
    main()
