"""The order of a sweep's runs: every run once, one road after the other, on each the longest first; in windows."""

from __future__ import annotations

import itertools
import random
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from vve_sumo.sweep import schedule
from vve_sumo.sweep.job import Job
from vve_sumo.sweep.run_specs import RunSpec


def job_of(run: RunSpec) -> Job:
    road = {"network": "town", "demand": [run.values["demand"]]}
    table: dict[str, Any] = {"road": road, "seed": run.seed, "duration_s": run.values["duration"], "ego": {}}
    if "speed" in run.values:
        table["ego"]["speed_mps"] = run.values["speed"]
    return Job(run.key, "s", table, Path("/s.toml"), Path("/"))


def runs(count: int) -> Iterator[RunSpec]:
    chance = random.Random(5)
    for number in range(count):
        values = {
            "demand": chance.choice(["light", "heavy"]),
            "duration": chance.choice([10.0, 20, 30.5]),
            "speed": chance.choice([5.0, 7.5, "fast"]),
        }
        yield RunSpec(number, f"{number:x}", values, chance.randrange(3))


def longest_first(run: RunSpec) -> tuple[Any, Any]:
    duration, speed = float(run.values["duration"]), run.values["speed"]
    return -duration, 0.0 if speed == "fast" else speed


def test_each_window_is_a_permutation_in_which_roads_follow_each_other() -> None:
    count = 2 * schedule.WINDOW + 17
    ordered = list(schedule.in_order(runs(count), job_of))
    assert sorted(ordered) == list(runs(count))
    for window, some in itertools.groupby(ordered, lambda run: run.number // schedule.WINDOW):
        part = list(some)
        assert len(part) == (17 if window == 2 else schedule.WINDOW)
        roads = [road for road, _runs in itertools.groupby(part, lambda run: (run.values["demand"], run.seed))]
        assert len(roads) == len(set(roads)) <= 6
        for here, there in itertools.pairwise(part):
            if (here.values["demand"], here.seed) == (there.values["demand"], there.seed):
                assert longest_first(here) <= longest_first(there)


def test_runs_that_nothing_tells_apart_keep_the_order_of_the_design() -> None:
    alike = [RunSpec(number, f"{number}", {"demand": "light", "duration": 5.0}, 1) for number in range(50)]
    assert list(schedule.in_order(alike, job_of)) == alike


def test_no_more_runs_are_asked_for_than_a_window_holds() -> None:
    taken = []

    def endless() -> Iterator[RunSpec]:
        for number in itertools.count():
            taken.append(number)
            yield RunSpec(number, f"{number}", {"demand": "light", "duration": 5.0}, 1)

    assert next(schedule.in_order(endless(), job_of)).number == 0
    assert len(taken) == schedule.WINDOW
