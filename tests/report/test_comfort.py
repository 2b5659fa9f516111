"""The section of a report that says how the ride felt."""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np
import pytest
from scipy import signal

from tests.analysis.made import PERIOD, moving, write
from tests.report.made import Folders
from vve_sumo.analysis.run import Run
from vve_sumo.metrics.per_drive import OF_RIDE, PER_DRIVE
from vve_sumo.metrics.table import label_of
from vve_sumo.report import curves
from vve_sumo.report.comfort import comfort
from vve_sumo.report.tables import Cell, ReportTable


def ridden(folder: Path, seconds: float, *, size: float = 0.0, speed: float = 10.0) -> Run:
    """A drive along a straight path whose acceleration is a sine of 1 Hz and of this size [m/s2]."""
    time = PERIOD * np.arange(round(seconds / PERIOD) + 1)
    course = np.full_like(time, speed)
    rows = moving(time, course * time, course)
    values = (size * np.sin(2.0 * math.pi * time)).tolist()
    return Run(
        write(
            folder,
            [row | {"true_acceleration_mps2": value} for row, value in zip(rows, values, strict=True)],
        )
    )


def figures(run: Run) -> dict[str, str]:
    table = comfort(run)["comfort"]
    assert isinstance(table, ReportTable)
    rows = {}
    for name, value in table.rows:
        assert isinstance(name, Cell)
        assert isinstance(value, str)
        rows[name.text] = value.replace("\u00a0", " ")
    return rows


def words(run: Run) -> str:
    return " ".join(comfort(run)["comfort_words"]).replace("\u00a0", " ")  # type: ignore[arg-type]


@pytest.mark.thorough
def test_the_section_holds_every_figure_and_the_standards_word(folders: Folders) -> None:
    """The drive's own summary against what the page shows; the killed drive is measured up to its end."""
    for folder in (folders.drive, folders.killed):
        page = (folder / "report.html").read_text(encoding="utf-8").replace("\u00a0", " ")
        section = page.partition('id="comfort"')[2].partition("</details>\n")[0]
        measured = PER_DRIVE.measure(Run(folder).data)
        assert "calls a vibration total value of" in section
        assert "the truth of the simulated vehicle" in section
        for name in OF_RIDE:
            value, unit = measured[name], PER_DRIVE[name].unit
            assert label_of(name) in section
            assert "none" in section if math.isnan(value) else f"{value:.{2 if value >= 0.1 else 3}f} {unit}" in section
        figures_of_the_drive = page.partition('id="figures"')[2].partition('id="stop"')[0]
        assert label_of("msdv_xy_mps1p5") not in figures_of_the_drive


def test_the_weighted_acceleration_of_a_drive_is_what_scipy_makes_of_its_columns(folders: Folders) -> None:
    """A ride that began and ended at rest: of the whole record, by filters in the frequencies of ISO 2631-1."""
    run = Run(folders.drive)
    acceleration = run.ticks["true_acceleration_mps2"].to_numpy()
    weighted = acceleration
    for zeros, poles, hertz in (
        ([1.0, 0.0, 0.0], [1.0, 2.0 * math.pi * 0.4 * math.sqrt(2.0), (2.0 * math.pi * 0.4) ** 2], 0.4),
        ([1.0 / (2.0 * math.pi * 2.0), 1.0], [1.0 / (4.0 * math.pi) ** 2, 1.0 / (0.63 * 4.0 * math.pi), 1.0], 2.0),
    ):
        weighted = signal.lfilter(*signal.bilinear(zeros, poles, fs=1.0 / run.period), weighted)
        assert hertz < 0.1 / run.period  # far below half the rate: prewarping is worth less than a tenth of a per cent
    energy = run.period * float(np.sum(weighted**2))
    ride = run.data.ride_comfort
    assert ride is not None
    duration = len(ride.time) * run.period
    assert (run.summary or {})["weighted_rms_x_mps2"] == pytest.approx(math.sqrt(energy / duration), rel=0.01)


@pytest.mark.parametrize(("size", "word"), [(0.3, "not uncomfortable"), (3.0, "very uncomfortable")])
def test_a_strong_ride_has_another_word(tmp_path: Path, size: float, word: str) -> None:
    """A sine's root mean square is 0.707 of its size; Wd is 1.011 at 1 Hz."""
    run = ridden(tmp_path / "ride", 60.0, size=size)
    assert comfort(run)["comfort_status"].startswith(word)  # type: ignore[attr-defined]
    said = re.search(r"total value of (\S+) m/s² “([^”]+)”", words(run))
    assert said is not None
    assert float(said[1]) == pytest.approx(1.011 * size / math.sqrt(2.0), abs=0.01)
    assert said[2].startswith(word)
    assert "vertical" in words(run)


def test_a_single_event_is_told_from_steady_shaking(tmp_path: Path, folders: Folders) -> None:
    assert "short events" not in words(ridden(tmp_path / "steady", 60.0, size=1.0))
    assert "short events" in words(Run(folders.drive))


def test_what_a_ride_is_too_short_for_is_none(tmp_path: Path) -> None:
    short, shorter = ridden(tmp_path / "short", 8.0, size=1.0), ridden(tmp_path / "shorter", 2.0, size=1.0)
    assert figures(short)[label_of("msdv_xy_mps1p5")] == "none"
    assert figures(short)[label_of("weighted_rms_x_mps2")] != "none"
    assert {name for name, value in figures(shorter).items() if value != "none"} == {label_of("max_jerk_xy_mps3")}
    assert comfort(shorter)["comfort_status"] == ""
    assert "total value" not in words(shorter)


def test_a_car_that_never_drove_has_no_comfort_and_the_section_says_so(tmp_path: Path) -> None:
    content = comfort(ridden(tmp_path / "standing", 30.0, speed=0.0))
    assert content["comfort"] is None
    assert "did not drive" in str(content["comfort_missing"])


def test_the_curves_have_a_panel_of_it(folders: Folders) -> None:
    run = Run(folders.drive)
    panels = [panel for panel in curves.curves(run)["panels"] if panel["series"][0]["label"] == "weighted acceleration"]
    assert len(panels) == 1
    assert panels[0]["unit"] == "m/s²"
    known = [value for value in panels[0]["series"][0]["values"] if value is not None]
    assert max(known) == pytest.approx((run.summary or {})["mtvv_xy_mps2"], abs=6e-4)
