"""Time and size of every export of records: `python -m benchmarks.exports RECORD …`; each in a process of its own."""

from __future__ import annotations

import multiprocessing
import resource
import sys
import tempfile
import time
from pathlib import Path

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


def main(records: list[str]) -> None:
    """Print a row a format and record."""
    print("| record | format | time [s] | size [MB] | memory [MB] |")
    print("|---|---|---|---|---|")
    for record in records:
        for form in FORMATS:
            with multiprocessing.get_context("spawn").Pool(1) as pool:
                took, size, memory = pool.apply(measure, (record, form))
            print(f"| `{Path(record).name}` | {form} | {took:.1f} | {size:.2f} | {memory:.0f} |")


if __name__ == "__main__":
    main(sys.argv[1:])
