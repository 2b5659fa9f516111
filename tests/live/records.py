"""Live drives for tests: what of the command drives, in processes of its own, on the shipped rig with faults put on."""

from __future__ import annotations

import contextlib
import json
import math
import os
import signal
import socket
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

from tests.conftest import REPOSITORY
from tests.live.stage import DRIVES
from vve_sumo.errors import ConfigError
from vve_sumo.record.reader import read_table

#: what becomes of the shipped scenario, so that a drive takes seconds: slow, and the parked car is near
SHORTER = {
    "speed_mps = 11.176": "speed_mps = 5.0",
    "at_m = 639.0": "at_m = 34.0",
    "after_stop_s = 3.0": "after_stop_s = 1.0",
}
#: for a drive to come to its end [s], on a machine that does other things as well
PATIENCE = 150.0


@dataclass
class Drive:
    """A live drive that goes on."""

    folder: Path  #: its record
    console: subprocess.Popen[bytes]
    t0: float = math.nan  #: monotonic second of drive time 0

    @property
    def processes(self) -> dict[str, int]:
        """Who is who."""
        reported = json.loads((self.folder / "processes.json").read_text(encoding="utf-8"))
        self.t0 = reported.pop("t0_monotonic_s")
        return {name: int(number) for name, number in reported.items()}

    def moves(self, speed: float = 2.0) -> bool:
        """Wait until the record says that the car drives [m/s]; whether it came to that."""
        deadline = time.monotonic() + PATIENCE
        while not self._speed() > speed:
            if self.console.poll() is not None or time.monotonic() > deadline:
                return False
            time.sleep(0.05)
        return True

    def _speed(self) -> float:
        try:
            speeds = read_table(self.folder, "gateway")["wheel_speed_mps"].to_pylist()
        except ConfigError:
            return 0.0
        return speeds[-1] if speeds else 0.0

    def kill(self, *names: str) -> float:
        """Kill processes at once, "console" being the command itself; the monotonic second at which it happened."""
        numbers = self.processes | {"console": self.console.pid}
        now = time.monotonic()
        for name in names:
            os.kill(numbers[name], signal.SIGKILL)
        return now

    def clear(self) -> None:
        """Leave nothing running."""
        if self.console.poll() is None:
            self.console.kill()
            self.console.wait()
        with contextlib.suppress(FileNotFoundError):
            for number in filter(_is_ours, self.processes.values()):
                os.kill(number, signal.SIGKILL)


def _is_ours(number: int) -> bool:
    """Whether a process of a live drive still has this number."""
    try:
        return b"vve_sumo.live." in Path(f"/proc/{number}/cmdline").read_bytes()
    except OSError:
        return False


def begin(folder: Path, *faults: str) -> Drive:
    """Start a short live drive in a new folder; each fault is what stands in a [[faults]] table."""
    folder.mkdir()
    scenario = (REPOSITORY / "scenarios" / "parked_car.toml").read_text(encoding="utf-8")
    for old, new in SHORTER.items():
        assert old in scenario
        scenario = scenario.replace(old, new)
    rig = (REPOSITORY / "rigs" / "simulated.toml").read_text(encoding="utf-8")
    assert "port = 3000" in rig
    rig = rig.replace("port = 3000", f"port = {_free_port()}")
    rig += "".join(f"\n[[faults]]\n{fault}\n" for fault in faults)
    (folder / "short.toml").write_text(scenario, encoding="utf-8")
    (folder / "rig.toml").write_text(rig, encoding="utf-8")
    with (folder / "said.txt").open("wb") as said:
        console = subprocess.Popen(
            [sys.executable, *DRIVES, "short.toml", "--rig", "rig.toml", "--out", "record"],
            cwd=folder,
            env=os.environ | {"PYTHONPATH": str(REPOSITORY)},
            stdin=subprocess.DEVNULL,
            stdout=said,
            stderr=said,
        )
    return Drive(folder / "record", console)


def _free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one:
        one.bind(("127.0.0.1", 0))
        return int(one.getsockname()[1])
