"""What it takes to analyse a sweep of 100,000 runs: wall time and greatest memory of tables and of the report.

python benchmarks/analysis.py [--runs N] [--smoke]
The rows are made up (a car that brakes late for a parked one, with noise) and written by the code that a sweep writes
with; nothing is driven. Two datasets: a grid of three parameters with five seeds a point, and points drawn once each,
every one a group of its own. Each measurement is a process of its own, so that its memory is its own.
"""

from __future__ import annotations

import argparse
import random
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path

REPOSITORY = Path(__file__).parent.parent
sys.path.insert(0, str(REPOSITORY))

from vve_sumo.analysis import Sweep, load  # noqa: E402
from vve_sumo.config_file import read  # noqa: E402
from vve_sumo.drive.resolved_scenario import versions  # noqa: E402
from vve_sumo.record.sweep_folder import FIGURES, SweepPlan  # noqa: E402
from vve_sumo.report import write_report  # noqa: E402
from vve_sumo.sweep.dataset import Dataset  # noqa: E402
from vve_sumo.sweep.job import RunResult  # noqa: E402
from vve_sumo.sweep.run_specs import RunSpec, key_of  # noqa: E402

SPEED, DELAY, OFFSET = "ego.speed_mps", "ego.car.gnss_delay_s", "obstacles.parked_car.offset_m"
SEEDS = 5
SCENARIO = REPOSITORY / "scenarios" / "parked_car.toml"


def points(design: str, runs: int) -> Iterator[tuple[dict[str, float], int]]:
    """Return the values and the seed of every run."""
    chance = random.Random(1)
    side = round((runs / SEEDS) ** (1 / 3)) + 1
    for number in range(runs):
        point, seed = divmod(number, SEEDS)
        shares = [point // side**2 / side, point // side % side / side, point % side / side]
        if design == "drawn":
            shares, seed = [chance.random() for _ in range(3)], 0
        yield {SPEED: 5.0 + 10.0 * shares[0], DELAY: 0.2 * shares[1], OFFSET: shares[2]}, 1 + seed


def figures(values: dict[str, float], chance: random.Random) -> dict[str, float | str | bool | int]:
    """Return what a run comes to: every figure of a drive."""
    gap = 12.0 - 0.06 * values[SPEED] ** 2 - values[SPEED] * values[DELAY] + chance.gauss(0.0, 0.5)
    named = {"outcome": "stopped" if gap > 0.0 else "contact", "passed": gap > 2.0, "collision": gap <= 0.0}
    made: dict[str, float | str | bool | int] = {name: chance.gauss(5.0, 1.0) for name in FIGURES}
    made |= {name: "" for name, metric in FIGURES.items() if metric.kind == "str"}
    made |= {name: False for name, metric in FIGURES.items() if metric.kind == "bool"}
    made |= {name: chance.randrange(3000) for name, metric in FIGURES.items() if metric.kind == "int"}
    measured = {"stop_gap_m": max(gap, 0.0), "min_gap_m": gap, "min_ttc_s": max(gap, 0.01) / values[SPEED]}
    measured |= {"meets_stop_gap_m": gap > 2.0}
    return made | named | measured | {"record_sha256": f"{chance.getrandbits(256):064x}"}


def make(folder: Path, design: str, runs: int) -> None:
    """Write a dataset."""
    spec = {"title": f"{runs} runs made up, {design}", "scenario": "parked_car", "parameters": {}}
    plan = SweepPlan(
        spec=spec,
        scenario="parked_car",
        table=read(SCENARIO, "scenario"),
        file=str(SCENARIO),
        working=str(REPOSITORY),
        cells=runs,
        parameters=dict.fromkeys((SPEED, DELAY, OFFSET), "float"),
        criteria=["stop_gap_m"],
        files_sha256={},
        versions=versions(),
    )
    dataset, chance = Dataset(folder, plan, resume=False), random.Random(2)
    for number, (values, seed) in enumerate(points(design, runs)):
        key = key_of("parked_car", values, seed)
        error = "timed_out" if number % 997 == 0 else ""
        result = RunResult(key, {} if error else figures(values, chance), error, 1.5, 1.4, 300.0)
        dataset.add(RunSpec(number, key, dict(values), seed), result)
    dataset.close()


def opened(folder: Path) -> Sweep:
    """Return the dataset."""
    sweep = load(folder)
    assert isinstance(sweep, Sweep)
    return sweep


STEPS: dict[str, Callable[[Path], object]] = {
    "rows, all columns": lambda folder: opened(folder).rows(),
    "rows, two columns": lambda folder: opened(folder).rows([SPEED, "stop_gap_m"]),
    "batches": lambda folder: sum(len(batch) for batch in opened(folder).batches()),
    "grouped": lambda folder: opened(folder).grouped(),
    "grouped by one": lambda folder: opened(folder).grouped([SPEED]),
    "sql": lambda folder: opened(folder).sql(f'SELECT "{DELAY}", avg(stop_gap_m) FROM runs GROUP BY 1'),
    "report": write_report,
}


def measure(step: str, folder: Path) -> None:
    """Print what one step takes in this process."""
    began = time.perf_counter()
    STEPS[step](folder)
    wall = time.perf_counter() - began
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e6
    print(f"{step:<20} {wall:8.2f} s {peak:8.0f} MB")


def main() -> None:
    """Make the datasets and measure every step."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=100_000)
    parser.add_argument("--measure", nargs=2, metavar=("STEP", "DIR"), help=argparse.SUPPRESS)
    parser.add_argument("--smoke", action="store_true", help="a few runs, only to see that it runs")
    arguments = parser.parse_args()
    if arguments.measure:
        measure(arguments.measure[0], Path(arguments.measure[1]))
        return
    memory = "/dev/shm" if Path("/dev/shm").is_dir() else None  # the writer waits for the disk at every run
    runs, designs = (20, ("drawn",)) if arguments.smoke else (arguments.runs, ("grid", "drawn"))
    for design in designs:
        with tempfile.TemporaryDirectory(dir=memory) as scratch:
            folder = Path(scratch) / design
            began = time.perf_counter()
            make(folder, design, runs)
            size = sum(file.stat().st_size for file in folder.rglob("*") if file.is_file()) / 1e6
            took = time.perf_counter() - began
            print(f"{design}: {runs} runs, {size:.0f} MB, written in {took:.0f} s", flush=True)
            for step in STEPS:
                subprocess.run([sys.executable, __file__, "--measure", step, str(folder)], check=True)


if __name__ == "__main__":
    main()
