"""A real on-board unit's packets over UDP in a live drive: bodies on the road, and a replay bit for bit."""

from __future__ import annotations

import json
import math
import os
import random
import signal
import socket
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from tests.live.command_line import begun, free_port, own_rig, vve_sumo
from tests.live.patience import until
from tests.stations.messages import car
from vve_sumo.drive.run import resolve_by_name
from vve_sumo.live.assembly import GNSS_OF_UNIX
from vve_sumo.record.reader import read_table

pytestmark = [pytest.mark.live]

SCENARIO = """
title = "A real car beside the street"
duration_s = 22.0
[road]
network = "linden"
[ego]
path = "linden_17th"
speed_mps = 6.0
[ego.lot]
latitude_deg = 40.0041
longitude_deg = -83.0186
heading_deg = 85.0
"""


class Driven(NamedTuple):
    """A drive that is over."""

    folder: Path
    summary: dict[str, Any]
    port: int


def driven(folder: Path, happens: Callable[[socket.socket, int, dict[str, Any], float], None]) -> Driven:
    """Drive while `happens` is called each 0.1 s, with a socket, the port, the processes and a GNSS time [s]."""
    folder.mkdir(parents=True, exist_ok=True)
    port, scenario, record = free_port(), folder / "beside.toml", folder / "record"
    scenario.write_text(SCENARIO, encoding="utf-8")
    rig = own_rig(folder, ("\n[operator]", f'\n[v2x]\nlisten = "127.0.0.1:{port}"\nframe = "road"\n\n[operator]'))
    process = begun("drive", str(scenario), "--rig", str(rig), "--out", str(record), cwd=folder)
    try:
        until(lambda: (record / "processes.json").exists() or process.poll() is not None, 60.0)
        until(lambda: (record / "processes.json").read_text(encoding="utf-8").endswith("\n"))
        processes = json.loads((record / "processes.json").read_text(encoding="utf-8"))
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
            while process.poll() is None:
                happens(sender, port, processes, time.time() + GNSS_OF_UNIX)
                time.sleep(0.1)
        process.communicate(timeout=90.0)
    finally:
        process.kill()
    summary = json.loads((record / "summary.json").read_text(encoding="utf-8"))
    return Driven(record, summary, port)


def _beside(repository: Path) -> Callable[[float], bytes]:
    """The packets, by their GNSS time [s], of a car that stands 12 m left of the path's 30th metre."""
    resolved = resolve_by_name("parked_car", repository)
    at, frame = resolved.path.at(30.0), resolved.map_frame
    x, y = at.x - 12.0 * math.sin(at.heading), at.y + 12.0 * math.cos(at.heading)
    return lambda gnss: car(gnss - 1.4e9, x, y, at.heading, 0.0, frame=frame)


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory, repository: Path) -> Driven:
    chance, beside = random.Random(5), _beside(repository)

    def happens(sender: socket.socket, port: int, _processes: dict[str, Any], gnss: float) -> None:
        sender.sendto(beside(gnss), ("127.0.0.1", port))
        sender.sendto(chance.randbytes(chance.randrange(1, 300)), ("127.0.0.1", port))

    return driven(tmp_path_factory.mktemp("stations"), happens)


def test_a_station_is_on_the_road_and_the_drive_lasts_as_long_as_it_may(drive: Driven) -> None:
    assert (drive.summary["outcome"], drive.summary["reasons"]) == ("timeout", [])
    datagrams = read_table(drive.folder, "station_datagrams").to_pylist()
    refused = [row["refused"] for row in datagrams]
    assert refused.count("") > 100
    assert refused.count("malformed") > 100
    assert set(refused) <= {"", "malformed", "old"}
    assert refused.count("old") < 10, "a machine that stood still"
    actors = set(read_table(drive.folder, "actors")["actor"].to_pylist())
    assert "station.4711" in actors


def test_the_record_replays_bit_for_bit(drive: Driven) -> None:
    done = vve_sumo("replay", str(drive.folder), cwd=drive.folder)
    assert done.returncode == 0, done.stdout + done.stderr


def test_a_process_that_is_gone_stops_the_car(tmp_path: Path, repository: Path) -> None:
    beside, begun_at = _beside(repository), time.monotonic()

    def happens(sender: socket.socket, port: int, processes: dict[str, Any], gnss: float) -> None:
        sender.sendto(beside(gnss), ("127.0.0.1", port))
        if "stations" in processes and time.monotonic() - begun_at > 12.0:
            os.kill(processes.pop("stations"), signal.SIGKILL)

    done = driven(tmp_path / "drive", happens)
    reasons = {code for text in read_table(done.folder, "ticks")["faults"].to_pylist() for code in text.split("+")}
    assert "stations_gone" in reasons
