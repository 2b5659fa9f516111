"""Quantities with units, wherever a number may be written; nearly right names; hints that can be followed."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import pytest
import scipy.constants
from hypothesis import given
from hypothesis import strategies as st

import vve_sumo as vve
from tests.conftest import REPOSITORY
from tests.isolated import command
from vve_sumo.config_file import in_key_units
from vve_sumo.errors import ConfigError
from vve_sumo.rig.load import parse as parse_rig
from vve_sumo.scenario.load import parse
from vve_sumo.scenario.schema import Scenario
from vve_sumo.sweep.plan import planned
from vve_sumo.units import DIMENSIONS, converted
from vve_sumo.vehicle.load import parse as parse_vehicle

PARKED = REPOSITORY / "scenarios" / "parked_car.toml"
CONSTANTS = {
    ("_mps", "km/h"): scipy.constants.kmh, ("_mps", "mph"): scipy.constants.mph, ("_mps", "kn"): scipy.constants.knot,
    ("_m", "ft"): scipy.constants.foot, ("_m", "in"): scipy.constants.inch, ("_m", "mi"): scipy.constants.mile,
    ("_s", "min"): scipy.constants.minute, ("_s", "h"): scipy.constants.hour, ("_mps2", "g"): scipy.constants.g,
    ("_deg", "rad"): 1.0 / scipy.constants.degree, ("_kg", "lb"): scipy.constants.pound,
}  # fmt: skip


@pytest.mark.parametrize("unit", CONSTANTS, ids=lambda unit: unit[1])
@given(st.decimals(-1000, 1000, places=3))
def test_units_are_those_of_scipys_constants(unit, number):
    assert converted(f"{number} {unit[1]}", DIMENSIONS[unit[0]]) == pytest.approx(
        float(number) * CONSTANTS[unit], rel=1e-12
    )


def test_conversion_is_exact_to_the_last_digit():
    assert converted("25 mph", DIMENSIONS["_mps"]) == 11.176
    assert converted("36km/h", DIMENSIONS["_mps"]) == 10.0
    assert converted("250 ms", DIMENSIONS["_s"]) == 0.25


def table(**changes):
    scenario = tomllib.loads(PARKED.read_text(encoding="utf-8"))
    scenario["ego"] |= changes
    return scenario


def test_a_scenario_takes_units_with_and_without_the_ending_of_the_key():
    for changes in ({"speed_mps": "25 mph"}, {"speed": "40.2336 km/h"}):
        said = table()
        if "speed" in changes:
            del said["ego"]["speed_mps"]
        said["ego"] |= changes
        said["actors"] = [{"id": "a", "at": "100 ft", "events": [{"speed": "10 m/s", "when": {"after": "500 ms"}}]}]
        scenario = parse(said, PARKED)
        assert scenario.ego.speed_mps == pytest.approx(11.176, rel=1e-15)
        assert scenario.actors[0].at_m == 30.48
        assert (scenario.actors[0].events[0].speed_mps, scenario.actors[0].events[0].when.after_s) == (10.0, 0.5)


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({"speed_mps": "25 kg"}, r"ego\.speed_mps: expected a speed in m/s, km/h, .*got '25 kg'"),
        ({"speed_mps": "fast"}, r"ego\.speed_mps: expected a number, got 'fast'"),
        ({"speed_mps": "25"}, r"ego\.speed_mps: expected a number, got '25'"),
        ({"speed_mps": "900 mph"}, r"ego\.speed_mps: expected less than or equal to 40"),
        ({"speed": "25 mph"}, r"ego\.speed: is there beside speed_mps"),
        ({"speed": 25.0}, r"unknown key 'ego\.speed', did you mean 'speed_mps'\? .*text with one: speed = \"5 m/s\""),
    ],
)
def test_what_is_no_speed_is_one_line(changes, why):
    with pytest.raises(ConfigError, match=why) as found:
        parse(table(**changes), PARKED)
    assert "\n" not in str(found.value)


def test_vehicle_files_and_rigs_take_units():
    file = REPOSITORY / "vehicles" / "ford_fusion.toml"
    said = tomllib.loads(file.read_text(encoding="utf-8"))
    metric = parse_vehicle(said, file)
    said["vehicle"]["wheelbase"] = f"{said['vehicle'].pop('wheelbase_m') * 100.0!r} cm"
    assert parse_vehicle(said, file).vehicle.wheelbase == pytest.approx(metric.vehicle.wheelbase, rel=1e-15)
    file = REPOSITORY / "rigs" / "simulated.toml"
    said = tomllib.loads(file.read_text(encoding="utf-8"))
    said["limits"]["speed_mps"] = "20 mph"
    assert parse_rig(said, file).limits.speed_mps == 8.9408


@pytest.mark.thorough
@given(st.recursive(st.integers() | st.text(max_size=3), lambda inner: st.dictionaries(st.text(max_size=3), inner)))
def test_what_holds_no_quantity_stays_as_it_is(tree):
    tree = tree if isinstance(tree, dict) else {"title": tree}
    assert in_key_units(tree, Scenario) == tree


def test_python_takes_units_where_it_takes_a_number():
    scenario = vve.Scenario("parked_car")
    assert scenario.replace({"ego.speed": "25 mph", "obstacles.parked_car.at": "0.3 km"})["ego.speed_mps"] == 11.176
    assert scenario.chosen(seed=None, speed="36 km/h", controller=None, vehicle=None)["ego.speed_mps"] == 10.0
    with pytest.raises(ConfigError, match=r"ego\.speed: expected a speed"):
        scenario.replace({"ego.speed": "25 s"})
    declared = vve.Scenario("seen_late").replace({"speed": "27 km/h"})
    assert declared["ego.speed_mps"] == 7.5
    with pytest.raises(ConfigError, match="the scenario declares"):
        vve.Scenario("seen_late").replace({"speed": "500 km/h"})


@pytest.mark.thorough
@pytest.mark.parametrize(
    "said",
    [
        {"ego.speed": ["10 mph", "20 mph"]},
        {"ego": {"speed_mps": {"from": "10 mph", "to": "20 mph", "step": "10 mph"}}},
    ],
)
def test_a_sweep_takes_units(said, tmp_path):
    spec = {"scenario": "parked_car", "parameters": said}
    query = planned(spec, Path("mine.toml"), tmp_path, yes=False)
    assert [run.values for run in query.cells] == [{"ego.speed_mps": 4.4704}, {"ego.speed_mps": 8.9408}]
    wrong = {"scenario": "parked_car", "parameters": {"ego.speed": ["10 kg"]}}
    with pytest.raises(ConfigError, match=r"mine\.toml: parameters\.ego\.speed: expected a speed"):
        planned(wrong, Path("mine.toml"), tmp_path, yes=False)


@pytest.mark.parametrize(
    ("arguments", "why"),
    [
        (("drive", "parkd_car"), "no scenario named 'parkd_car', did you mean 'parked_car'?"),
        (("drve",), "did you mean 'drive'?"),
        (("drive", "--set", "ego.sped=25 mph"), "unknown key 'ego.sped', did you mean 'speed_mps'?"),
        (("drive", "--set", "eggo.speed_mps=3"), "--set eggo.speed_mps: unknown to the scenario; did you mean 'ego'?"),
        (("drive", "--set", "ego.speed=fast"), "unknown key 'ego.speed'"),
        (("drive", "--set", "ego.speed_mps=true"), "ego.speed_mps: expected a number, got True"),
        (("drive", "--set", "ego.speed_mps=25 kg"), "ego.speed_mps: expected a speed"),
        (("drive", "--set", "ego.speed_mps"), "expected KEY=VALUE"),
        (("drive", "--set", "seed=1", "--set", "seed=2"), "--set seed: is set twice"),
        (("drive", "seen_late", "--set", "speed=500 km/h"), "--set speed: the scenario declares max"),
        (("drive", "--set", "obstacles.parkd_car.at_m=3"), "did you mean 'parked_car'?"),
        (("drive", "--controller", "follow_and_stp"), "did you mean 'follow_and_stop'?"),
        (("drive", "--set", "controller.tuning.gap=3.0"), "tuning key 'gap' is unknown"),
        (("drive", "--rig", "simulatd", "--set", "seed=3"), "no rig named 'simulatd', did you mean 'simulated'?"),
        (("drive", "--vehicle", "lincoln_mkx"), "did you mean 'lincoln_mkz'?"),
    ],
)
def test_the_command_line_says_in_one_line_what_is_wrong(arguments, why, tmp_path):
    done = command(*arguments, cwd=tmp_path)
    assert why in done.stderr
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert not list(tmp_path.iterdir())


def test_every_hint_to_install_names_an_extra_that_there_is():
    project = tomllib.loads((REPOSITORY / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    files = [*(REPOSITORY / "vve_sumo").rglob("*.py"), *(REPOSITORY / "docs").rglob("*.md"), REPOSITORY / "README.md"]
    files += [*(REPOSITORY / "notebooks").glob("*.ipynb"), *(REPOSITORY / "sweeps").glob("*.toml")]
    hints = [
        (file.name, extra)
        for file in files
        for extras in re.findall(r"vve-sumo\[([^\]]*)\]", file.read_text(encoding="utf-8"))
        for extra in extras.split(",")
        if not extra.startswith("{")  # of export.py, whose forms name theirs
    ]
    assert {extra for _file, extra in hints} >= {"sql", "search", "cluster", "dbc"}
    assert [hint for hint in hints if hint[1] not in project["optional-dependencies"]] == []
    bare = {
        hint
        for file in (REPOSITORY / "vve_sumo").rglob("*.py")
        for hint in re.findall(r"pip install (?!'vve-sumo)(\S+?)[\"'.]*(?:\s|$|\))", file.read_text(encoding="utf-8"))
    }
    assert bare == set()
