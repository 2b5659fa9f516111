"""The table of metrics: whole, unambiguous, and the one place where a metric is added."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from tests.conftest import REPOSITORY
from vve_sumo.metrics import per_drive
from vve_sumo.metrics.exposure import EXPOSURE
from vve_sumo.metrics.metric import UNITS, Metric, unit_of
from vve_sumo.metrics.per_drive import PER_DRIVE
from vve_sumo.metrics.per_tick import PER_TICK
from vve_sumo.metrics.table import METRICS, axis_of, label_of, meaning_of, with_labels
from vve_sumo.scenario.schema import Criteria, CriterionBand

#: what somebody who adds a metric writes at the end of `per_drive.py`
ADDED = """

metric(
    "max_yaw_rate_radps",
    "maximum yaw rate",
    "greatest size at any tick",
    lambda drive: maximum(np.abs(drive.column("yaw_rate_radps"))),
    worse="higher",
    source="a book",
)
"""

#: a program whose `per_drive.py` is the file given to it; what it then says of a drive
ELSEWHERE = """
import sys, types
from pathlib import Path
module = types.ModuleType("vve_sumo.metrics.per_drive")
sys.modules[module.__name__] = module
exec(compile(Path(sys.argv[1]).read_text(encoding="utf-8"), sys.argv[1], "exec"), module.__dict__)

import pandas as pd
from tests.metrics.tables import CAR, actors_of, straight, ticks_of
from tests.test_docs import GENERATED
from vve_sumo.drive.summary import unmet_criteria, summary_of
from vve_sumo.drive.termination import DriveEnd, Outcome
from vve_sumo.plotting.grids import distribution
from vve_sumo.record.sweep_folder import COLUMNS, SweepPlan
from vve_sumo.report.tables import head_of, named
from vve_sumo.scenario.load import load
from vve_sumo.scenario.schema import CriterionBand, Criteria
from vve_sumo.sweep.run import figures_of

NAME = "max_yaw_rate_radps"
scenario = load(Path("scenarios/parked_car.toml"))
scenario = scenario.model_copy(update={"criteria": Criteria(**{NAME: CriterionBand(max=0.1)})})
setting = types.SimpleNamespace(name="a drive", scenario=scenario, path=straight(), vehicle=CAR)
ticks = ticks_of([{"yaw_rate_radps": -0.25}, {"yaw_rate_radps": 0.2}])
summary = summary_of(setting, DriveEnd(Outcome.STOPPED, ()), ticks, actors_of([]), {})
assert summary[NAME] == 0.25
assert summary["failed"] == [f"{NAME} is 0.250, expected at most 0.1"]
row = figures_of(scenario, summary)
assert (row[NAME], row[f"meets_{NAME}"]) == (0.25, False)
plan = SweepPlan({}, "a drive", {}, "", "", 1, {}, [NAME], {}, {})
assert {NAME: "float", f"meets_{NAME}": "bool"}.items() <= plan.columns().items()
assert COLUMNS[NAME].meaning == "greatest size at any tick"
assert head_of(NAME) == "maximum yaw rate [rad/s]" and "greatest size at any tick" in str(named(NAME))
axes = distribution(pd.DataFrame({NAME: [0.1, 0.2, 0.3]}), NAME).axes[0]
assert axes.get_xlabel() == "maximum yaw rate [rad/s]"
line = f"| `{NAME}` | maximum yaw rate | rad/s | greatest size at any tick | higher | a book |"
assert line in GENERATED["measures.md", "drive metrics"]().splitlines()
"""


@pytest.mark.thorough
def test_a_metric_is_added_in_one_file_and_found_everywhere(tmp_path: Path) -> None:
    file = tmp_path / "per_drive.py"
    file.write_text(Path(per_drive.__file__).read_text(encoding="utf-8") + ADDED, encoding="utf-8")
    done = subprocess.run(
        [sys.executable, "-c", ELSEWHERE, str(file)],
        check=False,
        cwd=REPOSITORY,
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert done.returncode == 0, done.stderr


def test_no_name_is_taken_twice_and_every_row_says_what_it_is() -> None:
    assert not {*PER_DRIVE} & {*PER_TICK} | {*PER_DRIVE} & {*EXPOSURE} | {*PER_TICK} & {*EXPOSURE}
    for name, metric in METRICS.items():
        assert metric.name == name
        assert metric.label
        assert metric.meaning
        assert metric.source
        assert not metric.meaning.endswith(".")


def test_criteria_are_the_metrics_that_may_judge_and_the_outcome() -> None:
    judging = {name: metric for name, metric in PER_DRIVE.items() if metric.criterion}
    assert [*Criteria.model_fields] == ["outcome", *judging]
    for name, metric in judging.items():
        assert Criteria.model_fields[name].annotation == ((bool if metric.kind == "bool" else CriterionBand) | None)


@pytest.mark.parametrize(
    ("name", "label", "axis"),
    [
        ("min_ttc_s", "minimum TTC", "minimum TTC [s]"),
        ("ego.speed_mps", "ego speed", "ego speed [m/s]"),
        ("actors.0.events.1.after_s", "events after", "events after [s]"),
        ("driver", "driver", "driver [1]"),
    ],
)
def test_labels_of_metrics_and_of_other_columns(name: str, label: str, axis: str) -> None:
    assert (label_of(name), axis_of(name)) == (label, axis)
    assert axis_of(name, {name: "km/h"}) == f"{label} [km/h]"
    assert bool(meaning_of(name)) == (name in METRICS)


@pytest.mark.parametrize(
    ("text", "read"),
    [
        ("time with ttc_s below 1.5 s", "time with “TTC” below 1.5 s"),
        ("of min_ttc_s; none as min_ttc_s.", "of “minimum TTC”; none as “minimum TTC”."),
        ("sets ego.speed_mps", "sets ego.speed_mps"),  # a key of a scenario
        ("hunting, and passed, by geofence_breach", "hunting, and passed, by geofence_breach"),
    ],
)
def test_a_text_is_read_with_labels_and_without_names(text: str, read: str) -> None:
    assert with_labels(text) == read


def test_no_meaning_is_read_with_the_name_of_a_metric() -> None:
    for metric in METRICS.values():
        words = with_labels(metric.meaning).replace(",", " ").replace(";", " ").split()
        assert not {word for word in words if "_" in word}, metric.name


def test_the_longest_ending_is_the_unit() -> None:
    assert unit_of("jerk_m_s2") == "m/s²"
    assert unit_of("controller.tuning.speed_gain_per_s") == "1/s"
    assert unit_of("gap_gain_per_s2") == "1/s²"
    assert unit_of("kp_rad_per_m") == "rad/m"
    assert label_of("controller.tuning.speed_gain_per_s") == "tuning speed gain"
    assert {unit_of(f"x{ending}") for ending in UNITS} == {*UNITS.values()}
    assert Metric("x_mps", "x", "a speed").unit == "m/s"
