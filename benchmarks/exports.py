"""Time and size of every export of records, each in a process of its own.

python -m benchmarks.exports [RECORD ...] [--smoke]
"""

from __future__ import annotations

import argparse
import multiprocessing
import resource
import tempfile
import time
from pathlib import Path

from tests.drive.street import drive_once
from vve_sumo.analysis import Run
from vve_sumo.export.formats import FORMATS
from vve_sumo.export.write import export

MEGABYTE = 1e6


def measure(record: str, form: str) -> tuple[float, float, float]:
    """Return processor time [s], size of all files [MB] and greatest memory [MB] of one export."""
    with tempfile.TemporaryDirectory() as out:
        begun = time.process_time()
        files = export(Run(Path(record)), form, out)
        took = time.process_time() - begun
        size = sum(file.stat().st_size for file in files)
    return took, size / MEGABYTE, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / MEGABYTE


def main() -> None:
    """Print a row a format and record."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("records", nargs="*", metavar="RECORD")
    parser.add_argument("--smoke", action="store_true", help="of a short drive besides, only to see that it runs")
    asked = parser.parse_args()
    print("| record | format | time [s] | size [MB] | memory [MB] |")
    print("|---|---|---|---|---|")
    for record in asked.records:
        print_rows(record)
    if asked.smoke:
        with tempfile.TemporaryDirectory() as scratch:
            drive_once({"duration_s": 1.0}, f"{scratch}/short")
            print_rows(f"{scratch}/short")


def print_rows(record: str) -> None:
    """Print a row for each format of a record."""
    for form in FORMATS:
        with multiprocessing.get_context("spawn").Pool(1) as pool:
            took, size, memory = pool.apply(measure, (record, form))
        print(f"| `{Path(record).name}` | {form} | {took:.1f} | {size:.2f} | {memory:.0f} |")


if __name__ == "__main__":
    main()
