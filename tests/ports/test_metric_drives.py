"""A drive and a sweep that are measured and judged by the metrics of an invented lab."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from tests.drive.street import drive_once
from tests.isolated import isolated
from tests.ports.toy_metric import COMFORT, COURSE, HARD, PEAK
from tests.sweep.reading import load_rows
from vve_sumo import cli
from vve_sumo.analysis.load import load as load_record
from vve_sumo.analysis.over_time import over_time
from vve_sumo.analysis.run import Run
from vve_sumo.drive.verify import alterations
from vve_sumo.metrics.table import METRICS
from vve_sumo.report.drive import report

SHORT = {"duration_s": 8.0, "obstacles.0.at_m": 60.0, "metrics": [COMFORT]}
ASKED = {"criteria": {PEAK: {"max": 0.001}, HARD: False}}


@pytest.fixture(scope="module")
def record(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("metric") / "record"
    isolated(drive_once, SHORT | ASKED, str(folder))
    return folder


@pytest.mark.thorough
def test_a_drive_is_measured_and_judged(record: Path) -> None:
    """By the recorded ticks themselves, in plain Python."""
    run = load_record(record)
    assert isinstance(run, Run)
    rows = pq.read_table(record / "ticks.parquet").to_pylist()
    course = [row["true_speed_mps"] * row["yaw_rate_radps"] for row in rows]
    peak = max(abs(value) for value in course if value == value)
    assert run.summary is not None
    assert run.summary[PEAK] == pytest.approx(peak, rel=1e-12)
    assert peak > 0.001
    assert run.summary[HARD] is False
    assert f"{PEAK} is {peak:.3f}, expected at most 0.001" in run.summary["failed"]
    table = over_time(run)
    assert np.allclose(table[COURSE], course, rtol=1e-12, equal_nan=True)
    assert (table.attrs["units"][COURSE], table.attrs["labels"][COURSE]) == ("m/s²", "lateral acceleration")
    assert table.attrs["meanings"][COURSE] == "speed times yaw rate, left positive"


@pytest.mark.thorough
def test_the_report_shows_it_with_its_words_without_its_code(record: Path, tmp_path: Path) -> None:
    copy = Path(shutil.copytree(record, tmp_path / "copy"))
    resolved = json.loads((copy / "scenario.json").read_text(encoding="utf-8"))
    resolved["settings"]["metrics"] = ["gone.py:make"]
    (copy / "scenario.json").write_text(json.dumps(resolved), encoding="utf-8")
    METRICS.maps[1].clear()  # type: ignore[attr-defined]
    page = report(load_record(copy))  # type: ignore[arg-type]
    figures = {row[0].text: row[1] for row in page.content["figures"].rows}  # type: ignore[attr-defined]
    assert figures["maximum lateral acceleration"].endswith("m/s²")
    assert figures["hard turn"] == "no"
    assert page.key_figures[0].label == "maximum lateral acceleration"
    assert page.key_figures[0].kind == "no"
    assert [series["label"] for series in page.data["panels"][-1]["series"]] == ["lateral acceleration"]


def test_the_record_keeps_its_rows_and_the_hash_of_its_code(record: Path) -> None:
    resolved = json.loads((record / "scenario.json").read_text(encoding="utf-8"))
    assert [row["name"] for row in resolved["metrics"]["per_drive"]] == [PEAK, HARD]
    assert "metric_0:lateral_comfort" in resolved["files_sha256"]


def test_what_was_changed_of_it_is_found_and_nothing_of_it_is_run(record: Path, tmp_path: Path) -> None:
    assert alterations(record) == []
    copy = Path(shutil.copytree(record, tmp_path / "copy"))
    table = pq.read_table(copy / "metrics.parquet")
    pq.write_table(table.slice(1), copy / "metrics.parquet")
    assert [one.part for one in alterations(copy) or ()] == ["metrics"]
    (copy / "metrics.parquet").unlink()
    assert [one.part for one in alterations(copy) or ()] == ["metrics"]


@pytest.mark.thorough
def test_a_replay_needs_no_metric(record: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The metrics' file is another now; the drive is replayed all the same."""
    assert cli.main(["replay", str(record)]) == 0
    assert "every setpoint and every frame is the same" in capsys.readouterr().out


SCENARIO = """
title = "A second straight on"
duration_s = 1.0
road.network = "proving_ground"
ego.path = "proving_ground"
ego.speed_mps = 5.0
ego.lot = { latitude_deg = 40.0, longitude_deg = -83.0, heading_deg = 85.0 }
"""
MEASURE = """
from vve_sumo.metrics.port import Metrics


def fastest(drive):
    return float(drive.motion.speed.max())


def make():
    metrics = Metrics()
    metrics.per_drive.add("fastest_mps", "fastest", "greatest speed", fastest, worse="higher")
    return metrics
"""
RANGE = "[parameters]\nego.speed_mps = { min = 4.0, max = 6.0 }\n"


@pytest.fixture
def lab(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with a metric, a scenario that does not name it, and a sweep that does."""
    (tmp_path / "scenarios").mkdir()
    (tmp_path / "scenarios" / "second.toml").write_text(SCENARIO, encoding="utf-8")
    (tmp_path / "fast.py").write_text(MEASURE, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def sweep(lab: Path, text: str, *options: str) -> int:
    (lab / "mine.toml").write_text(f'scenario = "second"\nmetrics = ["fast.py:make"]\n{text}', encoding="utf-8")
    return cli.main(["sweep", "mine.toml", "--out", "rows", "--workers", "1", "--quiet", *options])


@pytest.mark.thorough
def test_a_sweep_has_a_column_of_it_and_resumes_with_the_same_code_alone(
    lab: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = "[parameters]\nego.speed_mps = [4.0, 6.0]\n"
    assert sweep(lab, text) == 0
    rows = load_rows(lab / "rows")
    assert rows["fastest_mps"].tolist() == rows["max_speed_mps"].tolist()
    opened = load_record(lab / "rows")
    assert opened.rows().attrs["meanings"]["fastest_mps"] == "greatest speed"  # type: ignore[union-attr]
    assert "fastest_mps" in opened.figures  # type: ignore[union-attr]
    grouped = opened.grouped(figures=["fastest_mps"])  # type: ignore[union-attr]
    assert grouped["worst_fastest_mps"].tolist() == grouped["greatest_fastest_mps"].tolist()
    assert "fastest_mps_worst" in (lab / "rows" / "combinations.csv").read_text(encoding="utf-8")
    assert sweep(lab, text, "--resume") == 0
    (lab / "fast.py").write_text(MEASURE.replace("max()", "min()"), encoding="utf-8")
    capsys.readouterr()
    assert sweep(lab, text, "--resume") == 2
    assert "the file of metric_0:fast has changed since that sweep began" in capsys.readouterr().err


@pytest.mark.thorough
def test_a_criterion_on_it_is_varied_and_one_that_fails_says_why_in_its_row(lab: Path) -> None:
    assert sweep(lab, "[parameters]\ncriteria.fastest_mps.max = [0.001, 9.0]\n") == 0
    rows = load_rows(lab / "rows")
    assert rows["meets_fastest_mps"].tolist() == [False, True]
    assert rows["passed"].tolist() == [False, True]
    (lab / "fast.py").write_text(MEASURE.replace("drive.motion", "drive.emotion"), encoding="utf-8")
    (lab / "mine.toml").write_text('scenario = "second"\nmetrics = ["fast.py:make"]\nseeds = 2\n', encoding="utf-8")
    assert cli.main(["sweep", "mine.toml", "--out", "broken", "--workers", "1", "--quiet"]) == 0
    rows = load_rows(lab / "broken")
    assert rows["fastest_mps"].isna().all()
    assert rows["max_speed_mps"].notna().all()
    said = "metric fast.py:make: fastest_mps raised AttributeError: 'DriveData' object has no attribute 'emotion'"
    assert rows["text"].tolist() == [f"{said} (fast.py, line 6)"] * 2


@pytest.mark.thorough
def test_a_search_looks_for_its_worst(lab: Path) -> None:
    pytest.importorskip("optuna", reason="a search for the worst case needs the extra `search`")
    assert sweep(lab, f'[search]\nhighest = "fastest_mps"\npoints = 2\nbatch = 2\n{RANGE}') == 0
    found = json.loads((lab / "rows" / "search.json").read_text(encoding="utf-8"))
    assert found["worst"]["fastest_mps"] == load_rows(lab / "rows")["fastest_mps"].max()


@pytest.mark.thorough(witnesses=1)
@pytest.mark.parametrize(
    ("text", "said"),
    [
        (
            '[search]\nhighest = "fastet_mps"\n[parameters]\nego.speed_mps = { min = 4.0, max = 6.0 }\n',
            "did you mean 'fastest_mps'",
        ),
        ("[parameters]\nmetrics.0 = ['a.py:make']\n", "parameters.metrics.0: expected metrics = "),
    ],
)
def test_what_is_wrong_with_a_sweep_of_it_is_one_line(
    text: str, said: str, lab: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert sweep(lab, text) == 2
    assert said in capsys.readouterr().err
    assert not (lab / "rows").exists()


@pytest.mark.thorough
def test_a_missing_file_is_found_before_anything_is_driven(lab: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (lab / "fast.py").unlink()
    assert sweep(lab, "seeds = 2\n") == 2
    assert "metrics: metric fast.py:make: there is no file fast.py" in capsys.readouterr().err
    assert cli.main(["drive", "second", "--set", 'metrics=["fast.py:make"]', "--out", "one"]) == 2
    assert not (lab / "one").exists()
