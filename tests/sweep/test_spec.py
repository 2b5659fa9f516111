"""What a sweep's file may say: every mistake is one line that names the file and the key."""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest

from tests.conftest import REPOSITORY
from vve_sumo.config_file import read
from vve_sumo.errors import ConfigError
from vve_sumo.scenario.load import load
from vve_sumo.sweep.run_specs import cells_of
from vve_sumo.sweep.spec import Spec, fit, parse_spec

FILE = Path("mine.toml")
PLAIN = 'scenario = "parked_car"\n'
VARIED = PLAIN + "parameters.ego.speed_mps = [1.0, 2.0]\n"


def spec(text: str) -> Spec:
    return parse_spec(tomllib.loads(text), FILE)


BAD = {
    "parameters.a = [1]": "key 'scenario' is missing",
    PLAIN: "an empty grid",
    PLAIN + "parameters.a = []": "a: the list is empty",
    PLAIN + "parameters.a = {}": "a: is empty",
    PLAIN + "parameters.a = 5": r"a: expected a list, .*got 5",
    PLAIN + "parameters.a = [1, 'x']": "one kind of them",
    PLAIN + "parameters.a = [nan]": "finite",
    PLAIN + "parameters.a = [9223372036854775808]": "integer of 64 bits",
    PLAIN + "parameters.a = [1, 1.0]": "1.0 occurs twice",
    PLAIN + "parameters.a = [[1, 2], [3]]": "one kind of them",
    PLAIN + "parameters.a = { from = 1, too = 2 }": "unknown key 'too'",
    PLAIN + "parameters.a = { from = 1 }": "got from",
    PLAIN + "parameters.a = { from = 2, to = 1, step = 1 }": "expected from <= to, got from 2, to 1",
    PLAIN + "parameters.a = { from = 1, to = 2, step = 0 }": "step: expected a number above 0",
    PLAIN + "parameters.a = { from = 1, to = 2, step = true }": "step: expected a number, got True",
    PLAIN + "parameters.a = { from = 1, to = 2, count = 1 }": "count: expected 2 or more",
    PLAIN + "parameters.a = { min = 1, max = 2 }": "min and max go with",
    PLAIN + "parameters.a = [1]\nparameters.'a' = [2]": None,  # TOML itself refuses it
    PLAIN + "design = 'gird'": "design: .*got 'gird'",
    PLAIN + "sample = 5": "unknown key 'sample', did you mean 'samples'",
    VARIED + "samples = 5": "samples: goes with",
    VARIED + "design = 'sobol'": "'samples' is missing",
    VARIED + "design = 'sobol'\nsamples = 8": "to draw from",
    PLAIN + "design = 'random'\nsamples = 8\nparameters.a = { min = 2, max = 2 }": "expected min < max",
    PLAIN + "design = 'random'\nsamples = 8\nparameters.a = { min = 0, max = 2, log = true }": "above 0 for log",
    PLAIN + "design = 'random'\nsamples = 8\nparameters.a = { min = 1, max = 2, log = 1 }": "log: expected true",
    PLAIN + "design = 'list'\nparameters = { a = [1, 2], b = [1] }": "of one length, got a 2, b 1",
    PLAIN + "design = 'list'\nparameters = { a = [1, 1], b = [2, 2] }": r"row \(1, 2\) occurs twice",
    VARIED + "seeds = 0": "seeds: expected how many.*got 0",
    VARIED + "seeds = [1, 1]": "each seed once",
    VARIED + "seeds = [-1]": "seeds from 0",
    VARIED + "seeds = true": "seeds: expected how many",
    VARIED + "keep = 'some'": "keep: expected 'none'.*got 'some'",
    VARIED + "keep = ['short']": "keep: expected 'none'",
    VARIED + "time_limit_s = 0": "time_limit_s",
}


@pytest.mark.parametrize("text", BAD)
def test_a_mistake_is_one_line_that_names_file_and_key(text: str) -> None:
    if BAD[text] is None:
        with pytest.raises(tomllib.TOMLDecodeError):
            tomllib.loads(text)
        return
    with pytest.raises(ConfigError, match=str(BAD[text])) as found:
        spec(text)
    assert str(found.value).startswith("mine.toml: ")
    assert "\n" not in str(found.value)


def test_keys_may_be_quoted_or_not() -> None:
    bare, quoted = spec(VARIED), spec(PLAIN + "[parameters]\n'ego.speed_mps' = [1.0, 2.0]\n")
    assert dict(bare.parameters) == dict(quoted.parameters)


def test_a_list_may_name_a_value_twice() -> None:
    assert spec(PLAIN + "design = 'list'\nparameters = { a = [1, 1], b = [2, 3] }").parameters["a"].ends() == (1, 1)


TABLE = {
    "title": "t",
    "ego": {"speed_mps": 5.0},
    "parameters": {
        "speed": {"sets": ["ego.speed_mps"], "min": 2.0, "max": 20.0},
        "duration_s": {"sets": ["duration_s"]},
        "chance": {"sets": ["seed"]},
    },
}

UNFIT = {
    "speeed = [5.0]": r"parameters.speeed: .*did you mean 'speed'\?",
    "wholly.different = [5.0]": "unknown to the scenario; it declares speed",
    "speed = [1.0, 5.0]": "parameters.speed: the scenario declares min 2, got 1.0",
    "speed = { from = 2.0, to = 20.5, step = 0.5 }": "declares max 20, got 20.5",
    "speed = ['fast']": "declares min 2, got 'fast'",
    "speed = [5.0]\nego.speed_mps = [6.0]": "sets ego.speed_mps, which speed sets too",
    "seed = [1, 2]": r"expected seeds = \[",
    "chance = [1, 2]": r"expected seeds = \[",
    "duration_s = [1.0]": "a column of that name",
}


@pytest.mark.parametrize("text", UNFIT)
def test_parameters_that_do_not_go_with_the_scenario(text: str) -> None:
    with pytest.raises(ConfigError, match=UNFIT[text]):
        fit(spec(f"{PLAIN}[parameters]\n{text}\n"), FILE, TABLE, frozenset({"duration_s"}))


def test_bounds_themselves_are_allowed() -> None:
    fit(spec(f"{PLAIN}[parameters]\nspeed = [2.0, 20.0]\n"), FILE, TABLE, frozenset())


@pytest.mark.parametrize("file", sorted((REPOSITORY / "sweeps").glob("*.toml")), ids=lambda file: file.stem)
def test_shipped_sweeps_are_in_order(file: Path) -> None:
    shipped = parse_spec(read(file, "sweep"), file)
    scenario = REPOSITORY / "scenarios" / f"{shipped.scenario}.toml"
    fit(shipped, file, tomllib.loads(scenario.read_text(encoding="utf-8")), frozenset())
    assert cells_of(shipped, shipped.scenario, load(scenario)).count < 1000
