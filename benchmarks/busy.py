"""How many live drives of `parked_car` reach their end on a computer that other programs keep busy.

python -m benchmarks.busy [--drives N] [--beside LOAD ...] [--rights with without] [--at M] [--smoke]
The whole live stack with the simulated vehicle (UDP loopback, slcan on a pty) drives beside each load: nothing,
`stress-ng --cpu` with a worker for each processor, or as many compilers in endless loops. It drives with the real-time
rights of whoever starts this, and without any (`setpriv` and `prlimit` take them away). Drives of all kinds alternate,
so that a noisy machine disturbs them alike. For each kind: how many reached their end, what ended the others, and how
long it took from the kernel's stamp of a fix to the last command frame, of all ticks of all drives. `--at` moves the
parked car, for shorter drives. `--smoke` drives for seconds, to see that everything runs; its figures say nothing.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import pyarrow as pa

REPOSITORY = Path(__file__).parent.parent
sys.path.insert(0, str(REPOSITORY))

from benchmarks.latency import rig  # noqa: E402
from vve_sumo.errors import VveError  # noqa: E402
from vve_sumo.record.latencies import TOTAL, latency_summary  # noqa: E402
from vve_sumo.record.reader import read_table  # noqa: E402

PROCESSORS = len(os.sched_getaffinity(0))
SOURCE = "#include <algorithm>\n#include <iostream>\n#include <map>\n#include <regex>\nint main() { return 0; }\n"
LOADS = ("nothing", "stress-ng", "compile")
RIGHTS = ("with", "without")


class Case(NamedTuple):
    """One kind of drive."""

    beside: str  #: one of LOADS
    rights: str  #: one of RIGHTS

    def __str__(self) -> str:
        return f"beside {self.beside}, {self.rights} rights"


class Driven(NamedTuple):
    """What is left of a drive."""

    ended: str  #: outcome and reasons, or what the command said where the drive never began
    finished: bool  #: whether the drive reached its end
    table: pa.Table | None  #: of the ticks' latency


@contextlib.contextmanager
def load(name: str, folder: Path) -> Iterator[None]:
    """Keep every processor busy while the block runs."""
    if name == "nothing":
        yield
        return
    command = ["stress-ng", "--quiet", "--cpu", str(PROCESSORS)]
    if name == "compile":
        source = folder / "compiled.cpp"
        source.write_text(SOURCE, encoding="ascii")
        loop = f"while true; do c++ -O2 -o /dev/null -x c++ {source}; done"
        command = ["sh", "-c", " & ".join([loop] * PROCESSORS)]
    process = subprocess.Popen(command, start_new_session=True)
    try:
        yield
    finally:
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()


def without_rights() -> list[str]:
    """Return the beginning of a command that runs without any real-time right."""
    plain = ["prlimit", "--rtprio=0", "--nice=0", "--memlock=65536"]
    # Root has the rights without any limit, as long as these are among what its programs may have.
    return ["setpriv", "--bounding-set=-sys_nice,-ipc_lock,-sys_resource", *plain] if os.geteuid() == 0 else plain


def drive(folder: Path, case: Case, changes: dict[str, float], number: int) -> Driven:
    """Drive once in processes of its own."""
    record = folder / f"record_{LOADS.index(case.beside)}_{case.rights}_{number}"
    command = [sys.executable, "-m", "vve_sumo.cli", "drive", "parked_car", "--rig", str(rig(folder, {}))]
    command += ["--out", str(record), *(f"--set={key}={value}" for key, value in changes.items())]
    if case.rights == "without":
        command = [*without_rights(), *command]
    with load(case.beside, folder):
        done = subprocess.run(
            command, check=False, cwd=REPOSITORY, stdin=subprocess.DEVNULL, capture_output=True, text=True
        )
    try:
        summary = json.loads((record / "summary.json").read_text(encoding="utf-8"))
        table = read_table(record, "latency")
    except (OSError, VveError):
        return Driven(f"not begun: {done.stderr.strip().splitlines()[-1:]}", False, None)
    ended = "+".join([summary["outcome"], *summary["reasons"]])
    return Driven(ended, summary["outcome"] == "stopped" and done.returncode == 0, table)


def main() -> None:
    """Alternate the cases; print a line for each."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--drives", type=int, default=20, help="of each kind (default: 20)")
    parser.add_argument("--beside", nargs="+", choices=LOADS, default=LOADS, help="loads (default: each)")
    parser.add_argument("--rights", nargs="+", choices=RIGHTS, default=RIGHTS, help="real-time rights (default: both)")
    parser.add_argument("--at", type=float, help="place of the parked car along the path [m] (default: the scenario's)")
    parser.add_argument("--smoke", action="store_true", help="drive for 2 s, once, beside nothing, without rights")
    arguments = parser.parse_args()
    changes = {} if arguments.at is None else {"obstacles.parked_car.at_m": arguments.at}
    cases = [Case(beside, rights) for beside in arguments.beside for rights in arguments.rights]
    drives = arguments.drives
    if arguments.smoke:
        cases, drives, changes = [Case("nothing", "without")], 1, {"duration_s": 2.0}
    for beside, tool in (("stress-ng", "stress-ng"), ("compile", "c++")):
        if any(case.beside == beside for case in cases) and shutil.which(tool) is None:
            sys.exit(f"install {tool}, or leave its load out")
    driven: dict[Case, list[Driven]] = {case: [] for case in cases}
    with tempfile.TemporaryDirectory() as scratch:
        for number in range(drives):
            for case in cases:
                one = drive(Path(scratch), case, changes, number)
                driven[case].append(one)
                print(f"{case}, {number + 1}: {one.ended}; {figures([one])}", flush=True)
    print()
    for case, parts in driven.items():
        print(f"{case}: {sum(one.finished for one in parts)} of {len(parts)} reached their end; {figures(parts)}")
        for ended, count in Counter(one.ended for one in parts if not one.finished).items():
            print(f"    {count}: {ended}")


def figures(parts: list[Driven]) -> str:
    """Return how long it took from datagram to frame, in words."""
    tables = [one.table for one in parts if one.table is not None]
    if not tables:
        return "no ticks"
    summary: dict[str, Any] = latency_summary(pa.concat_tables(tables))
    took = summary["legs_ms"][TOTAL]
    if took["p50"] is None:
        return f"{summary['ticks']} ticks, no frames"
    spread = f"median {took['p50']:.2f} ms, p99 {took['p99']:.2f} ms, at most {took['max']:.1f} ms"
    return f"datagram to frame {spread}, {summary['missed']} ticks missed"


if __name__ == "__main__":
    main()
