"""Two records compared: shifted, scaled, alike, and such as cannot be laid together."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest

from tests.analysis.made import BOX, CAR, PERIOD, moving, put, write
from vve_sumo.analysis.comparison import FIRST_MOTION, compare, first_motion
from vve_sumo.analysis.run import Run
from vve_sumo.cli import main
from vve_sumo.errors import ConfigError

TICKS = 1500
TIME = np.arange(TICKS) * PERIOD


def speed_at(time: np.ndarray) -> np.ndarray:
    """Off at 2 s, up to 10 m/s with waves on it."""
    since = np.maximum(time - 2.0, 0.0)
    return 10.0 * (1.0 - np.exp(-since / 3.0)) + np.where(since > 0.0, 1.5 * np.sin(0.9 * since), 0.0)


def made(folder: Path, late: float = 0.0, scale: float = 1.0, truth: bool = True, **changes: object) -> Run:
    """A drive that begins `late` seconds later; its deviation is a wave along the path, times `scale`."""
    fine = np.arange(0.0, TIME[-1] + 1e-9, 0.001)
    x = 20.0 + np.interp(TIME - late, fine, np.cumsum(speed_at(fine)) * 0.001)
    rows = moving(TIME, x, speed_at(TIME - late))
    for row in rows:
        deviation = scale * 0.1 * math.sin(row["s_m"] / 10.0)
        row.update(lateral_deviation_m=deviation, estimated_deviation_m=2.0 * deviation, state="engaged")
        row["speed_mps"] += 0.05
        if not truth:
            row.update({name: math.nan for name in row if name.startswith(("true_", "lateral_"))})
    record = write(folder, rows, {"outcome": "timeout"}, **changes)
    put(record, "actors", [{"tick": t, "actor": "parked", **BOX, "x_m": 290.0} for t in range(TICKS)])
    return Run(record)


def test_a_record_and_itself_are_alike_in_everything(tmp_path: Path) -> None:
    run = made(tmp_path / "a")
    same = compare(run, run)
    compared = same.signals.drop(index=["acceleration_mps2", "yaw_rate_radps", "steering_rad"])
    assert (compared[["rmse", "max_error", "mean_error", "theil_u"]] == 0.0).all(axis=None)
    assert compared["pearson_r"].to_list() == pytest.approx([1.0] * 3, abs=1e-12)
    assert same.signals.loc["speed_mps", "shift_s"] == pytest.approx(0.0, abs=1e-9)
    assert same.signals.loc["lateral_deviation_m", "shift_m"] == pytest.approx(0.0, abs=1e-9)
    differences = same.outcomes["difference"].dropna()
    assert len(differences) > 5
    assert (differences == 0.0).all()
    assert same.true
    assert same.notes == ()
    # Nobody reported a steering angle; and what never varies has no correlation.
    assert same.signals.loc["steering_rad", "n"] == 0
    assert math.isnan(same.signals.loc["acceleration_mps2", "pearson_r"])


@pytest.mark.parametrize("late", [1.5, 0.487])
def test_a_drive_that_begins_later_is_laid_on_the_other_at_first_motion(tmp_path: Path, late: float) -> None:
    """Between ticks too; then only the straight lines between them are left."""
    both = compare(made(tmp_path / "a"), made(tmp_path / "b", late))
    assert both.begin[1] - both.begin[0] == pytest.approx(late, abs=1e-3)
    speed = both.signals.loc["speed_mps"]
    assert speed["rmse"] < 5e-3
    assert speed["shift_s"] == pytest.approx(0.0, abs=1e-3)
    assert both.signals.loc["gap_m", "rmse"] < 0.02
    assert both.signals.loc["lateral_deviation_m", "rmse"] < 1e-4
    assert both.outcomes.loc["first_motion_s", "difference"] == pytest.approx(late, abs=1e-3)
    series = both.series["speed_mps"]
    assert series.index.name == "time_s"
    assert series["one"].iloc[0] == pytest.approx(FIRST_MOTION, abs=1e-9)


def test_a_scaled_deviation_has_theils_closed_form_over_the_path(tmp_path: Path) -> None:
    both = compare(made(tmp_path / "a"), made(tmp_path / "b", scale=1.5))
    deviation = both.signals.loc["lateral_deviation_m"]
    assert deviation["axis"] == "s_m"
    assert deviation["theil_u"] == pytest.approx(0.5 / 2.5, abs=1e-6)
    assert deviation["pearson_r"] == pytest.approx(1.0, abs=1e-9)
    assert deviation["max_error"] == pytest.approx(0.05, abs=1e-3)


def test_without_a_truth_in_one_both_are_measured_by_the_estimate(tmp_path: Path) -> None:
    """The estimate of both says 0.05 m/s too much and twice the deviation."""
    both = compare(made(tmp_path / "a"), made(tmp_path / "b", truth=False))
    assert not both.true
    assert both.signals.loc["speed_mps", "rmse"] == 0.0
    assert both.series["lateral_deviation_m"]["one"].max() == pytest.approx(0.2, abs=1e-3)
    assert both.outcomes.loc["max_speed_mps", "difference"] == 0.0
    assert any("no truth" in note for note in both.notes)


def test_gaps_to_two_different_actors_are_not_compared(tmp_path: Path) -> None:
    one, other = made(tmp_path / "a"), made(tmp_path / "b")
    rows = [{"tick": t, "actor": "parked" if t < 1000 else "bus", **BOX, "x_m": 280.0} for t in range(TICKS)]
    put(other.folder, "actors", rows)
    gap = compare(one, Run(other.folder)).signals.loc["gap_m"]
    assert gap["mean_error"] == pytest.approx(-10.0, abs=1e-9)
    # Nobody is looked at whose gap is more than 150 m.
    seen = one.motion.x[:1000] > 290.0 - 2.0 - CAR.rear_axle_to_bumper - 150.0
    assert gap["n"] == pytest.approx(seen.sum(), abs=3)


def test_what_was_asked_differently_is_said(tmp_path: Path) -> None:
    settings = {"title": "t", "seed": 2, "controller": {"name": "mine"}, "radar": {}}
    path = [f"{x:.1f} 1.0" for x in np.arange(0.0, 301.0, 2.0)]
    other = made(
        tmp_path / "b", scenario="cut_in", settings=settings, path_m=path, rig={"latency": {"budget_ms": 15.0}}
    )
    both = compare(made(tmp_path / "a"), other)
    for word in ("scenarios", "seeds", "controllers", "kinds of drive", "paths"):
        assert any(f"the {word} differ" in note for note in both.notes)
    assert both.signals.loc["lateral_deviation_m", "n"] == 0


def test_first_motion_lies_between_two_ticks() -> None:
    time, speed = np.arange(5.0), np.array([math.nan, 0.0, 0.25, 1.25, 0.0])
    assert first_motion(time, speed) == pytest.approx(2.25)
    assert first_motion(time, speed + 3.0) == 1.0
    assert math.isnan(first_motion(time, 0.1 * speed))


def test_what_cannot_be_compared_is_named(tmp_path: Path) -> None:
    run = made(tmp_path / "a")
    short = Run(write(tmp_path / "short", moving(TIME[:60], TIME[:60] * 3.0, np.linspace(0.0, 3.0, 60))))
    still = Run(write(tmp_path / "still", moving(TIME, np.zeros(TICKS), np.zeros(TICKS))))
    with pytest.raises(ConfigError, match=r"a and .*short: from first motion on they have 0\.98 s in common"):
        compare(run, short)
    with pytest.raises(ConfigError, match=r"still: the car never reaches 0\.5 m/s"):
        compare(run, still)


@pytest.mark.thorough
def test_the_command_prints_both_tables_and_refuses_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    made(tmp_path / "a")
    made(tmp_path / "b", late=0.4)
    (tmp_path / "sweep").mkdir()
    (tmp_path / "sweep" / "sweep.json").write_text(json.dumps({}), encoding="utf-8")
    assert main(["compare", "a", "b", "--out", "apart.png"]) == 0
    said = capsys.readouterr().out
    assert (tmp_path / "apart.png").read_bytes().startswith(b"\x89PNG")
    for word in ("Theil's U", "lateral deviation", "stop gap", "measured by the truth", "timeout"):
        assert word in said
    for arguments, says in (
        (("a", "nowhere"), "nowhere"),
        (("a", "b", "--out", "x.gif"), "--out: expected a file that ends in .png"),
        (("sweep", "b"), "sweep"),
    ):
        assert main(["compare", *arguments]) == 2
        refused = capsys.readouterr()
        assert refused.out == ""
        assert len(refused.err.splitlines()) == 1
        assert says in refused.err
