"""Drives, sweeps and searches made by hand for the plots."""

from __future__ import annotations

import itertools
import json
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from tests.analysis.made import BOX, CAR, PERIOD, moving, put, write
from vve_sumo.analysis import latency_margin as study
from vve_sumo.analysis.dataset import Sweep
from vve_sumo.analysis.run import Run
from vve_sumo.record.rows import LatencyRow
from vve_sumo.record.sweep_folder import SweepPlan

SPEED, BRAKING, GAP = 12.0, 3.0, 40.0
TIME = np.arange(0.0, 6.0, PERIOD)
CRITERIA = {"max_drac_mps2": {"min": None, "max": 4.0}, "min_ttc_s": {"min": 1.0, "max": None}}


def stopping(folder: Path, speed: float = SPEED, **changes: Any) -> Run:
    """A record of a car that brakes evenly to rest before a box, GAP metres ahead of its bumper at first."""
    moves = np.minimum(TIME, speed / BRAKING)
    x, v = speed * moves - 0.5 * BRAKING * moves**2, speed - BRAKING * moves
    settings = {"title": "by hand", "seed": 1, "controller": {"name": "nobody"}, "criteria": CRITERIA, "radar": {}}
    write(folder, moving(TIME, x, v), **{"settings": settings} | changes)
    box = BOX | {"actor": "parked", "x_m": CAR.rear_axle_to_bumper + GAP + 2.0}
    put(folder, "actors", [box | {"tick": tick} for tick in range(len(TIME))])
    return Run(folder)


TIMED, WORST = 2000, 1234
LEGS = np.array([2.0, 1.0, 0.5, 0.5, 1.5, 0.5])  #: [ms]


def timed(tick: int) -> LatencyRow:
    took = LEGS + np.array([0.0, 20.0, 0.0, 0.0, 0.0, 0.0]) * (tick == WORST)
    at = (tick * PERIOD + 1e-3 * np.cumsum(took)).tolist()
    due = tick * PERIOD
    return LatencyRow(tick, tick, due, due - 0.01, due, *at, due + 0.02, "datagram", 3 * (tick == 400))


def rows_of(count: int, seed: int = 1) -> pd.DataFrame:
    """Rows of a sweep over speed and delay: gaps fall with their product; some collide, some have an error."""
    random = np.random.default_rng(seed)
    speed, delay = random.uniform(5.0, 15.0, count), random.choice([0.0, 0.1, 0.2], count)
    demand, reaction = random.uniform(2.0, 3.0, count), random.uniform(0.03, 0.06, count)
    distance = speed * reaction + speed**2 / (2.0 * demand)
    gap = 2.0 - speed * delay + random.normal(0.0, 0.1, count)
    error = np.arange(count) % 10 == 3
    frame = pd.DataFrame(
        {
            "number": range(count),
            "ego.speed_mps": speed,
            "delay": delay,
            "seed": 1,
            "error": np.where(error, "timed_out", ""),
            "collision": gap < 0.0,
            "passed": gap > 0.5,
            "stop_gap_m": gap,
            "stop_onset_speed_mps": speed,
            "stop_distance_m": distance + np.where(np.arange(count) % 7 == 1, 0.2, 0.0),
            "stop_bound_m": distance,
            "stop_tolerance_m": 0.1,
            "stop_demand_mps2": demand,
            "stop_reaction_s": reaction,
            "hunting": False,
        }
    ).astype({"collision": "boolean", "passed": "boolean", "hunting": "boolean"})
    frame.loc[error, ["collision", "passed", "hunting"]] = pd.NA
    frame.loc[error, [name for name in frame if name.startswith("stop_")]] = np.nan
    frame.attrs["units"] = {"delay": "s"}
    return frame


FLIPS_AT = {1: 6.0, 2: 6.2}  #: by seed, the first speed at which there is a collision


def searched(folder: Path, search: dict[str, Any], found: dict[str, Any] | None) -> Sweep:
    """A search's folder: speeds with two seeds, a collision from FLIPS_AT on."""
    speeds = [5.0, 5.8, 6.0, 6.2, 7.0]
    plan = SweepPlan(
        spec={"title": "a search", "scenario": "s", "search": search},
        scenario="s",
        table={"title": "t", "parameters": {"pace": {"sets": ["ego.speed_mps"]}}},
        file="s.toml",
        working="/",
        cells=10,
        parameters={"pace": "float", "offset": "float"},
        criteria=[],
        files_sha256={},
        versions={"vve-sumo": "0"},
    )
    folder.mkdir()
    (folder / "sweep.json").write_text(plan.text(), encoding="utf-8")
    with (folder / "journal.jsonl").open("w", encoding="utf-8") as journal:
        for number, (seed, speed) in enumerate(itertools.product(FLIPS_AT, speeds)):
            hit = speed >= FLIPS_AT[seed]
            row = {"number": number, "key": f"{number:016x}", "pace": speed, "offset": 0.5, "seed": seed, "error": ""}
            row |= {"collision": hit, "passed": not hit, "impact_speed_mps": None if number == 2 else speed - 5.5}
            journal.write(json.dumps(dict.fromkeys(plan.columns()) | row) + "\n")
    if found is not None:
        (folder / "search.json").write_text(json.dumps(found), encoding="utf-8")
    return Sweep(folder)


BOUNDARY = {
    "search": "boundary",
    "along": "pace",
    "criterion": "collision",
    "boundaries": [
        {
            "values": {"offset": 0.5},
            "meets_first": True,
            "flips": [{"meets": 5.8, "fails": 6.0}],
            "seeds": [
                {"flips": [{"meets": 5.8, "fails": 6.0, "key_fails": f"{2:016x}"}]},
                {"flips": [{"meets": 6.0, "fails": 6.2, "key_fails": f"{8:016x}"}]},
            ],
        }
    ],
}


def cliff_rows() -> pd.DataFrame:
    random, rows = np.random.default_rng(3), []
    for noise, delay, seed in itertools.product((1.0, 2.0), np.arange(0.0, 0.45, 0.05), range(3)):
        gap = 4.0 - 0.2 * noise - 11.0 * delay + random.normal(0.0, 0.02)
        rows.append({study.DELAY: delay, study.NOISE: noise, "seed": seed, "error": "", "passed": gap > 1.0}
                    | {"collision": gap < 0.0, "outcome": "contact" if gap < 0.0 else "stopped", "stop_gap_m": gap}
                    | {"min_gap_m": gap, study.LATERAL: 0.1, "reasons": ""})  # fmt: skip
    return pd.DataFrame(rows)


def survivors() -> pd.DataFrame:
    """Ten runs of each of two controllers; those of the second drive through the obstacle above 12 m/s."""
    speed = np.tile(np.arange(5.0, 15.0), 2)
    second = np.arange(20) >= 10
    hit = second & (speed > 12.0)
    gap = np.where(hit, np.nan, np.where(second, 15.0 - speed, 30.0 - speed))
    demand = np.where(second, 2.0, 3.0)
    frame = {"ego.speed_mps": speed, "controller.name": np.where(second, "two", "one"), "error": "", "collision": hit}
    frame |= {"stop_gap_m": gap, "passed": ~hit, "weather": np.where(speed > 9.0, "wet", "dry")}
    frame |= {"stop_onset_speed_mps": speed, "stop_demand_mps2": demand, "stop_reaction_s": 0.0}
    frame |= {"stop_distance_m": speed**2 / 2.0 / demand, "stop_bound_m": speed**2 / 2.0 / demand}
    frame |= {"stop_tolerance_m": 0.1, "hunting": False}
    return pd.DataFrame(frame)


STILL = [{"tick": tick, "time_s": tick * PERIOD} for tick in range(30)]
