"""How late a command and the outgoing wires are, live: from the kernel's stamp of a fix.

python benchmarks/latency.py [--seconds S] [--rounds N] [--smoke]
The whole live stack with the simulated vehicle (UDP loopback, slcan on a pty). Twenty boxes stand in the radar's range;
the network holds 500 vehicles besides, or none; the rig has no outputs, or GNSS (NCOM) and radar datagrams over UDP;
the car has its radar, or a lidar and a camera's list of objects besides.
Drives of all kinds alternate, so that a noisy machine disturbs them alike; the figures are of all ticks of all rounds.
A command's latency, to the return of the last command frame's send, is from the drives' own latency tables; that of a
datagram is from the fix's stamp there to the kernel's stamp of the datagram at its receiver. `--smoke` drives for
seconds, to see that everything runs; its figures say nothing.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import math
import select
import socket
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
import tomlkit

REPOSITORY = Path(__file__).parent.parent
sys.path.insert(0, str(REPOSITORY))

from benchmarks.tick import demand  # noqa: E402
from vve_sumo.pose.ncom import Decoder  # noqa: E402
from vve_sumo.pose.sources import Source, open_udp  # noqa: E402
from vve_sumo.record.latencies import LEGS, TOTAL, latency_summary  # noqa: E402
from vve_sumo.record.reader import read_table  # noqa: E402
from vve_sumo.wire.datagrams import decode_radar  # noqa: E402

BOXES = 20


class Case(NamedTuple):
    """One kind of drive."""

    vehicles: int
    outputs: bool = False
    senses: bool = False

    def __str__(self) -> str:
        return f"{self.vehicles} vehicles{', outputs' * self.outputs}{', lidar and camera' * self.senses}"


CASES = (Case(0), Case(0, outputs=True), Case(500), Case(0, senses=True))
SMOKE = (Case(0), Case(0, outputs=True))
WIRES = ("ncom", "radar")


def scenario(folder: Path, case: Case, seconds: float) -> Path:
    """Write a slow drive towards parked boxes, all of them ahead and none in the way, and return its file."""
    table: Any = tomlkit.parse((REPOSITORY / "scenarios" / "parked_car.toml").read_text(encoding="utf-8"))
    table["duration_s"] = seconds
    table["road"]["demand"] = [str(demand(folder, case.vehicles))] if case.vehicles else []
    table["road"]["warm_up_s"] = 5.0
    table["ego"]["speed_mps"] = 0.6
    table["obstacles"] = [
        {"id": f"box{n}", "at_m": 60.0 + 3.0 * (n // 2), "offset_m": (1 if n % 2 else -1) * (8.0 + 0.12 * n)}
        | {"length_m": 2.2, "width_m": 1.2}
        for n in range(BOXES)
    ]
    if case.senses:
        table["sensors"] = [{"name": "roof", "kind": "lidar"}, {"name": "front", "kind": "camera"}]
    table["criteria"] = {"collision": False}
    table.pop("parameters", None)  # they vary the obstacle that has gone
    file = folder / f"{_file_name(case)}.toml"
    file.write_text(tomlkit.dumps(table), encoding="utf-8")
    return file


def _file_name(case: Case) -> str:
    return f"latency_{case.vehicles}_{int(case.outputs)}_{int(case.senses)}"


def rig(folder: Path, ports: dict[str, int]) -> Path:
    """Write the shipped rig with a UDP port that is free now and with outputs to these ports, and return its file."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    table: Any = tomlkit.parse((REPOSITORY / "rigs" / "simulated.toml").read_text(encoding="utf-8"))
    table["pose"]["port"] = port
    # A burst of fixes says nothing of how fast the program is: the first of them is late by itself.
    table["car_start"]["fidelity"] = "ideal"
    if ports:
        table["outputs"] = [{"kind": kind, "udp": f"127.0.0.1:{number}"} for kind, number in ports.items()]
    file = folder / "bench.toml"
    file.write_text(tomlkit.dumps(table), encoding="utf-8")
    return file


class Receivers:
    """Hears the outgoing wires on ports of its own; arrivals are the kernel's stamps, so a late reader does no harm."""

    def __init__(self) -> None:
        self._sources: dict[str, Source] = {kind: open_udp("127.0.0.1", 0) for kind in WIRES}
        self.ports = {kind: _port(source) for kind, source in self._sources.items()}
        self.heard: dict[str, list[tuple[float, bytes]]] = {kind: [] for kind in WIRES}
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._hear)

    def _hear(self) -> None:
        while not self._over.is_set():
            select.select(list(self._sources.values()), [], [], 0.05)
            for kind, source in self._sources.items():
                self.heard[kind] += source.receive()

    @contextlib.contextmanager
    def listening(self) -> Iterator[None]:
        """Listen while the block runs."""
        self._thread.start()
        try:
            yield
        finally:
            self._over.set()
            self._thread.join()
            for source in self._sources.values():
                source.close()

    def latencies(self, table: pa.Table, t0: float, epoch: float) -> dict[str, Any]:
        """Return by wire how long after its tick's fix each valid datagram came [ms]; a tick without a fix has none."""
        due = np.array(table["due_s"])
        fixes = np.where(np.array(table["woken_by"]) == "datagram", np.array(table["received_s"]), math.nan)
        late = {}
        for kind, datagrams in self.heard.items():
            came = np.array([(stamp - t0, time - epoch) for stamp, time in _dated(kind, datagrams)]).reshape(-1, 2)
            nearest = np.abs(due[:, None] - came[None, :, 1]).argmin(axis=0) if len(came) else np.zeros(0, int)
            found = 1000.0 * (came[:, 0] - fixes[nearest])
            late[kind] = found[np.isfinite(found)]
        return late


def _port(source: Source) -> int:
    with socket.fromfd(source.fileno(), socket.AF_INET, socket.SOCK_DGRAM) as same:
        return int(same.getsockname()[1])


def _dated(kind: str, datagrams: list[tuple[float, bytes]]) -> Iterator[tuple[float, float]]:
    """Give the arrival of each valid datagram, and the GNSS time of the tick that made it."""
    decoder = Decoder()
    for stamp, data in datagrams:
        if kind == "radar":
            seen = decode_radar(data)
            if seen is not None and seen.valid:
                yield stamp, seen.time
            continue
        for fix in decoder.feed(data, 0.0):
            if fix.locked:
                yield stamp, fix.time


class Driven(NamedTuple):
    """What is left of a drive."""

    table: pa.Table  #: of the ticks' latency
    summary: dict[str, Any]
    late: dict[str, Any]  #: of each wire, the latencies of its datagrams [ms]


def drive(folder: Path, case: Case, seconds: float, number: int) -> Driven:
    """Drive once in processes of its own."""
    record = folder / f"{_file_name(case)}_record_{number}"
    receivers = Receivers()
    file = rig(folder, receivers.ports if case.outputs else {})
    command = [sys.executable, "-m", "vve_sumo.cli", "drive", str(scenario(folder, case, seconds))]
    command += ["--rig", str(file), "--out", str(record)]
    with receivers.listening():
        done = subprocess.run(
            command, check=False, cwd=REPOSITORY, stdin=subprocess.DEVNULL, capture_output=True, text=True
        )
    if not (record / "summary.json").is_file():
        sys.exit(f"the drive did not begin: {done.stderr.strip()}")
    table = read_table(record, "latency")
    t0 = json.loads((record / "processes.json").read_text(encoding="utf-8"))["t0_monotonic_s"]
    epoch = json.loads((record / "scenario.json").read_text(encoding="utf-8"))["epoch_gnss_s"]
    summary = json.loads((record / "summary.json").read_text(encoding="utf-8"))
    return Driven(table, summary, receivers.latencies(table, t0, epoch) if case.outputs else {})


def main() -> None:
    """Alternate the cases; print a table of legs, the datagrams' latencies and the ratios."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=30.0, help="of each drive, after go (default: 30)")
    parser.add_argument("--rounds", type=int, default=2, help="of each case (default: 2)")
    parser.add_argument("--smoke", action="store_true", help="drive for 2 s, once each, without traffic")
    arguments = parser.parse_args()
    cases, seconds, rounds = CASES, arguments.seconds, arguments.rounds
    if arguments.smoke:
        cases, seconds, rounds = SMOKE, 2.0, 1
    driven: dict[Case, list[Driven]] = {case: [] for case in cases}
    with tempfile.TemporaryDirectory() as scratch:
        for number in range(rounds):
            for case in cases:
                one = drive(Path(scratch), case, seconds, number)
                driven[case].append(one)
                load = one.summary.get("step_time", {})
                print(
                    f"{case}: {one.summary['outcome']} ({'+'.join(one.summary['reasons'])}), {one.table.num_rows} "
                    f"ticks, removed {load.get('removed')}, refused {load.get('refused')}, step at most "
                    f"{1000.0 * load.get('longest_s', 0.0):.1f} ms"
                )
    show({case: latency_summary(pa.concat_tables([one.table for one in parts])) for case, parts in driven.items()})
    show_wires({case: parts for case, parts in driven.items() if case.outputs})


def show(figures: dict[Case, dict[str, Any]]) -> None:
    """Print every leg's median, 99th percentile and greatest [ms], and each case over the first."""
    print(f"\n{'leg [ms]':<12}" + "".join(f"{case!s:>22}: p50    p99    max" for case in figures))
    for leg in (*LEGS, TOTAL):
        cells = (figure["legs_ms"][leg] for figure in figures.values())
        print(f"{leg:<12}" + "".join(f"{c['p50']:>28.3f}{c['p99']:>7.2f}{c['max']:>7.1f}" for c in cells))
    (none, first), *others = figures.items()
    for case, figure in others:
        for name in ("p50", "p99"):
            ratio = figure["legs_ms"][TOTAL][name] / first["legs_ms"][TOTAL][name]
            print(f"{case} over {none}, {name} of the total: {ratio:.2f}")
    for case, figure in figures.items():
        print(f"{case}: {figure['missed']} ticks missed, {figure['woken_by_deadline']} without their fix")


def show_wires(driven: dict[Case, list[Driven]]) -> None:
    """Print how long after its fix each wire's datagram came [ms]."""
    for case, parts in driven.items():
        for kind in WIRES:
            late = np.concatenate([one.late[kind] for one in parts])
            middle, most = np.percentile(late, (50, 99)) if len(late) else (math.nan, math.nan)
            print(f"{case}, fix to {kind}: median {middle:.3f} ms, p99 {most:.2f} ms, {len(late)} datagrams")


if __name__ == "__main__":
    main()
