"""Steering around a parked car live: the whole stack in real time with the simulated vehicle.

The scenario is `parked_car_passed` from 99 m before the parked car on, where the street is straight: the car starts
there from rest, somebody comes the other way, and the path ends 160 m behind the parked car. With `--fault` the drive's
process is killed in each drive while the car is out of its lane, at another place each time; then the gateway alone
brings it to rest.

All figures of the car are of its truth, which no process of the drive reads: `truth.csv`, placed on the virtual road by
the turn and shift that fit it to the recorded poses best. Latencies are those of ticks from the first command on.

Usage: python -m benchmarks.steering_live [--planner NAME] [--runs N] [--fault] [--smoke]
"""

from __future__ import annotations

import argparse
import json
import math
import os
import re
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
import tomlkit

REPOSITORY = Path(__file__).parent.parent
PLANNERS = ("elastic_band", "frenet_sampling")
#: of linden_17th the part that is driven [m]
BEGIN, END = 540.0, 800.0
BEYOND: Final = 125.0  #: of the part's start, well behind the parked car [m]
OUT: Final = 1.0  #: of the path, a car that is farther to the left is out of its lane [m]
PATIENCE: Final = 240.0  #: for a drive to end [s]
#: the command without the pictures that it draws afterwards
DRIVES: Final = """
import sys
from pathlib import Path
from vve_sumo.cli.live_drive import drive
from vve_sumo.live.session import plan
drive(plan("scenario.toml", "rig.toml", Path.cwd(), out=Path("record"), seed=None, controller=None, shadow=False))
"""


class Drive(NamedTuple):
    """What came of a live drive."""

    outcome: str
    reasons: str
    contact: bool
    passed: bool  #: it came to well behind the parked car
    waited: bool  #: it stood in between
    clearance: float  #: least distance of the bodies [m]
    aside: float  #: greatest distance from the path [m]
    last: float  #: distance from the path at the end [m]
    speed: float  #: at the end [m/s]
    missed: int  #: ticks that were skipped
    step_ms: tuple[float, float, float]  #: of the controller: median, 99 %, greatest
    tick_ms: tuple[float, float, float]  #: from a tick's wake-up to the last command frame
    fit: float  #: root mean square of what placing the truth on the road leaves [m]
    killed_at: float  #: lateral deviation when the drive was killed [m]; NaN for no fault


def write(folder: Path, planner: str, **changes: Any) -> None:
    """Write the scenario, its path and the rig into a folder; `changes` are of the scenario's tables."""
    cut = ["path", "cut", "linden_17th", "--from", f"{BEGIN:g}", "--to", f"{END:g}", "--out", str(folder / "part.csv")]
    subprocess.run([sys.executable, "-m", "vve_sumo.cli", *cut], cwd=REPOSITORY, check=True, stdout=subprocess.DEVNULL)
    table: Any = tomlkit.parse((REPOSITORY / "scenarios" / "parked_car_passed.toml").read_text(encoding="utf-8"))
    for key in ("parameters", "criteria", "end_trigger"):
        del table[key]
    ego, oncoming = table["ego"], table["actors"][0]
    ego["path"], ego["corridor"][0]["from_m"], ego["corridor"][0]["to_m"] = "part.csv", 40.0, 180.0
    table["obstacles"][0]["at_m"] -= BEGIN
    oncoming["at_m"] -= BEGIN
    oncoming["enters"]["ego_at_m"] -= BEGIN
    table["controller"]["name"] = planner
    table.update(changes)
    (folder / "scenario.toml").write_text(tomlkit.dumps(table), encoding="utf-8")
    (folder / "rig.toml").write_text(rig(), encoding="utf-8")


def rig() -> str:
    """Return the rig `simulated` on a port of its own, in a lot of some kilometres."""
    text = (REPOSITORY / "rigs" / "simulated.toml").read_text(encoding="utf-8")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one:
        one.bind(("127.0.0.1", 0))
        text = text.replace("port = 3000", f"port = {one.getsockname()[1]}")
    begin, end = text.index("outline = ["), text.index("[alignment]")
    return (
        text[:begin] + "outline = [[39.99, -83.04], [39.99, -82.99], [40.02, -82.99], [40.02, -83.04]]\n" + text[end:]
    )


def drive(folder: Path, kill: float = math.nan, behind: float = BEYOND) -> Drive:
    """Drive scenario.toml on rig.toml of a folder; kill the drive's process where the car is so far on [m] and out.

    A car that comes so far along its path as `behind` [m] has passed.
    """
    said = folder / "said.txt"
    with said.open("wb") as out:
        console = subprocess.Popen(
            [sys.executable, "-c", DRIVES], cwd=folder, env=os.environ | {"PYTHONPATH": str(REPOSITORY)},
            stdin=subprocess.DEVNULL, stdout=out, stderr=out,
        )  # fmt: skip
        try:
            killed = _killed(folder / "record", console, kill) if math.isfinite(kill) else math.nan
            console.wait(PATIENCE)
        finally:
            console.kill()
            console.wait()
    _wait_for_the_end(folder / "record")
    return judged(folder / "record", killed, behind)


def _killed(record: Path, console: subprocess.Popen[bytes], place: float) -> float:
    """Kill the drive's process at a place, and return how far beside its path the car was [m]; NaN if it never was."""
    deadline = time.monotonic() + PATIENCE
    while console.poll() is None and time.monotonic() < deadline:
        time.sleep(0.02)
        rows = _truth(record)
        if len(rows):
            x, y, heading = rows[-1, 1] - rows[0, 1], rows[-1, 2] - rows[0, 2], rows[0, 3]
            along, aside = x * math.cos(heading) + y * math.sin(heading), y * math.cos(heading) - x * math.sin(heading)
            if along > place and aside > OUT:
                os.kill(int(json.loads((record / "processes.json").read_text())["drive"]), signal.SIGKILL)
                return float(aside)
    return math.nan


def _wait_for_the_end(record: Path) -> None:
    """Wait until the car, which outlives a drive that was killed, has written its last."""
    deadline, size = time.monotonic() + 30.0, -1
    while time.monotonic() < deadline and size != (size := (record / "truth.csv").stat().st_size):
        time.sleep(1.0)


def _truth(record: Path) -> np.ndarray:
    """Return time [s], place [m], heading [rad] and speed [m/s] of the truth, as far as it is written; shape (n, 5)."""
    file = record / "truth.csv"
    lines = file.read_text().split("\n")[1:-1] if file.exists() else []
    return np.array([[float(part) for part in line.split(",", 5)[:5]] for line in lines]).reshape(-1, 5)


def judged(record: Path, killed: float, behind: float) -> Drive:
    """Return what came of a drive by its record."""
    from vve_sumo.drive.resolved_scenario import resolve_scenario
    from vve_sumo.geometry import Boxes, distance, vehicle_boxes
    from vve_sumo.record.reader import read_table
    from vve_sumo.scenario.load import load

    file = record.parent / "scenario.toml"
    scenario = resolve_scenario("scenario", load(file), file, record.parent)
    truth, ticks = _truth(record), read_table(record, "ticks").to_pandas()
    place, fit = _placed(truth, ticks)
    moving = np.flatnonzero(truth[:, 4] > 1.0)
    first = truth[moving[0], 0] if len(moving) else math.inf
    under_way = ticks[ticks["time_s"] >= first]
    least, bodies, at = math.inf, None, -math.inf
    snapshots = dict(list(read_table(record, "actors").to_pandas().groupby("tick")))
    moments = [(row.time_s, snapshots.get(row.tick)) for row in under_way.itertuples()]
    last = moments[-1][0] if moments else math.inf
    # After the drive's process is gone, whoever was seen last is taken to go on as he did.
    moments += [(float(moment), None) for moment in truth[truth[:, 0] > last, 0][::2]]
    for moment, snapshot in moments:
        if snapshot is not None:
            bodies, at = snapshot, moment
        if bodies is None or (snapshot is None and moment <= last):
            continue
        values = {name: np.interp([moment], truth[:, 0], column) for name, column in place.items()}
        own = vehicle_boxes(values["x"], values["y"], values["heading"], values["speed"], scenario.vehicle)
        heading, speed = bodies["heading_rad"].to_numpy(), bodies["speed_mps"].to_numpy()
        x = bodies["x_m"].to_numpy() + speed * (moment - at) * np.cos(heading)
        y = bodies["y_m"].to_numpy() + speed * (moment - at) * np.sin(heading)
        others = Boxes(x, y, heading, bodies["length_m"].to_numpy(), bodies["width_m"].to_numpy(), speed)
        least = min(least, float(distance(own, others).min()))
    driven = truth[:, 0] >= first
    s, d = scenario.path.locate(place["x"][driven][::5], place["y"][driven][::5], -5.0, scenario.path.length + 60.0)
    between = (s > 45.0) & (s < 95.0)
    aside = float(np.nanmax(np.abs(d), initial=0.0))
    latency = read_table(record, "latency").to_pandas()
    latency = latency[latency["tick"] >= under_way["tick"].min()]
    answered = latency[latency["framed_s"].notna()]
    summary = record / "summary.json"
    said = json.loads(summary.read_text(encoding="utf-8")) if summary.exists() else {"outcome": "", "reasons": []}
    end = _end(truth, place, scenario.path)
    return Drive(
        str(said["outcome"]), ",".join(said["reasons"]), least <= 0.0, end[0] > behind,
        bool((truth[driven, 4][::5][between] < 0.3).any()), least, aside, abs(end[1]),
        float(truth[-1, 4]), int(latency["missed"].sum()),
        _spread(answered["decided_s"] - answered["sensed_s"]), _spread(answered["framed_s"] - answered["woken_s"]),
        fit, killed,
    )  # fmt: skip


def _placed(truth: np.ndarray, ticks: Any) -> tuple[dict[str, np.ndarray], float]:
    """Return the truth on the virtual road, by the turn and shift that fit the recorded poses, and the residual [m]."""
    known = ticks[ticks["x_m"].notna() & (ticks["time_s"] <= truth[-1, 0])]
    lot = sum(np.interp(known["time_s"], truth[:, 0], truth[:, 1 + part]) * (1.0, 1.0j)[part] for part in range(2))
    road = known["x_m"].to_numpy() + 1.0j * known["y_m"].to_numpy()
    turn = ((road - road.mean()) * np.conj(lot - lot.mean())).sum()
    turn /= abs(turn)
    on_road = road.mean() + turn * (truth[:, 1] + 1.0j * truth[:, 2] - lot.mean())
    left = np.abs(road - (road.mean() + turn * (lot - lot.mean())))
    heading = np.unwrap(truth[:, 3] + float(np.angle(turn)))
    place = {"x": on_road.real, "y": on_road.imag, "heading": heading, "speed": truth[:, 4]}
    return place, float(np.sqrt((left**2).mean()))


def _end(truth: np.ndarray, place: Mapping[str, np.ndarray], path: Any) -> tuple[float, float]:
    """Return s and d of the car at the end [m]."""
    last = path.project(float(place["x"][-1]), float(place["y"][-1]))
    return float(last.s), float(last.d)


def _spread(seconds: Any) -> tuple[float, float, float]:
    values = seconds.dropna().to_numpy() * 1e3
    return tuple(float(value) for value in np.quantile(values, (0.5, 0.99, 1.0))) if len(values) else (math.nan,) * 3


def load() -> float:
    """Return the load of the machine, of the last minute."""
    return float(re.split(r"\s", Path("/proc/loadavg").read_text())[0])


def main() -> None:
    """Drive, and print a row for each drive."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--planner", choices=PLANNERS, default=PLANNERS[0])
    parser.add_argument("--runs", type=int, default=10)
    parser.add_argument(
        "--fault", action="store_true", help="kill the drive's process while the car is out of its lane"
    )
    parser.add_argument("--smoke", action="store_true", help="one drive, only to see that all of it runs")
    given = parser.parse_args()
    print(f"{given.planner}{', faults' * given.fault}: load, then what came of the drive", flush=True)
    for number in range(1 if given.smoke else given.runs):
        place = 45.0 + 55.0 * number / max(given.runs - 1, 1) if given.fault else math.nan
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            write(folder, given.planner)
            before = load()
            done = drive(folder, place)
            print(f"| {number + 1} | {before:.0f} to {load():.0f} | {_row(done)} |", flush=True)


def _row(done: Drive) -> str:
    """Return a drive in a line."""
    state = "contact" if done.contact else "passed" if done.passed else "not passed"
    parts = [
        f"{state}{', had waited' * done.waited}", f"clear {done.clearance:.2f} m", f"aside {done.aside:.2f} m",
        f"at the end {done.last:.2f} m, {done.speed:.2f} m/s", f"missed {done.missed}",
        "controller {:.1f}, {:.1f}, {:.1f} ms".format(*done.step_ms),
        "wake-up to frames {:.1f}, {:.1f}, {:.1f} ms".format(*done.tick_ms),
        f"{done.outcome} {done.reasons}", f"fit {done.fit:.3f} m",
    ]  # fmt: skip
    if math.isfinite(done.killed_at):
        parts.append(f"killed {done.killed_at:.2f} m beside the path")
    return "; ".join(parts)


if __name__ == "__main__":
    main()
