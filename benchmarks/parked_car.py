"""Drives the paper's parked car over the whole matrix and prints what came out: 20 seeds at each of 5 to 45 mph.

python benchmarks/parked_car.py [--seeds N] [--csv FILE] [--smoke]
Each drive runs in a process of its own, two at a time. About half an hour on two cores.
"""

from __future__ import annotations

import argparse
import csv
import multiprocessing
import sys
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parent.parent))

from tests.drive.street import drive_once
from tests.drive.test_parked_car import SPEEDS_MPH, at_speed

COLUMNS = ("stop_gap_m", "max_lateral_deviation_m", "max_deceleration_mps2", "min_ttc_s")


def _one(case: tuple[int, int]) -> dict[str, Any]:
    mph, seed = case
    return {"mph": mph, **drive_once(at_speed(mph, seed))}


def main() -> None:
    """Drive the matrix and print one line a speed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--csv", type=Path)
    parser.add_argument("--smoke", action="store_true", help="a single drive, only to see that it runs")
    arguments = parser.parse_args()
    speeds, seeds = (SPEEDS_MPH[-1:], 1) if arguments.smoke else (SPEEDS_MPH, arguments.seeds)
    cases = [(mph, seed) for mph in speeds for seed in range(seeds)]
    with multiprocessing.get_context("forkserver").Pool(2, maxtasksperchild=1) as pool:
        rows = []
        for row in pool.imap(_one, cases, chunksize=1):
            rows.append(row)
            print(f"\r{len(rows)} of {len(cases)}", end="", file=sys.stderr, flush=True)
    print(file=sys.stderr)
    print(
        f"{'mph':>4} {'stopped':>8} {'contact':>8} {'emerg.':>9} {'gap [m]':>15} {'deviation [m]':>13} {'braking':>8}"
    )
    for mph in speeds:
        some = [row for row in rows if row["mph"] == mph]
        gaps = [row["stop_gap_m"] for row in some]
        print(
            f"{mph:4d} {sum(row['outcome'] == 'stopped' for row in some):5d}/{len(some):<2d} "
            f"{sum(row['collision'] for row in some):8d} {sum(row['emergency_used'] for row in some):9d} "
            f"{min(gaps):7.2f} to {max(gaps):<5.2f} {max(row['max_lateral_deviation_m'] for row in some):13.3f} "
            f"{max(row['max_deceleration_mps2'] for row in some):8.2f}"
        )
    if arguments.csv is not None:
        with arguments.csv.open("w", newline="", encoding="utf-8") as file:
            writer = csv.DictWriter(file, ["mph", "seed", "outcome", *COLUMNS], extrasaction="ignore")
            writer.writeheader()
            writer.writerows(rows)


if __name__ == "__main__":
    main()
