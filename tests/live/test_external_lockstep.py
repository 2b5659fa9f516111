"""An external controller in lockstep over real UDP: always the same record; a silent one stops the car."""

from __future__ import annotations

import json
import random
import shutil
import socket
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from tests.conftest import REPOSITORY
from tests.isolated import command
from tests.live.lockstep import running, write_rig
from vve_sumo.analysis.run import Run
from vve_sumo.wire.datagrams import RadarDatagram, SetpointDatagram, decode_radar, encode_setpoint

BRAINS = REPOSITORY / "examples" / "brains"
CC = shutil.which("cc") or shutil.which("gcc")
SHORT = ("--set", "duration_s=9", "--quiet", "--lockstep", "--rig", "foreign.toml")
RECORD = ("can.log", "pose.bin")


def _commands(program: str, folder: Path, ports: list[int]) -> list[str]:
    gnss, radar, setpoints = map(str, ports)
    if program == "minimal.c":
        built = folder / "minimal"
        flags = ["-std=gnu11", "-Wall", "-Wextra", "-Werror"]
        subprocess.run([CC or "cc", *flags, "-o", built, BRAINS / program, "-lm"], check=True)
        return [str(built), radar, setpoints]
    if program == "minimal.py":
        return [sys.executable, "-I", str(BRAINS / program), radar, setpoints]
    route = str(REPOSITORY / "routes" / "linden_17th.csv")
    places = ["--gnss", gnss, "--radar", radar, "--setpoints", setpoints]
    return [sys.executable, str(BRAINS / program), route, *places]


def _driven(folder: Path, name: str) -> tuple[tuple[bytes, ...], float]:
    done = command("drive", "parked_car", *SHORT, "--seed", "3", "--out", name, cwd=folder)
    assert "timeout" in done.stdout, done.stdout + done.stderr
    summary = json.loads((folder / name / "summary.json").read_text(encoding="utf-8"))
    return tuple((folder / name / part).read_bytes() for part in RECORD), float(summary["max_speed_mps"])


@pytest.mark.thorough
@pytest.mark.parametrize(
    "program",
    [
        "stop_for_parked.py",
        pytest.param("minimal.py", marks=pytest.mark.slow),
        pytest.param("minimal.c", marks=pytest.mark.skipif(CC is None, reason="needs a C compiler")),
    ],
)
def test_brain_of_another_process_drives_and_its_record_is_the_same_every_time(program: str, tmp_path: Path) -> None:
    ports = write_rig(tmp_path)
    records = []
    for name in ("one", "two") if program == "stop_for_parked.py" else ("one",):
        with running(_commands(program, tmp_path, ports), ports[1]):
            record, speed = _driven(tmp_path, name)
        assert speed > 3.0, "the brain did not drive"
        records.append(record)
    assert len(set(records)) == 1


@pytest.mark.slow
def test_the_record_says_that_a_foreign_brain_decided_and_cannot_be_asked_again(tmp_path: Path) -> None:
    ports = write_rig(tmp_path)
    with running(_commands("minimal.py", tmp_path, ports), ports[1]):
        _driven(tmp_path, "one")
    summary = json.loads((tmp_path / "one" / "summary.json").read_text(encoding="utf-8"))
    assert (summary["brain"], summary["controller"]) == ("setpoints", "foreign_brain")
    assert Run(tmp_path / "one").brain == "setpoints"
    replayed = command("replay", "one", cwd=tmp_path)
    assert replayed.returncode == 1
    assert "an external controller decided, which cannot be asked again" in replayed.stdout
    assert command("redrive", "one", "--controller", "follow_and_stop", cwd=tmp_path).returncode == 0
    assert command("report", "one", cwd=tmp_path).returncode == 0
    page = (tmp_path / "one" / "report.html").read_text(encoding="utf-8")
    assert "an external controller (setpoints)" in page
    assert "vve-sumo replay one" not in page
    assert "--controller follow_and_stop" not in page


@pytest.mark.slow
def test_minimal_brains_of_both_languages_drive_the_same(tmp_path: Path) -> None:
    if CC is None:
        pytest.skip("needs a C compiler")
    ports, records = write_rig(tmp_path), []
    for program in ("minimal.py", "minimal.c"):
        with running(_commands(program, tmp_path, ports), ports[1]):
            records.append(_driven(tmp_path, program.replace(".", "_"))[0])
    assert records[0] == records[1]


@pytest.mark.thorough
@pytest.mark.parametrize(
    "program",
    [
        "stop_for_parked.py",
        pytest.param("minimal.py", marks=pytest.mark.slow),
        pytest.param(
            "minimal.c", marks=[pytest.mark.slow, pytest.mark.skipif(CC is None, reason="needs a C compiler")]
        ),
    ],
)
def test_a_brain_with_the_key_drives_and_one_without_it_is_not_heard(program: str, tmp_path: Path) -> None:
    ports = write_rig(tmp_path, deadline=1.0)
    rig = (tmp_path / "foreign.toml").read_text(encoding="utf-8")
    (tmp_path / "foreign.toml").write_text(rig.replace("[brain]\n", '[brain]\nkey_file = "key"\n'), encoding="utf-8")
    (tmp_path / "key").write_text(random.Random(1).randbytes(32).hex() + "\n", encoding="ascii")
    (tmp_path / "other").write_text(random.Random(2).randbytes(32).hex() + "\n", encoding="ascii")
    words = _commands(program, tmp_path, ports)
    with running([*words, *_key(program, tmp_path / "key")], ports[1]):
        assert _driven(tmp_path, "one")[1] > 3.0, "the brain did not drive"
    for number, unsigned in enumerate((words, [*words, *_key(program, tmp_path / "other")])):
        with running(unsigned, ports[1]):
            refused = command("drive", "parked_car", *SHORT, "--out", f"none_{number}", cwd=tmp_path)
        assert refused.returncode == 3
        # It believes nothing that it hears, and says nothing.
        assert "the brain does not answer" in refused.stderr
        assert "start it before the drive" in refused.stderr


def _key(program: str, file: Path) -> list[str]:
    return [str(file)] if program.startswith("minimal") else ["--key", str(file)]


@pytest.mark.slow
def test_a_stray_datagram_before_the_brain_does_not_lock_it_out(tmp_path: Path) -> None:
    ports = write_rig(tmp_path)
    words = _commands("minimal.py", tmp_path, ports)
    over = threading.Event()

    def stray() -> None:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
            while not over.wait(0.002):  # from before the port is open: the first that it hears
                stranger.sendto(b"whoever is there", ("127.0.0.1", ports[2]))

    thread = threading.Thread(target=stray)
    thread.start()
    try:
        with running(words, ports[1]):
            assert _driven(tmp_path, "one")[1] > 3.0, "the brain did not drive"
    finally:
        over.set()
        thread.join()


@pytest.mark.thorough
def test_brain_that_is_not_there_is_one_line_and_no_record(tmp_path: Path) -> None:
    write_rig(tmp_path, deadline=0.2)
    done = command("drive", "parked_car", *SHORT, "--out", "none", cwd=tmp_path)
    assert done.returncode == 3
    line = done.stderr.strip()
    assert "\n" not in line
    assert "no answer within 0.2 s" in line
    assert "start it before the drive" in line
    assert not (tmp_path / "none").exists()


def test_a_recorded_drive_has_no_brain(tmp_path: Path) -> None:
    write_rig(tmp_path)
    done = command("drive", "parked_car", *SHORT, "--pose", "walk.csv", "--out", "none", cwd=tmp_path)
    assert done.returncode == 2
    assert done.stderr.strip().endswith(
        "--pose: a recorded drive has no external controller, and brain.kind of the rig is 'setpoints'; "
        "leave out one of --pose and --rig"
    )
    assert not (tmp_path / "none").exists()


def test_a_controller_beside_a_brain_is_refused(tmp_path: Path) -> None:
    write_rig(tmp_path)
    for how in (("--lockstep",), ()):
        words = ("drive", "parked_car", *how, "--rig", "foreign.toml", "--controller", "follow_and_stop")
        done = command(*words, "--out", "none", cwd=tmp_path)
        assert done.returncode == 2
        assert done.stderr.strip().endswith(
            "--controller: the rig's brain decides (brain.kind is 'setpoints'); leave it out"
        )
        assert not (tmp_path / "none").exists()


@pytest.mark.thorough
def test_brain_that_falls_silent_stops_the_car_with_a_reason(tmp_path: Path) -> None:
    gnss, radar, setpoints = write_rig(tmp_path, deadline=0.5)
    del gnss
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as end:
        end.bind(("127.0.0.1", radar))
        end.settimeout(60.0)
        thread = threading.Thread(target=_answer, args=(end, setpoints, 250))
        thread.start()
        done = command(
            "drive", "parked_car", "--lockstep", "--rig", "foreign.toml", "--quiet", "--out", "a", cwd=tmp_path
        )
        thread.join()
    assert done.returncode == 1, done.stderr
    summary = json.loads((tmp_path / "a" / "summary.json").read_text(encoding="utf-8"))
    assert "brain_overdue" in summary["reasons"]
    assert "no answer within 0.5 s" in summary["text"]
    assert summary["outcome"] == "fault"
    speed = Run(tmp_path / "a").arrow("ticks")["true_speed_mps"].to_numpy()
    assert speed.max() > 1.0
    assert abs(speed[-1]) < 0.05


def _answer(end: socket.socket, port: int, count: int) -> None:
    """Accelerate for so many answers, then never answer again."""
    for _ in range(count):
        heard: RadarDatagram | None = None
        while heard is None or not heard.valid:
            heard = decode_radar(end.recv(2048))
        asked = SetpointDatagram(heard.sequence, heard.sequence, heard.time, 0.1, 0.0, 1.0)
        end.sendto(encode_setpoint(asked), ("127.0.0.1", port))
