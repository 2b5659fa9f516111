"""A drive on the shipped rig with free ports and a domain of its own, the bridge and a real node beside it."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

import pytest

from tests.conftest import REPOSITORY
from tests.live.stage import free_ports

EXAMPLES: Final = REPOSITORY / "examples" / "ros2"
NODES: Final = Path(__file__).parent
NEEDS: Final = "needs an environment with ROS 2 (tests/bridges/ros2.txt), whose interpreter VVE_ROS2 names"


def interpreter() -> str:
    """Return the interpreter that has rclpy; skips where there is none."""
    named = os.environ.get("VVE_ROS2")
    if named is None:
        pytest.skip(NEEDS)
    return named


def write_rig(folder: Path, *changes: tuple[str, str]) -> int:
    """Write the shipped rig as `ros2.toml` with passages changed; return the port of the radar datagrams."""
    ports = free_ports(4)
    text = (REPOSITORY / "rigs" / "ros2.toml").read_text(encoding="utf-8")
    free = dict(zip(("5001", "5002", "5003", "5004"), map(str, ports), strict=True))
    text, replaced = re.subn(r"\b500[1234]\b", lambda found: free[found[0]], text)
    assert replaced == len(free)
    for old, new in (("domain_id = 0 ", f"domain_id = {1 + os.getpid() % 100} "), *changes):
        assert old in text, old
        text = text.replace(old, new)
    (folder / "ros2.toml").write_text(text, encoding="utf-8")
    return ports[1]


@contextmanager
def bridge(folder: Path, port: int, node: str, scenario: str = "parked_car") -> Iterator[list[str]]:
    """Have the bridge run with a node while the block does; yields a list that holds the bridge's lines afterwards."""
    lines: list[str] = []
    words = [sys.executable, "-m", "vve_sumo.cli", "ros2", scenario, "--rig", "ros2.toml", "--node", node]
    environment = {**os.environ, "PYTHONPATH": str(REPOSITORY)}
    process = subprocess.Popen(words, cwd=folder, env=environment, stderr=subprocess.PIPE, text=True)
    try:
        limit = time.monotonic() + 150.0
        while f":{port:04X} " not in Path("/proc/net/udp").read_text(encoding="ascii"):
            assert process.poll() is None
            assert time.monotonic() < limit
            time.sleep(0.05)
        yield lines
    finally:
        process.terminate()
        lines += process.communicate(timeout=20.0)[1].splitlines()
