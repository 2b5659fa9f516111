"""How late a command is, live: from the kernel's stamp of a fix to the return of the last command frame's send.

python benchmarks/latency.py [--seconds S] [--rounds N]
The whole live stack with the simulated vehicle (UDP loopback, slcan on a pty). Twenty boxes stand in the radar's range;
the network holds 500 vehicles besides, or none. Drives of both kinds alternate, so that a noisy machine disturbs them
alike; the figures are of all ticks of all rounds, from the drives' own latency tables.
"""

from __future__ import annotations

import argparse
import json
import socket
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import pyarrow as pa
import tomlkit

REPOSITORY = Path(__file__).parent.parent
sys.path.insert(0, str(REPOSITORY))

from benchmarks.tick import demand  # noqa: E402
from vve_sumo.drive.latency_monitor import LEGS, TOTAL, latency_summary  # noqa: E402
from vve_sumo.record.reader import read_table  # noqa: E402

BOXES = 20
CASES = (0, 500)


def scenario(folder: Path, vehicles: int, seconds: float) -> Path:
    """Write a slow drive towards parked boxes, all of them ahead and none in the way, and return its file."""
    table: Any = tomlkit.parse((REPOSITORY / "scenarios" / "parked_car.toml").read_text(encoding="utf-8"))
    table["duration_s"] = seconds
    table["road"]["demand"] = [str(demand(folder, vehicles))] if vehicles else []
    table["road"]["warm_up_s"] = 5.0
    table["ego"]["speed_mps"] = 0.6
    table["obstacles"] = [
        {"id": f"box{n}", "at_m": 60.0 + 3.0 * (n // 2), "offset_m": (1 if n % 2 else -1) * (8.0 + 0.12 * n)}
        | {"length_m": 2.2, "width_m": 1.2}
        for n in range(BOXES)
    ]
    table["criteria"] = {"collision": False}
    file = folder / f"latency_{vehicles}.toml"
    file.write_text(tomlkit.dumps(table), encoding="utf-8")
    return file


def rig(folder: Path) -> Path:
    """Write the shipped rig with a UDP port that is free now, and return its file."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    table: Any = tomlkit.parse((REPOSITORY / "rigs" / "simulated.toml").read_text(encoding="utf-8"))
    table["pose"]["port"] = port
    file = folder / "bench.toml"
    file.write_text(tomlkit.dumps(table), encoding="utf-8")
    return file


def drive(folder: Path, vehicles: int, seconds: float, number: int) -> tuple[pa.Table, dict[str, Any]]:
    """Drive once in processes of its own and return the latency table and the summary."""
    record = folder / f"record_{vehicles}_{number}"
    command = [sys.executable, "-m", "vve_sumo.cli", "drive", str(scenario(folder, vehicles, seconds))]
    command += ["--rig", str(rig(folder)), "--out", str(record)]
    done = subprocess.run(
        command, check=False, cwd=REPOSITORY, stdin=subprocess.DEVNULL, capture_output=True, text=True
    )
    if not (record / "summary.json").is_file():
        sys.exit(f"the drive did not begin: {done.stderr.strip()}")
    return read_table(record, "latency"), json.loads((record / "summary.json").read_text(encoding="utf-8"))


def main() -> None:
    """Alternate the cases; print a table of legs and the ratio."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=30.0, help="of each drive, after go (default: 30)")
    parser.add_argument("--rounds", type=int, default=2, help="of each case (default: 2)")
    arguments = parser.parse_args()
    tables: dict[int, list[pa.Table]] = {vehicles: [] for vehicles in CASES}
    with tempfile.TemporaryDirectory() as scratch:
        for number in range(arguments.rounds):
            for vehicles in CASES:
                table, summary = drive(Path(scratch), vehicles, arguments.seconds, number)
                tables[vehicles].append(table)
                load = summary.get("step_time", {})
                print(
                    f"{vehicles:4d} vehicles: {summary['outcome']} ({'+'.join(summary['reasons'])}), {table.num_rows} "
                    f"ticks, removed {load.get('removed')}, refused {load.get('refused')}, step at most "
                    f"{1000.0 * load.get('longest_s', 0.0):.1f} ms"
                )
    show({vehicles: latency_summary(pa.concat_tables(parts)) for vehicles, parts in tables.items()})


def show(figures: dict[int, dict[str, Any]]) -> None:
    """Print every leg's median, 99th percentile and greatest [ms], and 500 vehicles over none."""
    print(f"\n{'leg [ms]':<12}" + "".join(f"{v:>5} vehicles: p50    p99    max" for v in figures))
    for leg in (*LEGS, TOTAL):
        cells = (figures[v]["legs_ms"][leg] for v in figures)
        print(f"{leg:<12}" + "".join(f"{c['p50']:>19.3f}{c['p99']:>7.2f}{c['max']:>7.1f}" for c in cells))
    none, many = (figures[vehicles] for vehicles in CASES)
    for name in ("p50", "p99"):
        ratio = many["legs_ms"][TOTAL][name] / none["legs_ms"][TOTAL][name]
        print(f"{CASES[1]} vehicles over none, {name} of the total: {ratio:.2f}")
    for vehicles, figure in figures.items():
        print(f"{vehicles} vehicles: {figure['missed']} ticks missed, {figure['woken_by_deadline']} without their fix")


if __name__ == "__main__":
    main()
