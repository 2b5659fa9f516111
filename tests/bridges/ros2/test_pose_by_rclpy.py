"""A live drive whose receiver's driver is a node of ROS 2 in a process of its own: the car stops at the parked car."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest

from tests.bridges.ros2.stage import NODES, interpreter
from tests.conftest import REPOSITORY
from tests.live.command_line import free_port, vve_sumo
from tests.live.stage import free_ports
from vve_sumo.analysis import Run

pytest.importorskip("cyclonedds", reason="needs pip install 'vve-sumo[ros2]'")
pytestmark = pytest.mark.thorough


def _write_rig(folder: Path, node_port: int, domain: int) -> None:
    text = (REPOSITORY / "rigs" / "simulated.toml").read_text(encoding="utf-8")
    kind = f'kind = "{NODES / "car_over_ros.py"}:make"\nnode_port = {node_port}'
    for old, new in (
        ('kind = "ncom_udp"', kind),
        ("port = 3000", f"port = {free_port()}"),
        ("[mounting]", f"[ros2]\ndomain_id = {domain}\ncorrections_age_s = 10.0\n\n[mounting]"),
    ):
        assert old in text, old
        text = text.replace(old, new, 1)
    (folder / "over_ros.toml").write_text(text, encoding="utf-8")


def _write_scenario(folder: Path) -> None:
    text = (REPOSITORY / "scenarios" / "parked_car.toml").read_text(encoding="utf-8")
    for old, new in (("at_m = 639.0", "at_m = 70.0"), ("speed_mps = 11.176", "speed_mps = 8.0")):
        assert old in text, old
        text = text.replace(old, new)
    (folder / "near.toml").write_text(text, encoding="utf-8")


@contextmanager
def _running(*words: str, folder: Path, domain: int) -> Iterator[list[str]]:
    """Have a program run while the block does; yields a list that holds its lines afterwards."""
    environment = {**os.environ, "PYTHONPATH": str(REPOSITORY), "ROS_DOMAIN_ID": str(domain),
                   "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}  # fmt: skip
    process = subprocess.Popen(words, cwd=folder, env=environment, stderr=subprocess.PIPE, text=True)
    lines: list[str] = []
    try:
        yield lines
        assert process.poll() is None
    finally:
        process.terminate()
        lines += process.communicate(timeout=20.0)[1].splitlines()


@pytest.mark.live
def test_a_car_whose_receiver_is_a_ros_driver_stops_before_a_parked_car(tmp_path: Path) -> None:
    (node_port,), domain = free_ports(1), 1 + os.getpid() % 100
    _write_rig(tmp_path, node_port, domain)
    _write_scenario(tmp_path)
    node = (interpreter(), str(NODES / "driver_node.py"), str(node_port), "0.30", "0.20")
    relay = (sys.executable, "-m", "vve_sumo.cli", "pose", "ros2", "--rig", "over_ros.toml")
    with ExitStack() as beside:
        beside.enter_context(_running(*node, folder=tmp_path, domain=domain))
        lines = beside.enter_context(_running(*relay, folder=tmp_path, domain=domain))
        time.sleep(6.0)  # both find each other
        done = vve_sumo("drive", "near.toml", "--rig", "over_ros.toml", "--quiet", "--out", "one", cwd=tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr + "\n".join(lines)
    run = Run(tmp_path / "one")
    assert run.summary["outcome"] == "stopped"
    ticks = run.arrow("ticks")
    assert "messages refused none; 0 fixes lost" in lines[-1], lines
    assert ticks["pose_trusted"].to_numpy(zero_copy_only=False)[100:].mean() > 0.99
