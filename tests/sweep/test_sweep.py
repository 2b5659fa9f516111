"""Whole sweeps of real drives: killed and resumed, rerun, refused."""

from __future__ import annotations

import json
import os
import random
import shutil
import signal
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path

import pytest

from tests.conftest import REPOSITORY
from tests.exhaustive import with_slow
from tests.sweep.reading import load_rows
from vve_sumo.cli import main
from vve_sumo.cli.sweep import rerun
from vve_sumo.errors import ConfigError
from vve_sumo.metrics.table import FIGURES
from vve_sumo.record.sweep_folder import SweepPlan
from vve_sumo.sweep.plan import query_of

#: drives straight on for a second, notes that it began, and on one mark takes the process with it
CONTROLLER = """
import ctypes
from pathlib import Path
from vve_sumo.values import ControlCommand


class Marked:
    def __init__(self, mark):
        self.mark, self.begun = mark, False

    def step(self, observation):
        if not self.begun:
            with Path(__file__).with_name("begun.txt").open("a") as file:
                file.write(f"{self.mark}\\n")
        self.begun = True
        if self.mark == 3:
            ctypes.string_at(0)
        return ControlCommand(0.0, 1.0)


def make(vehicle, tuning):
    if set(tuning) - {"mark"}:
        from vve_sumo.errors import ConfigError
        raise ConfigError("tuning key 'wrong' is unknown")
    return Marked(tuning["mark"])
"""
SCENARIO = """
title = "A second straight on"
duration_s = 1.0
road.network = "proving_ground"
ego.path = "proving_ground"
ego.speed_mps = 5.0
ego.lot = { latitude_deg = 40.0, longitude_deg = -83.0, heading_deg = 85.0 }
controller = { name = "marked", tuning = { mark = 0 } }
criteria = { duration_s = { max = 9.0 } }
parameters.mark = { sets = ["controller.tuning.mark"], min = 0, max = 100 }
"""
MARKS = 16
#: mark 1 fails its criterion, mark 3 crashes
SWEEP = f"""
scenario = "second"
design = "list"
parameters = {{ mark = {[*range(MARKS)]}, criteria.duration_s.max = {[9.0, 0.1, *[9.0] * (MARKS - 2)]} }}
"""


def workspace(folder: Path) -> Path:
    for place, text in {
        "controllers/marked.py": CONTROLLER, "scenarios/second.toml": SCENARIO, "sweeps/marks.toml": SWEEP
    }.items():  # fmt: skip
        (folder / place).parent.mkdir(exist_ok=True, parents=True)
        (folder / place).write_text(text, encoding="utf-8")
    return folder


def begun(folder: Path) -> Counter[int]:
    """How often a drive with each mark was begun."""
    file = folder / "controllers" / "begun.txt"
    return Counter(map(int, file.read_text().split())) if file.exists() else Counter()


def swept(name: str, out: Path, *, keep: str | None = None, resume: bool = False) -> int:
    options = [*(("--keep-records", keep) if keep else ()), *(("--resume",) if resume else ())]
    return main(["sweep", name, "--out", str(out), "--workers", "1", "--quiet", *options])


def content(folder: Path) -> dict[str, bytes]:
    files = (file for file in sorted(folder.rglob("*")) if file.is_file() and "machine" not in file.parts)
    return {str(file.relative_to(folder)): file.read_bytes() for file in files if "records" not in file.parts}


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A workspace with an undisturbed sweep in `whole`."""
    folder = workspace(tmp_path_factory.mktemp("sweep"))
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        assert swept("marks", Path("whole"), keep="failed") == 0
    return folder


def test_every_run_is_a_row(whole: Path) -> None:
    rows = load_rows(whole / "whole")
    assert list(rows["mark"]) == list(range(MARKS))
    assert begun(whole) == Counter(range(MARKS))
    assert rows["error"].tolist() == ["crashed: SIGSEGV" if mark == 3 else "" for mark in range(MARKS)]
    assert rows["passed"].tolist() == [{1: False, 3: None}.get(mark, True) for mark in range(MARKS)]
    assert rows["meets_duration_s"].tolist() == rows["passed"].tolist()
    assert rows["record_sha256"].notna().tolist() == [mark != 3 for mark in range(MARKS)]


def test_records_are_kept_of_what_failed_and_hold_every_figure_of_a_row(whole: Path) -> None:
    rows = load_rows(whole / "whole").set_index("mark")
    kept = {folder.name for folder in (whole / "whole" / "records").iterdir()}
    assert rows["key"][1] in kept
    assert kept <= {rows["key"][1], rows["key"][3]}
    summary = json.loads((whole / "whole" / "records" / rows["key"][1] / "summary.json").read_text(encoding="utf-8"))
    identity = {"scenario", "title", "seed", "controller", "versions", "record_parts_sha256", "record_files_sha256"}
    identity |= {"summary_sha256"}
    assert set(summary) - identity == set(FIGURES)
    assert summary["record_sha256"] == rows["record_sha256"][1]


def test_a_run_is_the_same_when_it_is_driven_alone(
    whole: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(whole)
    row = load_rows(Path("whole")).set_index("mark").loc[6]
    assert rerun(Path("whole"), row["key"], None) == 0
    assert f"the same as in the sweep: record {row['record_sha256']}" in capsys.readouterr().out
    summary = json.loads(Path(f"whole/records/{row['key']}/summary.json").read_text(encoding="utf-8"))
    assert summary["record_sha256"] == row["record_sha256"]
    assert Path(f"whole/records/{row['key']}/drive.png").read_bytes().startswith(b"\x89PNG")
    with pytest.raises(ConfigError, match="not empty"):
        rerun(Path("whole"), row["key"], None)
    with pytest.raises(ConfigError, match="no finished run has the key 'abc'"):
        rerun(Path("whole"), "abc", None)


@pytest.mark.thorough
def test_a_rerun_that_differs_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(workspace(tmp_path))
    Path("sweeps/one.toml").write_text('scenario = "second"\nparameters.mark = [3]\n', encoding="utf-8")
    file = Path("controllers/marked.py")
    # What it hangs on beside its code is in no record.
    calm = 'mark == 3 and not Path(__file__).with_name("calm").exists()'
    file.write_text(file.read_text(encoding="utf-8").replace("mark == 3", calm), encoding="utf-8")
    assert swept("one", Path("one")) == 4  # every run broke
    assert "1 x crashed: SIGSEGV" in capsys.readouterr().out
    Path("controllers/calm").touch()
    assert rerun(Path("one"), load_rows(Path("one"))["key"][0], tmp_path / "again") == 1
    assert "DIFFERS: the sweep had crashed: SIGSEGV, now record" in capsys.readouterr().out
    # As if this program's own code had been another when the sweep began, at the same version.
    plan = json.loads(Path("one/sweep.json").read_text(encoding="utf-8"))
    other = json.dumps(plan | {"versions": plan["versions"] | {"code": "0" * 64}})
    shutil.copytree("one", "other")
    Path("other/sweep.json").write_text(other, encoding="utf-8")
    assert rerun(Path("other"), load_rows(Path("other"))["key"][0], tmp_path / "other again") == 1
    assert "the code of vve-sumo has changed since the sweep began" in "".join(capsys.readouterr())
    assert swept("one", Path("other"), resume=True) == 2
    assert f"mixed versions: its rows are of code {'0' * 64}" in capsys.readouterr().err
    file.write_text(file.read_text(encoding="utf-8").replace("mark == 3", "mark == 4"), encoding="utf-8")
    before = begun(Path())
    with pytest.raises(ConfigError, match=r"one: controller_marked has changed since: not run"):
        rerun(Path("one"), load_rows(Path("one"))["key"][0], tmp_path / "more")
    assert begun(Path()) == before
    assert swept("one", Path("one"), resume=True) == 2
    assert "controller_marked has changed since" in capsys.readouterr().err


def ended(folder: Path, how: signal.Signals, more: int) -> subprocess.CompletedProcess[str]:
    """Go on with a sweep, and end it by a signal at some moment after its journal has so many lines more."""
    journal, patience = folder / "killed" / "journal.jsonl", time.monotonic() + 120.0
    lines = more + _lines(journal)
    process = subprocess.Popen(
        [sys.executable, "-m", "vve_sumo.cli", "sweep", "marks", "--out", "killed", "--workers", "1", "--resume"],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(REPOSITORY)},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    while _lines(journal) < lines:
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < patience
        time.sleep(0.01)
    time.sleep(random.uniform(0.0, 0.15))
    process.send_signal(how)
    out, err = process.communicate(timeout=60)
    return subprocess.CompletedProcess(process.args, process.returncode, out, err)


def _lines(journal: Path) -> int:
    return journal.read_bytes().count(b"\n") if journal.exists() else 0


@pytest.mark.thorough
@pytest.mark.parametrize("kills", with_slow([1, 3], lambda kills: kills == 1))
def test_killed_and_then_interrupted_it_is_the_same_dataset(
    whole: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kills: int
) -> None:
    workspace(tmp_path)
    finished: set[int] = set()
    for more, how in ((2, signal.SIGKILL),) * kills + ((2, signal.SIGINT),):
        before = begun(tmp_path)
        run = ended(tmp_path, how, more)
        assert run.returncode == (-signal.SIGKILL if how is signal.SIGKILL else 130), run
        assert all(begun(tmp_path)[mark] == before[mark] for mark in finished), "a finished run was run again"
        finished = set(load_rows(tmp_path / "killed")["mark"])
    assert "to continue: vve-sumo sweep marks --out killed --resume" in run.stderr
    assert f"{len(finished)} of {MARKS} runs are finished" in run.stderr
    before = begun(tmp_path)
    monkeypatch.chdir(tmp_path)
    assert swept("marks", Path("killed"), resume=True) == 0
    assert begun(tmp_path) - before == Counter(set(range(MARKS)) - finished)
    one, other = content(whole / "whole"), content(tmp_path / "killed")
    plans = (SweepPlan.of(whole / "whole"), SweepPlan.of(tmp_path / "killed"))
    assert plans[0].columns() == plans[1].columns()
    assert one.pop("sweep.json").replace(bytes(whole), b"") == other.pop("sweep.json").replace(bytes(tmp_path), b"")
    assert one == other


WRONG = {
    "parameters.ego.speed_mph = [1.0, 2.0]": r"parameters\.ego\.speed_mph: unknown key .*did you mean 'speed_mps'\?",
    "parameters.ego.speed_mps = [1.0, 2000.0]": r"parameters\.ego\.speed_mps: .*got 2000\.0",
    "parameters.ego.speed_mps = { from = 0.001, to = 10, step = 0.00001 }": "999,901 runs; --yes",
    "parameters.mark = [1, 101]": "declares max 100, got 101",
    "parameters.controller.tuning.wrong = [1, 2]": r"parameters\.controller\.tuning\.wrong: .*'wrong' is unknown",
    "parameters.actors.lead.at_m = [1.0]": r"parameters\.actors\.lead\.at_m: ",
}


@pytest.mark.thorough(witnesses=1)
@pytest.mark.parametrize("text", WRONG)
def test_a_wrong_sweep_is_one_line_before_anything_runs(tmp_path: Path, text: str) -> None:
    workspace(tmp_path)
    file = tmp_path / "sweeps" / "wrong.toml"
    file.write_text(f'scenario = "second"\n{text}\n', encoding="utf-8")
    with pytest.raises(ConfigError, match=WRONG[text]) as found:
        query_of("wrong", tmp_path, yes=False)
    assert str(found.value).startswith(f"{file}: ")
    assert "\n" not in str(found.value)
    assert not begun(tmp_path)
