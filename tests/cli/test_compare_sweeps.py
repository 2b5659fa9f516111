"""`vve-sumo compare` of sweeps: pairs of two folders, of two values within one, and what is refused."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from tests.sweep.test_dataset import PLAN
from vve_sumo.cli.dispatch import main
from vve_sumo.sweep.dataset import Dataset
from vve_sumo.sweep.job import RunResult
from vve_sumo.sweep.run_specs import RunSpec


def sweep(folder: Path, gap: float) -> Path:
    """Six runs: three speeds, two kinds; those of kind b at the highest speed collide."""
    dataset = Dataset(folder, replace(PLAN, cells=6), resume=False)
    for number in range(6):
        speed, kind = float(number // 2), "ab"[number % 2]
        hit = kind == "b" and speed == 2.0
        figures: dict[str, Any] = {"passed": not hit, "collision": hit, "stop_gap_m": None if hit else gap + speed}
        run = RunSpec(number, f"{number:016x}", {"speed": speed, "kind": kind}, 1)
        dataset.add(run, RunResult("", figures, ""))
    dataset.close()
    return folder


def reported(capsys: pytest.CaptureFixture[str], *words: str | Path) -> str:
    assert main(["compare", *map(str, words)]) == 0
    return capsys.readouterr().out


def cells(text: str, name: str) -> list[str]:
    """The cells of the line that begins with a name."""
    (line,) = (line for line in text.splitlines() if line.split()[:1] == [name])
    return line.split()[1:]


@pytest.mark.thorough
def test_two_sweeps_are_compared_pair_by_pair(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = reported(capsys, sweep(tmp_path / "old", 1.0), sweep(tmp_path / "new", 1.5), "--out", tmp_path / "pairs.png")
    assert "6 pairs by speed, kind, seed" in text
    assert cells(text, "passed") == ["5", "0", "0", "1", "1"]
    gap = ["5", "0", "0", "2", "2.5", "0.5", "0.5", "0.5", "0.5", "0.5", "0", "1", "5", "0.0625", "lower"]
    assert cells(text, "stop_gap_m") == gap
    assert "differences are new minus old" in text
    assert (tmp_path / "pairs.png").stat().st_size > 0


def test_two_values_of_one_sweep_are_compared(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = reported(capsys, sweep(tmp_path / "sweep", 1.0), "--by", "kind")
    assert "3 pairs by speed, seed" in text
    assert cells(text, "collision") == ["0", "0", "1", "2", "1"]
    assert cells(text, "stop_gap_m")[:3] == ["2", "1", "0"]


@pytest.mark.thorough
def test_three_values_of_one_sweep_are_compared_each_with_each(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = reported(capsys, sweep(tmp_path / "sweep", 1.0), "--by", "speed", "--out", tmp_path / "pairs.png")
    for pair in ("1.0 minus 0.0", "2.0 minus 0.0", "2.0 minus 1.0"):
        assert f"differences are {pair}" in text
    assert text.count("2 pairs by kind, seed") == 3
    assert sorted(file.name for file in tmp_path.glob("*.png")) == [f"pairs_{number}.png" for number in (1, 2, 3)]


@pytest.mark.parametrize(
    ("more", "says"),
    [
        ([], "is a sweep, expected either another sweep or --by PARAMETER"),
        (["--by", "nix"], "'nix' was not varied; there are speed, kind"),
    ],
)
def test_what_makes_no_pairs_is_one_line(
    more: list[str], says: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["compare", str(sweep(tmp_path / "sweep", 1.0)), *more]) == 2
    said = capsys.readouterr()
    assert says in said.err
    assert said.out == ""
