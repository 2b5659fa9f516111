"""Brains side by side, and certificates that were interrupted: what was driven is kept, and nothing else."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tests.certify.toy_street import SPEED
from tests.conftest import REPOSITORY
from vve_sumo.certify import kept
from vve_sumo.certify.kept import WireSummary
from vve_sumo.certify.link import Answer, Window
from vve_sumo.certify.places import has_places, place_of, places_of
from vve_sumo.certify.pool import Pool
from vve_sumo.errors import ConfigError, RigError, SimulationError
from vve_sumo.rig.load import load as load_rig
from vve_sumo.rig.schema import Rig

COMMAND = "./brain --see {radar} --place {ncom} --say {setpoints}"


@pytest.fixture
def rig() -> Rig:
    return load_rig(REPOSITORY / "rigs" / "foreign.toml", REPOSITORY)


def test_the_rigs_own_place_has_its_own_ports(rig: Rig) -> None:
    assert place_of(rig, COMMAND).command == "./brain --see 5002 --place 5001 --say 5003"
    assert place_of(rig, COMMAND).ports == {5001: "ncom", 5002: "radar"}
    assert place_of(rig, None).command is None
    with pytest.raises(ConfigError, match=r"\{esr\} stands for no wire of the rig, expected one of \{setpoints\}"):
        place_of(rig, "./brain {esr}")


def test_places_share_no_port_and_no_link(rig: Rig) -> None:
    bus = rig.outputs[0].model_copy(update={"kind": "esr", "udp": None, "interface": "slcan", "channel": "pty:esr.pty"})
    rig = rig.model_copy(update={"outputs": (*rig.outputs, bus)})
    places = places_of(rig, COMMAND + " --bus {esr}", 3)
    ports = [port for place in places for port in (*place.ports, place.rig.brain.port)]
    assert len(set(ports)) == 9
    assert {(place.command or "").rpartition(" ")[2] for place in places} == {f"esr.pty.{n}" for n in range(3)}
    for place in places:
        said = (place.command or "").split()
        by_kind = {kind: port for port, kind in place.ports.items()}
        assert [said[2], said[4], said[6]] == [str(by_kind["radar"]), str(by_kind["ncom"]), str(place.rig.brain.port)]


@pytest.mark.parametrize(
    ("command", "said"),
    [
        (None, "expected --brain"),
        ("./brain", r"expected \{ncom\} in the brain's command, in the place of 5001"),
        ("./brain {ncom} {radar}", r"expected \{setpoints\} in the brain's command, in the place of 5003"),
    ],
)
def test_brains_that_would_meet_on_a_port_are_refused(rig: Rig, command: str | None, said: str) -> None:
    assert not has_places(rig, command)
    assert has_places(rig, COMMAND)
    with pytest.raises(ConfigError, match=f"--workers 2: {said}"):
        places_of(rig, command, 2)
    assert len(places_of(rig, command, 1)) == 1


def test_all_jobs_are_driven_and_those_that_follow(tmp_path: Path) -> None:
    def drive(job: int) -> None:
        (tmp_path / f"{job}").write_text(str(os.getpid()))

    over: list[int] = []

    def done(job: int) -> list[int]:
        assert (tmp_path / f"{job}").exists()
        over.append(job)
        return [10 * job, 10 * job + 1] if job < 10 else []

    pool: Pool[int] = Pool([drive, drive])
    try:
        pool.run([1, 2, 3], done)
    finally:
        pool.close()
    assert sorted(over) == [1, 2, 3, 10, 11, 20, 21, 30, 31]
    assert os.getpid() not in {int(file.read_text()) for file in tmp_path.iterdir()}


def _fails(job: str) -> None:
    if job == "dies":
        os.kill(os.getpid(), signal.SIGKILL)
    raise RigError("no port")


@pytest.mark.parametrize(("job", "error"), [("dies", SimulationError), ("raises", RigError)])
def test_what_a_worker_raises_is_raised_and_one_that_dies_is_said(job: str, error: type[Exception]) -> None:
    pool: Pool[str] = Pool([_fails])
    try:
        with pytest.raises(error):
            pool.run([job], lambda _job: [])
    finally:
        pool.close()


INTERRUPTED = """
import os, sys, time
from pathlib import Path
from vve_sumo.certify.pool import Pool
def drive(job):
    try:
        Path(sys.argv[1], "begun").touch()
        time.sleep(60.0)
    finally:
        time.sleep(0.3)  # a second signal must not cut the end short
        Path(sys.argv[1], "ended").touch()
pool = Pool([drive])
try:
    pool.run([1], lambda job: [])
finally:
    pool.close()
"""


def test_an_interrupt_ends_the_brain_of_every_worker(tmp_path: Path) -> None:
    process = subprocess.Popen(
        [sys.executable, "-c", INTERRUPTED, str(tmp_path)], cwd=REPOSITORY, start_new_session=True
    )
    limit = time.monotonic() + 60.0
    while not (tmp_path / "begun").exists() and time.monotonic() < limit:
        time.sleep(0.02)
    os.killpg(process.pid, signal.SIGINT)  # as a terminal does: to all of the group
    assert process.wait(30.0) != 0
    assert (tmp_path / "ended").exists()


def test_a_drive_is_kept_only_with_its_own_window(tmp_path: Path) -> None:
    answers = [Answer(0.06000000000000001, 3, 4, 0.1, -1.5)]
    wire_summary = WireSummary(8.1, {"setpoint_late": 2}, 40, ("ncom",))
    assert kept.wire_summary_of(tmp_path, Window(8.1, 9.0)) is None
    kept.keep(tmp_path, answers, wire_summary)
    assert kept.wire_summary_of(tmp_path, Window(8.1, 9.0)) == wire_summary
    assert kept.wire_summary_of(tmp_path, Window(8.2, 9.0)) is None
    assert kept.wire_summary_of(tmp_path, None) is None
    assert kept._answers(tmp_path / kept.ANSWERS) == [Answer(0.06, 3, 4, 0.1, -1.5)]
    (tmp_path / kept.DRIVE).write_text('{"begins": 8.1')
    assert kept.wire_summary_of(tmp_path, Window(8.1, 9.0)) is None


def test_only_the_same_query_is_gone_on_with(tmp_path: Path) -> None:
    out, asked = tmp_path / "out", {"brain": "./brain", "values": {"speed": SPEED}}
    with pytest.raises(ConfigError, match=r"--resume: .*expected a folder with the query\.json"):
        kept.begin(out, asked, resume=True)
    assert not out.exists()
    kept.begin(out, asked, resume=False)
    kept.begin(out, asked, resume=True)
    with pytest.raises(ConfigError, match=r"query\.json: brain: was begun with './brain', got './other'"):
        kept.begin(out, asked | {"brain": "./other"}, resume=True)
    with pytest.raises(ConfigError, match=r"is not empty.*--resume"):
        kept.begin(out, asked, resume=False)
    assert json.loads((out / kept.QUERY).read_text()) == asked
