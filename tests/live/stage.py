"""Runs a row of the fault matrix: a live drive with all its processes, one fault under way, and what is left of it.

It judges nothing. Times are monotonic seconds outside of the record and drive times inside.
"""

from __future__ import annotations

import contextlib
import csv
import functools
import json
import math
import os
import pty
import resource
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tests.conftest import REPOSITORY
from tests.live.matrix import AT, SPEED, Right, Row
from tests.live.patience import until
from tests.live.spoilt import MOMENT
from tests.live.witness import stalls, witness
from vve_sumo.plant.injected_faults import START_SPEED
from vve_sumo.record.reader import read_table

#: a drive that was ridden through goes on for so long after its last fault, then the operator stops it [s]
GOES_ON = 3.0
#: from rest to the gateway's letting go [s]
PARKING = 2.0
#: for all processes to end, a frozen drive's among them [s]
PATIENCE = 60.0
#: where the pole of a row stands: ahead and to the right of the car at its start [m]
POLE = ((26.0, 3.5), (26.0, 6.0), (40.0, 6.0), (40.0, 3.5))
START, HEADING = (40.0041, -83.0186), math.radians(85.0)

SCENARIO = """
title = "A short drive"
seed = 1
duration_s = 60.0

[road]
network = "linden"
warm_up_s = 0.0

[ego]
path = "linden_17th"
speed_mps = 5.0

[ego.lot]
latitude_deg = 40.0041
longitude_deg = -83.0186
heading_deg = 85.0
"""

#: the whole command, and what of it drives: pictures and tables after the drive take as long as the drive
COMMAND = ["-m", "vve_sumo.cli", "drive"]
DRIVES = [
    "-c",
    """
import sys
from pathlib import Path
from vve_sumo.cli.live_drive import drive
from vve_sumo.live.session import plan
scenario, _, rig, _, out, *controller = sys.argv[1:]
drive(plan(scenario, rig, Path.cwd(), out=Path(out), seed=None, controller=(None, *controller)[-1], shadow=False))
""",
]
#: before one of them: standard input becomes the terminal of this session, whose closing is then heard
TERMINAL = [
    "-c",
    """
import fcntl, os, sys, termios
fcntl.ioctl(0, termios.TIOCSCTTY, 0)
os.execv(sys.executable, [sys.executable, *sys.argv[1:]])
""",
]


@dataclass(frozen=True)
class Evidence:
    """What is left of a drive."""

    folder: Path  #: of the record
    t0: float  #: monotonic second of drive time 0
    moment: float  #: drive time of the fault [s]; NaN where the car never came to it
    said: str  #: by the console and in the logs
    alive: tuple[str, ...]  #: processes that did not end
    stalls: tuple[tuple[float, float], ...]  #: of the machine while the car was commanded, drive time [s]

    @functools.cached_property
    def truth(self) -> dict[str, Any]:
        """Columns of truth.csv; all but the gear are arrays of numbers."""
        return read_truth(self.folder)

    @functools.cached_property
    def gateway(self) -> list[dict[str, Any]]:
        """The gateway's steps."""
        return rows(self.folder, "gateway")

    @functools.cached_property
    def ticks(self) -> list[dict[str, Any]]:
        """The drive's ticks."""
        return rows(self.folder, "ticks")

    @functools.cached_property
    def summary(self) -> dict[str, Any]:
        """What summary.json says; nothing where there is none."""
        file = self.folder / "summary.json"
        return dict(json.loads(file.read_text(encoding="utf-8"))) if file.exists() else {}


def rows(folder: Path, table: str) -> list[dict[str, Any]]:
    """Return the rows of a table, finished or cut off."""
    return list(read_table(folder, table).to_pylist())


def read_truth(folder: Path) -> dict[str, Any]:
    """Return the columns of truth.csv, as far as its lines are whole."""
    text = (folder / "truth.csv").read_text()
    lines = list(csv.DictReader(text[: text.rfind("\n") + 1].splitlines()))
    return {
        name: [line[name] for line in lines] if name == "gear" else np.array([float(line[name]) for line in lines])
        for name in lines[0]
    }


class Stage:
    """One run of a row."""

    def __init__(self, row: Row, folder: Path) -> None:
        folder.mkdir(parents=True)
        self.row, self.folder, self.record = row, folder, folder / "record"
        self._moment = folder / "moment"
        (folder / "short.toml").write_text(SCENARIO)
        (folder / "rig.toml").write_text(rig_of(row, free_port()))
        self._said = folder / "said.txt"
        self._truth = b""
        self._read = 0
        self._master = -1
        self.pids: dict[str, int] = {}
        self.t0 = math.nan

    def run(self) -> Evidence:
        """Drive, break, wait for the end."""
        file = self.folder / "witness.txt"
        with witness(file), self._console() as console:
            moment = self._break(console) if self._under_way(console) else math.nan
            if self.row.right is Right.RIDDEN:
                last = moment + max((fault.later for fault in self.row.faults), default=0.0) + GOES_ON
                time.sleep(max(last - time.monotonic(), 0.0) if moment == moment else 0.0)
                console.send_signal(signal.SIGINT)
            alive = self._wait_for_the_end(console)
        logs = [self._said, self.record / "traceback.txt", *(self.record / f"{name}.log" for name in self.pids)]
        said = "".join(log.read_text(errors="replace") for log in logs if log.exists())
        begin, end = self._span()
        stood = tuple((a - self.t0, b - self.t0) for a, b in stalls(file, begin, end))
        return Evidence(self.record, self.t0, moment - self.t0, said, alive, stood)

    @contextlib.contextmanager
    def _console(self) -> Iterator[subprocess.Popen[bytes]]:
        row = self.row
        whole = row.stage == "hangup" or (row.signal is not None and row.signal.process == "console")
        controller = ["--controller", f"{REPOSITORY}/tests/live/spoilt.py:{row.controller}"] if row.controller else []
        names = [str(self.folder / "short.toml"), "--rig", str(self.folder / "rig.toml"), "--out", str(self.record)]
        paths = [str(REPOSITORY)] + [str(REPOSITORY / "tests" / "live" / "stalled")] * (row.stage == "stalled")
        terminal, slave = pty.openpty() if row.stage == "hangup" else (-1, -1)
        self._master = terminal
        with self._said.open("wb") as said:
            process = subprocess.Popen(
                [
                    sys.executable,
                    *(TERMINAL if slave >= 0 else []),
                    *(COMMAND if whole else DRIVES),
                    *names,
                    *controller,
                ],
                cwd=REPOSITORY,
                env={**os.environ, "PYTHONPATH": os.pathsep.join(paths), MOMENT: str(self._moment)},
                stdin=slave if slave >= 0 else subprocess.DEVNULL,
                stdout=slave if slave >= 0 else said,
                stderr=slave if slave >= 0 else said,
                start_new_session=True,
            )
        if slave >= 0:
            os.close(slave)
        self.pids["console"] = process.pid
        try:
            yield process
        finally:
            for pid in self.pids.values():
                if running(pid):
                    os.kill(pid, signal.SIGKILL)
            process.wait()

    # The fault.

    def _under_way(self, console: subprocess.Popen[bytes]) -> bool:
        """Wait until the car moves, where a fault is injected, or is fast enough; whether it came to that."""
        return self.moving(console, START_SPEED if self.row.faults else SPEED)

    def moving(self, console: subprocess.Popen[bytes], least: float) -> bool:
        """Wait until the car is as fast as `least` [m/s]; whether it came to that."""
        while self._speed() < least:
            if console.poll() is not None:
                return False
            if math.isnan(self.t0) and (file := self.record / "processes.json").exists():
                with contextlib.suppress(ValueError):  # half written
                    numbers = json.loads(file.read_text())
                    self.t0 = numbers.pop("t0_monotonic_s")
                    self.pids |= numbers
            self._drain()
            time.sleep(0.005)
        return True

    def _speed(self) -> float:
        """Return the car's newest true speed."""
        file = self.record / "truth.csv"
        if not file.exists():
            return 0.0
        with file.open("rb") as truth:
            truth.seek(self._read)
            data = self._truth + truth.read()
            self._read = truth.tell()
        *lines, self._truth = data.split(b"\n")
        speeds = [float(line.split(b",")[4]) for line in lines if line[:1].isdigit()]
        return speeds[-1] if speeds else 0.0

    def _break(self, console: subprocess.Popen[bytes]) -> float:
        """Bring the fault about, or wait until it has come; return its moment."""
        row, act = self.row, self._acts().get(self.row.stage)
        if row.faults:
            truth = read_truth(self.record)
            moved = float(truth["time_s"][np.flatnonzero(np.abs(truth["speed_mps"]) > START_SPEED)[0]])
            moment = self.t0 + moved + AT + min(row.faults[0].later, 0.0)
            time.sleep(max(moment - time.monotonic(), 0.0))
            return max(moment, self._spoilt(console)) if row.controller else moment
        if row.signal is not None:
            return self._send(row.signal.process)
        if act is not None:
            moment = time.monotonic()
            act()
            return moment
        return self._spoilt(console)

    def _spoilt(self, console: subprocess.Popen[bytes]) -> float:
        """Wait until the controller goes wrong; return when it did."""
        until(lambda: console.poll() is not None or bool(self._moment.exists() and self._moment.read_text()))
        return float(self._moment.read_text()) if self._moment.exists() else math.nan

    def _acts(self) -> dict[str, Callable[[], None]]:
        return {"full": self._fill, "hangup": lambda: os.close(self._master)}

    def _fill(self) -> None:
        """Let no file of the recorder's grow beyond what it is now."""
        resource.prlimit(self.pids["recorder"], resource.RLIMIT_FSIZE, (1, resource.RLIM_INFINITY))

    def _send(self, process: str) -> float:
        wanted = self.row.signal
        assert wanted is not None
        moment = time.monotonic()
        for _ in range(wanted.times):
            with contextlib.suppress(ProcessLookupError):
                os.kill(self.pids[process], wanted.number)
            time.sleep(0.01 if wanted.times > 1 else 0.0)
        if wanted.continued is not None:
            time.sleep(wanted.continued)
            os.kill(self.pids[process], signal.SIGCONT)
        return moment

    # The end.

    def _wait_for_the_end(self, console: subprocess.Popen[bytes]) -> tuple[str, ...]:
        """Wait until every process has ended; names of those that haven't."""
        deadline = time.monotonic() + PATIENCE
        while (left := [name for name, pid in self.pids.items() if running(pid)]) and time.monotonic() < deadline:
            console.poll()
            self._drain()
            time.sleep(0.02)
        return tuple(left)

    def _drain(self) -> None:
        """Read what stands on the terminal, as a terminal does."""
        if self.row.stage == "hangup":
            with contextlib.suppress(OSError):
                os.set_blocking(self._master, False)
                with self._said.open("ab") as said:
                    said.write(os.read(self._master, 65536))

    def _span(self) -> tuple[float, float]:
        """Return when the car was engaged and when it had been let go."""
        truth = read_truth(self.record)
        moving = truth["time_s"][np.flatnonzero(truth["speed_mps"] != 0.0)]
        first, last = (float(moving[0]), float(moving[-1])) if len(moving) else (0.0, math.inf)
        return self.t0 + first - 1.0, self.t0 + last + PARKING


def running(pid: int) -> bool:
    """Whether a process is there and is no zombie."""
    try:
        state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[:1]
    except OSError:
        return False
    return state not in ([], ["Z"])


def free_port() -> int:
    """Return a UDP port of the loopback that nobody uses now."""
    return free_ports(1)[0]


def free_ports(count: int) -> list[int]:
    """Return so many UDP ports of the loopback that nobody uses now."""
    with contextlib.ExitStack() as stack:
        probes = [stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) for _ in range(count)]
        for probe in probes:
            probe.bind(("127.0.0.1", 0))
        return [int(probe.getsockname()[1]) for probe in probes]


def rig_of(row: Row, port: int) -> str:
    """Return the shipped rig `simulated` as this row needs it."""
    text = (REPOSITORY / "rigs" / "simulated.toml").read_text(encoding="utf-8")
    changes = {"port = 3000": f"port = {port}", "budget_ms = 40.0": f"budget_ms = {row.budget_ms}"}
    if any(fault.kind == "pose_forged" for fault in row.faults):
        # Forged fixes in the gaps of one that comes in bursts are the only ones there are: they stop the car.
        changes["[car_start] "] = '[car_start]\nfidelity = "ideal"\n'
    if row.pole:
        changes["holes = ["] = f"holes = [\n  {pole()},"
    for old, new in changes.items():
        assert text.count(old) == 1
        text = text.replace(old, new)
    for fault in row.faults:
        text += f'\n[[faults]]\nkind = "{fault.kind}"\nat_s = {AT + fault.later}\nfor_s = {fault.duration}\n'
        if fault.flapping is not None:
            text += f'shape = "flapping"\nperiod_s = {fault.flapping}\n'
        text += "" if fault.value is None else f"value = {fault.value}\n"
    return text


def pole() -> list[list[float]]:
    """Return the corners of the pole, latitude and longitude [deg]."""
    metre = 1.0 / 111_200.0  # in degrees of latitude, good to a thousandth
    corners = []
    for ahead, right in POLE:
        north = ahead * math.cos(HEADING) - right * math.sin(HEADING)
        east = ahead * math.sin(HEADING) + right * math.cos(HEADING)
        latitude = START[0] + north * metre
        corners.append([latitude, START[1] + east * metre / math.cos(math.radians(latitude))])
    return corners
