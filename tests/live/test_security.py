"""Nothing that anybody else on the machine or the network can reach engages or moves the car: tried, not argued."""

from __future__ import annotations

import contextlib
import json
import random
import re
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests import fixes
from tests.conftest import REPOSITORY
from tests.live.command_line import own_rig
from tests.live.patience import until
from tests.setpoints import setpoint as complete
from vve_sumo.pose.ncom import Encoder
from vve_sumo.record.reader import read_table
from vve_sumo.vehicle import link
from vve_sumo.vehicle.arming_machine import OperatorCommand

pytestmark = pytest.mark.live

#: the kernel's tables of sockets that are reached by an address
#: name of a rig's lock (`rig.lock`), in the kernel's own space of names
LOCK = re.compile(r"@(vve_sumo|[0-9a-f]{64}$)")
TABLES = ("tcp", "tcp6", "udp", "udp6", "raw", "raw6")


def sockets_of(pid: int) -> set[str]:
    """Inodes of the sockets that a process holds."""
    held = set()
    for entry in Path(f"/proc/{pid}/fd").iterdir():
        with contextlib.suppress(FileNotFoundError):  # it was closed meanwhile
            if found := re.fullmatch(r"socket:\[(\d+)\]", str(entry.readlink())):
                held.add(found[1])
    return held


def reachable(pids: list[int]) -> list[tuple[str, str, int]]:
    """Protocol, local address (the kernel's hexadecimal) and port of all sockets with an address."""
    inodes = set().union(*(sockets_of(pid) for pid in pids))
    found = []
    for table in TABLES:
        for line in Path(f"/proc/net/{table}").read_text().splitlines()[1:]:
            fields = line.split()
            if fields[9] in inodes:
                address, port = fields[1].rsplit(":", 1)
                found.append((table, address, int(port, 16)))
    return found


def named_unix_sockets(pids: list[int]) -> list[str]:
    """Names of Unix sockets that others could connect to, but for the rig's locks, from which nobody ever reads."""
    inodes = set().union(*(sockets_of(pid) for pid in pids))
    lines = [line.split() for line in Path("/proc/net/unix").read_text().splitlines()[1:]]
    return [line[7] for line in lines if len(line) > 7 and line[6] in inodes and not LOCK.match(line[7])]


def is_loopback(address: str) -> bool:
    """Whether the kernel's hexadecimal form of an IPv4 address is 127.x.y.z, or an IPv6 one is ::1."""
    return address.endswith("7F") if len(address) == 8 else address == "0" * 24 + "01000000"


@pytest.fixture
def waiting(tmp_path: Path) -> Iterator[tuple[subprocess.Popen[str], Path]]:
    """A live drive that is ready and waits for its operator, who is this test."""
    rig = own_rig(tmp_path, ("automatic = true", "automatic = false"))
    record = tmp_path / "record"
    process = subprocess.Popen(
        [sys.executable, "-m", "vve_sumo.cli", "drive", "--rig", str(rig), "--out", str(record)],
        cwd=REPOSITORY,
        stdin=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        stderr=(tmp_path / "said.txt").open("w"),
        text=True,
    )
    until(lambda: "s  READY" in (tmp_path / "said.txt").read_text() or process.poll() is not None, 60.0)
    assert process.poll() is None, (tmp_path / "said.txt").read_text()
    yield process, record
    process.kill()
    process.wait()


def bait() -> list[bytes]:
    """What somebody might send who knows every format of ours: acts, setpoints, fixes elsewhere, and noise."""
    setpoint = complete(
        0.0, 2.0, sequence=1 << 40, time=0.0, expires=0.1, x=0.0, y=0.0, heading=0.0, speed=0.0, yaw_rate=0.0
    )  # fmt: skip
    return [
        link.encode_operator_command(OperatorCommand.ENGAGE),
        link.encode_operator_command(OperatorCommand.GO),
        link.encode_setpoint(setpoint),
        b"e",
        b"engage\n",
        b"go\n",
        Encoder().encode(fixes.elsewhere()),
        random.Random(1).randbytes(500),
    ]


def test_whatever_is_sent_to_any_open_port_engages_and_moves_nothing(
    waiting: tuple[subprocess.Popen[str], Path],
) -> None:
    process, record = waiting
    pids = [process.pid, *(v for k, v in json.loads((record / "processes.json").read_text()).items() if "_s" not in k)]
    doors = reachable(pids)
    assert all(is_loopback(address) for _table, address, _port in doors), doors
    assert [table for table, _address, _port in doors if not table.startswith("udp")] == [], (
        "nothing accepts connections"
    )
    assert named_unix_sockets(pids) == [], "every channel between the processes is nameless"
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
        for _ in range(100):
            for _table, _address, port in doors:
                for datagram in bait():
                    stranger.sendto(datagram, ("127.0.0.1", port))
            time.sleep(0.01)
    assert process.stdin is not None
    process.stdin.write("stop\n")
    process.stdin.flush()
    process.wait(60.0)
    states = set(read_table(record, "gateway")["state"].to_pylist())
    assert "ready" in states
    assert states <= {"disarmed", "ready", "fault"}
    moved = [float(line.split(",")[4]) for line in (record / "truth.csv").read_text().splitlines()[1:]]
    assert max(map(abs, moved)) == 0.0
