"""How a platoon of five egos passes on its leader's changes of speed: head to tail, by ACC and by CACC, over headways.

python -m benchmarks.platoon [--headways S …] [--jobs N] [--smoke]
Drives the scenario `platoon` with each controller and headway. The amplification is that of the last car's
speed over the leader's, both counted from the undisturbed speed, from the tick on at which every car is settled behind
the one ahead, and before the leader's first change. The closed form says where it begins: an ACC with k2 = 1 / h passes
no disturbance on with gain where h > 2 (delay + lag). Delay and lag of the car's answer are fitted to the first car's
drive, and the radar's latency counts as delay, too.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any, NamedTuple

os.environ.setdefault("LIBSUMO_AS_TRACI", "quiet")

REPOSITORY = Path(__file__).parent.parent
sys.path.insert(0, str(REPOSITORY))

SCENARIO = REPOSITORY / "scenarios" / "platoon.toml"
HEADWAYS = (0.3, 0.5, 0.8, 1.2)
#: of the ACC of the closed form: k1 = SHARE / h, k2 = 1 / h [1/s]
SHARE = 0.1
STANDSTILL = 5.0  #: [m]
SPEED = 15.0  #: of the undisturbed platoon [m/s]
#: drive time of the leader's first change, less a second [s]
BEFORE = 24.0
CHAIN = ("ego", "second", "third", "fourth", "fifth")
LENGTH = 4.872  #: of a car of the platoon [m]


class Case(NamedTuple):
    """One drive."""

    controller: str
    headway: float  #: [s]
    tuning: dict[str, Any]
    duration: float = 60.0  #: [s]


class Found(NamedTuple):
    """What a drive showed."""

    l2: float  #: head to tail
    linf: float
    closest: float  #: least gap in the platoon [m]
    outcomes: tuple[str, ...]
    delay: float  #: of the first car's answer to what its controller asks for [s]
    lag: float  #: [s]


def changes_of(case: Case) -> dict[str, Any]:
    """Return the changes of the scenario: controller, and every car at the headway's gap behind the one ahead."""
    gap = STANDSTILL + case.headway * SPEED
    front = 190.0
    further = enumerate(CHAIN[1:], 1)
    places = {f"egos.{name}.initial_s_m": front - number * (gap + LENGTH) for number, name in further}
    tuning = {f"controller.tuning.{key}": value for key, value in case.tuning.items()}
    drive = {"controller.name": case.controller, "duration_s": case.duration, "actors.leader.ahead_m": gap}
    return drive | places | tuning


def driven(case: Case) -> Found:
    """Drive a case and measure it; runs in a process of its own."""
    import numpy as np

    from vve_sumo.analysis.run import Run
    from vve_sumo.analysis.string_stability import head_to_tail
    from vve_sumo.drive import run as drives

    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch) / "record"
        resolved = drives.resolve_by_name(str(SCENARIO), REPOSITORY, values=changes_of(case))
        done = drives.run(resolved, folder, REPOSITORY)
        run = Run(folder)
        runs = run.egos
        found = head_to_tail(run, "leader", CHAIN, SPEED, BEFORE)
        closest = min(float(np.nanmin(one.lead.gap)) for one in runs.values())
        outcomes = tuple(dict.fromkeys(one.summary["outcome"] for one in (done, *done.others.values())))
        return Found(found.l2, found.linf, closest, outcomes, *answer(runs["ego"]))


def answer(run: Any) -> tuple[float, float]:
    """Return delay and lag [s] with which the car's true acceleration follows what its controller asks for."""
    import numpy as np

    ticks = run.arrow("ticks")
    asked = np.nan_to_num(ticks["acceleration_setpoint_mps2"].to_numpy())
    true = ticks["true_acceleration_mps2"].to_numpy()
    best = (np.inf, 0.0, 0.0)
    for delay in np.arange(0.0, 0.41, 0.02):
        late = np.concatenate([np.full(round(delay / run.period), asked[0]), asked])[: len(asked)]
        for lag in np.arange(0.02, 0.81, 0.02):
            share, value, answered = run.period / (lag + run.period), late[0], np.empty(len(late))
            for row, wanted in enumerate(late.tolist()):
                value += share * (wanted - value)
                answered[row] = value
            error = float(np.sqrt(np.nanmean((answered - true)[100:] ** 2)))
            best = min(best, (error, float(delay), float(lag)))
    return best[1], best[2]


def cases(headways: tuple[float, ...]) -> list[Case]:
    """Return the drives: the ACC of the closed form and the CACC, at every headway."""
    found = []
    for headway in headways:
        law = {"gap_m": STANDSTILL, "time_headway_s": headway}
        gains = {"gap_gain_per_s2": SHARE / headway, "speed_gain_per_s": 1.0 / headway}
        found += [Case("acc", headway, law | gains), Case("cacc", headway, law)]
    return found


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--headways", type=float, nargs="+", default=HEADWAYS, metavar="S", help="[s]")
    parser.add_argument("--jobs", type=int, default=1, help="drives at a time (default: 1)")
    parser.add_argument("--smoke", action="store_true", help="one headway, a short drive, only to see that it runs")
    arguments = parser.parse_args()
    from vve_sumo.sensors.radar_settings import RadarSettings

    latency = RadarSettings().latency_s
    wanted = cases((1.2,) if arguments.smoke else tuple(arguments.headways))
    if arguments.smoke:
        wanted = [one._replace(duration=30.0) for one in wanted]
    with ProcessPoolExecutor(arguments.jobs, max_tasks_per_child=1) as pool:
        for case, found in zip(wanted, pool.map(driven, wanted), strict=True):
            limit = 2.0 * (found.delay + latency + found.lag)
            print(
                f"{case.controller:5} headway {case.headway:.1f} s: head to tail {found.l2:.2f} (L2), "
                f"{found.linf:.2f} (greatest); least gap {found.closest:.1f} m; {', '.join(found.outcomes)}; "
                f"delay {found.delay + latency:.2f} s + lag {found.lag:.2f} s, closed form {limit:.2f} s",
                flush=True,
            )


if __name__ == "__main__":
    main()
