"""The Python front door: what it exports, what it drives, how it shows itself, and what it says of what is wrong."""

from __future__ import annotations

import doctest
import json
import os
import re
import signal
import subprocess
import sys
import threading
import time
import tomllib
from pathlib import Path

import numpy as np
import pytest

import vve_sumo as vve
from tests.conftest import REPOSITORY
from tests.isolated import command
from vve_sumo import analysis

#: a scenario that takes a few seconds: one parked car on an empty straight street
NEAR = {"obstacles.parked_car.at_m": 120.0}
CRASHING = """
import os, signal
class Crashing:
    def step(self, observation):
        print("about to crash", flush=True)
        os.kill(os.getpid(), signal.SIGSEGV)
def make(vehicle, tuning):
    return Crashing()
"""
#: never comes back from its first step
HANGING = "import time\nclass Hanging:\n    def step(self, observation):\n        time.sleep(1000.0)\n"
HANGING += "def make(vehicle, tuning):\n    return Hanging()\n"


@pytest.fixture
def working(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty folder to work in."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture(scope="module")
def near(tmp_path_factory: pytest.TempPathFactory) -> vve.Run:
    """A short drive."""
    folder = tmp_path_factory.mktemp("near") / "record"
    return vve.drive(vve.Scenario("delay_probe").replace(NEAR), speed=8, out=folder)


def test_what_is_public_is_exported_on_purpose() -> None:
    assert vve.__all__ == sorted(vve.__all__)
    assert [name for name in dir(vve) if not name.startswith("_")] == vve.__all__
    assert all(getattr(vve, name) is not None for name in vve.__all__)
    with pytest.raises(AttributeError, match="has no attribute 'nothing'"):
        _ = vve.nothing  # type: ignore[attr-defined]


def test_functions_keep_their_names_whatever_rooms_are_imported() -> None:
    code = (
        "import vve_sumo.drive.run, vve_sumo.sweep.plan, vve_sumo as vve\n"
        "from vve_sumo.drive.run import resolve_by_name\n"
        "import vve_sumo.drive, vve_sumo.sweep\n"
        "print(callable(vve.drive), callable(vve.sweep), [name for name in dir(vve) if name[0] != '_'] == vve.__all__)"
    )
    assert _python(code) == "True True True"


def test_the_import_brings_nothing_else() -> None:
    code = (
        "import sys; before = set(sys.modules); import vve_sumo\n"
        "print(*sorted({name.split('.')[0] for name in set(sys.modules) - before} - set(sys.stdlib_module_names)))\n"
        "print(*sorted(name for name in sys.modules if name.startswith('vve_sumo.')))"
    )
    foreign, own = _python(code).splitlines()
    assert foreign == "vve_sumo"
    assert own == "vve_sumo.drive vve_sumo.errors vve_sumo.sweep vve_sumo.version"


def _python(code: str) -> str:
    return subprocess.run(
        [sys.executable, "-c", code], cwd=REPOSITORY, capture_output=True, text=True, check=True
    ).stdout.strip()


def test_the_analysis_reads_with_the_same_classes() -> None:
    assert (vve.Run, vve.Sweep, vve.load) == (analysis.Run, analysis.Sweep, analysis.load)


def test_types_are_declared() -> None:
    assert (REPOSITORY / "vve_sumo" / "py.typed").is_file()


@pytest.mark.slow
def test_every_export_explains_itself_by_an_example_that_runs(working: Path) -> None:
    # A sweep and a drive make what the others load.
    order = sorted(vve.__all__, key=lambda name: (name not in ("drive", "sweep"), name))
    runner = doctest.DocTestRunner()
    for name in order:
        (found,) = doctest.DocTestFinder(recurse=False).find(getattr(vve, name), name, module=False)
        assert found.examples, f"{name} has no example"
        runner.run(found)
    assert runner.summarize().failed == 0


@pytest.mark.slow
def test_the_blocks_of_the_page_run(working: Path) -> None:
    text = (REPOSITORY / "docs" / "python.md").read_text(encoding="utf-8")
    names: dict[str, object] = {}
    for block in re.findall(r"```python\n(.*?)```", text, re.DOTALL):
        exec(compile(block, "docs/python.md", "exec"), names)
    assert {"run", "sweep", "scenario"} <= names.keys()


@pytest.mark.thorough
def test_a_drive_is_that_of_the_command_line(working: Path) -> None:
    near = ("--set", "obstacles.parked_car.at_m=200.0")
    done = command("drive", "parked_car", "--seed", "2", *near, "--quiet", "--out", "by_command", cwd=working)
    assert done.returncode == 0, done.stderr
    run = vve.drive(vve.Scenario("parked_car").replace({"obstacles.parked_car.at_m": 200.0}), seed=2)
    by_command = json.loads((working / "by_command" / "summary.json").read_text(encoding="utf-8"))
    assert run.summary["record_sha256"] == by_command["record_sha256"]
    # The moment of the drive stands in its provenance, and so in the hashes of files. What PROJ complains of depends on
    # the library that loaded it first, which in the tests' forked processes is another one.
    differing = {"summary_sha256", "record_files_sha256", "sumo_warnings"}
    assert {key: run.summary[key] for key in run.summary if key not in differing} == {
        key: by_command[key] for key in by_command if key not in differing
    }
    assert run.folder.parent == Path("runs")
    assert run.folder.name.endswith("_parked_car")


@pytest.mark.thorough
def test_a_drive_shows_its_verdict_its_figures_with_units_and_its_picture(near: vve.Run) -> None:
    shown = near._repr_html_()
    assert "passed: The car came to rest" in shown
    assert f"<th>gap at rest</th><td>{near.summary['stop_gap_m']:.3f} m</td>" in shown
    assert 'src="data:image/png;base64,' in shown
    assert near.ticks["speed_mps"].max() == pytest.approx(8.0, abs=0.2)
    assert set(near.actors["actor"]) == {"parked_car"}
    again = vve.load(near.folder)
    assert isinstance(again, vve.Run)
    assert again.summary == near.summary
    assert again.plot().axes


@pytest.mark.thorough
def test_a_recording_is_played(near: vve.Run, working: Path) -> None:
    played = vve.drive("delay_probe", pose=near.folder / "pose.bin", out="played")
    assert played.summary["outcome"] == "played"
    assert played.summary["prediction_error_100ms_max_m"] < 0.1
    assert "prediction over 100 ms, maximum error" in played._repr_html_()


@pytest.mark.thorough
def test_a_rig_brings_its_car_and_its_faults(working: Path) -> None:
    faults = '[[faults]]\nkind = "wheel_speeds_zero"\nat_s = 2.0\n'
    (working / "ours.toml").write_text((REPOSITORY / "rigs/simulated.toml").read_text() + faults)
    scenario = vve.Scenario("delay_probe").replace(NEAR)
    run = vve.drive(scenario, speed=8, rig="ours.toml", out="faulty")
    assert run.summary["outcome"] == "fault"
    rows = vve.sweep(scenario, seeds=2, rig="ours.toml", out="sweep").rows()
    assert list(rows["outcome"]) == ["fault", "fault"]


@pytest.mark.thorough
def test_a_crash_is_an_error_that_names_the_drive_and_the_next_drive_goes_on(working: Path) -> None:
    (working / "crashing.py").write_text(CRASHING, encoding="utf-8")
    with pytest.raises(vve.SimulationError, match=r"delay_probe: the drive came to no end: crashed: SIGSEGV") as crash:
        vve.drive("delay_probe", controller="crashing.py:make", out="crashed")
    assert "about to crash" in crash.value.__notes__[0]
    assert "record up to there: crashed" in str(crash.value)
    assert (working / "crashed" / "scenario.json").is_file()
    assert vve.drive(vve.Scenario("delay_probe").replace(NEAR)).summary["outcome"] == "stopped"


@pytest.mark.thorough
def test_an_interrupt_ends_the_drive_and_leaves_no_process_and_no_part(working: Path) -> None:
    (working / "hanging.py").write_text(HANGING, encoding="utf-8")
    threading.Thread(target=_interrupt_when, args=(working / "hung.part" / "scenario.json",)).start()
    with pytest.raises(KeyboardInterrupt):
        vve.drive("delay_probe", controller="hanging.py:make", out="hung")
    assert [place.name for place in working.iterdir() if place.suffix == ".part"] == []
    assert (working / "hung" / "scenario.json").is_file()
    assert not _children()


def _interrupt_when(file: Path) -> None:
    end = time.monotonic() + 100.0
    while not file.exists() and time.monotonic() < end:
        time.sleep(0.05)
    os.kill(os.getpid(), signal.SIGINT)


def _children() -> list[str]:
    """The command lines of this process' children that drive."""
    found = []
    for child in Path(f"/proc/{os.getpid()}/task/{os.getpid()}/children").read_text(encoding="ascii").split():
        found.append(Path(f"/proc/{child}/cmdline").read_text(encoding="utf-8"))
    return [line for line in found if "sweep.server" in line]


@pytest.mark.parametrize(
    ("call", "says"),
    [
        (lambda: vve.drive("nowhere"), "no scenario named 'nowhere'; known: "),
        (lambda: vve.drive("parked_car", seed=-1), "seed: expected 0 to 2147483647, got -1"),
        (lambda: vve.drive("parked_car", speed=99), "ego.speed_mps: expected less than or equal to 40, got 99"),
        (lambda: vve.drive("parked_car", vehicle="tank"), "no vehicle named 'tank'"),
        (lambda: vve.drive("parked_car", rig="nowhere"), "no rig named 'nowhere'"),
        (lambda: vve.drive("parked_car", rig="simulated", vehicle="fusion"), "a rig brings its own vehicle"),
        (lambda: vve.sweep("parked_car", seeds=2, rig="foreign"), "only a single drive can use an external controller"),
        (lambda: vve.drive("parked_car", controller="nobody"), "controller nobody: unknown"),
        (lambda: vve.drive("parked_car", pose="no.csv"), "no.csv"),
        (lambda: vve.drive("parked_car", out="full"), "full is not empty"),
        (lambda: vve.sweep("nowhere"), "no sweep named 'nowhere'"),
        (lambda: vve.sweep("parked_car", vary={"ego.sped_mps": [1.0]}), "ego.sped_mps"),
        (lambda: vve.sweep("parked_car", vary={"speed": [99.0]}), "speed: the scenario declares max 15.6, got 99.0"),
        (lambda: vve.sweep("parked_car", seeds=2, workers=0), "workers: expected 1 or more, got 0"),
        (lambda: vve.sweep(vve.Scenario("parked_car")), "expected vary={…}, controllers={…} or seeds=…"),
        (lambda: vve.sweep({"scenario": "parked_car"}, seeds=2), "leave out vary, controllers and seeds"),
        (lambda: vve.load("nowhere"), "nowhere: not there"),
        (lambda: vve.Scenario("parked_car").replace(spede=3), "spede: unknown to the scenario; did you mean 'speed'?"),
        (lambda: vve.Scenario("parked_car").replace(speed=50), "speed: the scenario declares max 15.6, got 50"),
        (lambda: vve.Scenario("parked_car").replace({"obstacles.car.at_m": 3}), "no 'car' in obstacles"),
        (lambda: vve.Scenario("parked_car")["ego.sped_mps"], "unknown key 'ego.sped_mps', did you mean 'speed_mps'?"),
    ],
)
def test_what_is_wrong_is_one_line_and_leaves_nothing(call: object, says: str, working: Path) -> None:
    (working / "full").mkdir()
    (working / "full" / "mine.txt").write_text("mine", encoding="utf-8")
    with pytest.raises(vve.ConfigError) as error:
        call()  # type: ignore[operator]
    assert says in str(error.value)
    assert "\n" not in str(error.value)
    assert sorted(place.name for place in working.rglob("*")) == ["full", "mine.txt"]


def test_what_is_no_argument_is_refused() -> None:
    with pytest.raises(TypeError, match="spede"):
        vve.drive("parked_car", spede=3)  # type: ignore[call-arg]


def test_a_scenario_is_changed_by_making_another() -> None:
    scenario = vve.Scenario("parked_car")
    other = scenario.replace({"ego.speed_mps": np.float64(12.0)}, seed=np.int64(7), offset=0.5)
    assert (other["ego.speed_mps"], other["seed"], other["obstacles.parked_car.offset_m"]) == (12.0, 7, 0.5)
    assert (scenario["ego.speed_mps"], scenario["seed"], scenario["offset"]) == (11.176, 1, 0.0)
    assert scenario == vve.Scenario("parked_car") != other
    assert tomllib.loads(other.to_toml()) == other.table
    assert "offset" in other.parameters


def test_the_text_of_a_scenario_is_a_scenario(working: Path) -> None:
    other = vve.Scenario("lead_braking").replace(seed=9)
    (working / "mine.toml").write_text(other.to_toml(), encoding="utf-8")
    assert vve.Scenario("mine.toml").table == other.table
    assert vve.Scenario(working / "mine.toml").name == "mine"


def test_a_scenario_is_drawn() -> None:
    assert vve.Scenario("cut_in").draw().axes


@pytest.mark.thorough
def test_the_listing_is_the_command_lines(working: Path) -> None:
    (working / "scenarios").mkdir()
    (working / "scenarios" / "wrong.toml").write_text("title = 3\n", encoding="utf-8")
    with pytest.warns(UserWarning, match="wrong.toml"):
        listed = vve.scenarios()
    printed = command("scenarios", cwd=working).stdout
    assert all(name in printed and listed[name].title in printed for name in listed)
    assert len(listed) == len(list((REPOSITORY / "scenarios").glob("*.toml")))
    assert f"<td>{listed['cut_in'].title}</td>" in listed._repr_html_()
    assert re.search(r"(?m)^cut_in +A car cuts in from the left lane$", repr(listed))


@pytest.mark.slow
def test_a_sweep_in_code_is_one_of_a_file_and_goes_on_where_it_was(working: Path) -> None:
    scenario = vve.Scenario("delay_probe").replace(NEAR)
    speeds, braked = np.array([5.0, 8.0]), "controller.tuning.deceleration_m_s2"
    sweep = vve.sweep(scenario, vary={"ego.speed_mps": speeds, braked: (2.0, 3.0)}, out="code")
    (working / "near.toml").write_text(scenario.to_toml(), encoding="utf-8")
    text = f'scenario = "near.toml"\n[parameters]\n"ego.speed_mps" = [5.0, 8.0]\n"{braked}" = [2.0, 3.0]\n'
    (working / "file.toml").write_text(text, encoding="utf-8")
    by_file = vve.sweep("file.toml", workers=1, out="file").rows()
    rows = sweep.rows()
    assert rows["stop_gap_m"].tolist() == by_file["stop_gap_m"].tolist()
    assert rows["record_sha256"].notna().all()
    before = (working / "code" / "rows" / "part-00000.parquet").stat().st_mtime_ns
    again = vve.sweep(scenario, vary={"ego.speed_mps": speeds, braked: (2.0, 3.0)}, out="code")
    assert again.rows()["key"].tolist() == rows["key"].tolist()
    assert (working / "code" / "rows" / "part-00000.parquet").stat().st_mtime_ns == before
    with pytest.raises(vve.ConfigError, match="code"):
        vve.sweep(scenario, vary={"ego.speed_mps": [6.0]}, out="code")
    shown = sweep._repr_html_()
    assert "4 runs: 4 passed, 0 failed, 0 with an error" in shown
    assert "mean gap at rest [m]" in shown or "mean minimum TTC [s]" in shown
    assert 'src="data:image/png;base64,' in shown
    assert len(sweep.plot("stop_gap_m").axes) == 2  # the map and its scale
    with pytest.raises(vve.ConfigError, match="no column 'gap'"):
        sweep.plot("gap")
