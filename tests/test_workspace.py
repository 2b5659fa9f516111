"""Names are found in the working folder first, then among what is shipped."""

from __future__ import annotations

from pathlib import Path

import pytest

from vve_sumo import workspace
from vve_sumo.errors import ConfigError


def test_shipped_names_are_known_from_any_folder(tmp_path: Path) -> None:
    assert "linden" in workspace.known("network", tmp_path)
    assert workspace.find("scenario", "parked_car", tmp_path).name == "parked_car.toml"


def test_the_working_folder_wins(tmp_path: Path) -> None:
    mine = tmp_path / "scenarios" / "parked_car.toml"
    mine.parent.mkdir()
    mine.write_text("", encoding="utf-8")
    assert workspace.find("scenario", "parked_car", tmp_path) == mine


def test_a_path_counts_from_the_scenarios_folder_first(tmp_path: Path) -> None:
    (tmp_path / "a").mkdir()
    for folder in (tmp_path, tmp_path / "a"):
        (folder / "x.csv").write_text(folder.name, encoding="utf-8")
    assert workspace.find("path", "x.csv", tmp_path, beside=tmp_path / "a") == tmp_path / "a" / "x.csv"
    assert workspace.find("path", "x.csv", tmp_path) == tmp_path / "x.csv"


def test_an_unknown_name_lists_the_known(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"no network named 'mars'; known: .*linden"):
        workspace.find("network", "mars", tmp_path)


def test_lay_out_refuses_before_it_writes(tmp_path: Path) -> None:
    (tmp_path / "scenarios").mkdir()
    (tmp_path / "scenarios" / "parked_car.toml").write_text("mine", encoding="utf-8")
    with pytest.raises(ConfigError, match=r"parked_car\.toml is there already"):
        workspace.lay_out(tmp_path)
    assert [p.name for p in tmp_path.rglob("*") if p.is_file()] == ["parked_car.toml"]


def test_lay_out_refuses_a_file(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("", encoding="utf-8")
    with pytest.raises(ConfigError, match="is a file"):
        workspace.lay_out(tmp_path / "file")
