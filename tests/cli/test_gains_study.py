"""`vve-sumo study gains` as a user meets it: table, picture, a schedule that drives; live drives that are refused."""

from __future__ import annotations

import csv
from pathlib import Path

import pytest

from tests.conftest import REPOSITORY
from tests.drive.street import altered
from vve_sumo.cli import main
from vve_sumo.controller import load
from vve_sumo.drive.gain_region import delay_of, refuse_outside
from vve_sumo.drive.steering_margins import margins_at_speed
from vve_sumo.errors import ConfigError
from vve_sumo.live.session import plan
from vve_sumo.rig.load import load as load_rig

SPEEDS = "2.2,4.5,6.7,11.2,15.6"


@pytest.fixture(scope="module")
def studied(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a study of five speeds."""
    out = tmp_path_factory.mktemp("study") / "gains"
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(out.parent)
        assert main(["study", "gains", "parked_car", "--out", "gains", "--speeds-mps", SPEEDS]) == 0
    return out


def test_table_picture_and_schedule_are_there(studied: Path) -> None:
    assert sorted(file.name for file in studied.iterdir()) == ["gains.csv", "gains.png", "scheduled.py"]
    assert (studied / "gains.png").stat().st_size > 20_000
    with (studied / "gains.csv").open(encoding="utf-8") as stream:
        rows = list(csv.DictReader(stream))
    assert [float(row["speed_mps"]) for row in rows] == [2.2, 4.5, 6.7, 11.2, 15.6]
    assert [row["inside"] for row in rows] == ["true"] * 5
    for row in rows:
        assert 0.5 < float(row["central_kp_rad_per_m"]) / float(row["kp_rad_per_m"]) < 2.0


def test_the_schedule_is_a_controller_of_the_documented_kind(studied: Path) -> None:
    name = f"{studied / 'scheduled.py'}:make"
    vehicle = altered({}).vehicle
    controller = load(name, vehicle, {"gap_m": 4.0, "cdob_time_constant_s": 0.1}, [])
    with (studied / "gains.csv").open(encoding="utf-8") as stream:
        middle = list(csv.DictReader(stream))[3]
    gains = controller.preview_tuning.at(vehicle, 11.2)  # type: ignore[attr-defined]
    assert gains.proportional == pytest.approx(float(middle["central_kp_rad_per_m"]), rel=1e-4)
    with pytest.raises(ConfigError, match="tuning key 'steering' is unknown"):
        load(name, vehicle, {"steering": "stanley"}, [])


def test_a_schedule_has_margins_and_drives_live(studied: Path) -> None:
    scheduled = altered({"controller": {"name": f"{studied / 'scheduled.py'}:make", "tuning": {}}})
    usual = altered({})
    assert 0.2 < margins_at_speed(scheduled, REPOSITORY).delay < margins_at_speed(usual, REPOSITORY).delay
    rig = load_rig(REPOSITORY / "rigs" / "simulated.toml", REPOSITORY)
    assert delay_of(rig) == pytest.approx(0.05)
    for resolved in (scheduled, usual):
        refuse_outside(resolved, REPOSITORY, delay_of(rig))
    refuse_outside(scheduled, REPOSITORY, 0.1)
    with pytest.raises(ConfigError, match="outside the D-stable region"):
        refuse_outside(usual, REPOSITORY, 0.15)


@pytest.mark.parametrize("speed", [0.6, 5.0 / 3.6])
def test_a_drive_slower_than_all_speeds_of_the_parameter_space_is_allowed(speed: float) -> None:
    """As is the first one of a new car, at 5 km/h: the usual gains are good at the least speed of the space."""
    rig = load_rig(REPOSITORY / "rigs" / "simulated.toml", REPOSITORY)
    slow = altered({"ego.speed_mps": speed})
    refuse_outside(slow, REPOSITORY, delay_of(rig))
    with pytest.raises(ConfigError, match=r"at 2.2 m/s, .* outside the D-stable region"):
        refuse_outside(slow, REPOSITORY, 1.5)


def test_a_live_drive_outside_is_refused_and_nothing_is_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    nervous = {"controller.tuning.look_ahead_time_s": 0.3}
    with pytest.raises(ConfigError, match=r"^steering gains: at .* outside the D-stable region"):
        plan(
            "parked_car", "simulated", tmp_path, out=tmp_path / "out", seed=None, controller=None, shadow=False,
            values=nervous,
        )  # fmt: skip
    assert not (tmp_path / "out").exists()
    # In shadow mode nothing is commanded; of another law nothing is known.
    other = {"controller.tuning.steering": "stanley"}
    for shadow, values in ((True, nervous), (False, other)):
        plan(
            "parked_car", "simulated", tmp_path, out=tmp_path / "out", seed=None, controller=None, shadow=shadow,
            values=values,
        )  # fmt: skip


def test_where_no_gains_are_good_there_is_no_schedule(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    late = ["--delay-ms", "900", "--speeds-mps", "15.6"]
    assert main(["study", "gains", "parked_car", "--out", "late", *late]) == 0
    assert "no schedule" in capsys.readouterr().out
    assert sorted(file.name for file in (tmp_path / "late").iterdir()) == ["gains.csv", "gains.png"]
