"""Whole certificates in lockstep over real sockets, with the shipped brains as processes of their own."""

from __future__ import annotations

import json
import re
import shutil
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from tests.conftest import REPOSITORY
from tests.drive.street import drive_once
from tests.exhaustive import with_slow
from tests.isolated import isolated
from tests.live.patience import until
from tests.live.stage import free_ports
from tests.vehicles import FUSION
from vve_sumo import controller, workspace
from vve_sumo.analysis import load
from vve_sumo.certify import run
from vve_sumo.certify.cases import select_cases
from vve_sumo.certify.limits import CertificateLimits
from vve_sumo.certify.run import CertifyQuery
from vve_sumo.errors import ConfigError
from vve_sumo.record.sweep_folder import SweepPlan
from vve_sumo.report.write import report_of

#: a street with a bend, so that every case can be tested, and short
STREET = REPOSITORY / "examples" / "brains" / "street"
SCENARIO = str(STREET / "certificate.toml")
#: program of a brain and its first words, a case that it must pass, the cases that show its bug, a part of its name
BUGS = [
    ("acts_on_invalid", "", ("radar_invalid",), "acts on radar marked invalid"),
    ("acts_on_invalid", "radar_drop_out", ("radar_invalid",), "acts on radar marked invalid"),
    ("mirrors_azimuth", "", ("target_bend_in_way", "target_bend_mirrored"), "azimuth is mirrored"),
]


def certified(brain: str, folder: Path, cases: str, *more: str) -> tuple[int, dict[str, Any]]:
    """Certify a shipped brain on two workers; return the exit code and the certificate."""
    done = certify(brain, folder, cases, *more)
    assert done.returncode in (0, 1), done.stderr
    return done.returncode, json.loads((folder / "out" / "certificate.json").read_text(encoding="utf-8"))


def certify(brain: str, folder: Path, cases: str, *more: str) -> subprocess.CompletedProcess[str]:
    """Run the certificate of a shipped brain on two workers."""
    gnss, radar, setpoints = free_ports(3)
    rig = folder / "foreign.toml"
    text = (
        (REPOSITORY / "rigs" / "simulated.toml").read_text(encoding="utf-8")
        + f'\n[brain]\nkind = "setpoints"\nport = {setpoints}\n'
        + f'\n[[outputs]]\nkind = "ncom"\nudp = "127.0.0.1:{gnss}"\n'
        + f'\n[[outputs]]\nkind = "radar"\nudp = "127.0.0.1:{radar}"\n'
    )
    if not rig.exists():
        rig.write_text(text, encoding="utf-8")
    words = f"{sys.executable} {REPOSITORY / 'examples' / 'brains'}/{brain} {STREET / 'bend.csv'} --speed 9"
    words += " --gnss {ncom} --radar {radar} --setpoints {setpoints}"
    out = folder / "out"
    options = ["--rig", str(rig), "--brain", words, "--out", str(out), "--workers", "2", *more]
    options += ["--cases", cases] if cases else []
    return subprocess.run(
        [sys.executable, "-m", "vve_sumo.cli", "certify", SCENARIO, *options],
        cwd=REPOSITORY,
        check=False,
        capture_output=True,
        text=True,
        timeout=7200.0,
    )


@pytest.mark.thorough
@pytest.mark.parametrize(("brain", "passes", "fails", "defect"), with_slow(BUGS, lambda bug: bug is BUGS[0]))
def test_a_planted_bug_is_caught_and_named(
    brain: str, passes: str, fails: tuple[str, ...], defect: str, tmp_path: Path
) -> None:
    cases = ",".join(filter(None, (passes, *fails)))
    code, certificate = certified(f"planted_bug.py {brain}", tmp_path, cases)
    verdicts = {result["case"]: result["verdict"] for result in certificate["results"]}
    assert code == 1
    assert [defect in one["name"] for one in certificate["defects"]] == [True]
    assert {name for name, verdict in verdicts.items() if verdict == "FAILED"} == set(fails)
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert defect in page
    assert (tmp_path / "out" / "records" / f"{fails[0]}_seed_1" / "summary.json").is_file()
    rows = load(tmp_path / "out").rows().set_index("case")
    assert rows["verdict"].to_dict() == verdicts
    assert not any(rows.loc[list(fails), "passed"])
    # Other limits judge what was driven anew, and drive nothing.
    before = {record: record.stat().st_mtime_ns for record in (tmp_path / "out" / "records").iterdir()}
    _, stricter = certified(f"planted_bug.py {brain}", tmp_path, cases, "--resume", "--limit", "max_left_m=1.1")
    assert {result["case"]: result["verdict"] for result in stricter["results"]}["nominal"] == "FAILED"
    assert {record: record.stat().st_mtime_ns for record in (tmp_path / "out" / "records").iterdir()} == before
    assert load(tmp_path / "out").rows().set_index("case").loc["nominal", "why"].endswith("required 1 to 1.1 m")
    with pytest.raises(ConfigError, match=r"report\.html is the certificate"):
        report_of(tmp_path / "out")
    _the_nominal_case_alone_is_continued_with_further_limits(tmp_path, brain)
    _another_record_is_refused(tmp_path, brain, fails[0])


def _the_nominal_case_alone_is_continued_with_further_limits(folder: Path, brain: str) -> None:
    """Every finished case is judged by the limits that the plan states, also one that was not asked for again."""
    before = load(folder / "out").rows().set_index("case")
    _, nominal = certified(f"planted_bug.py {brain}", folder, "nominal", "--resume", "--limit", "max_deviation_m=0.001")
    assert [result["case"] for result in nominal["results"]] == ["nominal"]
    plan = SweepPlan.of(folder / "out")
    assert (plan.spec["cases"], plan.spec["limits"]["max_deviation_m"]) == (before.index.tolist(), 0.001)
    rows = load(folder / "out").rows().set_index("case")
    assert rows.index.tolist() == before.index.tolist()
    assert all("0.001 m" in why for why in rows["why"])
    assert not any("0.001 m" in why for why in before["why"])


def _another_record_is_refused(folder: Path, brain: str, case: str) -> None:
    out = folder / "out"
    nominal, other = (out / "records" / f"{name}_seed_1" for name in ("nominal", case))
    kept = {file: file.read_bytes() for file in sorted(out.rglob("*")) if file.is_file()}

    command = SweepPlan.of(out).spec["brain"]
    limits = CertificateLimits(max_left_m=9.0)
    query = CertifyQuery(
        str(folder / "foreign.toml"), SCENARIO, command, select_cases([case]), (1,), out, {}, limits, resume=True
    )

    def refused(line: str) -> None:
        with pytest.raises(ConfigError, match=re.escape(line)):
            run.certify(query, REPOSITORY, lambda _case: None, lambda _tally: None)
        assert (out / "sweep.json").read_bytes() == kept[out / "sweep.json"]

    # A program may have loaded the scenario's controller before, which the command that began this had not.
    controller.load("follow_and_stop", FUSION.vehicle, {}, workspace.controller_folders(REPOSITORY))
    nominal.rename(folder / "nominal")
    isolated(drive_once, {"duration_s": 1.0}, str(nominal))
    refused(f"{nominal}: not as the certificate's drive left it: it is the record of another drive")
    shutil.rmtree(nominal)
    (folder / "nominal").rename(nominal)
    (other / "setpoints.csv").write_bytes(kept[other / "setpoints.csv"].replace(b"-0.0", b"-0.1", 1))
    refused(f"{other}: not as the certificate's drive left it: setpoints.csv")
    (other / "setpoints.csv").write_bytes(kept[other / "setpoints.csv"])
    (other / "summary.json").write_bytes(kept[other / "summary.json"].replace(b"0", b"1", 1))
    refused(f"{other}: not as the certificate's drive left it: summary.json")
    shutil.rmtree(other)
    refused(f"{other}: not as the certificate's drive left it: its record is gone or was cut off")


@pytest.mark.slow
@pytest.mark.parametrize("brain", ["stop_for_parked", "stanley_idm", "pursuit_headway"])
def test_the_right_brains_pass_every_case(brain: str, tmp_path: Path) -> None:
    code, certificate = certified(f"{brain}.py", tmp_path, "")
    assert [one for one in certificate["results"] if one["verdict"] not in ("passed", "not applicable")] == []
    assert (code, certificate["defects"]) == (0, [])
    assert certificate["limits"]["max_deviation_m"] == 0.5


def minimal(folder: Path, *more: str, rig: str | None = None) -> subprocess.Popen[str]:
    """Start the certificate of the brain that hears radar datagrams alone, by a rig that has NCOM as well.

    The rig is a new one with free ports, or has the text of one of before.
    """
    gnss, radar, setpoints = free_ports(3)
    text = (REPOSITORY / "rigs" / "foreign.toml").read_text(encoding="utf-8")
    for port, free in ((5001, gnss), (5002, radar), (5003, setpoints)):
        text = text.replace(str(port), str(free))
    (folder / "foreign.toml").write_text(rig or text, encoding="utf-8")
    brain = f"{sys.executable} {REPOSITORY / 'examples' / 'brains' / 'minimal.py'} {{radar}} {{setpoints}}"
    options = ["--rig", str(folder / "foreign.toml"), "--brain", brain, "--out", str(folder / "out"), *more]
    return subprocess.Popen(
        [sys.executable, "-m", "vve_sumo.cli", "certify", str(STREET / "straight.toml"), *options],
        cwd=REPOSITORY,
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )


@pytest.mark.slow
def test_a_brain_by_radar_alone_is_certified_also_after_an_interrupt(tmp_path: Path) -> None:
    cases = ["--cases", "radar_invalid,gnss_drop_out,radar_delay,target_bend_mirrored"]
    first = minimal(tmp_path, *cases)
    nominal = tmp_path / "out" / "records" / "nominal_seed_1" / "summary.json"
    journal = tmp_path / "out" / "journal.jsonl"
    until(lambda: nominal.exists() and journal.stat().st_size > 0, 600.0)
    first.send_signal(signal.SIGINT)
    _, said = first.communicate(timeout=120.0)
    assert (first.returncode, "--resume" in said) == (130, True), said
    driven = nominal.stat().st_mtime_ns
    rig = (tmp_path / "foreign.toml").read_text(encoding="utf-8")

    again = minimal(tmp_path, *cases, "--resume")  # other ports: another rig
    _, said = again.communicate(timeout=120.0)
    assert (again.returncode, "the file of rig has changed since that certificate began" in said) == (2, True), said

    last = minimal(tmp_path, *cases, "--resume", rig=rig)
    _, said = last.communicate(timeout=1800.0)
    assert last.returncode == 1, said
    certificate = json.loads((tmp_path / "out" / "certificate.json").read_text(encoding="utf-8"))
    verdicts = {result["case"]: result["verdict"] for result in certificate["results"]}
    assert verdicts == {
        "nominal": "passed",
        "radar_invalid": "passed",
        "radar_delay": "not applicable",
        "gnss_drop_out": "not applicable",
        "target_bend_mirrored": "VOID",
    }
    assert (certificate["passed"], certificate["verdict"]) == (False, "INCOMPLETE")
    assert nominal.stat().st_mtime_ns == driven
