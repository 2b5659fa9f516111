"""What a run of a sweep costs: beside SUMO's bare steps, with two workers, and over thousands of runs.

python benchmarks/sweep.py [--rounds N] [--jobs N] [--runs N] [--smoke]
A drive of 60 s (3000 ticks) among 50 vehicles of Linden past a car parked far on, noise on, with the shipped
controller. **Whole** is a run as the sweep's server drives it: fork of a process that has Python and SUMO imported,
scenario, street, car and controller set up, drive, record hashed (nobody keeps it), figures, result. **Bare** is SUMO
alone in a fork of a process that has it imported: the same network, demand, options and step length, loaded, stepped
3000 times and closed; no ego, no reading. **Moved** is what any program must do that drives an ego through SUMO at
every tick: a fork of a process that has started SUMO with the traffic, as a whole is one, puts an ego on the path at
the drive's speed with `moveToXY`, sets its speed, steps, and reads the vehicles around it by its context
subscription. All three alternate, each in a process of its own; medians of processor and wall time. The traffic is
the shipped one, whose drivers act every 0.1 s, and the same one acting at every tick. All wholes have one seed: their
server has loaded the road, so that a whole does not load it, as a bare does.
Runs an hour are those of a few seeds, as in most sweeps, and of a seed for each run, whose road is loaded each time.
Runs that differ in the controller's gap alone are driven as one until they differ, and each alone; both have the same
figures, the record's hash among them.
With --runs, that many short runs instead, and whether the memory of the last 500 is that of the first.
"""

from __future__ import annotations

import argparse
import json
import os
import select
import statistics
import subprocess
import sys
import tempfile
import time
import tomllib
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

REPOSITORY = Path(__file__).parent.parent
sys.path.insert(0, str(REPOSITORY))

os.environ.setdefault("LIBSUMO_AS_TRACI", "quiet")

from vve_sumo.drive.run import resolve_by_name  # noqa: E402
from vve_sumo.sweep.engine import Local  # noqa: E402
from vve_sumo.sweep.job import Job, RunResult  # noqa: E402
from vve_sumo.sweep.worker import Worker  # noqa: E402
from vve_sumo.world.ego_sync import KEEP_ROUTE_EXACT, MATCH_THRESHOLD, compass  # noqa: E402
from vve_sumo.world.simulation import OPTIONS  # noqa: E402
from vve_sumo.world.surroundings import MAX_CENTRE_DISTANCE  # noqa: E402

TICKS, SHORT_TICKS, PERIOD = 3000, 100, 0.02
SCENARIO = REPOSITORY / "scenarios" / "parked_car.toml"
DEMAND = REPOSITORY / "routes" / "linden_moderate.rou.xml"
SEEDS = 3  #: of a sweep of which runs an hour are counted, one after the other, as a sweep orders its runs
NETWORK = REPOSITORY / "networks" / "linden.net.xml"
AROUND = 220.0 + MAX_CENTRE_DISTANCE  #: range of the subscription of a moved ego, as the virtual road's [m]
AHEAD = 400.0  #: place on the path of the parked car before which runs that are driven as one come to differ [m]
ACTING = ' actionStepLength="0.1"'  #: of the shipped traffic's vehicle types
FRESH = """
import sys
from pathlib import Path
from vve_sumo.sweep.job import Job
from vve_sumo.sweep.input_cache import InputCache
from vve_sumo.sweep.run import run_job
print(run_job(Job.from_json(sys.stdin.read()), Path(sys.argv[1]), InputCache()).to_json())
"""


class Cost(NamedTuple):
    """What a process took."""

    cpu: float  #: [s]
    wall: float  #: [s]


def job(key: str, demand: Path, ticks: int, seed: int = 1) -> Job:
    """Return the drive of this benchmark."""
    table: dict[str, Any] = tomllib.loads(SCENARIO.read_text(encoding="utf-8"))
    table |= {"duration_s": ticks * PERIOD, "seed": seed}
    table["road"]["demand"] = [str(demand)]
    table["obstacles"][0]["at_m"] = 760.0
    table.pop("criteria", None)
    return Job(key, SCENARIO.stem, table, SCENARIO, REPOSITORY)


def started(demand: Path) -> list[str]:
    """Return SUMO's command line."""
    arguments = ["sumo", "--net-file", str(NETWORK), "--seed", "1", "--step-length", f"{PERIOD:.3f}"]
    return [*arguments, "--route-files", str(demand), *(word for option in OPTIONS for word in option)]


def bare(demand: Path, ticks: int) -> Cost:
    """Let a child start SUMO, step it and close it."""
    import libsumo

    arguments = started(demand)
    begun, pid = time.monotonic(), os.fork()
    if pid == 0:
        libsumo.start(arguments)
        for _ in range(ticks):
            libsumo.simulationStep()
        libsumo.close()
        os._exit(0)
    _pid, status, usage = os.wait4(pid, 0)
    if status:
        sys.exit(f"SUMO alone ended with status {status}")
    return Cost(usage.ru_utime + usage.ru_stime, time.monotonic() - begun)


def way(ticks: int) -> tuple[list[tuple[float, float, float]], float]:
    """Return x, y [m] and SUMO's angle [degrees] of an ego on the drive's path at each tick, and its speed [m/s]."""
    resolved = resolve_by_name(str(SCENARIO), REPOSITORY, seed=1)
    speed = resolved.scenario.ego.speed_mps
    points = [resolved.path.at(speed * PERIOD * (tick + 1)) for tick in range(ticks)]
    return [(point.x, point.y, compass(point.heading)) for point in points], speed


def moved(demand: Path, poses: list[tuple[float, float, float]], speed: float) -> Cost:
    """Let a child start SUMO; return what a fork of it takes that moves an ego, steps and reads what is around it."""
    here, there = os.pipe()
    pid = os.fork()
    if pid == 0:
        os.close(here)
        os.write(there, json.dumps(_moved(demand, poses, speed)).encode())
        os._exit(0)
    os.close(there)
    with os.fdopen(here, "rb") as pipe:
        cost = pipe.read()
    _pid, status = os.waitpid(pid, 0)
    if status or not cost:
        sys.exit(f"SUMO with a moved ego ended with status {status}")
    return Cost(*json.loads(cost))


def _moved(demand: Path, poses: list[tuple[float, float, float]], speed: float) -> Cost:
    import libsumo

    libsumo.start(started(demand))
    begun, pid = time.monotonic(), os.fork()
    if pid == 0:
        _move(libsumo, poses, speed)
        os._exit(0)
    _pid, status, usage = os.wait4(pid, 0)
    if status:
        os._exit(1)
    return Cost(usage.ru_utime + usage.ru_stime, time.monotonic() - begun)


def _move(libsumo: Any, poses: list[tuple[float, float, float]], speed: float) -> None:
    vehicle = libsumo.vehicle
    edge, _position, _lane = libsumo.simulation.convertRoad(*poses[0][:2])
    libsumo.route.add("way", [edge])
    vehicle.add("ego", "way", departSpeed=f"{speed}")
    vehicle.setSpeedMode("ego", 32)
    vehicle.setLaneChangeMode("ego", 0)
    variables = (libsumo.VAR_POSITION, libsumo.VAR_SPEED, libsumo.VAR_ANGLE)
    vehicle.subscribeContext("ego", libsumo.CMD_GET_VEHICLE_VARIABLE, AROUND, variables)
    for x, y, angle in poses:
        vehicle.moveToXY("ego", "", -1, x, y, angle, KEEP_ROUTE_EXACT, MATCH_THRESHOLD)
        vehicle.setSpeed("ego", speed)
        libsumo.simulationStep()
        if "ego" not in vehicle.getContextSubscriptionResults("ego"):
            os._exit(1)


def driven(engine: Local, jobs: list[Job]) -> list[RunResult]:
    """Drive jobs and return their results; end the benchmark at the first that has an error."""
    results: list[RunResult] = []

    def done(_job: Job, result: RunResult) -> None:
        if result.error:
            sys.exit(f"run {result.key}: {result.error} {result.said}")
        results.append(result)

    engine.run(jobs, done)
    return results


def whole(worker: Worker, one: Job, ticks: int) -> Cost:
    """Let a sweep's server drive a job of so many ticks."""
    worker.submit(one)
    while (result := worker.result()) is None:
        select.select([worker], [], [])
    if result.error or result.figures["ticks"] != ticks:
        sys.exit(f"the drive did not last: {result}")
    return Cost(result.cpu_s, result.wall_s)


def compare(name: str, demand: Path, rounds: int, ticks: int) -> None:
    """Alternate whole drives, a moved ego and bare steps; print medians and their ratios."""
    worker, one, wholes, moves, bares = Worker(), job("one", demand, ticks), [], [], []
    poses, speed = way(ticks)
    try:
        whole(worker, one, ticks)  # a server reads network and path once, not at every run
        for _ in range(rounds):
            wholes.append(whole(worker, one, ticks))
            moves.append(moved(demand, poses, speed))
            bares.append(bare(demand, ticks))
    finally:
        worker.kill()
    print(f"\n{name}: medians of {rounds}")
    for kind in Cost._fields:
        drive, ego, alone = (
            statistics.median(getattr(cost, kind) for cost in costs) for costs in (wholes, moves, bares)
        )
        print(
            f"  {kind:4}  whole {drive:6.3f} s  moved {ego:6.3f} s  bare {alone:6.3f} s"
            f"  whole over moved {drive / ego:5.2f}, over bare {drive / alone:5.2f}"
        )


def hourly(count: int, drive: Callable[[], object]) -> float:
    """Return how many runs an hour a call makes that drives `count` of them."""
    begun = time.monotonic()
    drive()
    return 3600.0 * count / (time.monotonic() - begun)


def workers(count: int, ticks: int, rounds: int) -> None:
    """Print runs an hour of one worker, two, and a fresh process for each run."""
    jobs = [job(f"{number}", DEMAND, ticks, 1 + number * SEEDS // count) for number in range(count)]
    apart = [job(f"{seed}", DEMAND, ticks, seed) for seed in range(1, count + 1)]
    few = jobs[: max(1, count // 8)]
    rates: dict[str, list[float]] = {}
    for _ in range(rounds):
        for name, drive, driven_jobs in (
            ("one worker", lambda: driven(Local(1), jobs), jobs),
            ("two workers", lambda: driven(Local(2), jobs), jobs),
            ("two workers, a seed a run", lambda: driven(Local(2), apart), apart),
            ("fresh process a run", lambda: fresh(few), few),
        ):
            rates.setdefault(name, []).append(hourly(len(driven_jobs), drive))
    medians = {name: statistics.median(found) for name, found in rates.items()}
    each = f"{count} runs of {ticks * PERIOD:g} s each time"
    print(f"\nruns an hour, {each}, of {SEEDS} seeds, start of the server included: medians of {rounds}")
    for name, rate in medians.items():
        print(f"  {name:26} {rate:7.0f}")
    print(f"  two workers over one: {medians['two workers'] / medians['one worker']:.2f}")


def as_one(count: int, ticks: int) -> None:
    """Print what runs take that differ in the gap to a parked car, driven as one until they differ, and alone."""
    runs = []
    for number in range(count):
        one = job(f"{number}", DEMAND, ticks)
        one.table["controller"] = {"name": "follow_and_stop", "tuning": {"gap_m": 4.0 + 0.1 * number}}
        one.table["obstacles"][0]["at_m"] = AHEAD
        runs.append(one)
    # Jobs of which each has another limit are driven alone.
    alone = [replace(one, time_limit_s=one.time_limit_s + number) for number, one in enumerate(runs)]
    took: dict[str, tuple[float, float]] = {}
    figures = []
    for name, jobs in (("as one", runs), ("alone", alone)):
        begun = time.monotonic()
        results = driven(Local(1), jobs)
        took[name] = time.monotonic() - begun, sum(result.cpu_s for result in results)
        figures.append({result.key: result.figures for result in results})
        shared = [result.shared_s for result in results]
        print(f"\n{count} gaps, {name}: {took[name][0]:.1f} s wall, {took[name][1]:.1f} s of a processor")
        if name == "as one":
            print(f"  until {min(shared):.1f} to {max(shared):.1f} s of {ticks * PERIOD:g} s at most")
    if figures[0] != figures[1]:
        sys.exit("runs that were driven as one are not those driven alone")
    wall, cpu = (took["alone"][which] / took["as one"][which] for which in range(2))
    print(f"  runs an hour, as one over alone: {wall:.2f}; processor time, alone over as one: {cpu:.2f}; same figures")


def fresh(jobs: list[Job]) -> None:
    """Drive each job in a new interpreter, one after another."""
    for one in jobs:
        with tempfile.TemporaryDirectory() as scratch:
            command = [sys.executable, "-c", FRESH, scratch]
            done = subprocess.run(
                command, input=one.to_json(), capture_output=True, text=True, cwd=REPOSITORY, check=False
            )
        if done.returncode != 0 or RunResult.from_json(done.stdout.splitlines()[-1]).error:
            sys.exit(f"a fresh process failed: {done.stdout[-300:]} {done.stderr[-300:]}")


def memory(runs: int) -> None:
    """Drive many short runs and print the greatest memory of the first 500 and of the last."""
    jobs = [job(f"{seed}", DEMAND, SHORT_TICKS, seed) for seed in range(1, runs + 1)]
    begun = time.monotonic()
    results = driven(Local(2), jobs)
    assert len({result.key for result in results}) == runs
    part = min(500, runs // 2)
    first, last = (max(r.peak_mb for r in some) for some in (results[:part], results[-part:]))
    took, each = time.monotonic() - begun, SHORT_TICKS * PERIOD
    print(f"\n{runs} runs of {each:g} s with two workers in {took:.0f} s, every one there once")
    print(f"  greatest memory: first {part} {first:.1f} MB, last {part} {last:.1f} MB, {last / first - 1:+.1%}")


def main() -> None:
    """Print the ratios, or the memory of many runs."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=7, help="of whole drive and bare steps (default: 7)")
    parser.add_argument("--jobs", type=int, default=24, help="driven for runs an hour; 0 for none (default: 24)")
    parser.add_argument("--runs", type=int, help="short runs for the memory, instead of everything else")
    parser.add_argument("--smoke", action="store_true", help="a few short runs, only to see that it runs")
    arguments = parser.parse_args()
    rounds, jobs, ticks, repeated = arguments.rounds, arguments.jobs, TICKS, 3
    if arguments.smoke:
        rounds, jobs, ticks, repeated = 1, 2, SHORT_TICKS, 1
        memory(2)
    if arguments.runs:
        memory(arguments.runs)
        return
    with tempfile.TemporaryDirectory() as scratch:
        every = Path(scratch) / "acting_at_every_tick.rou.xml"
        every.write_text(DEMAND.read_text(encoding="utf-8").replace(ACTING, ""), encoding="utf-8")
        if not arguments.smoke:
            compare("shipped traffic: drivers act every 0.1 s", DEMAND, rounds, ticks)
        compare("the same vehicles, drivers act at every tick", every, rounds, ticks)
    if jobs:
        workers(jobs, ticks, repeated)
        as_one(jobs, ticks)


if __name__ == "__main__":
    main()
