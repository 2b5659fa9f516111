"""What the bench itself does: a brain's process ends with all that it started, and none is waited for too long."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from tests.conftest import REPOSITORY
from tests.live.patience import until
from tests.live.stage import free_ports
from vve_sumo.analysis import load
from vve_sumo.certify.brain_process import BrainProcess
from vve_sumo.certify.cases import CASES, NAMES, select_cases
from vve_sumo.certify.limits import CertificateLimits
from vve_sumo.certify.link import FaultLink
from vve_sumo.certify.report import reproduce_command
from vve_sumo.certify.results import BrainUnderTest, CaseResult, CaseVerdict, Certificate
from vve_sumo.certify.run import CertificateDesign, CertifyQuery, certify
from vve_sumo.cli.parser import setting
from vve_sumo.errors import ConfigError, RigError, SimulationError, VveError
from vve_sumo.pose.sources import open_udp
from vve_sumo.record.sweep_folder import SweepPlan
from vve_sumo.sweep.dataset import Dataset
from vve_sumo.sweep.engine import Local
from vve_sumo.sweep.job import RunResult
from vve_sumo.wire.datagrams import SetpointDatagram, encode_setpoint
from vve_sumo.wire.signature import signed

FOREIGN = str(REPOSITORY / "rigs" / "foreign.toml")
#: listens on a port, and does not end when it is asked to
STUBBORN = """
import signal, socket, sys
signal.signal(signal.SIGTERM, signal.SIG_IGN)
end = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
end.bind(("127.0.0.1", int(sys.argv[1])))
end.recv(1)
"""


def _foreign_rig(folder: Path) -> int:
    """Write `foreign.toml` with free ports into a folder; return the radar's."""
    ports = free_ports(3)
    text = Path(FOREIGN).read_text(encoding="utf-8")
    for port, free in zip(("5001", "5002", "5003"), ports, strict=True):
        text = text.replace(port, str(free))
    (folder / "foreign.toml").write_text(text, encoding="utf-8")
    return int(text.partition('kind = "radar"')[2].partition("127.0.0.1:")[2].partition('"')[0])


def _is_listened_on(port: int) -> bool:
    return f":{port:04X} " in Path("/proc/net/udp").read_text(encoding="ascii")


def test_a_launchers_brain_ends_with_the_case(tmp_path: Path) -> None:
    (port,) = free_ports(1)
    (tmp_path / "brain.py").write_text(STUBBORN, encoding="utf-8")
    launcher = tmp_path / "launcher.sh"
    launcher.write_text(f"{sys.executable} {tmp_path / 'brain.py'} {port} &\nwait\n", encoding="utf-8")
    process = BrainProcess(f"sh {launcher}", [port], tmp_path / "brain.log", tmp_path)
    assert process.wait_until_it_listens([port]) == frozenset()
    process.close()
    limit = time.monotonic() + 5.0
    while _is_listened_on(port) and time.monotonic() < limit:
        time.sleep(0.01)
    assert not _is_listened_on(port)


@pytest.mark.thorough
def test_an_interrupt_of_a_certificate_ends_its_brain(tmp_path: Path) -> None:
    radar = _foreign_rig(tmp_path)
    (tmp_path / "brain.py").write_text(STUBBORN, encoding="utf-8")
    brain = f"{sys.executable} {tmp_path / 'brain.py'} {{radar}}"
    command = ["certify", "--rig", "foreign.toml", "--brain", brain, "--out", "out"]
    process = subprocess.Popen(
        [sys.executable, "-P", "-m", "vve_sumo.cli", *command],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(REPOSITORY)},
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    until(lambda: _is_listened_on(radar), 120.0)
    os.killpg(process.pid, signal.SIGINT)  # as a terminal does: to all of the group
    _, said = process.communicate(timeout=60.0)
    assert (process.returncode, "--out out --resume" in said) == (130, True), said
    assert not _is_listened_on(radar)


@pytest.mark.parametrize(("command", "line"), [("", "got nothing"), ("  ", "got nothing"), ("nowhere", "cannot be")])
def test_a_command_that_starts_nothing_is_one_line(command: str, line: str, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=f"--brain: .*{line}"):
        BrainProcess(command, [], tmp_path / "brain.log", tmp_path)


@pytest.mark.parametrize("there", [False, True])
def test_a_brain_that_cannot_be_started_leaves_nothing_behind(there: bool, tmp_path: Path) -> None:
    rig = tmp_path / "foreign.toml"
    rig.write_text((REPOSITORY / "rigs" / "foreign.toml").read_text(encoding="utf-8"), encoding="utf-8")
    out = tmp_path / "out"
    query = CertifyQuery(str(rig), "parked_car", "nowhere", select_cases(["radar_gap"]), (1,), out, {})
    if there:
        out.mkdir()
    with pytest.raises(ConfigError, match="'nowhere' cannot be started"):
        certify(query, tmp_path, lambda _case: None, lambda _tally: None)
    assert out.exists() is there
    assert not there or not any(out.iterdir())


@pytest.mark.parametrize(
    ("error", "kind", "line"),
    [
        ("config: --brain: no", ConfigError, "--brain: no"),
        ("rig: port 1", RigError, "port 1; 0 of {n} runs are finished"),
        ("broken: it", SimulationError, "case nominal: broken: it; 0 of {n} runs"),
    ],
)
def test_a_drive_that_broke_ends_the_certificate(
    error: str, kind: type[VveError], line: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Wrong input leaves nothing behind; what broke later can be continued."""
    query = CertifyQuery(FOREIGN, "parked_car", None, select_cases(["radar_gap"]), (1,), tmp_path / "out", {})
    monkeypatch.setattr(
        Local, "run", lambda _engine, jobs, done: done(job := next(jobs), RunResult(job.key, error=error))
    )
    with pytest.raises(kind, match=line.format(n=2)):
        certify(query, tmp_path, lambda _case: None, lambda _tally: None)
    assert query.out.exists() is (kind is not ConfigError)


@pytest.mark.thorough
@pytest.mark.parametrize("brain", [None, "./brain"])
def test_a_brain_that_no_drive_can_start_is_exit_code_2_and_leaves_nothing(brain: str | None, tmp_path: Path) -> None:
    """It is no program although it is executable, or nobody is there to start it."""
    (tmp_path / "brain").write_text("neither a script nor a program\n", encoding="utf-8")
    (tmp_path / "brain").chmod(0o755)
    _foreign_rig(tmp_path)
    command = ["certify", "--rig", "foreign.toml", "--out", "out", *(["--brain", brain] if brain else [])]
    done = subprocess.run(
        [sys.executable, "-P", "-m", "vve_sumo.cli", *command],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(REPOSITORY)},
        stdin=subprocess.DEVNULL,
        capture_output=True,
        check=False,
        text=True,
        timeout=120.0,
    )
    assert done.returncode == 2, done.stderr
    assert "--brain: " in done.stderr.splitlines()[-1]
    assert "Traceback" not in done.stderr
    assert not (tmp_path / "out").exists()


def test_a_certificate_that_never_began_is_not_continued(tmp_path: Path) -> None:
    query = CertifyQuery(FOREIGN, "parked_car", None, select_cases([]), (1,), tmp_path / "out", {}, resume=True)
    with pytest.raises(ConfigError, match="expected the folder of a begun certificate"):
        certify(query, tmp_path, lambda _case: None, lambda _tally: None)
    assert not query.out.exists()


@pytest.mark.thorough
def test_drives_of_another_car_or_another_road_are_in_no_one_certificate(tmp_path: Path) -> None:
    """The rig's and the scenario's own files stay as they are; what they name changes."""
    for folder, name in (("rigs", "foreign.toml"), ("scenarios", "parked_car.toml"), ("vehicles", "ford_fusion.toml")):
        (tmp_path / folder).mkdir()
        text = (REPOSITORY / folder / name).read_text(encoding="utf-8")
        (tmp_path / folder / name).write_text(text, encoding="utf-8")
    query = CertifyQuery("foreign", "parked_car", None, select_cases(["radar_gap"]), (1,), tmp_path / "out", {})

    def plan() -> SweepPlan:
        return CertificateDesign(query, tmp_path, lambda _case: None).plan

    before = plan()
    assert plan() == before
    car = tmp_path / "vehicles" / "ford_fusion.toml"
    car.write_text(car.read_text(encoding="utf-8").replace("mass_kg = 1690.0", "mass_kg = 1990.0"), encoding="utf-8")
    heavier = plan()
    Dataset(query.out, before, resume=False).close()
    with pytest.raises(ConfigError, match=r"the file of vehicle has changed since that certificate began"):
        Dataset(query.out, heavier, resume=True)
    (tmp_path / "routes").mkdir()
    routes = [file for file in (REPOSITORY / "routes").iterdir() if file.suffix == ".csv"]
    for file in routes:
        rows = file.read_text(encoding="utf-8").splitlines(keepends=True)
        (tmp_path / "routes" / file.name).write_text("".join(rows[:-1]), encoding="utf-8")
    assert plan().files_sha256["path"] != heavier.files_sha256["path"]


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"command": "./other"}, "its brain differs"),
        ({"values": {"ego.speed_mps": 9}}, "its values differs"),
        ({"scenario": "delay_probe"}, "its scenario differs"),
    ],
)
def test_only_the_same_certificate_is_continued(changes: dict[str, Any], said: str, tmp_path: Path) -> None:
    for program in ("brain", "other"):
        (tmp_path / program).write_text("#!/bin/sh\n", encoding="utf-8")
        (tmp_path / program).chmod(0o755)
    query = CertifyQuery(FOREIGN, "parked_car", "./brain", select_cases(["radar_gap"]), (1,), tmp_path / "out", {})

    def opened(**changes: Any) -> None:
        plan = CertificateDesign(replace(query, **changes), tmp_path, lambda _case: None).plan
        Dataset(query.out, plan, resume=query.out.exists()).close()

    opened()
    opened(seeds=(1, 2), cases=select_cases(["target_ghost"]), limits=CertificateLimits(max_deviation_m=0.3))
    with pytest.raises(ConfigError, match=said):
        opened(**{"seeds": (1, 2), **changes})
    (tmp_path / "brain").write_text("#!/bin/sh\nanother\n", encoding="utf-8")
    with pytest.raises(ConfigError, match=r"the file of brain, \./brain has changed"):
        opened(seeds=(1, 2))


def test_a_certificate_of_an_earlier_version_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "cases").mkdir()
    (tmp_path / "query.json").write_text("{}", encoding="utf-8")
    with pytest.raises(ConfigError, match="the layout that a certificate of an earlier vve-sumo left"):
        load(tmp_path)
    query = CertifyQuery(FOREIGN, "parked_car", None, select_cases(["radar_gap"]), (1,), tmp_path, {}, resume=True)
    with pytest.raises(ConfigError, match="the layout that a certificate of an earlier vve-sumo left"):
        certify(query, tmp_path, lambda _case: None, lambda _tally: None)


def test_a_brain_is_waited_for_as_long_as_the_rig_says_and_then_only_while_it_thinks() -> None:
    looks: list[float] = []

    def quiet() -> bool:
        looks.append(time.monotonic())
        return True

    link = FaultLink((), open_udp("127.0.0.1", 0, None, "brain"), None, quiet, timeout=0.1)
    begun = time.monotonic()
    assert link.receive(0.0, True) == []
    assert time.monotonic() - begun >= 0.1
    assert looks == []
    assert link.receive(0.02, True) == []
    assert len(looks) == 1
    link.close()


def test_an_answer_that_is_signed_is_read_and_a_forged_one_is_not() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as brain:
        (port,) = free_ports(1)
        link = FaultLink((), open_udp("127.0.0.1", port, None, "brain"), None, lambda: True, 5.0, b"secret")
        asked = encode_setpoint(SetpointDatagram(1, 7, 0.0, 0.1, 0.25, -8.0))
        for data in (asked, signed(asked, b"other"), signed(asked, b"secret")):
            brain.sendto(data, ("127.0.0.1", port))
            link.receive(0.0, True)
        link.close()
    assert [(one.answers, one.acceleration) for one in link.answers] == [(7, -8.0)]


def _certificate(**other: object) -> Certificate:
    values: dict[str, object] = {
        "rig": "foreign", "rig_argument": "mine/foreign.toml", "rig_sha256": "", "scenario": "parked_car", "values": {},
        "brain": BrainUnderTest("./brain --fast", {}), "wires": ("radar",), "seeds": (1, 2), "cases": NAMES,
        "limits": CertificateLimits(),
        "results": (), "defects": (), "software": {}, "began_utc": "",
    }  # fmt: skip
    return Certificate(**(values | other))  # type: ignore[arg-type]


def test_the_command_that_drives_it_again_has_the_same_rig_cases_and_values() -> None:
    asked = "vve-sumo certify parked_car --rig mine/foreign.toml --seeds 2"
    assert reproduce_command(_certificate()) == f"{asked} --brain './brain --fast'"
    select_cases = reproduce_command(_certificate(cases=("nominal", "radar_gap"), brain=BrainUnderTest("", {})))
    assert select_cases == f"{asked} --cases nominal,radar_gap"
    stricter = reproduce_command(
        _certificate(limits=CertificateLimits(max_deviation_m=0.3), brain=BrainUnderTest("", {}))
    )
    assert stricter == f"{asked} --limit max_deviation_m=0.3"


def test_what_was_not_tested_is_not_passed() -> None:
    def with_verdicts(*verdicts: CaseVerdict) -> Certificate:
        return _certificate(results=tuple(CaseResult(CASES[0], n, verdict) for n, verdict in enumerate(verdicts)))

    assert with_verdicts(CaseVerdict.PASSED, CaseVerdict.NOT_APPLICABLE).verdict == "passed"
    assert with_verdicts(CaseVerdict.PASSED, CaseVerdict.VOID).verdict == "INCOMPLETE"
    assert not with_verdicts(CaseVerdict.PASSED, CaseVerdict.VOID).passed
    assert with_verdicts(CaseVerdict.FAILED, CaseVerdict.VOID).verdict == "FAILED"


@pytest.mark.thorough
def test_a_brain_that_sees_by_radar_alone_need_not_listen_elsewhere(tmp_path: Path) -> None:
    """Ports that it has not opened when it waits are those of wires that it does not use; the radar's it must open."""
    radar, gnss = free_ports(2)
    (tmp_path / "brain.py").write_text(STUBBORN, encoding="utf-8")
    command = f"{sys.executable} {tmp_path / 'brain.py'} {radar}"
    process = BrainProcess(command, [radar, gnss], tmp_path / "brain.log", tmp_path)
    try:
        assert process.wait_until_it_listens([radar]) == {gnss}
    finally:
        process.close()


@pytest.mark.parametrize("value", [True, 12, 0.5, "25 mph", [1, 2], ["a", "b"]])
def test_a_value_is_set_again_as_it_was(value: object) -> None:
    words = reproduce_command(_certificate(values={"key": value}, brain=BrainUnderTest("", {}))).partition("--set ")[2]
    assert setting(words.strip("'")) == ("key", value)
