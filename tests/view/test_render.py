"""`vve-sumo render`: pictures of a record, the same every time, and one clear line where something is missing."""

from __future__ import annotations

import io
import re
import subprocess
import sys
from itertools import combinations
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from PIL import Image

from tests.exhaustive import with_slow
from tests.view.made import Made
from vve_sumo.analysis.run import Run
from vve_sumo.cli import main
from vve_sumo.errors import ConfigError
from vve_sumo.view import browser, movie
from vve_sumo.view.browser import BrowserError, find_browser
from vve_sumo.view.pictures import VIEWS, Pictures

#: a fixture that takes long: `./check test` leaves its tests out
THOROUGH_FIXTURE = "drawn"

SMALL = ["--size", "192x108"]


@pytest.fixture(autouse=True, scope="module")
def _with_a_browser() -> None:
    try:
        find_browser()
    except BrowserError as missing:
        pytest.skip(str(missing))


def colours(picture: bytes) -> Any:
    return np.asarray(Image.open(io.BytesIO(picture)).convert("RGB")).astype(int)


class Drawn(NamedTuple):
    middle: bytes
    end: bytes
    again: bytes  #: as `middle`, after `end`


@pytest.fixture(scope="module")
def drawn(made: Made) -> dict[str, Drawn]:
    """Pictures of a drive, of every view."""
    run, found = Run(made.drive), {}
    middle, end = float(run.time[-1]) / 3.0, float(run.time[-1])
    for view in VIEWS:
        with Pictures(run, view, 320, 180) as pictures:
            found[view] = Drawn(*(pictures.at(time) for time in (middle, end, middle)))
            assert not pictures.complaints
    return found


@pytest.mark.thorough
@pytest.mark.parametrize("view", VIEWS)
def test_a_view_shows_something_that_moves_and_is_the_same_every_time(drawn: dict[str, Drawn], view: str) -> None:
    middle, end, again = drawn[view]
    assert middle == again
    assert colours(middle).shape == (180, 320, 3)
    assert len(np.unique(colours(middle).reshape(-1, 3), axis=0)) > 50
    # The caption, which changes anyway, lies in the lower third.
    changed = np.abs(colours(middle) - colours(end))[:120].sum(axis=2) > 30
    assert changed.mean() > 0.01


@pytest.mark.thorough
def test_another_browser_draws_the_same_bytes(made: Made, drawn: dict[str, Drawn]) -> None:
    run = Run(made.drive)
    with Pictures(run, "driver", 320, 180) as pictures:
        assert pictures.at(float(run.time[-1]) / 3.0) == drawn["driver"].middle


@pytest.mark.thorough
def test_pictures_know_the_gap_and_what_was_not_detected(made: Made) -> None:
    run = Run(made.drive)
    k = int(np.flatnonzero(np.isfinite(run.data.strip_lead.gap))[-20])
    with Pictures(run, "street", 64, 64) as pictures:
        frame = pictures.evaluate(f"pictures.frames.frame({k})")
    assert frame["gap"] == pytest.approx(float(run.data.strip_lead.gap[k]), abs=1e-4)
    assert {*frame["sensed"][0]["unseen"]} == {"id", "why"}


def test_views_differ_from_each_other(drawn: dict[str, Drawn]) -> None:
    for one, other in combinations((colours(each.middle) for each in drawn.values()), 2):
        assert (np.abs(one - other).sum(axis=2) > 30).mean() > 0.2


@pytest.mark.thorough
def test_a_picture_is_written_and_none_replaced(
    made: Made, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    asked = ["render", str(made.drive), "--png", "--at", "4.5", "--view", "chase", *SMALL]
    assert main(asked) == 0
    assert Image.open(tmp_path / "drive.png").size == (192, 108)
    assert capsys.readouterr().out == "png: drive.png\n"
    before = (tmp_path / "drive.png").read_bytes()
    assert main(asked) == 2
    assert "drive.png: exists already" in capsys.readouterr().err
    assert (tmp_path / "drive.png").read_bytes() == before


@pytest.mark.thorough
@pytest.mark.parametrize("form", with_slow(["gif", "webp"], lambda form: form == "webp"))
def test_a_moving_picture_has_a_frame_for_each_time(made: Made, tmp_path: Path, form: str) -> None:
    file = tmp_path / f"moving.{form}"
    span = ["--from", "5", "--to", "6", "--fps", "5"]
    assert main(["render", str(made.drive), f"--{form}", *span, *SMALL, "--out", str(file)]) == 0
    with Image.open(file) as moving:
        assert (moving.size, moving.n_frames, moving.info["loop"]) == ((192, 108), 6, 0)
        durations = []
        for k in range(moving.n_frames):
            moving.seek(k)
            moving.load()
            durations.append(moving.info["duration"])
    assert durations == [200] * 6


def test_a_gif_takes_as_long_as_the_drive(tmp_path: Path) -> None:
    file, pictures = tmp_path / "second.gif", []
    for k in range(30):
        picture = io.BytesIO()
        Image.new("RGB", (64, 64), (8 * k, 0, 0)).save(picture, "PNG")
        pictures.append(picture.getvalue())
    movie.write_gif(file, pictures, 30.0)
    with Image.open(file) as moving:
        lasting = 0
        for k in range(moving.n_frames):
            moving.seek(k)
            lasting += moving.info["duration"]
    assert lasting == 1000


@pytest.mark.slow
def test_a_film_is_h264_of_the_length_that_was_asked_for(made: Made, tmp_path: Path) -> None:
    try:
        ffmpeg = movie.find_ffmpeg()
    except ConfigError as missing:
        pytest.skip(str(missing))
    file = tmp_path / "film.mp4"
    span = ["--from", "5", "--to", "6", "--fps", "10"]
    assert main(["render", str(made.drive), "--mp4", *span, *SMALL, "--out", str(file)]) == 0
    said = subprocess.run([ffmpeg, "-i", str(file)], capture_output=True, text=True, timeout=60, check=False).stderr
    assert re.search(r"Video: h264.*yuv420p.*192x108.* 10 fps", said), said
    assert "Duration: 00:00:01.10" in said
    again = tmp_path / "again.mp4"
    assert main(["render", str(made.drive), "--mp4", *span, *SMALL, "--out", str(again)]) == 0
    assert again.read_bytes() == file.read_bytes()


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        (["--png"], "--png: expected --at, a drive time from 0 to "),
        (["--png", "--at", "900"], "--at 900: expected a drive time from 0 to "),
        (["--gif", "--at", "2"], "--at: goes with --png"),
        (["--gif", "--from", "9", "--to", "8"], "--to 8: expected a drive time from 9 to "),
        (["--gif", "--fps", "60"], "--fps 60: expected at most 50 pictures a second for a GIF"),
        (["--webp", "--fps", "100", "--size", "4096x4096"], " pictures of 4096x4096 are too many to keep in memory"),
        (["--webp", "--out", "nowhere/a.webp"], "nowhere: no such folder for a.webp"),
    ],
)
def test_what_cannot_be_drawn_is_one_line(
    made: Made, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str],
    asked: list[str], said: str,
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    assert main(["render", str(made.drive), *asked]) == 2
    error = capsys.readouterr().err
    assert said in error
    assert error.count("\n") == 1
    assert not [*tmp_path.iterdir()]


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        (["--size", "12x12"], "expected sides of 64 to 4096 pixels, got 12x12"),
        (["--size", "wide"], "expected WIDTHxHEIGHT such as 1280x720, got 'wide'"),
        (["--fps", "0"], "expected more than 0 and at most 100 pictures a second, got 0"),
        (["--from", "nan"], "expected seconds such as 12.3, got 'nan'"),
    ],
)
def test_wrong_numbers_are_wrong_use(
    made: Made, capsys: pytest.CaptureFixture[str], asked: list[str], said: str
) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["render", str(made.drive), "--gif", *asked])
    assert ended.value.code == 2
    assert said in capsys.readouterr().err


@pytest.mark.thorough
def test_a_missing_browser_is_said_with_what_installs_one(
    made: Made, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.delenv(browser.VARIABLE, raising=False)
    asked = ["render", str(made.drive), "--png", "--at", "2"]
    assert main(asked) == 2
    error = capsys.readouterr().err
    assert "no Chromium is installed" in error
    assert "sudo apt-get install chromium" in error
    assert error.count("\n") == 1
    monkeypatch.setenv(browser.VARIABLE, "/nowhere/chromium")
    assert main(asked) == 2
    assert (
        "VVE_CHROMIUM: expected the path of a Chromium, found no program /nowhere/chromium" in capsys.readouterr().err
    )
    # Something that is no browser.
    monkeypatch.setenv(browser.VARIABLE, sys.executable)
    assert main(asked) == 2
    assert "the browser ended unexpectedly" in capsys.readouterr().err
    assert not [*tmp_path.iterdir()]


def test_a_missing_ffmpeg_is_said_before_anything_is_drawn(
    made: Made, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    assert main(["render", str(made.drive), "--mp4", "--out", str(tmp_path / "film.mp4")]) == 2
    error = capsys.readouterr().err
    assert "no ffmpeg is installed" in error
    assert "pip install 'vve-sumo[video]'" in error
    assert not [*tmp_path.iterdir()]


def test_a_sweep_is_no_drive(made: Made, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["render", str(made.sweep), "--png", "--at", "1"]) == 2
    assert "is a sweep's folder, expected the record of one drive" in capsys.readouterr().err
