"""`vve-sumo scenarios`: a line each, a picture, a schema; and one clear line for what is wrong."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path

import pytest

from benchmarks import library
from tests import isolated
from tests.conftest import REPOSITORY

DOCS = REPOSITORY / "docs"


def said(*arguments: str, folder: Path) -> subprocess.CompletedProcess[str]:
    return isolated.command("scenarios", *arguments, cwd=folder)


def test_every_scenario_is_one_line_with_its_title(tmp_path: Path) -> None:
    own = tmp_path / "scenarios"
    own.mkdir()
    (own / "wrong.toml").write_text("title = 3\n")
    done = said(folder=tmp_path)
    lines = done.stdout.splitlines()
    for name in library.names():
        (line,) = [line for line in lines if line.startswith(f"{name} ")]
        assert library.load(REPOSITORY / "scenarios" / f"{name}.toml").title in line
    assert done.returncode == 2
    assert "wrong.toml" in done.stderr


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (("show",), "either a scenario's name or --all DIR"),
        (("show", "cut_in", "--all", "x"), "either a scenario's name or --all DIR"),
        (("show", "cut_inn"), "no scenario named 'cut_inn'"),
        (("show", "cut_in", "--out", "nowhere/x.png"), "expected an existing folder, got nowhere"),
        (("--scenario", "cut_in"), "--scenario: goes with --fit-lot RIG"),
        (("--fit-lot", "small_lot", "--scenario", "cut_inn"), "no scenario named 'cut_inn'"),
    ],
)
def test_what_is_wrong_is_one_line(tmp_path: Path, arguments: tuple[str, ...], complaint: str) -> None:
    done = said(*arguments, folder=tmp_path)
    assert done.returncode == 2
    assert complaint in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
    assert not list(tmp_path.iterdir())


def test_one_scenario_alone_is_asked_whether_it_fits_into_a_lot(tmp_path: Path) -> None:
    """As its rig has it laid into that lot already, at its own speed."""
    asked = ("--fit-lot", "small_lot", "--scenario", "small_lot_cut_in", "--json")
    (row,) = json.loads(said(*asked, folder=tmp_path).stdout)
    assert (row["scenario"], row["speed_mps"], row["why_not"]) == ("small_lot_cut_in", row["own_speed_mps"], "")


def test_the_schema_is_printed_as_json(tmp_path: Path) -> None:
    assert json.loads(said("schema", folder=tmp_path).stdout)["properties"]["actors"]


def test_the_page_says_of_every_scenario_what_its_file_says() -> None:
    text = (DOCS / "library.md").read_text(encoding="utf-8")
    assert library.sections(library.names()).strip() in text, "run python -m benchmarks.library --pictures"
    for name in library.names():
        assert (DOCS / "scenarios" / f"{name}.png").stat().st_size < 80_000
        assert f"| [`{name}`](#{name}) |" in text
