"""The shipped metrics and those of an invented lab against the port's suite; how a file is found and fails."""

from __future__ import annotations

import json
import math
import re
import sys
from pathlib import Path
from typing import Any, ClassVar

import pytest

from tests.metrics.tables import CAR, straight
from tests.ports.metric import BRAKING, MetricConformance, approach
from tests.ports.toy_metric import COMFORT, COURSE, HARD, PEAK
from vve_sumo import cli
from vve_sumo.drive.summary import measure, summary_of
from vve_sumo.drive.termination import DriveEnd, Outcome
from vve_sumo.errors import ConfigError
from vve_sumo.metrics.own import RESERVED, load_own
from vve_sumo.metrics.port import PORT, load, shipped
from vve_sumo.metrics.table import FIGURES, SHIPPED_METRICS
from vve_sumo.record.sweep_folder import COLUMNS
from vve_sumo.scenario.load import check_criteria, parse
from vve_sumo.scenario.schema import Criteria, CriterionBand, Scenario
from vve_sumo.sweep.plan import with_metrics
from vve_sumo.sweep.spec import parse_spec


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


@pytest.mark.thorough(witnesses=2)
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
