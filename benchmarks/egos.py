"""What further egos cost: a lockstep tick of four controlled cars against that of one, as a ratio within one run.

python -m benchmarks.egos [--ticks N] [--before CHECKOUT] [--smoke]
Every car has its own vehicle, receiver, radar, controller, gateway and record; all drive behind each other through one
street with fifty boxes in range and so many vehicles in the network. Blocks of the settings alternate, so that a noisy
machine disturbs all of them alike. With --before, one ego is also driven by the code of another checkout, of a version
that has one ego alone.
"""

from __future__ import annotations

import argparse
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

BLOCK = 50  #: ticks between two changes of the setting
WARM_UP = 150  #: ticks before anything is counted
VEHICLES = 50
SPEED = 1.0  #: [m/s]
#: front to front [m]
SPACING = 30.0
#: where the first car begins on the path [m]
BEGIN = 160.0


def serve(pipe: Connection, egos: int, vehicles: int, checkout: str) -> None:
    """Drive a block of ticks for every request, and answer with what each of them cost."""
    from benchmarks.tick import setting

    sys.path.insert(0, checkout)  # before anything of the package is imported
    from vve_sumo.drive.lockstep import Lockstep
    from vve_sumo.record.writer import RecordWriter

    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        rolling = {"ego.speed_mps": SPEED, "ego.initial_speed_mps": SPEED, "ego.initial_s_m": BEGIN}
        further = [{"id": f"car{n}", "initial_s_m": BEGIN - SPACING * n} for n in range(1, egos)]
        drive = setting(folder, vehicles, boxes=True, **rolling, **({"egos": further} if further else {}))
        shell = Lockstep(drive, REPOSITORY)
        records = [
            RecordWriter(folder / f"record{number}", one.to_dict(REPOSITORY), ego.lot.epoch)
            for number, (one, ego) in enumerate(zip(getattr(drive, "egos", (drive,)), shell.egos, strict=True))
        ]
        ticks = shell.ticks(*records)
        while (count := pipe.recv()) > 0:
            samples = []
            for _ in range(count):
                start = time.perf_counter()
                next(ticks)
                samples.append(time.perf_counter() - start)
            pipe.send(samples)
        shell.close()


def main() -> None:
    """Alternate blocks of the settings and print means and ratios."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--ticks", type=int, default=1500, help="counted for each setting (default: 1500)")
    parser.add_argument("--before", type=Path, metavar="CHECKOUT", help="whose code drives one ego, too")
    parser.add_argument("--smoke", action="store_true", help="a few ticks, only to see that it runs")
    arguments = parser.parse_args()
    size, uncounted, counted, vehicles = BLOCK, WARM_UP // BLOCK, arguments.ticks // BLOCK, VEHICLES
    if arguments.smoke:
        size, uncounted, counted, vehicles = 5, 1, 1, 5
    context = multiprocessing.get_context("spawn")
    cases: dict[str, tuple[int, str]] = {
        "one ego": (1, str(REPOSITORY)),
        "two egos": (2, str(REPOSITORY)),
        "four egos": (4, str(REPOSITORY)),
    }
    if arguments.before is not None:
        cases["one ego, before"] = (1, str(arguments.before.absolute()))
    pipes = {}
    for name, (egos, checkout) in cases.items():
        here, there = context.Pipe()
        context.Process(target=serve, args=(there, egos, vehicles, checkout), daemon=True).start()
        pipes[name] = here
    found: dict[str, list[float]] = {name: [] for name in cases}
    for block in range(uncounted + counted):
        for name, pipe in pipes.items():
            pipe.send(size)
            samples = pipe.recv()
            if block >= uncounted:
                found[name] += samples
    for pipe in pipes.values():
        pipe.send(0)
    report(found)


def report(found: dict[str, list[Any]]) -> None:
    """Print the table: a tick's mean and median, and their ratios to those of one ego."""
    mean, median = (statistics.fmean(found["one ego"]), statistics.median(found["one ego"]))
    for name, samples in found.items():
        own = statistics.fmean(samples), statistics.median(samples)
        print(
            f"{name:16} a tick: mean {1e3 * own[0]:6.3f} ms, median {1e3 * own[1]:6.3f} ms, ratio to one ego "
            f"{own[0] / mean:.2f} by the mean, {own[1] / median:.2f} by the median"
        )


if __name__ == "__main__":
    main()
