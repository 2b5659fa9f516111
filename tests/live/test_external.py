"""An external controller drives: the reference brain as a process of its own, on a bus whose log says who sent what.

One short drive is judged from all sides: what was on the bus and from whom, what the record holds, when the sensors
were valid, and whether the record replays.
"""

from __future__ import annotations

import contextlib
import json
import os
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import pytest

from tests.conftest import REPOSITORY
from tests.live.records import PATIENCE, SHORTER
from tests.live.stage import DRIVES, free_port, rows
from vve_sumo.bus import read_log
from vve_sumo.live.replay import read_live_inputs, replay_drive, replay_gateway
from vve_sumo.values import Frame
from vve_sumo.vehicle.dataspeed import codec, layout
from vve_sumo.wire.datagrams import RadarDatagram, decode_radar

#: a fixture that takes long: `./check test` leaves its tests out
THOROUGH_FIXTURE = "evidence"

pytestmark = pytest.mark.live

TRIES = 3
PERIOD = 0.02


@dataclass
class Evidence:
    """What is left of a drive with an external controller."""

    record: Path
    said: str  #: by the console
    brain: str  #: by the brain
    bus: list[tuple[str, Frame]]  #: sender and frame, of everything that was on the car's bus
    radar: list[RadarDatagram]  #: of everything that the outputs said

    @property
    def steps(self) -> list[dict[str, object]]:
        """The gateway's rows."""
        return rows(self.record, "gateway")

    @property
    def drove(self) -> bool:
        """Whether the brain drove the car, and the drive came to its own end."""
        # Not by the greatest: before the car's first report it is not a number, which any comparison keeps.
        return any(float(row["wheel_speed_mps"]) > 2.0 for row in self.steps) and "let go" in self.brain


def drive(folder: Path) -> Evidence:
    """Drive the shortened scenario by the reference brain."""
    folder.mkdir()
    scenario = (REPOSITORY / "scenarios" / "parked_car.toml").read_text(encoding="utf-8")
    for old, new in SHORTER.items():
        scenario = scenario.replace(old, new)
    (folder / "short.toml").write_text(scenario, encoding="utf-8")
    gnss, radar = free_port(), socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    radar.bind(("127.0.0.1", 0))
    rig = (REPOSITORY / "rigs" / "external.toml").read_text(encoding="utf-8")
    rig = rig.replace("port = 3000", f"port = {free_port()}").replace("127.0.0.1:5001", f"127.0.0.1:{gnss}")
    rig += f'\n[[outputs]]\nkind = "radar"\nudp = "127.0.0.1:{radar.getsockname()[1]}"\n'
    (folder / "rig.toml").write_text(rig, encoding="utf-8")
    with _listening(radar) as datagrams, _brain(folder, gnss) as brain, (folder / "said.txt").open("wb") as said:
        subprocess.run(
            [sys.executable, *DRIVES, "short.toml", "--rig", "rig.toml", "--out", "record"],
            cwd=folder, env=os.environ | {"PYTHONPATH": str(REPOSITORY)}, stdin=subprocess.DEVNULL, stdout=said,
            stderr=said, timeout=PATIENCE, check=False,
        )  # fmt: skip
        with contextlib.suppress(subprocess.TimeoutExpired):
            brain.wait(5.0)
    record = folder / "record"
    bus = [(sender, frame) for _time, sender, frame in read_log(record / "bus.log")]
    texts = [(folder / name).read_text(errors="replace") for name in ("said.txt", "brain.txt")]
    return Evidence(record, texts[0], texts[1], bus, [seen for data in datagrams if (seen := decode_radar(data))])


@contextlib.contextmanager
def _brain(folder: Path, gnss: int) -> Iterator[subprocess.Popen[bytes]]:
    program, route = REPOSITORY / "examples/brains/drive_by_wire.py", REPOSITORY / "routes/linden_17th.csv"
    with (folder / "brain.txt").open("wb") as said:
        process = subprocess.Popen(
            [sys.executable, str(program), str(route), "--gnss", str(gnss), "--speed", "5"],
            cwd=folder, env=os.environ | {"PYTHONPATH": str(REPOSITORY)}, stdout=said, stderr=said,
        )  # fmt: skip
    try:
        yield process
    finally:
        process.kill()
        process.wait()


@contextlib.contextmanager
def _listening(end: socket.socket) -> Iterator[list[bytes]]:
    datagrams: list[bytes] = []

    def listen() -> None:
        while data := end.recv(2048):
            datagrams.append(data)

    thread = threading.Thread(target=listen)
    thread.start()
    try:
        yield datagrams
    finally:
        end.sendto(b"", end.getsockname())
        thread.join()
        end.close()


@pytest.fixture(scope="module")
def evidence(tmp_path_factory: pytest.TempPathFactory) -> Evidence:
    """The last drive, and the first that the machine let come to its end."""
    folder = tmp_path_factory.mktemp("external")
    for number in range(TRIES):
        found = drive(folder / str(number))
        if found.drove:
            return found
    raise AssertionError(found.said + found.brain)


def test_not_one_frame_on_the_bus_is_ours(evidence: Evidence) -> None:
    senders = {sender for sender, _frame in evidence.bus}
    assert senders == {"car", "brain"}
    assert {frame.id for sender, frame in evidence.bus if sender == "car"}.isdisjoint(layout.COMMAND_IDS)
    assert {row["frames_sent"] for row in evidence.steps} == {0}


def test_every_command_in_the_record_is_the_brains(evidence: Evidence) -> None:
    """The record holds the brain's commands in the brain's order, from the first to the last that came while it ran."""
    sent = [frame for sender, frame in evidence.bus if sender == "brain"]
    kept = [f for _time, _bus, f in read_log(evidence.record / "can.log") if f.id in layout.COMMAND_IDS]
    assert len(kept) > 400
    begin = next(n for n in range(len(sent)) if sent[n : n + 40] == kept[:40])
    assert sent[begin : begin + len(kept)] == kept


def test_the_brain_counts_enables_shifts_and_lets_go(evidence: Evidence) -> None:
    brakes = [codec.decode(f) for sender, f in evidence.bus if sender == "brain" and f.id == codec.BRAKE_COMMAND]
    counters = [command.counter for command in brakes]
    assert all(later == (earlier + 1) & 0xFF for earlier, later in pairwise(counters))
    assert brakes[0].clear
    assert brakes[0].enable
    assert not brakes[-1].enable
    assert rows(evidence.record, "gateway")[-1]["gear"] in ("park", "drive")


def test_the_sensors_are_valid_from_go_until_the_stop(evidence: Evidence) -> None:
    """Times are those that the datagrams say, so that a busy machine shows late ones, not wrong ones."""
    states = [(float(str(row["time_s"])), row["state"], str(row["reasons"])) for row in evidence.steps]
    went = next(time for time, state, why in states if state == "engaged" and "waiting_for_go" not in why)
    over = next(time for time, state, _why in states if state == "stopping")
    epoch = read_live_inputs(evidence.record).scenario_content["epoch_gnss_s"]
    valid = [seen.time - epoch for seen in evidence.radar if seen.valid]
    assert went < min(valid)
    assert min(valid) < went + 0.5
    assert max(valid) < over + 2.0 * PERIOD
    assert any(not seen.valid and seen.time - epoch < went for seen in evidence.radar)
    assert any(not seen.valid and seen.time - epoch > over for seen in evidence.radar)


def test_the_summary_says_who_commanded_and_the_record_replays(evidence: Evidence) -> None:
    summary = json.loads((evidence.record / "summary.json").read_text(encoding="utf-8"))
    assert (summary["brain"], summary["controller"]) == ("external", "foreign_brain")
    inputs = read_live_inputs(evidence.record)
    assert inputs.torn == 0
    assert replay_gateway(inputs) is None
    assert replay_drive(inputs, REPOSITORY) is None
    assert "THE EXTERNAL CONTROLLER DRIVES" in evidence.said
