"""A live drive of two real cars on one street, with all its processes, in which one part of it is killed under way.

It judges by what the two simulated vehicles really did, each by its own record of its true motion.
"""

from __future__ import annotations

import contextlib
import json
import math
import os
import signal
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from tests.conftest import REPOSITORY
from tests.live.kills import most
from tests.live.matrix import EXPIRY, FIX, GATEWAY, STEP, WATCHDOG, Layer, Right, Row
from tests.live.stage import PATIENCE, free_ports, read_truth, rows, running
from tests.live.witness import stalls, witness
from vve_sumo.live.car import GATEWAY_SILENCE
from vve_sumo.plant.injected_faults import START_SPEED
from vve_sumo.timing import PERIOD

#: ids of the two egos
CARS: Final = ("ego", "second")
#: of both cars when a part is killed [m/s]; they drive at 5 m/s
SPEED: Final = 2.5
#: from the moment at which a car first moves to the loss of its fixes [s]
LOST_AT: Final = 2.0
#: from one car's stop to the other car's gateway: the stopped one's gateway tells the drive, whose next tick tells the
#: other gateway; a gateway that is killed closes its channel, one that is frozen is silent for so long first
TOLD: Final = GATEWAY_SILENCE + 2.0 * PERIOD + 2.0 * STEP
#: how far the second car stands ahead of the first [m]
AHEAD: Final = 60.0
#: of these parts one is killed, or is lost
PARTS: Final = ("gateway", "gateway:second", "drive", "receiver", "receiver:second")

SCENARIO: Final = """
title = "Two cars on one street"
seed = 1
duration_s = 60.0

[road]
network = "test_track"
warm_up_s = 0.0

[ego]
path = "test_track"
speed_mps = 5.0

[ego.lot]
latitude_deg = 40.0041
longitude_deg = -83.0186
heading_deg = 85.0

[[egos]]
id = "second"
path = "ahead.csv"
"""
DRIVES: Final = """
import sys
from pathlib import Path
from vve_sumo.cli.live_drive import drive
from vve_sumo.live.session import plan
further = {"second": "second.toml"} if sys.argv[1] == "two" else {}
drive(
    plan(
        "two.toml", "ego.toml", Path.cwd(), out=Path("record"), seed=None, controller=None, shadow=False,
        further=further,
    )
)
"""


@dataclass(frozen=True)
class Stop:
    """What is right to happen to one car."""

    layer: Layer  #: that stops it
    notice: float  #: from the loss to that layer's knowing of it, at most [s]
    codes: frozenset[str]  #: one of these stands in the gateway's reasons; empty for a gateway that is dead


def right(part: str) -> dict[str, Stop]:
    """Return what is right to happen to each car where this part is lost."""
    if part == "drive":
        return dict.fromkeys(CARS, Stop(GATEWAY, EXPIRY, frozenset({"drive_gone"})))
    kind, _, car = part.partition(":")
    own = car or "ego"
    other = CARS[1 - CARS.index(own)]
    if kind == "gateway":
        return {own: Stop(WATCHDOG, 0.0, frozenset()), other: Stop(GATEWAY, TOLD, frozenset({"other_car_gone"}))}
    told = Stop(GATEWAY, FIX + TOLD, frozenset({"other_car_stopped"}))
    return {own: Stop(GATEWAY, FIX, frozenset({"pose_stale"})), other: told}


@dataclass(frozen=True)
class Outcome:
    """What is left of a drive."""

    record: Path
    part: str
    moment: float  #: drive time of the loss [s]; NaN where it never came to it
    alive: tuple[str, ...]  #: processes that did not end
    stood: tuple[tuple[float, float], ...]  #: when the machine itself stood still, drive time [s]
    said: str

    def folder(self, car: str) -> Path:
        """Return the folder of a car's record."""
        return self.record if car == "ego" else self.record / "egos" / car

    def way(self, car: str) -> tuple[float, float]:
        """Return how far a car really drove after the loss, and how far it may have [m]."""
        truth, stop = read_truth(self.folder(car)), right(self.part)[car]
        times, speeds = truth["time_s"], truth["speed_mps"]
        after = times >= self.moment
        way = float(np.hypot(np.diff(truth["x_m"][after]), np.diff(truth["y_m"][after])).sum())
        here, before = (float(np.interp(at, times, speeds)) for at in (self.moment, self.moment - 0.1))
        row = Row("", "", Right.REST, stops=stop.layer, notice=stop.notice)
        return way, most(row, here, (here - before) / 0.1)

    def wrong(self) -> str:
        """Return what was not right; empty for nothing."""
        if math.isnan(self.moment):
            return f"it never came to the loss: {self.said[-1500:]}"
        if self.alive:
            return f"{', '.join(self.alive)} did not end"
        return "; ".join(line for car in CARS for line in self._wrong_with(car))

    def _wrong_with(self, car: str) -> list[str]:
        stop, lines = right(self.part)[car], []
        truth = read_truth(self.folder(car))
        if truth["speed_mps"][-1] != 0.0:
            lines.append(f"{car} moves with {truth['speed_mps'][-1]:.2f} m/s at the end")
        way, bound = self.way(car)
        if not way <= bound:
            lines.append(f"{car} drove {way:.2f} m, bound {bound:.2f} m")
        steps = rows(self.folder(car), "gateway")
        states = [step["state"] for step in steps]
        before = [step["state"] for step in steps if step["time_s"] <= self.moment]
        if before[-1:] != ["engaged"]:
            lines.append(f"{car} was {before[-1:]} when the part was lost")
        left = next((place for place, state in enumerate(states) if state == "stopping"), len(states))
        if "engaged" in states[left:]:
            lines.append(f"{car} was engaged again")
        heard = {code for step in steps for code in step["reasons"].split("+")}
        if stop.codes and stop.codes.isdisjoint(heard):
            lines.append(f"{car} was not told: {sorted(heard)}")
        return lines


class TwoCars:
    """One drive of two real cars, or, not `both`, of a real one and a simulated ego."""

    def __init__(
        self,
        part: str,
        folder: Path,
        *,
        both: bool = True,
        duration: float = 60.0,
        ahead: float = AHEAD,
        goes_on: bool = False,
    ) -> None:
        """Write scenario and rigs into `folder`, which is made; without a `part` the drive ends after its duration.

        The second car stands `ahead` of the first [m]. With `goes_on` a car goes on where the other one is lost.
        """
        folder.mkdir(parents=True)
        self.part, self.folder, self.record = part, folder, folder / "record"
        self._both = both
        (folder / "two.toml").write_text(SCENARIO.replace("duration_s = 60.0", f"duration_s = {duration}"))
        (folder / "ahead.csv").write_text(path_ahead(ahead))
        for car, port in zip(CARS, free_ports(2), strict=True):
            text = rig(port, lost=part == named("receiver", car))
            if goes_on:
                text = text.replace("automatic = true", 'automatic = true\nwhen_another_car_stops = "go_on"')
            (folder / f"{car}.toml").write_text(text)
        self.pids: dict[str, int] = {}
        self.t0 = math.nan

    def run(self) -> Outcome:
        """Drive, lose the part, wait for the end."""
        file, said = self.folder / "witness.txt", self.folder / "said.txt"
        with witness(file), said.open("wb") as out:
            console = subprocess.Popen(
                [sys.executable, "-c", DRIVES, "two" if self._both else "one"],
                cwd=self.folder,
                env=os.environ | {"PYTHONPATH": str(REPOSITORY)},
                stdin=subprocess.DEVNULL,
                stdout=out,
                stderr=out,
                start_new_session=True,
            )
            self.pids["console"] = console.pid
            try:
                moment = self._lose() if self._moving(console) else math.nan
                alive = self._wait_for_the_end(console)
            finally:
                for pid in self.pids.values():
                    if running(pid):
                        os.kill(pid, signal.SIGKILL)
                console.wait()
        begun = self.t0 + self._first_motion() - 1.0 if self.t0 == self.t0 else 0.0
        stood = tuple((a - self.t0, b - self.t0) for a, b in stalls(file, begun, math.inf))
        return Outcome(self.record, self.part, moment - self.t0, alive, stood, said.read_text(errors="replace"))

    def _moving(self, console: subprocess.Popen[bytes]) -> bool:
        """Wait until both cars are as fast as SPEED; whether it came to that."""
        while not all(self._speed(car) >= SPEED for car in CARS[: 1 + self._both]):
            if console.poll() is not None:
                return False
            if math.isnan(self.t0) and (file := self.record / "processes.json").exists():
                with contextlib.suppress(ValueError):  # half written
                    numbers = json.loads(file.read_text())
                    self.t0 = numbers.pop("t0_monotonic_s")
                    self.pids |= {name: int(number) for name, number in numbers.items()}
            time.sleep(0.02)
        return True

    def _speed(self, car: str) -> float:
        """Return a car's newest true speed [m/s]."""
        try:
            lines = (self._folder(car) / "truth.csv").read_bytes()[-400:].split(b"\n")
            return float(lines[-2].split(b",")[4])
        except (OSError, IndexError, ValueError):
            return 0.0

    def _folder(self, car: str) -> Path:
        return self.record if car == "ego" else self.record / "egos" / car

    def _lose(self) -> float:
        """Bring the loss about, or wait until it has come; return its moment."""
        if self.part.startswith("receiver"):
            car = self.part.partition(":")[2] or "ego"
            moment = self.t0 + self._first_motion(car) + LOST_AT
            time.sleep(max(moment - time.monotonic(), 0.0))
            return moment
        moment = time.monotonic()
        if self.part:
            os.kill(self.pids[self.part], signal.SIGKILL)
        return moment

    def _first_motion(self, car: str = "ego") -> float:
        truth = read_truth(self._folder(car))
        moving = np.flatnonzero(np.abs(truth["speed_mps"]) > START_SPEED)
        return float(truth["time_s"][moving[0]]) if len(moving) else 0.0

    def _wait_for_the_end(self, console: subprocess.Popen[bytes]) -> tuple[str, ...]:
        """Wait until every process has ended; names of those that haven't."""
        deadline = time.monotonic() + PATIENCE
        while (left := [name for name, pid in self.pids.items() if running(pid)]) and time.monotonic() < deadline:
            console.poll()
            time.sleep(0.02)
        return tuple(left)


def named(part: str, car: str) -> str:
    """Return the name of a part of a car, as processes.json has it."""
    return part if car == "ego" else f"{part}:{car}"


def path_ahead(ahead: float) -> str:
    """Return the path along the test track, begun so far ahead of its start [m]."""
    lines = (REPOSITORY / "routes" / "test_track.csv").read_text(encoding="utf-8").splitlines()
    first = next(place for place, line in enumerate(lines) if line[:1].isdigit())
    points = [tuple(map(float, line.split(","))) for line in lines[first:]]
    metres_per_degree = 111_320.0 * math.cos(math.radians(40.0))
    rest = [point for point in points if (point[1] - points[0][1]) * metres_per_degree >= ahead]
    return "\n".join([*lines[:first], *(f"{latitude:.10f},{longitude:.10f}" for latitude, longitude in rest)]) + "\n"


def rig(port: int, *, lost: bool) -> str:
    """Return the shipped rig `simulated` in a lot of some kilometres, with a receiver that is lost under way or not."""
    text = (REPOSITORY / "rigs" / "simulated.toml").read_text(encoding="utf-8")
    begin, end = text.index("outline = ["), text.index("[alignment]")
    wide = "outline = [[39.99, -83.04], [39.99, -82.99], [40.02, -82.99], [40.02, -83.04]]\n\n"
    text = (text[:begin] + wide + text[end:]).replace("port = 3000", f"port = {port}")
    return text + (f'\n[[faults]]\nkind = "pose_lost"\nat_s = {LOST_AT}\nfor_s = 60.0\n' if lost else "")
