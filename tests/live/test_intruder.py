"""Another program speaks to the receiver's port while the car drives: nothing of it counts, and the car stops."""

from __future__ import annotations

import contextlib
import json
import re
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from tests import fixes
from tests.conftest import REPOSITORY
from tests.live.command_line import own_rig
from tests.live.patience import until
from tests.live.stage import SCENARIO, read_truth
from vve_sumo.pose.ncom import pack
from vve_sumo.record.reader import read_table

pytestmark = pytest.mark.live

SPEED = 4.0  #: of the car when the other program begins [m/s]
FLOOD = 2.0  #: how long one goes on [s]


@dataclass(frozen=True)
class Ended:
    """What is left of a drive."""

    summary: dict[str, Any]
    ticks: dict[str, list[Any]]
    begun: float  #: drive time at which the other program began [s]
    sent: int  #: datagrams of it


@contextlib.contextmanager
def driving(folder: Path) -> Iterator[tuple[subprocess.Popen[bytes], Path, int]]:
    """A live drive of the simulated vehicle, its record and the receiver's port; the car is fast enough."""
    (folder / "short.toml").write_text(SCENARIO)
    rig, record = own_rig(folder), folder / "record"
    found = re.search(r"\nport = (\d+)", rig.read_text())
    assert found is not None
    names = [str(folder / "short.toml"), "--rig", str(rig), "--out", str(record)]
    process = subprocess.Popen(
        [sys.executable, "-m", "vve_sumo.cli", "drive", *names],
        cwd=REPOSITORY,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=(folder / "said.txt").open("w"),
    )
    try:
        until(lambda: process.poll() is not None or speed(record) > SPEED, 90.0)
        assert process.poll() is None, (folder / "said.txt").read_text()
        yield process, record, int(found[1])
    finally:
        process.kill()
        process.wait()


def speed(record: Path) -> float:
    """The car's newest true speed."""
    if not (record / "truth.csv").exists() or not (record / "truth.csv").read_text().count("\n") > 1:
        return 0.0
    return float(read_truth(record)["speed_mps"][-1])


def elsewhere() -> bytes:
    """A packet that a receiver could have sent, of a place far away."""
    return pack(fixes.elsewhere(), 16, bytes(8))


def intruded(folder: Path, datagram: bytes | None, seconds: float) -> Ended:
    """Drive, have another program speak for so long, once for no time at all, and wait for the end."""
    with driving(folder) as (process, record, port):
        begun = time.monotonic() - json.loads((record / "processes.json").read_text())["t0_monotonic_s"]
        until_when, sent = time.monotonic() + seconds, 0
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
            while sent == 0 or time.monotonic() < until_when:
                stranger.sendto(datagram or elsewhere(), ("127.0.0.1", port))
                sent += 1
        process.wait(60.0)
    summary = json.loads((record / "summary.json").read_text())
    return Ended(summary, read_table(record, "ticks").to_pydict(), begun, sent)


@pytest.mark.thorough
def test_one_datagram_of_another_program_stops_the_car_and_counts_for_nothing(tmp_path: Path) -> None:
    ended = intruded(tmp_path, None, 0.0)
    assert (ended.summary["outcome"], ended.summary["reasons"][0]) == ("fault", "pose_two_senders")
    assert sum(ended.summary["receiver"]["refused"].values()) == 1
    assert ended.summary["receiver"]["sender"].startswith("127.0.0.1:")
    assert {"pose_jump", "gap", "settling"}.isdisjoint("+".join(ended.ticks["pose_reasons"]).split("+"))


@pytest.mark.thorough
@pytest.mark.parametrize(
    "datagram", [None, pytest.param(b"\xe7" * 4096, marks=pytest.mark.slow)], ids=["packets", "long ones"]
)
def test_a_flood_ends_in_a_stop_with_its_reason_and_never_in_a_hang(tmp_path: Path, datagram: bytes | None) -> None:
    ended = intruded(tmp_path, datagram, FLOOD)
    assert ended.summary["outcome"] == "fault"
    assert "pose_two_senders" in ended.summary["reasons"]
    refused = sum(ended.summary["receiver"]["refused"].values())
    assert 0 < refused <= ended.sent
    during = [at for at in ended.ticks["time_s"] if ended.begun < at < ended.begun + FLOOD]
    assert len(during) > 0.5 * FLOOD / 0.02, "the drive ticks on"
