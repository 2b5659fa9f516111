"""Drives a street with signals with and without Pass-at-Green: red lights run, and energy of the ego and its followers.

python -m benchmarks.signals DIR [--first SEED] [--seeds N] [--smoke]
Each seed is a pair of drives of `signal_street` with the same traffic, at another moment of the signals' cycle. DIR
keeps a row a drive, and a run goes on where the last one ended. Energy is that of SUMO's emission models for the driven
speeds, by SUMO's own emissionsDrivingCycle, along the same stretch of street. Two minutes a pair on one core.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any, Final

sys.path.insert(0, str(Path(__file__).parent.parent))

import numpy as np
import pyarrow.parquet as pq
import sumo

from vve_sumo.drive.run import resolve_by_name, run
from vve_sumo.values import Floats

CONTROLLERS: Final = ("follow_and_stop", "pass_at_green")
#: SUMO's emission classes, with the unit of what is used
CLASSES: Final = {"HBEFA4/PC_petrol_Euro-4": "fuel", "MMPEVEM": "electricity"}
FROM, TO = 100.0, 1000.0  #: the stretch of the path on which energy is counted [m]
RUN_IN: Final = 60.0  #: from the street's begin to the path's [m]
STEP: Final = 5  #: ticks between two speeds of a driving cycle
PERIOD: Final = 0.02  #: [s]
CYCLE: Final = 60.0  #: of the signals [s]


def used(speed: Floats, model: str) -> float:
    """Return what a car uses that drives these speeds [m/s], STEP ticks apart: fuel [g], electricity [Wh]."""
    step = STEP * PERIOD
    rate = np.gradient(speed, step)
    home = Path(sumo.SUMO_HOME)
    with tempfile.TemporaryDirectory() as folder:
        cycle = Path(folder) / "cycle.csv"
        rows = (f"{row * step:.2f};{v:.4f};{a:.4f}\n" for row, (v, a) in enumerate(zip(speed, rate, strict=True)))
        cycle.write_text("".join(rows), encoding="ascii")
        command = [str(home / "bin" / "emissionsDrivingCycle"), "-t", str(cycle), "-e", model]
        command += ["-o", str(Path(folder) / "cycle_out.csv")]
        environment = os.environ | {"SUMO_HOME": str(home)}
        done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    # The tool takes each row for one second; fuel is in mg.
    total = next(
        float(line.split(":")[1]) for line in done.stdout.splitlines() if line.startswith(CLASSES[model] + ":")
    )
    return total * step * (1e-3 if CLASSES[model] == "fuel" else 1.0)


def _cycles(folder: Path) -> dict[str, Floats]:
    """Return the speeds along the stretch of the ego and of every car that drove all of it behind it."""
    ticks = pq.read_table(folder / "ticks.parquet", columns=["s_m", "true_speed_mps"]).to_pandas()
    inside = (ticks.s_m >= FROM) & (ticks.s_m < TO)
    found = {"ego": ticks.true_speed_mps[inside].to_numpy()[::STEP]}
    entered = int(np.flatnonzero(inside)[0])
    actors = pq.read_table(folder / "actors.parquet", columns=["tick", "actor", "x_m", "speed_mps"]).to_pandas()
    for name, rows in actors[actors.actor.str.startswith("east.")].groupby("actor"):
        s = rows.x_m.to_numpy() - RUN_IN
        along = (s >= FROM) & (s < TO)
        tick = rows.tick.to_numpy()[along]
        # A car that is too far from the ego for a while is not in the table.
        whole = len(tick) and len(tick) == tick[-1] - tick[0] + 1 and s.min() < FROM and s.max() >= TO
        if whole and tick[0] > entered:
            found[str(name)] = rows.speed_mps.to_numpy()[along][::STEP]
    return found


def drive(case: tuple[int, str, Path, float]) -> None:
    """Drive one case and keep its row."""
    seed, controller, out, duration = case
    warm_up = round(5.0 + CYCLE * ((seed * 0.6180339887) % 1.0), 1)
    values = {"road.warm_up_s": warm_up, "duration_s": duration}
    resolved = resolve_by_name("signal_street", Path.cwd(), seed=seed, controller=controller, values=values)
    with tempfile.TemporaryDirectory() as folder:
        done = run(resolved, Path(folder) / "drive", Path.cwd())
        summary, cycles = done.summary, _cycles(Path(folder) / "drive") if duration > 100.0 else {}
    row = {
        "seed": seed,
        "controller": controller,
        "outcome": summary["outcome"],
        "red_lights_run": summary["red_lights_run"],
        "collision": summary["collision"],
        "seconds": summary["duration_s"] if "duration_s" in summary else summary["ticks"] * PERIOD,
        "used": {name: {model: used(speed, model) for model in CLASSES} for name, speed in cycles.items()},
        "travel_s": len(cycles.get("ego", ())) * STEP * PERIOD,
    }
    (out / f"{seed}_{controller}.json").write_text(json.dumps(row, indent=1), encoding="utf-8")


def interval(values: list[float]) -> str:
    """Return the mean with its 95 % interval (Student)."""
    from scipy import stats

    mean = float(np.mean(values))
    if len(values) < 2:
        return f"{mean:.1f}"
    half = float(stats.t.ppf(0.975, len(values) - 1) * np.std(values, ddof=1) / np.sqrt(len(values)))
    return f"{mean:.1f} ({mean - half:.1f} to {mean + half:.1f}), n = {len(values)}"


def table(rows: list[dict[str, Any]]) -> None:
    """Print what the drives came to."""
    hours = sum(row["seconds"] for row in rows) / 3600.0
    red = sum(row["red_lights_run"] for row in rows)
    print(
        f"{len(rows)} drives, {hours:.2f} h: {red:.0f} red lights run, {sum(row['collision'] for row in rows)} contacts"
    )
    pairs: dict[int, dict[str, Any]] = {}
    for row in rows:
        pairs.setdefault(row["seed"], {})[row["controller"]] = row
    both = [tuple(pair[name] for name in CONTROLLERS) for pair in pairs.values() if len(pair) == len(CONTROLLERS)]
    for model in CLASSES:
        saved: dict[str, list[float]] = {"ego": [], "followers": []}
        for without, advised in both:
            same = [name for name in without["used"] if name in advised["used"] and name != "ego"]
            for who, names in (("ego", ["ego"] if "ego" in without["used"] else []), ("followers", same)):
                if names:
                    before, after = (sum(run_["used"][name][model] for name in names) for run_ in (without, advised))
                    # MMPEVEM has no answer for some accelerations.
                    if np.isfinite(before) and np.isfinite(after):
                        saved[who].append(100.0 * (1.0 - after / before))
        for who, values in saved.items():
            if values:
                print(f"| {model} | {who} | saves [%] {interval(values)} |")
    if both and both[0][0]["travel_s"]:
        print(f"travel time longer by [s] {interval([b['travel_s'] - a['travel_s'] for a, b in both])}")


def main() -> None:
    """Drive what is not there yet, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", type=Path, nargs="?", default=Path("signals"))
    parser.add_argument("--first", type=int, default=1, metavar="SEED", help="of the first pair (default: 1)")
    parser.add_argument("--seeds", type=int, default=20, metavar="N", help="pairs (default: 20)")
    parser.add_argument("--smoke", action="store_true", help="a drive of a few seconds, only to see that it runs")
    arguments = parser.parse_args()
    seeds, duration = (1, 4.0) if arguments.smoke else (arguments.seeds, 300.0)
    out = Path(tempfile.mkdtemp()) if arguments.smoke else arguments.out
    out.mkdir(parents=True, exist_ok=True)
    drawn = range(arguments.first, arguments.first + seeds)
    cases = [(seed, name, out, duration) for seed in drawn for name in CONTROLLERS]
    left = [case for case in cases if not (out / f"{case[0]}_{case[1]}.json").exists()]
    with multiprocessing.get_context("forkserver").Pool(2, maxtasksperchild=1) as pool:
        for number, _ in enumerate(pool.imap(drive, left, chunksize=1), 1):
            print(f"\r{number} of {len(left)}", end="", file=sys.stderr, flush=True)
    print(file=sys.stderr)
    table([json.loads(file.read_text(encoding="utf-8")) for file in sorted(out.glob("*.json"))])


if __name__ == "__main__":
    main()
