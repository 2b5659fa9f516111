"""`vve-sumo study latency` as a user meets it: the table, the dataset and the picture; one line for what is wrong."""

from __future__ import annotations

import math
import re
import shutil
import subprocess
from pathlib import Path

import pytest

from tests import isolated
from tests.conftest import REPOSITORY
from tests.sweep.test_dataset import fill
from vve_sumo.analysis.dataset import Sweep
from vve_sumo.analysis.latency_margin import latency_margin_of
from vve_sumo.errors import ConfigError
from vve_sumo.sweep.study import DELAYS_MS, FACTORS, latency_study

#: a fixture that takes long: `./check test` leaves its tests out
THOROUGH_FIXTURE = "folder"

SPEED = 5.0
SHORT = f"""
title = "A short approach to a wall"
duration_s = 30.0
after_stop_s = 0.1
road.network = "proving_ground"
ego.path = "proving_ground"
ego.speed_mps = {SPEED}
ego.car.noise = false
ego.lot = {{ latitude_deg = 40.0, longitude_deg = -83.0, heading_deg = 85.0 }}
radar.ideal = true
controller = {{ name = "brake_at", tuning = {{ trigger_m = 8.0 }} }}
obstacles = [{{ id = "wall", at_m = 70.0 }}]
criteria = {{ outcome = "stopped" }}
"""
STEPS = ("--delays-ms", "0,100", "--seeds", "1")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A workspace with the short scenario."""
    place = tmp_path_factory.mktemp("study")
    (place / "scenarios").mkdir()
    (place / "scenarios" / "short.toml").write_text(SHORT, encoding="utf-8")
    return place


@pytest.fixture(scope="module")
def studied(folder: Path) -> subprocess.CompletedProcess[str]:
    """The study of the short scenario, in the workspace's folder `cliff`."""
    done = isolated.command("study", "latency", "short", "--out", "cliff", *STEPS, "--quiet", cwd=folder)
    assert done.returncode == 0, done.stderr
    return done


@pytest.mark.thorough
def test_a_study_end_to_end(folder: Path, studied: subprocess.CompletedProcess[str]) -> None:
    for word in (
        "Latency margin of short",
        "v x delay",
        "1 of 1",
        "noise x 0: the mean margin",
        "by its design",
    ):
        assert word in studied.stdout
    assert (folder / "cliff" / "latency_margin.png").stat().st_size > 10_000
    study = latency_margin_of(Sweep(folder / "cliff"))
    bears = re.search(r"by its design the steering loop bears (\d+) ms", studied.stdout)
    assert bears is not None
    assert 1000.0 * study.design_margin == pytest.approx(float(bears[1]), abs=0.5)
    assert study.steps["delay_s"].tolist() == [0.0, 0.1]
    kept, late = study.steps["mean_margin_m"]
    assert kept - late == pytest.approx(SPEED * 0.1, abs=0.05)
    rows = (folder / "cliff" / "rows" / "part-00000.parquet").read_bytes()

    again = isolated.command("study", "latency", "short", "--out", "cliff", *STEPS, cwd=folder)
    assert (again.returncode, again.stderr.count("\n")) == (2, 1)
    assert "--resume continues it" in again.stderr
    (folder / "cliff" / "latency_margin.png").unlink()
    resumed = isolated.command("study", "latency", "short", "--out", "cliff", *STEPS, "--resume", "--quiet", cwd=folder)
    assert (resumed.returncode, resumed.stdout) == (0, studied.stdout)
    assert (folder / "cliff" / "latency_margin.png").exists()
    assert (folder / "cliff" / "rows" / "part-00000.parquet").read_bytes() == rows


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("nowhere",), "no scenario named 'nowhere'"),
        (("short", "--delays-ms", "0,1001"), "--delays-ms: expected numbers from 0 to 1000, got 1001"),
        (("short", "--delays-ms", "nan"), "--delays-ms: expected numbers from 0 to 1000, got nan"),
        (("short", "--delays-ms", "0;5"), "expected numbers such as 0,100,200, got '0;5'"),
        (("parked_car", "--noise=-1"), "--noise: expected numbers from 0 to 100, got -1"),
        (("short", "--noise", "0,1"), "--noise: short turns the noise off (ego.car.noise), expected 0, got 0,1"),
        (("short", "--seeds", "0"), "--seeds: expected 1 or more, got 0"),
        (("short", "--out", "scenarios"), "holds something else (short.toml)"),
    ],
)
def test_what_is_wrong_is_one_line(folder: Path, arguments: tuple[str, ...], says: str) -> None:
    out = () if "--out" in arguments else ("--out", "new")
    done = isolated.command("study", "latency", *arguments, *out, cwd=folder)
    assert done.returncode == 2
    assert says in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
    assert not (folder / "new").exists()
    assert [file.name for file in (folder / "scenarios").iterdir()] == ["short.toml"]


@pytest.mark.thorough
def test_what_is_usual_goes_with_the_scenario(folder: Path) -> None:
    shipped, quiet = latency_study("seen_late", REPOSITORY), latency_study("short", folder)
    assert shipped.plan.cells == len(DELAYS_MS) * len(FACTORS) * 3
    assert quiet.plan.cells == len(DELAYS_MS)


@pytest.mark.thorough
def test_a_study_of_a_rigs_car(folder: Path) -> None:
    assert latency_study("short", folder, rig="simulated").plan.rig == str(REPOSITORY / "rigs" / "simulated.toml")
    assert latency_study("short", folder).plan.rig == ""


@pytest.mark.usefixtures("studied")
def test_a_note_that_is_none_is_named(folder: Path, tmp_path: Path) -> None:
    shutil.copytree(folder / "cliff", tmp_path / "cliff")
    (tmp_path / "cliff" / "study.json").unlink()
    assert math.isnan(latency_margin_of(Sweep(tmp_path / "cliff")).design_margin)
    for text, says in (("{", "not what a study writes"), ('{"design_delay_margin_s": "long"}', "expected a number")):
        (tmp_path / "cliff" / "study.json").write_text(text, encoding="utf-8")
        with pytest.raises(ConfigError, match=rf"study\.json: .*{says}"):
            latency_margin_of(Sweep(tmp_path / "cliff"))


def test_another_sweep_is_no_study(tmp_path: Path) -> None:
    fill(tmp_path).close()
    with pytest.raises(ConfigError, match="no study of delay and noise: it varied"):
        latency_margin_of(Sweep(tmp_path))


@pytest.mark.thorough
def test_a_sensor_beside_the_ideal_radar_is_left_to_chance(tmp_path: Path) -> None:
    """Nobody knows what another sensor draws, so a study drives more than one seed of it."""
    (tmp_path / "scenarios").mkdir()
    noisy = 'sensors = [{ name = "noisy", kind = "radar" }]'
    (tmp_path / "scenarios" / "two.toml").write_text(SHORT + noisy, encoding="utf-8")
    assert latency_study("two", tmp_path).plan.cells == 3 * len(DELAYS_MS)
