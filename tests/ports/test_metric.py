"""The shipped metrics and those of an invented lab against the port's suite; how a file is found, fails and is used."""

from __future__ import annotations

import json
import math
import re
import shutil
import sys
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pyarrow.parquet as pq
import pytest

from tests.drive.street import drive_once
from tests.isolated import isolated
from tests.metrics.tables import CAR, straight
from tests.ports.metric import BRAKING, MetricConformance, approach
from tests.sweep.reading import load_rows
from vve_sumo import cli
from vve_sumo.analysis.load import load as load_record
from vve_sumo.analysis.over_time import over_time
from vve_sumo.analysis.run import Run
from vve_sumo.drive.summary import measure, summary_of
from vve_sumo.drive.termination import DriveEnd, Outcome
from vve_sumo.drive.verify import alterations
from vve_sumo.errors import ConfigError
from vve_sumo.metrics.own import RESERVED, load_own
from vve_sumo.metrics.port import PORT, load, shipped
from vve_sumo.metrics.table import FIGURES, METRICS, SHIPPED_METRICS
from vve_sumo.record.sweep_folder import COLUMNS
from vve_sumo.report.drive import report
from vve_sumo.scenario.load import check_criteria, parse
from vve_sumo.scenario.schema import Criteria, CriterionBand, Scenario
from vve_sumo.sweep.plan import with_metrics
from vve_sumo.sweep.spec import parse_spec

TOY = Path(__file__).parent / "toy"
COMFORT = f"{TOY / 'lateral_comfort.py'}:make"
PEAK, HARD, COURSE = "max_lateral_acceleration_mps2", "hard_turn", "lateral_acceleration_mps2"


class TestPerDrive(MetricConformance):
    name = "per_drive"
    expected: ClassVar[dict[str, Any]] = {"collision": False, "max_speed_mps": 10.0, "max_deceleration_mps2": BRAKING}


class TestPerTick(MetricConformance):
    name = "per_tick"


class TestLateralComfort(MetricConformance):
    name = COMFORT
    #: 10 m/s times a yaw rate of 0.08 rad/s, at the top of its sine
    expected: ClassVar[dict[str, Any]] = {PEAK: 0.8, HARD: False}


def test_the_tables_hold_what_the_port_brings_of_the_shipped_files() -> None:
    offered = [load(name) for name in PORT.shipped]
    names = {name for part in offered for table in (part.per_drive, part.per_tick) for name in table}
    assert names == {*shipped().per_drive} | {*shipped().per_tick} <= {*SHIPPED_METRICS}
    assert {*shipped().per_drive} <= {*FIGURES}


def test_no_metric_may_have_the_name_of_what_else_stands_in_a_row_or_a_summary() -> None:
    assert {*COLUMNS} <= {*SHIPPED_METRICS} | RESERVED


# --- how a file is found, and what is wrong with it -------------------------------------------------------------------

OFFER = """
from vve_sumo.metrics.port import Metrics


def make():
    metrics = Metrics()
    metrics.{table}.add({arguments})
    return metrics
"""
IMPORT = "from vve_sumo.metrics.port import Metrics\n"
GOOD = "'mine_m', 'mine', 'how far', lambda drive: 1.0"


def offering(folder: Path, arguments: str = GOOD, table: str = "per_drive", name: str = "mine") -> str:
    file = folder / f"{name}.py"
    file.write_text(OFFER.format(arguments=arguments, table=table), encoding="utf-8")
    return f"{file}:make"


WRONG = [
    ("'Mine', 'mine', 'how far', len", r"'Mine': expected a name of small letters"),
    ("'meets_mine', 'mine', 'how far', len", r"'meets_mine': expected a name that does not begin with meets_"),
    ("'min_gap_m', 'mine', 'how far', len", r"min_gap_m is a name that vve_sumo uses itself, expected another"),
    ("'seed', 'mine', 'how far', len", r"seed is a name that vve_sumo uses itself, expected another"),
    ("'mine_m', '', 'how far', len", r"'mine_m': label: expected a text of one line, got ''"),
    ("'mine_m', 'mine', 'how\\nfar', len", r"'mine_m': meaning: expected a text of one line, got 'how\\nfar'"),
    ("'mine_m', 'mine', 'how far', 5", r"mine_m: expected a function that measures it"),
    ("'mine_m', 'mine', 'how far', len, worse='up'", r"'mine_m': worse: expected 'lower', 'higher' or None, got 'up'"),
    ("'mine_m', 'mine', 'how far', len, kind='list'", r"'mine_m': kind: expected bool, int, float, str, got 'list'"),
    (
        "'mine_m', 'mine', 'how far', len, absent='x'",
        r"'mine_m': expected criterion as a truth value, absent",
    ),
    ("'mine_m', 'mine', 'how far', len, actor='who'", r"mine_m: actor: no metric 'who' that names an actor"),
    ("'mine_m', 'mine', 'how far', len, better='up'", r"make raised TypeError: .*'better' \(metric.py, line \d+\)"),
    (f"{GOOD}); metrics.per_drive.add({GOOD}", r"make raised ValueError: mine_m is added twice"),
    (f"{GOOD}); metrics.per_tick.add({GOOD}", r"mine_m is a metric of the drive and of the ticks"),
]


@pytest.mark.parametrize(("arguments", "said"), WRONG)
def test_a_wrong_offer_is_one_line(arguments: str, said: str, tmp_path: Path) -> None:
    name = offering(tmp_path, arguments)
    with pytest.raises(ConfigError, match=f"^metric {re.escape(name)}: {said}") as refused:
        load_own([name])
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("def make(:", "reading .* raised SyntaxError"),
        ("made = 1", r"offers no function make\(\)"),
        ("def make(): return {}", r"make returned {}, expected Metrics"),
        ("def make(): raise SystemExit(3)", "make raised SystemExit: 3"),
        (f"{IMPORT}make = Metrics", "it offers no metric"),
        (
            "from vve_sumo.metrics.port import Metrics\ndef make(): return Metrics(per_drive={})",
            "expected a MetricTable",
        ),
    ],
)
def test_a_file_that_offers_nothing_is_one_line(text: str, said: str, tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text(text, encoding="utf-8")
    with pytest.raises(ConfigError, match=f"^metric .*{said}") as refused:
        load_own([f"{tmp_path / 'mine.py'}:make"])
    assert "\n" not in str(refused.value)


def test_only_numbers_and_texts_are_of_ticks(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="mine_m: kind 'bool', of ticks expected float or str"):
        load_own([offering(tmp_path, f"{GOOD}, kind='bool'", "per_tick")])


def test_two_files_do_not_share_a_name_and_shipped_ones_are_always_measured(tmp_path: Path) -> None:
    one, other = offering(tmp_path), offering(tmp_path, name="other")
    with pytest.raises(ConfigError, match=rf"other.py:make: mine_m is also a metric of {re.escape(one)}"):
        load_own([one, other])
    with pytest.raises(ConfigError, match="metric per_drive: shipped metrics are always measured"):
        load_own(["per_drive"])


@pytest.fixture
def plugin(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An installed package that offers `mine_m` by that name, and one that is broken."""
    metadata = tmp_path / "site" / "vve_test_metrics-1.0.dist-info"
    metadata.mkdir(parents=True)
    offering(tmp_path / "site", name="vve_test_metrics")
    (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: vve-test-metrics\nVersion: 1.0\n")
    points = "mine_m = vve_test_metrics:make\nbroken = vve_test_metrics:absent\n"
    (metadata / "entry_points.txt").write_text(f"[vve_sumo.metrics]\n{points}")
    monkeypatch.syspath_prepend(tmp_path / "site")
    yield tmp_path
    sys.modules.pop("vve_test_metrics", None)


def scenario_with(**keys: Any) -> Scenario:
    table = {"title": "t", "road": {"network": "n"}, "ego": {"path": "p", "speed_mps": 5.0, "lot": LOT}}
    return parse({**table, **keys}, Path("mine.toml"))


LOT = {"latitude_deg": 40.0, "longitude_deg": -83.0, "heading_deg": 0.0}


def test_an_installed_metric_needs_no_more_than_a_criterion(plugin: Path) -> None:
    scenario = scenario_with(criteria={"mine_m": {"max": 2.0}})
    assert scenario.metrics == ("mine_m",)
    assert dict(scenario.criteria)["mine_m"] == CriterionBand(max=2.0)
    assert [*load_own(scenario.metrics).declared.per_drive] == ["mine_m"]
    assert parse(scenario.model_dump(mode="json"), Path("mine.toml")) == scenario
    with pytest.raises(ConfigError, match=r"^metric broken: its entry point raised AttributeError"):
        load_own(["broken"])


def test_a_search_for_an_installed_metric_measures_it(plugin: Path) -> None:
    axis = {"ego.speed_mps": {"min": 1.0, "max": 2.0}}
    spec = parse_spec({"scenario": "s", "search": {"lowest": "mine_m"}, "parameters": axis}, Path("sweep.toml"))
    assert with_metrics({"metrics": ["a.py:make"]}, spec)["metrics"] == ["a.py:make", "mine_m"]


def test_the_command_lists_shipped_installed_and_own_ones(plugin: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["metrics", COMFORT, "--json"]) == 2, "one is broken"
    said = capsys.readouterr()
    rows = {row["name"]: row for row in json.loads(said.out)}
    assert {PEAK, COURSE, "mine_m", "min_gap_m", "jerk_mps3"} <= {*rows}
    assert (rows[PEAK]["unit"], rows[PEAK]["worse"], rows[PEAK]["from"]) == ("m/s²", "higher", COMFORT)
    assert said.err.splitlines() == [said.err.strip()]
    assert said.err.startswith("vve-sumo metrics: metric broken: ")


# --- criteria ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("criteria", "said"),
    [
        ({"max_lateral_acceleration": {"max": 1.0}}, f"unknown key .*, did you mean '{PEAK}'"),
        ({"min_ttc": {"min": 1.0}}, "unknown key 'criteria.min_ttc', did you mean 'min_ttc_s'"),
        ({COURSE: {"max": 1.0}}, f"unknown key 'criteria.{COURSE}'"),
        ({PEAK: True}, rf"criteria.{PEAK}: expected a band {{ min = …, max = … }}"),
        ({HARD: {"max": 1.0}}, f"criteria.{HARD}: expected true or false"),
    ],
)
def test_a_criterion_that_no_metric_brings_is_one_line(criteria: dict[str, Any], said: str) -> None:
    scenario = scenario_with(metrics=[COMFORT], criteria=criteria)
    with pytest.raises(ConfigError, match=f"^mine.toml: {said}"):
        check_criteria(scenario, load_own(scenario.metrics).declared, Path("mine.toml"))


@pytest.mark.parametrize(
    ("criteria", "said"),
    [
        ({"min_ttc": {"min": 1.0}}, "mine.toml: unknown key 'criteria.min_ttc', did you mean 'min_ttc_s'?"),
        ({PEAK: {"max": 1.0}}, f"mine.toml: unknown key 'criteria.{PEAK}'"),
    ],
)
def test_without_metrics_an_unknown_criterion_is_found_at_once(criteria: dict[str, Any], said: str) -> None:
    with pytest.raises(ConfigError, match=re.escape(said)):
        scenario_with(criteria=criteria)


@pytest.mark.parametrize(
    ("limit", "said"),
    [
        (5, "criteria.mine_m: expected a table, got 5"),
        ({"max": "far"}, "criteria.mine_m.max: expected a number, got 'far'"),
        ({"most": 1.0}, "unknown key 'criteria.mine_m.most'"),
        ({"min": 2.0, "max": 1.0}, "criteria.mine_m: least 2 is above greatest 1"),
    ],
)
def test_a_wrong_limit_of_a_metric_names_its_key(limit: object, said: str) -> None:
    with pytest.raises(ConfigError, match=re.escape(said)):
        scenario_with(metrics=["mine.py:make"], criteria={"mine_m": limit})


# --- a metric that fails ----------------------------------------------------------------------------------------------


class Setting:
    """What a drive is judged by."""

    name, path, vehicle = "a drive", straight(), CAR

    def __init__(self, metrics: list[str], **criteria: Any) -> None:
        self.scenario = scenario_with(metrics=metrics).model_copy(update={"criteria": Criteria(**criteria)})


def summary_with(name: str, **criteria: Any) -> dict[str, Any]:
    setting, drive, own = Setting([name], **criteria), approach(), load_own([name])
    measured = measure(setting, own, drive.ticks, drive.actors, None)
    return summary_of(setting, DriveEnd(Outcome.STOPPED, ()), drive.ticks, drive.actors, {}, None, measured)


FAILING = [
    ("lambda drive: 1 / 0", "float", r"raised ZeroDivisionError: division by zero \(mine.py, line 7\)"),
    ("lambda drive: drive.column('no_such')", "float", "raised KeyError: .*no_such"),
    ("lambda drive: exit(3)", "float", "raised SystemExit: 3"),
    ("lambda drive: float('inf')", "float", "returned inf, expected a finite number, or NaN where there is nothing"),
    ("lambda drive: 'far'", "float", "returned 'far', expected a finite number"),
    ("lambda drive: None", "float", "returned None, expected a finite number"),
    ("lambda drive: True", "float", "returned True, expected a finite number"),
    ("lambda drive: drive.motion.speed", "float", "returned .*, expected a finite number"),
    ("lambda drive: 1.5", "int", "returned 1.5, expected a whole number"),
    ("lambda drive: 2**63", "int", "returned 9223372036854775808, expected a whole number"),
    ("lambda drive: 1", "bool", "returned 1, expected True or False"),
    ("lambda drive: 'a' * 201", "str", "returned a str, expected a text of one line, at most 200 characters"),
    ("lambda drive: 'two\\nlines'", "str", "returned .*, expected a text of one line"),
]


@pytest.mark.parametrize(("function", "kind", "said"), FAILING)
def test_a_metric_that_fails_is_one_line_and_meets_no_criterion(
    function: str, kind: str, said: str, tmp_path: Path
) -> None:
    name = offering(tmp_path, f"'mine', 'mine', 'how far', {function}, kind='{kind}', absent=0.0")
    wanted = {"bool": {"mine": False}, "str": {}}.get(kind, {"mine": CriterionBand(max=9.0)})
    summary = summary_with(name, **wanted)
    assert summary["metric_errors"].keys() == {"mine"}
    line = summary["metric_errors"]["mine"]
    assert re.match(f"metric {re.escape(name)}: mine {said}", line), line
    assert "\n" not in line
    assert summary["mine"] is None or math.isnan(summary["mine"])
    assert summary["min_gap_m"] == pytest.approx(measured_gap(), abs=1e-9), "the others are measured"
    if wanted:
        expected = "at most 9" if kind != "bool" else "False"
        assert summary["failed"] == [f"mine is none ({line}), expected {expected}"]


def measured_gap() -> float:
    return float(load("per_drive").per_drive.measure(approach())["min_gap_m"])


@pytest.mark.parametrize(
    ("function", "kind", "said"),
    [
        (
            "lambda drive: drive.motion.speed[1:]",
            "float",
            r"returned an array of float64 of shape \(599,\)",
        ),
        ("lambda drive: drive.motion.speed / 0.0", "float", "returned inf at a tick, expected finite numbers, or NaN"),
        ("lambda drive: 5.0", "float", r"returned an array of float64 of shape \(\), expected 600 numbers"),
        ("lambda drive: ['x'] * 600", "float", "returned an array of <U1 of shape"),
        ("lambda drive: ['x'] * 3", "str", "returned .*, expected a list of 600 texts, one a tick"),
        ("lambda drive: [1] * 600", "str", "returned .*, expected a list of 600 texts"),
        ("lambda drive: 1 / 0", "str", "raised ZeroDivisionError"),
    ],
)
@pytest.mark.filterwarnings("ignore:divide by zero", "ignore:invalid value")
def test_a_column_that_fails_is_one_line(function: str, kind: str, said: str, tmp_path: Path) -> None:
    name = offering(tmp_path, f"'mine', 'mine', 'how far', {function}, kind='{kind}'", "per_tick")
    measured = load_own([name]).measure(approach())
    assert not measured.per_tick
    assert re.match(f"metric {re.escape(name)}: mine {said}", measured.errors["mine"]), measured.errors["mine"]


def test_nan_is_nothing_to_measure(tmp_path: Path) -> None:
    name = offering(tmp_path, "'mine_m', 'mine', 'how far', lambda drive: float('nan'), missing='nobody was there'")
    summary = summary_with(name, mine_m=CriterionBand(min=1.0))
    assert summary["failed"] == ["mine_m is none (nobody was there), expected at least 1"]
    assert "metric_errors" not in summary
    endless = offering(tmp_path, "'mine_m', 'mine', 'how far', lambda drive: float('nan'), absent=float('inf')")
    assert summary_with(endless, mine_m=CriterionBand(min=1.0))["failed"] == []


def test_a_metric_that_writes_into_a_drive_changes_no_shipped_one(tmp_path: Path) -> None:
    name = offering(tmp_path, "'mine_m', 'mine', 'how far', lambda drive: drive.lead.gap.fill(0.0) or 1.0")
    assert summary_with(name)["min_gap_m"] == pytest.approx(measured_gap(), abs=1e-9)


# --- a drive and a sweep ----------------------------------------------------------------------------------------------

SHORT = {"duration_s": 8.0, "obstacles.0.at_m": 60.0, "metrics": [COMFORT]}
ASKED = {"criteria": {PEAK: {"max": 0.001}, HARD: False}}


@pytest.fixture(scope="module")
def record(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("metric") / "record"
    isolated(drive_once, SHORT | ASKED, str(folder))
    return folder


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


def test_a_search_looks_for_its_worst(lab: Path) -> None:
    pytest.importorskip("optuna", reason="a search for the worst case needs the extra `search`")
    assert sweep(lab, f'[search]\nhighest = "fastest_mps"\npoints = 2\nbatch = 2\n{RANGE}') == 0
    found = json.loads((lab / "rows" / "search.json").read_text(encoding="utf-8"))
    assert found["worst"]["fastest_mps"] == load_rows(lab / "rows")["fastest_mps"].max()


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


def test_a_missing_file_is_found_before_anything_is_driven(lab: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (lab / "fast.py").unlink()
    assert sweep(lab, "seeds = 2\n") == 2
    assert "metrics: metric fast.py:make: there is no file fast.py" in capsys.readouterr().err
    assert cli.main(["drive", "second", "--set", 'metrics=["fast.py:make"]', "--out", "one"]) == 2
    assert not (lab / "one").exists()
