"""A short drive in lockstep that a node of rclpy drives and writes down, made once for all tests that look at it."""

from __future__ import annotations

import json
import shlex
from pathlib import Path
from typing import Any, Final, NamedTuple

import pytest

from tests.bridges.ros2.stage import EXAMPLES, NODES, bridge, interpreter, write_rig
from tests.conftest import REPOSITORY
from tests.live.command_line import vve_sumo
from tests.live.stage import free_ports
from tests.once import once
from vve_sumo.analysis import Run

#: topics of further sensors
SENSES: Final = ("/roof/points", "/front/objects", "/obu/stations", "/second/points")
_RADAR: Final = '[[outputs]]\nkind = "radar" '


class Heard(NamedTuple):
    """A drive, and what a node heard of it."""

    run: Run  #: the record
    messages: dict[str, list[dict[str, Any]]]  #: by topic, as JSON has them


def heard(factory: pytest.TempPathFactory) -> Heard:
    """Return the drive; skips where there is no interpreter with rclpy."""
    interpreter()
    folder = once(factory, "ros2", _drive)
    return Heard(Run(folder / "one"), json.loads((folder / "heard.json").read_text(encoding="utf-8")))


def _drive(folder: Path) -> None:
    """Drive past two parked cars and a child, with a second radar, a lidar, a camera and a V2X receiver."""
    folder.mkdir()
    scenario = (REPOSITORY / "scenarios" / "every_sense.toml").read_text(encoding="utf-8")
    second = '[[sensors]]\nname = "second"\nkind = "radar"\n\n[[obstacles]]'
    (folder / "senses.toml").write_text(scenario.replace("[[obstacles]]", second, 1), encoding="utf-8")
    names = [topic.split("/")[1] for topic in SENSES]
    wires = "".join(f'[[outputs]]\nkind = "sense"\nsensor = "{name}"\nudp = "127.0.0.1:{port}"\n\n'
                    for name, port in zip(names, free_ports(len(names)), strict=True))  # fmt: skip
    port = write_rig(folder, (_RADAR, wires + _RADAR))
    words = [interpreter(), str(NODES / "witness_node.py"), str(EXAMPLES), str(folder / "heard.json")]
    node = shlex.join(words + [f"{topic}:PointCloud2" for topic in SENSES])
    with bridge(folder, port, node, "senses.toml") as lines:
        done = vve_sumo(
            "drive", "senses.toml", "--rig", "ros2.toml", "--lockstep", "--set", "duration_s=7", "--out", "one",
            cwd=folder,
        )  # fmt: skip
    assert "timeout" in done.stdout, done.stdout + done.stderr + "\n".join(lines)
    assert "refused none; 0 messages dropped, 0 datagrams not read, 0 setpoints lost" in lines[-1], lines
