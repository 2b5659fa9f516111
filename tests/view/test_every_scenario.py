"""Every shipped scenario's record can be shown, drawn, reported and exported, also one of an empty street."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest

from tests.exhaustive import with_slow
from tests.isolated import REPOSITORY, isolated
from tests.live.patience import until
from tests.view.conftest import holds
from tests.view.test_page import opened
from vve_sumo.cli import main
from vve_sumo.export.formats import FORMATS
from vve_sumo.view.browser import BrowserError, find_browser

#: a drive's end [s]: by then the ego moves in every scenario
ENDS = 12.0
EMPTY = "calibration"
#: with nobody on the street, with signals
USUAL = (EMPTY, "crossing_at_signal")
SCENARIOS = sorted(file.stem for file in (REPOSITORY / "scenarios").glob("*.toml"))


def drive(name: str, folder: str) -> None:
    """Drive the beginning of a shipped scenario; call it through `isolated`."""
    from vve_sumo.drive import run as drives
    from vve_sumo.drive.run import resolve_by_name

    drives.run(resolve_by_name(name, REPOSITORY, values={"duration_s": ENDS}), Path(folder), REPOSITORY)


@pytest.fixture(scope="module")
def record(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    """What returns the record of a scenario's beginning, driven once."""

    @cache
    def driven(name: str) -> Path:
        folder = tmp_path_factory.mktemp("every") / name
        isolated(drive, name, str(folder))
        return folder

    return driven


@pytest.fixture(scope="module", params=with_slow(SCENARIOS, lambda name: name in USUAL))
def driven(request: pytest.FixtureRequest, record: Callable[[str], Path]) -> Path:
    """The record of one scenario's beginning."""
    return record(request.param)


def ended(record: Path) -> float:
    """Return the drive time of a record's last tick [s]."""
    return float(pq.read_table(record / "ticks.parquet")["time_s"][-1].as_py())


@pytest.mark.thorough
def test_an_empty_street_is_among_them(record: Callable[[str], Path]) -> None:
    assert pq.read_metadata(record(EMPTY) / "actors.parquet").num_rows == 0


@pytest.mark.thorough(witnesses=1)
def test_the_page_opens_and_plays_to_the_end(driven: Path, tmp_path: Path, browser: Any) -> None:
    page = tmp_path / "page.html"
    assert main(["view", str(driven), "--html", str(page)]) == 0
    with opened(browser, page.as_uri()) as shown:
        until(lambda: holds(shown, "vveSumo.shown.records[0].frames.details !== null"))
        shown.evaluate(f"vveSumo.shown.seek({ENDS})")
        assert shown.evaluate("vveSumo.shown.time") == pytest.approx(ended(driven))


@pytest.mark.thorough
def test_a_picture_is_drawn(driven: Path, tmp_path: Path) -> None:
    try:
        find_browser()
    except BrowserError as missing:
        pytest.skip(str(missing))
    picture = tmp_path / "picture.png"
    size = ["--size", "128x72"]
    assert (
        main(
            [
                "render",
                str(driven),
                "--png",
                "--at",
                f"{0.9 * ended(driven):.2f}",
                "--view",
                "street",
                *size,
                "--out",
                str(picture),
            ]
        )
        == 0
    )
    assert picture.stat().st_size > 0


@pytest.mark.thorough
def test_the_report_is_written(driven: Path) -> None:
    assert main(["report", str(driven)]) == 0
    assert (driven / "report.html").stat().st_size > 0


@pytest.mark.thorough
def test_every_format_is_written(driven: Path, tmp_path: Path) -> None:
    for name in FORMATS:
        (tmp_path / name).mkdir()
        assert main(["export", str(driven), name, "--out", str(tmp_path / name)]) == 0
        assert all(file.stat().st_size > 0 for file in (tmp_path / name).iterdir())
