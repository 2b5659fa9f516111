"""Several controllers in one sweep, each with a tuning of its own."""

from __future__ import annotations

import itertools
import tomllib
from pathlib import Path

import pandas as pd
import pytest

import vve_sumo as vve
from tests.conftest import REPOSITORY
from tests.sweep.test_spec import spec
from vve_sumo.errors import ConfigError
from vve_sumo.report.sweep import report
from vve_sumo.scenario.load import parse
from vve_sumo.sweep.plan import job_of, planned
from vve_sumo.sweep.rerun import rerun
from vve_sumo.sweep.run_specs import RunSpecs

SCENARIO = 'scenario = "parked_car"\n'
TWO = """
[[controllers]]
name = "a"
tuning = { gain = [1, 2], mode = "soft", window = { from = 1, to = 3, step = 1 } }
[[controllers]]
name = "b"
tuning.gain = [0.5]
"""


def values(text: str) -> list[dict[str, object]]:
    return [run.values for run in RunSpecs(spec(SCENARIO + text), "parked_car", (1, 2))]


def test_every_point_goes_with_every_controller_and_every_combination_of_its_own_tuning() -> None:
    driven = values("[parameters]\nego.speed_mps = [5.0, 6.0]\n" + TWO)
    of_a = itertools.product(["a"], [1.0, 2.0], ["soft"], [1, 2, 3], [5.0, 6.0], [1, 2])
    keys = [f"controller.{key}" for key in ("name", "tuning.gain", "tuning.mode", "tuning.window")]
    expected = [dict(zip([*keys, "ego.speed_mps"], one[:-1], strict=True)) for one in of_a]
    expected += [
        {"controller.name": "b", "controller.tuning.gain": 0.5, "ego.speed_mps": speed}
        for speed, _seed in itertools.product([5.0, 6.0], [1, 2])
    ]
    assert driven == expected
    assert RunSpecs(spec(SCENARIO + TWO), "parked_car", (1, 2)).count == (2 * 3 + 1) * 2


def test_drawn_points_are_the_same_for_every_controller() -> None:
    text = "design = 'sobol'\nsamples = 4\n[parameters]\nego.speed_mps = { min = 5.0, max = 9.0 }\n"
    driven = values(text + "[[controllers]]\nname = 'a'\n[[controllers]]\nname = 'b'\n")
    speeds = {name: [run["ego.speed_mps"] for run in driven if run["controller.name"] == name] for name in "ab"}
    assert speeds["a"] == speeds["b"]
    assert len(set(map(float, map(str, speeds["a"])))) == 4


def test_a_search_for_a_boundary_finds_one_for_every_controller() -> None:
    from vve_sumo.sweep.search import AdaptiveSearch

    text = "search = { along = 'speed', scan = 2, criterion = 'collision' }\n[parameters]\n"
    text += "speed = { from = 1.0, to = 9.0, step = 1.0 }\n" + TWO
    search = AdaptiveSearch(RunSpecs(spec(SCENARIO + text), "parked_car", (1,)), {}, "folder")
    flips = {"a": 4.0, "b": 7.0}  # the closed form: each controller collides from its speed on
    for run in search.cells():
        if run is not None:
            hit = float(run.values["speed"]) >= flips[str(run.values["controller.name"])]
            search.take({"key": run.key, "error": "", "collision": hit, "failed": ""})
    assert search.result is not None
    lines = search.result["boundaries"]
    assert [line["values"]["controller.name"] for line in lines] == ["a"] * 6 + ["b"]
    assert {line["values"]["controller.name"]: line["flips"][0]["fails"] for line in lines} == flips


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("[[controllers]]\ntuning = { a = [1] }", r"key 'controllers\.0\.name' is missing"),
        ("[[controllers]]\nname = 'a'\ntunning = { a = [1] }", "did you mean 'tuning'"),
        ("[[controllers]]\nname = 'a'\ntuning = { g = [1, 1] }", "g: 1 occurs twice"),
        ("[[controllers]]\nname = 'a'\ntuning = { g = { min = 1, max = 2 } }", "g: expected a value, a list"),
        ("[[controllers]]\nname = 'a'\ntuning = { g = [] }", "g: the list is empty"),
        ("[[controllers]]\nname = 'a'\ntuning = 5", "expected a table of tuning keys, got 5"),
        ("[[controllers]]\nname = 'a'\n[[controllers]]\nname = 'a'", "'a' occurs twice"),
        (TWO + "[[controllers]]\nname = 'c'\ntuning = { gain = 'high' }", "c: gain: expected the type of value"),
        ("search = { lowest = 'min_gap_m' }\nparameters.speed = { min = 1, max = 2 }\n" + TWO, "takes one"),
    ],
)
def test_a_mistake_is_one_line(text: str, why: str) -> None:
    with pytest.raises(ConfigError, match=why) as found:
        spec(SCENARIO + text)
    assert "\n" not in str(found.value)


#: accelerates evenly, by a key of its own
TOY = """
from vve_sumo.controller import settle
from vve_sumo.values import ControlCommand

class Toy:
    def __init__(self, gain):
        self.gain = gain

    def step(self, observation):
        return ControlCommand(0.0, self.gain)

def make(vehicle, tuning):
    return Toy(settle(tuning, {"%s": 1.0}, {"%s": (0.1, 9.0)})["%s"])
"""


@pytest.fixture
def toys(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "controllers").mkdir()
    for name, key in (("soft", "ease"), ("hard", "force")):
        (tmp_path / "controllers" / f"{name}.py").write_text(TOY % (key, key, key), encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def asked(toys: Path, text: str, scenario: str = "parked_car") -> dict[str, object]:
    query = planned(tomllib.loads(f"scenario = '{scenario}'\n{text}"), Path("mine.toml"), toys, yes=False)
    return {run.key: job_of(query.plan, query.spec, run, None).table["controller"] for run in query.cells}


@pytest.mark.thorough
def test_a_controller_gets_its_own_tuning_and_that_of_the_scenario_goes_to_its_own_controller(toys: Path) -> None:
    text = (REPOSITORY / "scenarios" / "parked_car.toml").read_text(encoding="utf-8")
    (toys / "scenarios").mkdir()
    tuned = toys / "scenarios" / "tuned.toml"
    tuned.write_text(text + "\n[controller]\nname = 'soft'\ntuning = { ease = 3.0 }\n", encoding="utf-8")
    two = "[[controllers]]\nname = 'soft'\n[[controllers]]\nname = 'hard'\ntuning = { force = [2.0, 4.0] }\n"
    assert list(asked(toys, two, "tuned").values()) == [
        {"name": "soft", "tuning": {"ease": 3.0}},
        {"name": "hard", "tuning": {"force": 2.0}},
        {"name": "hard", "tuning": {"force": 4.0}},
    ]
    parse(tomllib.loads(tuned.read_text(encoding="utf-8")), tuned)


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("name = 'hard'\ntuning = { ease = 1.0 }", r"mine\.toml: controllers\.hard\.tuning\.ease: .*unknown"),
        ("name = 'hard'\ntuning = { force = [1.0, 99.0] }", r"mine\.toml: controllers\.hard\.tuning\.force: .*got 99"),
        ("name = 'haard'", r"mine\.toml: controllers\.haard: .*unknown"),
    ],
)
def test_each_controllers_tuning_is_tried_before_anything_runs(toys: Path, text: str, why: str) -> None:
    first = "[[controllers]]\nname = 'soft'\ntuning = { ease = [1.0, 2.0] }\n"
    with pytest.raises(ConfigError, match=why):
        asked(toys, f"{first}[[controllers]]\n{text}\n")


def test_a_key_set_twice_is_refused(toys: Path) -> None:
    for key in ("name = ['soft']", "tuning.force = [1.0]"):
        with pytest.raises(ConfigError, match=r"sets controller\..*which controllers"):
            asked(toys, f"[parameters]\ncontroller.{key}\n[[controllers]]\nname = 'hard'\ntuning = {{ force = 2.0 }}\n")


@pytest.mark.slow
def test_from_python_without_a_file_to_a_row_each_and_one_driven_again(toys: Path) -> None:
    short = vve.Scenario("delay_probe").replace({"end_trigger.ego_at_m": 15.0, "ego.speed_mps": 8.0})
    (toys / "elsewhere").mkdir()
    (toys / "elsewhere" / "third.py").write_text(TOY % ("pull", "pull", "pull"), encoding="utf-8")
    third = f"{toys / 'elsewhere' / 'third.py'}:make"
    tunings = {"soft": {"ease": [0.5, 1]}, third: {"pull": 1.5}, "hard": {"force": 2.0}, "follow_and_stop": {}}
    sweep = vve.sweep(short, controllers=tunings, out="compared", progress=False)
    rows = sweep.rows()
    assert not rows["error"].any()
    assert list(rows["controller.name"]) == ["soft", "soft", third, "hard", "follow_and_stop"]
    assert rows["controller.tuning.ease"].tolist()[:2] == [0.5, 1.0]
    assert rows["controller.tuning.ease"].isna().tolist() == [False, False, True, True, True]
    assert rows["controller.tuning.force"].isna().tolist() == [True, True, True, False, True]
    # The same way from rest takes the shorter, the stronger the constant acceleration is.
    assert rows["duration_s"][:4].is_monotonic_decreasing
    assert rows["duration_s"][:4].is_unique
    assert len(sweep.grouped()) == 5
    pd.testing.assert_frame_equal(rows, vve.load("compared").rows())
    for key in rows["key"]:  # of its own controller a rerun needs the code alone
        assert rerun(Path("compared"), key, None, lambda line: None).same
    named = [row for row in report(sweep).content["provenance"].rows if row[0] == "controller"]  # type: ignore[attr-defined]
    assert [row[1].text.partition(": ")[0] for row in named] == list(tunings)
    (toys / "elsewhere" / "third.py").write_text(TOY % ("pull", "pull", "pull") + "# changed\n", encoding="utf-8")
    with pytest.raises(ConfigError, match="controller_third has changed since"):
        rerun(Path("compared"), rows.loc[2, "key"], toys / "again", lambda line: None)
    assert rerun(Path("compared"), rows.loc[3, "key"], toys / "once more", lambda line: None).same
    assert "0.5, 1 (soft)" in str(report(sweep).content["varied"])


@pytest.mark.parametrize("said", [[], "soft", {}])
def test_controllers_of_python_are_names(said: object) -> None:
    with pytest.raises(ConfigError, match="controllers: expected names"):
        vve.sweep("parked_car", controllers=said)  # type: ignore[arg-type]
