"""The relay of a ROS 2 driver's fixes: rigs that it refuses, and messages over DDS that come out as NCOM."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

pytest.importorskip("rosbags", reason="needs pip install 'vve-sumo[ros2]'")
pytest.importorskip("cyclonedds", reason="needs pip install 'vve-sumo[ros2]'")
from tests.bridges.ros2.test_fixes import EPOCH, good_messages, true_fix
from tests.conftest import REPOSITORY
from vve_sumo.bridges.ros2.dds import Dds
from vve_sumo.bridges.ros2.relay import KINDS, TOPICS, FixRelay
from vve_sumo.cli import main
from vve_sumo.errors import ConfigError
from vve_sumo.pose.ncom import Decoder
from vve_sumo.rig.load import load
from vve_sumo.values import Fix

DOMAIN = 1 + (os.getpid() + 50) % 100  # another than that of the bridge's tests
ROS2 = "[ros2]\ndomain_id = {}\ncorrections_age_s = 5.0\n\n[mounting]\nforward_m = 0.90\nleft_m = -0.35\n"
MOUNTING = "[mounting]\nforward_m = 0.30\nleft_m = 0.20\n"
POSE = 'kind = "ncom_udp"\naddress = "127.0.0.1"\nport = 3000\n'


def _rig(folder: Path, *changes: tuple[str, str]) -> Path:
    text = (REPOSITORY / "rigs" / "simulated.toml").read_text(encoding="utf-8")
    for old, new in changes:
        assert old in text, old
        text = text.replace(old, new)
    file = folder / "mine.toml"
    file.write_text(text, encoding="utf-8")
    return file


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (
            (POSE, 'kind = "ubx_udp"\naddress = "127.0.0.1"\nport = 3000\n'),
            "expected kind 'ncom_udp' on 127.0.0.1, got",
        ),
        (("[mounting]", "[ros2]\ndomain_id = 3\n\n[mounting]"), "ros2.corrections_age_s is missing"),
        (("[mounting]", "[ros2]\ncorrections_age_s = 30.0\n\n[mounting]"), "ros2.corrections_age_s"),
    ],
)
def test_a_rig_that_it_cannot_serve_is_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], change: tuple[str, str], words: str
) -> None:
    assert main(["pose", "ros2", "--rig", str(_rig(tmp_path, change))]) == 2
    assert words in capsys.readouterr().err


def test_fixes_leave_this_machine_for_nobody(tmp_path: Path) -> None:
    rig = load(_rig(tmp_path, (MOUNTING, ROS2.format(DOMAIN))), tmp_path)
    elsewhere = rig.model_copy(update={"pose": rig.pose.model_copy(update={"address": "192.168.1.5"})})
    with pytest.raises(ConfigError, match=r"on 127\.0\.0\.1, got 192\.168\.1\.5 port 3000"):
        FixRelay(elsewhere, TOPICS)


@contextmanager
def _relay(file: Path) -> Iterator[list[str]]:
    """Have the relay run in a process of its own; yields a list that holds its lines afterwards."""
    words = [sys.executable, "-m", "vve_sumo.cli", "pose", "ros2", "--rig", str(file)]
    environment = {**os.environ, "PYTHONPATH": str(REPOSITORY)}
    lines: list[str] = []
    with subprocess.Popen(words, cwd=file.parent, env=environment, stderr=subprocess.PIPE, text=True) as process:
        assert process.stderr is not None
        lines.append(process.stderr.readline())
        try:
            yield lines
        finally:
            process.terminate()
            try:
                lines += process.communicate(timeout=30.0)[1].splitlines()
            finally:
                process.kill()


def test_messages_over_dds_come_out_as_packets_of_the_receiver(tmp_path: Path) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as drive:
        drive.bind(("127.0.0.1", 0))
        drive.settimeout(5.0)
        port = drive.getsockname()[1]
        file = _rig(tmp_path, ("port = 3000", f"port = {port}"), (MOUNTING, ROS2.format(DOMAIN)))
        with _relay(file) as lines:
            fixes = _fixes_of(drive)
    wanted, got = true_fix(0.55), fixes[-1]
    assert len(fixes) > 5  # the packets need some until the date is known
    assert abs(got.time - EPOCH - 0.55) < 1e-3
    assert (got.latitude, got.longitude) == pytest.approx((wanted.latitude, wanted.longitude), abs=1e-12)
    assert (got.heading, got.yaw_rate) == pytest.approx((wanted.heading, wanted.yaw_rate), abs=2e-5)
    assert (got.locked, got.quality, got.differential_age) == (True, wanted.quality, 5.0)
    assert lines[-1] == "pose ros2: 12 fixes sent, messages refused none; 0 fixes lost"


def _fixes_of(drive: socket.socket) -> list[Fix]:
    """Publish twelve fixes and their company; return those that came out."""
    driver, decoder, fixes = Dds(DOMAIN), Decoder(), []
    try:
        for key, kind in KINDS.items():
            driver.advertise(TOPICS[key], kind)
        limit = time.monotonic() + 20.0
        while not driver.has_node():
            assert time.monotonic() < limit
            time.sleep(0.05)
        time.sleep(0.5)  # all three
        for number in range(12):
            sent = good_messages(0.05 * number)
            for key, kind in KINDS.items():
                driver.publish(TOPICS[key], sent[kind])
            fixes += decoder.feed(drive.recv(2048), 0.05 * number)
    finally:
        driver.close()
    return fixes
