"""What a million runs take: processor time, wall time, disk, and what a cluster adds to each run.

python benchmarks/cost_model.py [--runs N] [--ticks N] [--cores N [N ...]] [--tasks N] [--smoke]
**Measured**, on this machine: the processor time of drives of several lengths as the sweep's server drives them, to
which a + b x ticks is fitted by least squares (to the least of each length: a busy neighbour only ever adds), and what
the server itself takes; what the client takes to keep a row; the bytes of a row in a part of 1000, of its machine's
side, of its line in the journal, and of a full record. The 1000 rows are those of the drives, each number changed a
little, each hash made up and no figure left out, or they would compress too well. Of Dask: the processor time of client
and scheduler for a task that carries a job's line and does nothing.
**Extrapolated**: all that is said of a million runs, as products of these. Processor time is used throughout, so a busy
machine spoils little; wall times are of cores that do nothing else.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import os
import random
import resource
import subprocess
import sys
import tempfile
import time
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

REPOSITORY = Path(__file__).parent.parent
sys.path.insert(0, str(REPOSITORY))

os.environ.setdefault("LIBSUMO_AS_TRACI", "quiet")

from vve_sumo.drive.resolved_scenario import versions  # noqa: E402
from vve_sumo.record.sweep_folder import FIGURES, SweepPlan  # noqa: E402
from vve_sumo.sweep.dataset import Dataset  # noqa: E402
from vve_sumo.sweep.engine import Local  # noqa: E402
from vve_sumo.sweep.job import Job, RunResult  # noqa: E402
from vve_sumo.sweep.run_specs import RunSpec  # noqa: E402

MILLION = 1_000_000
PERIOD = 0.02
LENGTHS = (5.0, 30.0, 60.0)  #: of the drives [s]
TRAFFIC = {"no traffic": [], "light traffic": ["linden_light"], "about 50 vehicles": ["linden_moderate"]}
SCENARIO = REPOSITORY / "scenarios" / "parked_car.toml"
PARAMETERS = ("ego.speed_mps", "ego.car.gnss_delay_s", "obstacles.parked_car.offset_m")
ROWS = 1000  #: of a part
AHEAD = 4  #: tasks that the scheduler holds


class Model(NamedTuple):
    """Processor time of a run [s]."""

    a: float  #: whatever its length
    b: float  #: for each tick
    server: float  #: of the process that forks the runs, for each

    def of(self, ticks: float) -> float:
        """Return the time of a run of so many ticks."""
        return self.a + self.b * ticks + self.server


class Sizes(NamedTuple):
    """Bytes of a run, and the client's processor time for it [s]."""

    row: float
    machine: float
    journal: float
    client: float


def job(demand: list[str], seconds: float, seed: int, keep: Path | None = None) -> Job:
    """Return a drive that nothing ends before its time."""
    table: dict[str, Any] = tomllib.loads(SCENARIO.read_text(encoding="utf-8"))
    table |= {"duration_s": seconds, "seed": seed}
    table["road"]["demand"] = demand
    table["obstacles"][0]["at_m"] = 760.0
    return Job(f"{seconds} {seed}", SCENARIO.stem, table, SCENARIO, REPOSITORY, keep)


def driven(jobs: list[Job]) -> list[tuple[Job, RunResult]]:
    """Drive jobs one after the other; end the benchmark at one with an error."""
    came: list[tuple[Job, RunResult]] = []
    Local(1).run(jobs, lambda one, result: came.append((one, result)))
    for one, result in came:
        if result.error or abs(result.figures["ticks"] - one.table["duration_s"] / PERIOD) > 1:  # type: ignore[operator]
            sys.exit(f"the drive {one.key} did not last: {result}")
    return came


def spent(who: int) -> float:
    """Return the processor time of this process or of its children [s]."""
    usage = resource.getrusage(who)
    return usage.ru_utime + usage.ru_stime


def fitted(demand: list[str], lengths: Sequence[float], runs: int) -> tuple[Model, float, list[RunResult]]:
    """Return the model of a kind of run, how far its worst length lies off it, and the results that it is from."""
    before = spent(resource.RUSAGE_CHILDREN)
    came = driven([job(demand, seconds, seed) for seed in range(1, runs + 1) for seconds in lengths])
    total = spent(resource.RUSAGE_CHILDREN) - before
    ticks = np.array([seconds / PERIOD for seconds in lengths])
    cost = np.array([min(r.cpu_s for one, r in came if one.table["duration_s"] == length) for length in lengths])
    b, a = np.polyfit(ticks, cost, 1)
    server = (total - sum(result.cpu_s for _one, result in came)) / len(came)
    return Model(a, b, server), float(np.max(np.abs(a + b * ticks - cost))), [result for _one, result in came]


def changed(result: RunResult, seed: int) -> RunResult:
    """Return a result as another run's might be."""
    chance = random.Random(seed)
    floats = {name for name, figure in FIGURES.items() if figure.kind == "float"}
    figures = {
        name: (value or 1.0) * (1.0 + 0.01 * chance.gauss()) if name in floats else value  # type: ignore[operator]
        for name, value in result.figures.items()
    }
    machine = {name: getattr(result, name) * (1.0 + 0.01 * chance.gauss()) for name in ("wall_s", "cpu_s", "peak_mb")}
    return dataclasses.replace(result, figures=figures | {"record_sha256": chance.randbytes(32).hex()}, **machine)


def kept(results: list[RunResult], rows: int) -> Sizes:
    """Keep a part's rows and return what that took."""
    table = job([], 60.0, 1).table
    plan = SweepPlan(
        spec={"scenario": SCENARIO.stem, "seeds": 1}, scenario=SCENARIO.stem, table=table, file=str(SCENARIO),
        working=str(REPOSITORY), cells=rows, parameters=dict.fromkeys(PARAMETERS, "float"),
        criteria=list(table["criteria"]), files_sha256={}, versions=versions(),
    )  # fmt: skip
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch) / "sweep"
        dataset = Dataset(folder, plan, resume=False, rows_per_part=rows)
        begun = spent(resource.RUSAGE_SELF)
        for number in range(rows):
            chance = random.Random(number)
            cell = RunSpec(number, f"{number:016x}", {name: chance.random() for name in PARAMETERS}, 1)
            journal = folder / "journal.jsonl"
            length = journal.stat().st_size
            dataset.add(cell, changed(results[number % len(results)], number))
        client = (spent(resource.RUSAGE_SELF) - begun) / rows
        row, machine = ((folder / place / "part-00000.parquet").stat().st_size for place in ("rows", "machine"))
        dataset.close()
    return Sizes(row / rows, machine / rows, length / (rows - 1), client)


def record(seconds: float) -> int:
    """Return the bytes of a full record of a drive."""
    with tempfile.TemporaryDirectory() as scratch:
        keep = Path(scratch) / "record"
        driven([job(TRAFFIC["about 50 vehicles"], seconds, 1, keep)])
        return sum(file.stat().st_size for file in keep.rglob("*") if file.is_file())


def of_process(pid: int) -> float:
    """Return the processor time of a process [s]."""
    fields = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def dask_tasks(count: int) -> tuple[float, float] | None:
    """Return the processor time of client and scheduler for a task [s]; None without Dask."""
    try:
        from distributed import Client, as_completed
    except ImportError:
        return None
    line = job([], 60.0, 1).to_json()
    with tempfile.TemporaryDirectory() as scratch:
        file = Path(scratch) / "scheduler.json"
        dask = [sys.executable, "-m", "dask"]
        options = ["--host", "127.0.0.1", "--no-dashboard", "--scheduler-file", str(file)]
        with (Path(scratch) / "log").open("wb") as log:
            scheduler = subprocess.Popen([*dask, "scheduler", "--port", "0", *options], stderr=log)
            worker = subprocess.Popen([*dask, "worker", "--nthreads", "1", "--no-nanny", *options], stderr=log)
            try:
                while not file.exists() or not file.read_text(encoding="utf-8").endswith("}"):
                    time.sleep(0.1)
                with Client(json.loads(file.read_text(encoding="utf-8"))["address"]) as client:
                    client.wait_for_workers(1)
                    client.submit(len, line).result()
                    before = np.array([spent(resource.RUSAGE_SELF), of_process(scheduler.pid)])
                    done = as_completed(client.submit(len, line, pure=False) for _ in range(AHEAD))
                    for number, future in enumerate(done, AHEAD):
                        future.result()
                        if number < count:
                            done.add(client.submit(len, line, pure=False))
                    after = np.array([spent(resource.RUSAGE_SELF), of_process(scheduler.pid)])
            finally:
                for process in (worker, scheduler):
                    process.kill()
                    process.wait()
    own, scheduling = (after - before) / count
    return float(own), float(scheduling)


def main() -> None:
    """Print what was measured and what follows for a million runs."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=3, help="of each length (default: 3)")
    parser.add_argument("--ticks", type=int, default=3000, help="of a run, for the million (default: 3000: 60 s)")
    parser.add_argument("--cores", type=int, nargs="+", default=[2, 16, 128, 1024], help="for the million")
    parser.add_argument("--tasks", type=int, default=1000, help="of Dask that do nothing (default: 1000)")
    parser.add_argument("--smoke", action="store_true", help="short drives and few tasks, only to see that it runs")
    arguments = parser.parse_args()
    lengths, runs, rows, tasks = LENGTHS, arguments.runs, ROWS, arguments.tasks
    if arguments.smoke:
        lengths, runs, rows, tasks = (0.5, 1.0, 1.5), 1, 20, 2 * AHEAD
    print("measured: processor time of a run = a + b x ticks, and the server's own, its start shared by the runs")
    models, results = {}, list[RunResult]()
    for name, demand in TRAFFIC.items():
        model, off, came = fitted(demand, lengths, runs)
        models[name], results = model, results + came
        print(
            f"  {name:18} a {model.a:.3f} s  b {1e3 * model.b:.4f} ms  "
            f"(worst length {off:.3f} s off)  server {model.server:.3f} s"
        )
    sizes, whole, dask = kept(results, rows), record(lengths[-1]), dask_tasks(tasks)
    print(f"measured: bytes of a run: row {sizes.row:.0f}, machine {sizes.machine:.0f}, journal {sizes.journal:.0f}")
    print(f"  until its part is whole; full record of {lengths[-1]:g} s among 50 vehicles {whole / 1e6:.2f} MB")
    print(f"measured: the client takes {1e3 * sizes.client:.2f} ms to keep a row")
    own = sizes.client
    if dask is not None:
        own += dask[0]
        print(f"measured: a task of Dask takes its client {1e3 * dask[0]:.2f} ms, its scheduler {1e3 * dask[1]:.2f} ms")
    limit = max(own, dask[1] if dask else 0.0)
    print(f"\nextrapolated: a million runs of {arguments.ticks} ticks, days of wall time on so many idle cores")
    print(f"  {'':18} {'core-hours':>10} " + " ".join(f"{cores:>8}" for cores in arguments.cores))
    for name, model in models.items():
        hours = MILLION * model.of(arguments.ticks) / 3600.0
        days = (max(hours / cores, MILLION * limit / 3600.0) / 24.0 for cores in arguments.cores)
        print(f"  {name:18} {hours:10.0f} " + " ".join(f"{day:8.2f}" for day in days))
    dataset = MILLION * (sizes.row + sizes.machine)
    print(f"  client or scheduler alone: {MILLION * limit / 3600.0:.2f} h; so at most {1.0 / limit:.0f} runs a second")
    print(f"  dataset {dataset / 1e9:.2f} GB; records, if all are kept, {MILLION * whole / 1e12:.2f} TB")


if __name__ == "__main__":
    main()
