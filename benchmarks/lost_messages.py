"""Contacts in a CACC platoon of five whose messages end while its leader brakes: many short drives, each drawn anew.

python -m benchmarks.lost_messages [--runs N] [--first SEED] [--minutes M] [--headway S] [--smoke]
The scenario `platoon`, begun settled at the headway, for 12 s. The leader brakes after 2 to 4 s with 1 to 6 m/s2 to a
speed of 0 to 10 m/s; every receiver is jammed from 2 s before to 2 s after that on. No record is kept: a gap is that of
true places on the straight track. Drives begin until the minutes are over; how many there were is printed.
"""

from __future__ import annotations

import argparse
import math
import multiprocessing
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np

from vve_sumo.statistics import wilson

REPOSITORY = Path(__file__).parent.parent
CHAIN: Final = ("ego", "second", "third", "fourth", "fifth")
PRELOADED: Final = ["scipy.optimize", "vve_sumo.drive.lockstep", "vve_sumo.drive.run", "vve_sumo.record.writer"]
SPEED, STANDSTILL = 15.0, 5.0  #: of the platoon [m/s]; its gap at rest [m]
LENGTH: Final = 4.872  #: of a car of the platoon [m]
FRONT: Final = 190.0  #: s of the first ego's rear axle at the start [m]
LASTS: Final = 12.0  #: of a drive [s]


class Case(NamedTuple):
    """One drive."""

    seed: int
    headway: float  #: [s]
    brakes: float  #: drive time at which the leader brakes [s]
    deceleration: float  #: [m/s2]
    slowed: float  #: speed that it brakes down to [m/s]
    jammed: float  #: drive time from which on no message comes [s]
    lasts: float = LASTS  #: [s]


class Outcome(NamedTuple):
    """What came of it."""

    least_gap: float  #: between any two that follow each other [m]
    stopped: int  #: egos that the gateway stopped
    cost: float  #: processor time [s]


def drawn(seed: int, headway: float) -> Case:
    """Draw a drive."""
    draw = np.random.default_rng(seed)
    brakes = float(draw.uniform(2.0, 4.0))
    jammed = max(brakes + float(draw.uniform(-2.0, 2.0)), 0.0)
    return Case(seed, headway, brakes, float(draw.uniform(1.0, 6.0)), float(draw.uniform(0.0, 10.0)), jammed)


def drive(case: Case) -> Outcome:
    """Drive a case; in a process of its own."""
    from vve_sumo.drive import run as drives
    from vve_sumo.drive.lockstep import Lockstep
    from vve_sumo.record.writer import MemoryRecorder
    from vve_sumo.timing import PERIOD
    from vve_sumo.values import EGO, ArmingState

    begin = time.process_time()
    resolved = drives.resolve_by_name("platoon", REPOSITORY, seed=case.seed, values=changes_of(case))
    shell, vehicle = Lockstep(resolved, REPOSITORY), resolved.vehicle
    egos = zip(resolved.egos, shell.egos, strict=True)
    records = [MemoryRecorder(one.to_dict(REPOSITORY), ego.lot.epoch) for one, ego in egos]
    least, stopped = math.inf, set[str]()
    for number, ticks in enumerate(shell.ticks(*records)):
        if number == 0:
            # Not from the headway without messages, from which closing up takes half a minute.
            for ego in shell.egos:
                ego.pipeline._controller._controller._own._law.time_gap = case.headway
        actors = ticks[EGO].actors
        rear = math.inf
        for row in (row for row, name in enumerate(actors.ids) if name == "leader"):
            rear = resolved.path.project(float(actors.x[row]), float(actors.y[row]), None).s - 0.5 * actors.length[row]
        for name in CHAIN:
            truth, state = ticks[name].truth, ticks[name].output.status.state
            place = resolved.path.project(truth.x, truth.y, None).s
            least = min(least, float(rear - place - vehicle.rear_axle_to_bumper))
            rear = place - vehicle.rear_overhang
            if state in (ArmingState.STOPPING, ArmingState.FAULT):
                stopped.add(name)
        if least <= 0.0 or number * PERIOD >= case.lasts:
            break
    shell.close()
    return Outcome(least, len(stopped), time.process_time() - begin)


def changes_of(case: Case) -> dict[str, Any]:
    """Return the changes of the scenario."""
    gap = STANDSTILL + case.headway * SPEED
    event = {
        "when": {"after_s": case.brakes}, "speed_mps": case.slowed, "acceleration_mps2": case.deceleration,
        "build_up_s": 0.5,
    }  # fmt: skip
    places = {f"egos.{name}.initial_s_m": FRONT - number * (gap + LENGTH) for number, name in enumerate(CHAIN[1:], 1)}
    return places | {
        "controller.tuning.time_headway_s": case.headway,
        "controller.tuning.gap_m": STANDSTILL,
        "sensors": [
            {"name": "obu", "kind": "v2x", "settings": {"jammed_from_s": case.jammed, "longest_cam_interval_s": 0.1}}
        ],
        "actors": [{"id": "leader", "ahead_m": gap, "speed_mps": SPEED, "events": [event]}],
    }


def driven(headway: float, seeds: range, minutes: float, lasts: float) -> Iterator[tuple[Case, Outcome]]:
    """Drive one case after the other, each in a process of its own, until there are so many or the time is over."""
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(PRELOADED)
    end = time.monotonic() + 60.0 * minutes
    with ProcessPoolExecutor(1, context, max_tasks_per_child=1) as pool:
        for seed in seeds:
            if time.monotonic() > end:
                return
            case = drawn(seed, headway)._replace(lasts=lasts)
            yield case, pool.submit(drive, case).result()


def main() -> None:
    """Drive and print what came of it, and each drive with a contact."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=1000, help="drives at most (default: 1000)")
    parser.add_argument("--first", type=int, default=1, metavar="SEED", help="of the first drive (default: 1)")
    parser.add_argument("--minutes", type=float, default=math.inf, help="in which drives begin (default: no limit)")
    parser.add_argument("--headway", type=float, default=0.5, metavar="S", help="[s] (default: 0.5)")
    parser.add_argument("--smoke", action="store_true", help="one drive of 2 s, only to see that it runs")
    given = parser.parse_args()
    runs, lasts = (1, 2.0) if given.smoke else (given.runs, LASTS)
    gaps, costs, contacts, stopped = list[float](), list[float](), 0, 0
    for case, one in driven(given.headway, range(given.first, given.first + runs), given.minutes, lasts):
        gaps.append(one.least_gap)
        costs.append(one.cost)
        stopped += one.stopped
        if one.least_gap <= 0.0:
            contacts += 1
            print(f"contact: {case}", flush=True)
    share = wilson(contacts, len(gaps))
    print(
        f"headway {given.headway:g} s, seeds from {given.first}: {contacts} contacts in {len(gaps)} drives "
        f"(95 %: at most {share.high:.4f}), {stopped} egos stopped by the gateway; least gap "
        f"{min(gaps):.2f} m, median {np.median(gaps):.2f} m; {np.mean(costs):.1f} s of one processor a drive"
    )


if __name__ == "__main__":
    main()
