"""A record that was altered is named and never believed: nothing that it names is run, and it is never "the same"."""

from __future__ import annotations

import copy
import json
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.drive.street import drive_once
from tests.exhaustive import with_slow
from tests.isolated import isolated
from vve_sumo import cli

#: leaves a trace as soon as it is imported
CONTROLLER = """
from pathlib import Path

from vve_sumo.values import ControlCommand

with Path(__file__).with_suffix(".ran").open("a") as file:
    file.write("imported\\n")


class Straight:
    def step(self, observation):
        return ControlCommand(0.0, 0.5)


def make(vehicle, tuning):
    return Straight()
"""


@pytest.fixture(scope="module")
def driven(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a controller's file and the record of a short drive of it."""
    folder = tmp_path_factory.mktemp("driven")
    (folder / "mine.py").write_text(CONTROLLER, encoding="utf-8")
    name = {"name": f"{folder / 'mine.py'}:make", "tuning": {}}
    obstacles = [{"id": "parked_car", "at_m": 90.0}]
    isolated(drive_once, {"controller": name, "duration_s": 4.0, "obstacles": obstacles}, str(folder / "record"))
    return folder


@pytest.fixture
def record(driven: Path, tmp_path: Path) -> Iterator[Path]:
    """A copy of the record to be altered; the controller has not been run yet."""
    trace = driven / "mine.ran"
    trace.unlink(missing_ok=True)
    yield Path(shutil.copytree(driven / "record", tmp_path / "r"))
    trace.unlink(missing_ok=True)


def ran(driven: Path) -> bool:
    """Whether the controller's file was run."""
    return (driven / "mine.ran").exists()


def replayed(folder: Path, capsys: pytest.CaptureFixture[str]) -> tuple[int, str]:
    """Return the exit code and all that the command says."""
    code = cli.main(["replay", str(folder)])
    said = capsys.readouterr()
    assert "Traceback" not in said.out + said.err
    return code, said.out + said.err


@pytest.mark.thorough
def test_a_record_as_it_was_left_is_the_same(driven: Path, record: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Else all the other tests would find nothing."""
    code, said = replayed(record, capsys)
    assert "every setpoint and every frame is the same" in said
    assert (code, ran(driven)) == (0, True)


def places(content: Any, *above: Any) -> Iterator[tuple[Any, ...]]:
    """Every key of a JSON value, with those above it."""
    inside = content.items() if isinstance(content, dict) else enumerate(content) if isinstance(content, list) else ()
    for key, value in inside:
        yield (*above, key)
        yield from places(value, *above, key)


def other(value: Any) -> Any:
    """Another value of the same kind."""
    if isinstance(value, bool):
        return not value
    if isinstance(value, (int, float)):
        return value + 1
    if isinstance(value, str):
        return f"{value}x"
    return {} if isinstance(value, dict) and value else [] if isinstance(value, list) and value else 7


@pytest.mark.thorough
@pytest.mark.parametrize("file", ["summary.json", "scenario.json"])
@pytest.mark.parametrize("how", with_slow(["changed", "gone"], lambda how: how == "changed"))
def test_every_key_counts(driven: Path, record: Path, file: str, how: str, capsys: pytest.CaptureFixture[str]) -> None:
    text = (record / file).read_text(encoding="utf-8")
    content = json.loads(text)
    form: dict[str, Any] = {"indent": 1, "sort_keys": file == "scenario.json"}
    assert json.dumps(content, **form) + "\n" == text, "else the form alone would be found"
    points = [place for place in places(content) if place[0] != "path_m" or len(place) < 2 or place[1] % 50 == 0]
    assert len(points) > 50
    for place in points:
        altered = copy.deepcopy(content)
        inner = altered
        for key in place[:-1]:
            inner = inner[key]
        if how == "gone":
            del inner[place[-1]]
        else:
            inner[place[-1]] = other(inner[place[-1]])
        (record / file).write_text(json.dumps(altered, **form) + "\n", encoding="utf-8")
        code, said = replayed(record, capsys)
        assert "is the same" not in said, place
        # Another layout is another version's record, whose hashes this one cannot judge.
        other_layout = place == ("layout",)
        assert code == (2 if other_layout else 1), (place, said)
        assert (" of a record, expected" if other_layout else f"{file} is not as the drive left it") in said, place
        assert not ran(driven), place


FILES = (
    "summary.json",
    "scenario.json",
    "pose.bin",
    "can.log",
    "ticks.parquet",
    "actors.parquet",
    "readings.parquet",
    "sensor_radar.parquet",
    "provenance.json",
)


@pytest.mark.thorough(witnesses=3)
@pytest.mark.parametrize("file", FILES)
def test_every_byte_counts(driven: Path, record: Path, file: str, capsys: pytest.CaptureFixture[str]) -> None:
    whole = (record / file).read_bytes()
    random = np.random.default_rng(len(whole))
    for at in (0, len(whole) - 1, *random.integers(len(whole), size=40).tolist()):
        altered = bytearray(whole)
        altered[at] ^= 1 << int(random.integers(8))
        (record / file).write_bytes(altered)
        code, said = replayed(record, capsys)
        assert "is the same" not in said, at
        named = f"{file.removesuffix('.parquet')} is not as the drive left it" in said
        assert code == (1 if named else 2), (at, said)
        assert named or " of a record, expected" in said, (at, said)
        assert not ran(driven), at


@pytest.mark.parametrize("file", FILES)
def test_a_file_that_is_gone_or_cut_short_counts(
    driven: Path, record: Path, file: str, capsys: pytest.CaptureFixture[str]
) -> None:
    whole = (record / file).read_bytes()
    (record / file).write_bytes(whole[: len(whole) // 2])
    for _ in range(2):
        code, said = replayed(record, capsys)
        assert "is the same" not in said
        assert code in (1, 2)
        assert not ran(driven)
        (record / file).unlink(missing_ok=True)


def test_a_controller_that_has_changed_is_not_run(
    driven: Path, record: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = driven / "mine.py"
    whole = file.read_bytes()
    try:
        file.write_bytes(whole + b"# changed\n")
        code, said = replayed(record, capsys)
    finally:
        file.write_bytes(whole)
    assert "controller_mine has changed since" in said
    assert "vve-sumo redrive" in said
    assert code == 1
    assert not ran(driven)


@pytest.mark.thorough
def test_a_redrive_does_not_run_the_recorded_controller(
    driven: Path, record: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Also where it has changed, or is gone: who names another one has no use for it."""
    named = tmp_path / "named.py"
    named.write_text(CONTROLLER.replace("0.5", "0.25"), encoding="utf-8")
    file = driven / "mine.py"
    whole = file.read_bytes()
    try:
        file.unlink()
        code = cli.main(["redrive", str(record), "--controller", f"{named}:make"])
    finally:
        file.write_bytes(whole)
    assert "greatest difference" in capsys.readouterr().out
    assert code == 0
    assert named.with_suffix(".ran").exists()
    assert not ran(driven)
