"""What a tick costs, as ratios within one run: from fix to frames, and the whole lockstep tick against SUMO's own step.

python benchmarks/tick.py [--ticks N] [--smoke]
Fifty boxes stand in the radar's range; the network holds 50 or 500 vehicles besides. Blocks of the four settings
alternate, so that a noisy machine disturbs all of them alike. Medians and means in milliseconds of this machine.
"""

from __future__ import annotations

import argparse
import math
import multiprocessing
import os
import statistics
import sys
import tempfile
import time
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

REPOSITORY = Path(__file__).parent.parent
sys.path.insert(0, str(REPOSITORY))

os.environ.setdefault("LIBSUMO_AS_TRACI", "quiet")

AWAY = 400.0  #: the traffic keeps this far from the ego's street, so that the same boxes stand in range [m]
BLOCK = 100  #: ticks between two changes of the setting
WARM_UP = 250  #: ticks before anything is counted
BOXES = 50
STEPS = "steps alone"


def demand(folder: Path, vehicles: int) -> Path:
    """Write traffic that holds `vehicles` vehicles on the network from the start, none of them near the ego."""
    from tests.drive.street import altered
    from vve_sumo.world.network import Roads

    roads = Roads(REPOSITORY / "networks" / "linden.net.xml")
    import numpy as np

    random = np.random.default_rng(vehicles)
    begin = altered({}).path.at(0.0)
    near = {
        edge.getID()
        for edge in roads.edges
        if any(math.dist(point[:2], (begin.x, begin.y)) < AWAY for point in edge.getShape())
    }
    edges = [edge.getID() for edge in roads.edges if edge.getLength() > 60.0 and edge.allows("passenger")]
    edges = [edge for edge in edges if edge not in near]
    lines, placed = ["<routes>"], 0
    while placed < vehicles:
        start, end = random.choice(len(edges), 2, replace=False)
        try:
            route = roads.route((edges[start], edges[end]))
        except ValueError:
            continue
        if len(route) < 12 or not near.isdisjoint(route):
            continue
        lines.append(
            f'<vehicle id="v{placed}" depart="0" departPos="random_free" departSpeed="0">'
            f'<route edges="{" ".join(route)}"/></vehicle>'
        )
        placed += 1
    lines.append("</routes>")
    file = folder / f"bench_{vehicles}.rou.xml"
    file.write_text("\n".join(lines), encoding="utf-8")
    return file


def setting(folder: Path, vehicles: int, boxes: bool, **changes: Any) -> Any:
    """Return a drive past parked boxes that never ends by itself, with so many vehicles in the network.

    `changes` are further dotted keys of the scenario.
    """
    from tests.drive.street import altered

    rows = [
        {"id": f"box{n}", "at_m": 60.0 + 3.0 * (n // 2) + 0.5 * (n % 2), "offset_m": side * (8.0 + 0.12 * n)}
        for n, side in ((n, 1 if n % 2 else -1) for n in range(BOXES))
    ]
    for row in rows:
        row |= {"length_m": 2.2, "width_m": 1.2}
    return altered(
        {
            "road.demand": [str(demand(folder, vehicles))],
            "road.warm_up_s": 5.0,
            "ego.speed_mps": 0.6,
            "obstacles": rows if boxes else [],
            "duration_s": 3600.0,
            **changes,
        }
    )


class Timed:
    """Sums and samples of wall time spent inside wrapped calls."""

    def __init__(self) -> None:
        self.samples: list[float] = []

    def wrap(self, function: Any) -> Any:
        """Return the function, timed."""

        def timed(*arguments: Any, **named: Any) -> Any:
            begun = time.perf_counter()
            try:
                return function(*arguments, **named)
            finally:
                self.samples.append(time.perf_counter() - begun)

        return timed


def serve(pipe: Connection, vehicles: int, boxes: bool) -> None:
    """Drive a block of ticks for every request, and answer with what they cost."""
    import libsumo

    from vve_sumo.drive.lockstep import Lockstep
    from vve_sumo.drive.resolved_scenario import DEFAULT_EPOCH
    from vve_sumo.record.writer import RecordWriter
    from vve_sumo.values import EGO

    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        drive = setting(folder, vehicles, boxes)
        step = Timed()
        libsumo.simulationStep = step.wrap(libsumo.simulationStep)
        shell = Lockstep(drive, REPOSITORY)
        record = RecordWriter(folder / "record", drive.to_dict(REPOSITORY), DEFAULT_EPOCH)
        pipeline, gateway = shell.egos[0].pipeline, shell.egos[0].gateway
        path = Timed()
        pipeline.receive, pipeline.see = path.wrap(pipeline.receive), path.wrap(pipeline.see)  # type: ignore[method-assign]
        pipeline.decide, gateway.step = path.wrap(pipeline.decide), path.wrap(gateway.step)  # type: ignore[method-assign]
        ticks = shell.ticks(record)
        while (count := pipe.recv()) > 0:
            rows = []
            for _ in range(count):
                for timed in (step, path):
                    timed.samples.clear()
                start = time.perf_counter()
                result = next(ticks)[EGO].result
                whole = time.perf_counter() - start
                detections = len(result.sensors["radar"].range)
                rows.append(("radar" in result.readings, sum(path.samples), whole, sum(step.samples), detections))
            pipe.send((rows, libsumo.vehicle.getIDCount(), len(shell.road.around[EGO].actors.ids)))
        shell.close()


def serve_steps(pipe: Connection, vehicles: int, boxes: bool) -> None:
    """Step the same street without ego and pipeline, a block for every request, and answer with what SUMO cost."""
    import libsumo

    from vve_sumo.drive.virtual_road import open_world

    with tempfile.TemporaryDirectory() as scratch:
        world = open_world(setting(Path(scratch), vehicles, boxes))
        while (count := pipe.recv()) > 0:
            samples = []
            for _ in range(count):
                start = time.perf_counter()
                libsumo.simulationStep()
                samples.append(time.perf_counter() - start)
            pipe.send((samples, libsumo.vehicle.getIDCount(), 0))
        world.close()


def main() -> None:
    """Alternate blocks of the settings and print medians, means and ratios."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--ticks", type=int, default=1500, help="counted for each setting (default: 1500)")
    parser.add_argument("--smoke", action="store_true", help="a few ticks, only to see that it runs")
    arguments = parser.parse_args()
    size, uncounted, counted, few, many = BLOCK, WARM_UP // BLOCK + 1, arguments.ticks // BLOCK, 50, 500
    if arguments.smoke:
        size, uncounted, counted, few, many = 10, 1, 1, 5, 10
    context = multiprocessing.get_context("spawn")
    cases = {
        f"{few} vehicles": (serve, few, True),
        f"{many} vehicles": (serve, many, True),
        f"{few} vehicles, nothing parked": (serve, few, False),
        STEPS: (serve_steps, few, False),
    }
    pipes = {}
    for name, (server, *case) in cases.items():
        here, there = context.Pipe()
        context.Process(target=server, args=(there, *case), daemon=True).start()
        pipes[name] = here
    found: dict[str, list[Any]] = {name: [] for name in cases}
    counts: dict[str, tuple[int, int]] = {}
    for block in range(uncounted + counted):
        for name, pipe in pipes.items():
            pipe.send(size)
            rows, vehicles, boxes = pipe.recv()
            if block >= uncounted:
                found[name] += rows
                counts[name] = (vehicles, boxes)
    for pipe in pipes.values():
        pipe.send(0)
    report(found, counts)


def report(found: dict[str, list[Any]], counts: dict[str, tuple[int, int]]) -> None:
    """Print the table."""
    bare = statistics.fmean(1e3 * sample for sample in found.pop(STEPS))
    medians = {}
    for name, rows in found.items():
        scans = [1e3 * row[1] for row in rows if row[0]]
        others = [1e3 * row[1] for row in rows if not row[0]]
        whole, inside = (statistics.fmean(1e3 * row[k] for row in rows) for k in (2, 3))
        medians[name] = (statistics.median(scans), statistics.median(others))
        seen = statistics.median(row[4] for row in rows)
        print(f"{name} ({counts[name][0]} in SUMO at the end, {counts[name][1]} boxes near, {seen:.0f} detections)")
        print(f"  fix to frames, ticks that scan   median {medians[name][0]:6.3f} ms")
        print(f"  fix to frames, other ticks       median {medians[name][1]:6.3f} ms")
        print(f"  whole tick                       mean   {whole:6.3f} ms")
        print(f"  inside simulationStep            mean   {inside:6.3f} ms, ratio {whole / inside:.2f}")
        if counts[name][0] < 150:
            print(f"  against step-only blocks         mean   {bare:6.3f} ms, ratio {whole / bare:.2f}")
    (few_name, few), (many_name, many), *_ = medians.items()
    ratios = f"{many[0] / few[0]:.2f} on ticks that scan, {many[1] / few[1]:.2f} else"
    print(f"{many_name} against {few_name}, same boxes: {ratios}")


if __name__ == "__main__":
    main()
