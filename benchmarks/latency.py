"""How late a command and the outgoing wires are, live: from the kernel's stamp of a fix.

python benchmarks/latency.py [--seconds S] [--rounds N] [--ros2] [--smoke]
The whole live stack with the simulated vehicle (UDP loopback, slcan on a pty). Twenty boxes stand in the radar's range;
the network holds 500 vehicles besides, or none; the rig has no outputs, or GNSS (NCOM) and radar datagrams over UDP;
the car has its radar, or a lidar and a camera's list of objects besides.
Drives of all kinds alternate, so that a noisy machine disturbs them alike; the figures are of all ticks of all rounds.
A command's latency, to the return of the last command frame's send, is from the drives' own latency tables; that of a
datagram is from the fix's stamp there to the kernel's stamp of the datagram at its receiver. `--ros2` compares three
kinds alone: no outputs, outputs that nobody shows, and the ROS 2 bridge beside the drive with a subscriber of its
`/odom`, by Cyclone DDS in this process; a message's latency is to when that process has read it. `--smoke` drives for
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
import time
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
from vve_sumo.pose.nmea_encoder import LEAP_SECONDS  # noqa: E402
from vve_sumo.pose.sources import Source, open_udp  # noqa: E402
from vve_sumo.record.latencies import LEGS, TOTAL, latency_summary  # noqa: E402
from vve_sumo.record.reader import read_table  # noqa: E402
from vve_sumo.wire.datagrams import decode_radar  # noqa: E402
from vve_sumo.wire.ros2.messages import GNSS_EPOCH  # noqa: E402

BOXES = 20


class Case(NamedTuple):
    """One kind of drive."""

    vehicles: int
    outputs: bool = False
    senses: bool = False
    ros2: bool = False

    def __str__(self) -> str:
        besides = ", outputs" * self.outputs + ", lidar and camera" * self.senses + ", ROS 2 bridge" * self.ros2
        return f"{self.vehicles} vehicles{besides}"


CASES = (Case(0), Case(0, outputs=True), Case(500), Case(0, senses=True))
SMOKE = (Case(0), Case(0, outputs=True))
WITH_BRIDGE = (Case(0), Case(0, outputs=True), Case(0, ros2=True))
WIRES = ("ncom", "radar")
BRIDGE_WIRES = ("ncom", "scene", "radar")
DOMAIN = 97  # of the bridge and its subscriber


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
    return f"latency_{case.vehicles}_{int(case.outputs)}_{int(case.senses)}_{int(case.ros2)}"


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
    table["ros2"] = {"domain_id": DOMAIN}
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

    def dated(self) -> dict[str, list[tuple[float, float]]]:
        """Return by wire the arrival of each valid datagram, and the GNSS time of the tick that made it."""
        return {kind: list(_dated(kind, datagrams)) for kind, datagrams in self.heard.items()}


class Subscriber:
    """Hears a topic of the bridge that it starts; arrivals are the times at which a message has been read."""

    def __init__(self, scenario: Path, rig: Path) -> None:
        from vve_sumo.bridges.ros2.dds import Dds

        command = [sys.executable, "-m", "vve_sumo.cli", "ros2", str(scenario), "--rig", str(rig)]
        self._bridge = subprocess.Popen(command, cwd=REPOSITORY, stderr=subprocess.PIPE, text=True)
        assert self._bridge.stderr is not None
        self._bridge.stderr.readline()  # it listens
        self._dds = Dds(DOMAIN)
        self._dds.subscribe("/odom", "nav_msgs/msg/Odometry")
        self._heard: list[tuple[float, float]] = []
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._hear)

    def _hear(self) -> None:
        while not self._over.is_set():
            select.select([self._dds], [], [], 0.05)
            for heard in self._dds.receive():
                stamp = heard.message.header.stamp
                unix = stamp.sec + 1e-9 * stamp.nanosec
                self._heard.append((time.monotonic(), unix - GNSS_EPOCH + LEAP_SECONDS))

    @contextlib.contextmanager
    def listening(self) -> Iterator[None]:
        """Listen while the block runs."""
        self._thread.start()
        try:
            yield
        finally:
            self._over.set()
            self._thread.join()
            self._dds.close()
            self._bridge.terminate()
            print(self._bridge.communicate()[1].strip())

    def dated(self) -> dict[str, list[tuple[float, float]]]:
        """Return by topic the arrival of each message, and the GNSS time of its tick."""
        return {"/odom": self._heard}


def latencies(heard: dict[str, list[tuple[float, float]]], table: pa.Table, t0: float, epoch: float) -> dict[str, Any]:
    """Return by wire how long after its tick's fix each message came [ms]; a tick without a fix has none."""
    due = np.array(table["due_s"])
    fixes = np.where(np.array(table["woken_by"]) == "datagram", np.array(table["received_s"]), math.nan)
    late = {}
    for kind, dated in heard.items():
        came = np.array([(stamp - t0, at - epoch) for stamp, at in dated]).reshape(-1, 2)
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
    road = scenario(folder, case, seconds)
    listener: Receivers | Subscriber
    if case.ros2:
        file = rig(folder, dict(zip(BRIDGE_WIRES, _free_ports(len(BRIDGE_WIRES)), strict=True)))
        listener = Subscriber(road, file)
    else:
        listener = receivers = Receivers()
        file = rig(folder, receivers.ports if case.outputs else {})
    command = [sys.executable, "-m", "vve_sumo.cli", "drive", str(road), "--rig", str(file), "--out", str(record)]
    with listener.listening():
        done = subprocess.run(
            command, check=False, cwd=REPOSITORY, stdin=subprocess.DEVNULL, capture_output=True, text=True
        )
    if not (record / "summary.json").is_file():
        sys.exit(f"the drive did not begin: {done.stderr.strip()}")
    table = read_table(record, "latency")
    t0 = json.loads((record / "processes.json").read_text(encoding="utf-8"))["t0_monotonic_s"]
    epoch = json.loads((record / "scenario.json").read_text(encoding="utf-8"))["epoch_gnss_s"]
    summary = json.loads((record / "summary.json").read_text(encoding="utf-8"))
    heard = listener.dated() if case.outputs or case.ros2 else {}
    return Driven(table, summary, latencies(heard, table, t0, epoch))


def _free_ports(count: int) -> list[int]:
    with contextlib.ExitStack() as open_:
        probes = [open_.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) for _ in range(count)]
        for probe in probes:
            probe.bind(("127.0.0.1", 0))
        return [int(probe.getsockname()[1]) for probe in probes]


def main() -> None:
    """Alternate the cases; print a table of legs, the datagrams' latencies and the ratios."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=30.0, help="of each drive, after go (default: 30)")
    parser.add_argument("--rounds", type=int, default=2, help="of each case (default: 2)")
    parser.add_argument("--ros2", action="store_true", help="the ROS 2 bridge alone: with it and without")
    parser.add_argument("--smoke", action="store_true", help="drive for 2 s, once each, without traffic")
    arguments = parser.parse_args()
    cases: tuple[Case, ...] = WITH_BRIDGE if arguments.ros2 else CASES
    seconds, rounds = arguments.seconds, arguments.rounds
    if arguments.smoke:
        cases, seconds, rounds = (cases if arguments.ros2 else SMOKE), 2.0, 1
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
    show_wires({case: parts for case, parts in driven.items() if case.outputs or case.ros2})


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
        for kind in parts[0].late:
            late = np.concatenate([one.late[kind] for one in parts])
            middle, most = np.percentile(late, (50, 99)) if len(late) else (math.nan, math.nan)
            print(f"{case}, fix to {kind}: median {middle:.3f} ms, p99 {most:.2f} ms, {len(late)} datagrams")


if __name__ == "__main__":
    main()
