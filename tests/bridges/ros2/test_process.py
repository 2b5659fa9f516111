"""The bridge's process: rigs that it refuses in one line, ports that are taken, a node that cannot be started."""

from __future__ import annotations

import os
import socket
import sys
from pathlib import Path

import pytest

pytest.importorskip("rosbags", reason="needs pip install 'vve-sumo[ros2]'")
from tests import isolated
from tests.bridges.ros2.stage import write_rig
from vve_sumo.bridges.ros2.process import WIRES, Node, places_of, senses_of
from vve_sumo.cli import main
from vve_sumo.errors import ConfigError
from vve_sumo.rig.load import load
from vve_sumo.rig.schema import Rig

SCENE = '[[outputs]]\nkind = "scene"                 # bodies, state and reasons, for what shows the drive\n'


def _rig(folder: Path, *changes: tuple[str, str]) -> Rig:
    write_rig(folder, *changes)
    return load(folder / "ros2.toml", folder)


def test_the_shipped_rig_has_every_wire(tmp_path: Path) -> None:
    assert places_of(_rig(tmp_path)).keys() == set(WIRES)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ((SCENE, '[[outputs]]\nkind = "osi_view"\n'), "needs one of kind 'scene' over udp, and has none"),
        ((SCENE, '[[outputs]]\nkind = "ncom"\n'), "hears one wire of kind 'ncom', got two"),
    ],
)
def test_a_rig_without_the_bridges_wires_is_refused(tmp_path: Path, change: tuple[str, str], words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        places_of(_rig(tmp_path, change))


def test_the_radar_has_to_end_a_tick(tmp_path: Path) -> None:
    rig = _rig(tmp_path)
    turned = rig.model_copy(update={"outputs": rig.outputs[::-1]})
    with pytest.raises(ConfigError, match="expected the one of kind 'radar' after 'ncom' and 'scene'"):
        places_of(turned)


WIRE = '[[outputs]]\nkind = "sense"\nsensor = "{}"\nudp = "127.0.0.1:{}"\n\n'


def test_further_sensors_are_heard_by_their_names(tmp_path: Path) -> None:
    rig = _rig(tmp_path, (SCENE, WIRE.format("roof", 4100) + WIRE.format("front", 4101) + SCENE))
    assert senses_of(rig) == {"roof": ("127.0.0.1", 4100), "front": ("127.0.0.1", 4101)}
    assert places_of(rig).keys() == set(WIRES)


@pytest.mark.parametrize(
    ("names", "words"),
    [
        (("roof", "roof"), "outputs.2: sensor 'roof': got two"),
        (("front-left",), "'front-left' cannot be a topic of ROS 2, expected letters, digits and underscores"),
        (("gnss",), "'gnss' cannot be a frame, the ROS 2 bridge has another of that name"),
    ],
)
def test_a_name_that_cannot_be_a_topic_is_refused(tmp_path: Path, names: tuple[str, ...], words: str) -> None:
    wires = "".join(WIRE.format(name, 4100 + number) for number, name in enumerate(names))
    with pytest.raises(ConfigError, match=words):
        senses_of(_rig(tmp_path, (SCENE, wires + SCENE)))


def test_a_port_that_is_taken_is_one_line(tmp_path: Path) -> None:
    """In a process of its own: the bridge asks for a priority and for signals, and keeps them."""
    pytest.importorskip("cyclonedds", reason="needs pip install 'vve-sumo[ros2]'")
    port = write_rig(tmp_path)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", port))
        done = isolated.command("ros2", "parked_car", "--rig", "ros2.toml", cwd=tmp_path)
    assert done.returncode == 3
    assert f"udp 127.0.0.1:{port}: cannot be listened on" in done.stderr


def test_an_empty_node_is_refused_before_anything_is_opened(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    write_rig(tmp_path)
    assert main(["ros2", "--rig", "ros2.toml", "--node", " "]) == 2
    assert "--node: expected the command that starts the node, got nothing" in capsys.readouterr().err


def test_a_node_that_cannot_be_started_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="no_such_program: cannot be started"):
        Node(["no_such_program"], tmp_path, dict(os.environ))


def test_a_node_ends_when_it_is_told_to(tmp_path: Path) -> None:
    node = Node([sys.executable, "-c", "import time; time.sleep(60)"], tmp_path, dict(os.environ))
    assert not node.ended
    assert node.close() != 0
    assert node.ended
