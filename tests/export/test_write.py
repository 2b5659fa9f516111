"""Where exports go, what is refused, and what the command says."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import pandas as pd
import pytest

import vve_sumo as vve
from tests.export.made import TICKS, TIME, record
from tests.sweep.test_dataset import fill
from vve_sumo.cli import main
from vve_sumo.export.formats import FORMATS

#: formats that need nothing but the record that `made` writes
PLAIN = [name for name in FORMATS if name != "commonroad"]


@pytest.fixture
def working(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder to work in, with a record and a sweep below runs/."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "runs").mkdir()
    record(tmp_path / "runs" / "mine", {"outcome": "timeout"})
    fill(tmp_path / "runs" / "speeds")
    return tmp_path


def files(folder: Path) -> set[str]:
    return {file.name for file in folder.iterdir()}


@pytest.mark.thorough(witnesses=3)
@pytest.mark.parametrize("name", PLAIN)
def test_the_working_folder_is_where_an_export_goes(
    working: Path, name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["export", "runs/mine", name]) == 0
    written = files(working) - {"runs"}
    first, *rest = capsys.readouterr().out.splitlines()
    assert re.fullmatch(rf"{name}: (\w+_)?mine{re.escape(FORMATS[name].ending)}", first)
    assert {first, *rest} == {f"{name}: {file}" for file in written}


def test_it_goes_to_a_file_or_into_a_folder_that_is_asked_for(working: Path) -> None:
    (working / "out").mkdir()
    assert main(["export", "runs/mine", "fcd", "--out", "out"]) == 0
    assert main(["export", "runs/mine", "csv", "--out", "out/crash.csv"]) == 0
    assert files(working / "out") == {"mine.fcd.xml", "crash.csv", "crash.actors.csv", "crash.columns.csv"}


def test_python_has_the_same(working: Path) -> None:
    run, sweep = vve.load("runs/mine"), vve.load("runs/speeds")
    assert isinstance(run, vve.Run)
    assert isinstance(sweep, vve.Sweep)
    assert run.export("fcd") == [Path("mine.fcd.xml")]
    assert sweep.export(out=working / "rows.csv") == [working / "rows.csv", working / "rows.columns.csv"]
    assert run.export("csv", "a.csv")[0].read_bytes() == run.export("csv", "b.csv")[0].read_bytes()
    with pytest.raises(vve.ConfigError, match="no format 'xlsx' to export to; there are csv, fcd, "):
        run.export("xlsx")


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (["nowhere", "csv"], "nowhere: not there"),
        (["runs", "csv"], "runs: neither a record nor a dataset"),
        (["runs/speeds", "fcd"], "runs/speeds: a sweep's folder; fcd is of one drive: a record, such as "),
        (["runs/mine", "csv", "--out", "no/mine.csv"], "no: no such folder for mine.csv"),
        (["runs/mine", "csv", "--out", "taken.csv"], "taken.columns.csv: there already"),
        (["runs/mine", "fcd", "--out", "taken.columns.csv"], "taken.columns.csv: there already"),
    ],
)
def test_what_is_wrong_is_said_in_one_line_and_nothing_is_written(
    working: Path, arguments: list[str], complaint: str, capsys: pytest.CaptureFixture[str]
) -> None:
    (working / "taken.columns.csv").write_text("kept")
    assert main(["export", *arguments]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"vve-sumo: {complaint}")
    assert files(working) == {"runs", "taken.columns.csv"}
    assert (working / "taken.columns.csv").read_text() == "kept"


def test_several_formats_are_written_all_of_them_or_none(working: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (working / "out").mkdir()
    assert main(["export", "runs/mine", "fcd", "blf", "fcd", "--out", "out"]) == 0
    assert files(working / "out") == {"mine.fcd.xml", "mine.blf"}
    assert main(["export", "runs/mine", "csv", "blf", "--out", "out"]) == 2, "the log is there already"
    assert files(working / "out") == {"mine.fcd.xml", "mine.blf"}
    assert main(["export", "runs/mine", "csv", "asc", "--out", "out/mine.csv"]) == 2
    assert "2 formats make several files" in capsys.readouterr().err
    assert files(working / "out") == {"mine.fcd.xml", "mine.blf"}


@pytest.mark.parametrize("arguments", [[], ["xlsx"], ["--xlsx"]])
def test_a_format_is_asked_for(working: Path, arguments: list[str]) -> None:
    with pytest.raises(SystemExit) as wrong:
        main(["export", "runs/mine", *arguments])
    assert wrong.value.code == 2
    assert files(working) == {"runs"}


@pytest.mark.parametrize(
    ("form", "package", "needs"),
    [
        ("openscenario", "scenariogeneration", "openscenario needs scenariogeneration"),
        ("mf4", "asammdf", "mf4 needs asammdf"),
        ("osi", "osi3.osi_sensorview_pb2", "OSI needs osi-python"),
        ("mcap", "mcap.writer", "mcap needs mcap, mcap-protobuf-support and foxglove-schemas-protobuf"),
    ],
)
def test_an_extra_that_is_missing_is_named(
    working: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    form: str,
    package: str,
    needs: str,
) -> None:
    monkeypatch.setitem(sys.modules, package, None)
    assert main(["export", "runs/mine", form]) == 2
    assert capsys.readouterr().err == f"vve-sumo: {needs}: pip install 'vve-sumo[{form}]'\n"
    assert files(working) == {"runs"}


def test_a_killed_drive_is_exported_up_to_its_last_whole_tick(
    working: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    record(working / "killed", None, ticks=100)
    assert main(["export", "killed", "csv"]) == 0
    said = capsys.readouterr().out.splitlines()[0]
    assert said == f"the record has no end of the drive: exported up to its last complete tick, at {TIME[99]:.2f} s"
    assert (
        len(pd.read_csv("killed.csv")) == len(pd.read_csv("killed.actors.csv").query("actor == 'ego'")) == 100 < TICKS
    )


def test_where_one_file_cannot_be_written_none_is_left(working: Path) -> None:
    (working / "x.actors.csv").symlink_to("/nowhere/to/write")  # its name is free, and opening it fails
    assert main(["export", "runs/mine", "csv", "--out", "x.csv"]) == 2
    assert files(working) == {"runs", "x.actors.csv"}
