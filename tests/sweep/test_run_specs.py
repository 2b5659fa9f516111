"""The runs of a sweep: counted in closed form, keyed, drawn as scipy draws, laid into the scenario's table."""

from __future__ import annotations

import copy
import itertools
import math
import tomllib
from decimal import Decimal
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import qmc

from tests.conftest import REPOSITORY
from vve_sumo.errors import ConfigError
from vve_sumo.scenario.load import load, parse
from vve_sumo.scenario.overrides import apply_overrides
from vve_sumo.sweep.axes import Steps, axes
from vve_sumo.sweep.run_specs import RunSpecs, cells_of, key_of, shares
from vve_sumo.sweep.spec import parse_spec

SCENARIO = REPOSITORY / "scenarios" / "parked_car.toml"


def cells(table: dict[str, Any]) -> RunSpecs:
    return cells_of(parse_spec({"scenario": "s"} | table, Path("mine.toml")), "s", load(SCENARIO))


@pytest.mark.parametrize(
    ("start", "end", "step"),
    [("0.1", "0.7", "0.1"), ("0", "1", "0.3"), ("-2.5", "2.5", "0.5"), ("1e-3", "0.02", "1e-3")],
)
def test_steps_are_the_decimal_numbers_themselves(start: str, end: str, step: str) -> None:
    (axis,) = axes({"a": {"from": float(start), "to": float(end), "step": float(step)}}).values()
    wanted = [Decimal(start) + number * Decimal(step) for number in range(1000)]
    wanted = [value for value in wanted if value <= Decimal(end)]
    assert isinstance(axis, Steps)
    assert [axis[number] for number in range(axis.count)] == [float(value) for value in wanted]


def test_counted_steps_end_where_they_should() -> None:
    (axis,) = axes({"a": {"from": 1, "to": 2, "count": 7}}).values()
    assert isinstance(axis, Steps)
    assert [axis[number] for number in range(7)] == pytest.approx(np.linspace(1.0, 2.0, 7).tolist(), abs=1e-15)
    assert axis[6] == 2.0


def test_whole_steps_stay_whole() -> None:
    (axis,) = axes({"a": {"from": 2, "to": 11, "step": 3}}).values()
    assert isinstance(axis, Steps)
    assert [axis[number] for number in range(axis.count)] == [2, 5, 8, 11]
    assert type(axis[0]) is int


lists = st.lists(st.integers(-99, 99), min_size=1, max_size=5, unique=True)


@given(st.dictionaries(st.sampled_from("abcd"), lists, min_size=1, max_size=4), st.integers(1, 4))
def test_a_grid_is_the_product_in_its_order_with_unique_keys(varied: dict[str, list[int]], seeds: int) -> None:
    grid = cells({"parameters": varied, "seeds": seeds})
    found = list(grid)
    product = [dict(zip(varied, values, strict=True)) for values in itertools.product(*varied.values())]
    assert [cell.values for cell in found] == [values for values in product for _ in range(seeds)]
    assert [cell.number for cell in found] == list(range(grid.count))
    assert [cell.seed for cell in found[:seeds]] == list(range(1, seeds + 1))
    assert len({cell.key for cell in found}) == grid.count
    odd = list(grid.unless(lambda number: number % 2 == 0))
    assert odd == found[1::2]


def test_a_list_goes_side_by_side() -> None:
    rows = cells({"design": "list", "parameters": {"a": [1, 2, 2], "b": ["x", "x", "y"]}, "seeds": [7]})
    assert [cell.values for cell in rows] == [{"a": 1, "b": "x"}, {"a": 2, "b": "x"}, {"a": 2, "b": "y"}]


def test_a_huge_grid_is_counted_and_begun_without_being_made() -> None:
    axis = {"from": 0.0, "to": 1e6, "step": 1e-6}
    grid = cells({"parameters": {"a": axis, "b": axis}, "seeds": 10})
    assert grid.count == 10 * (10**12 + 1) ** 2
    assert next(iter(grid.unless(lambda number: number < 25))).values == {"a": 0.0, "b": 2e-6}


def test_a_key_is_the_same_in_every_sweep() -> None:
    assert key_of("s", {"a": 1, "b": 0.5}, 3) == key_of("s", {"b": 0.5, "a": 1.0}, 3)
    others = [("t", {"a": 1, "b": 0.5}, 3), ("s", {"a": 1, "b": 0.5}, 4), ("s", {"a": 2, "b": 0.5}, 3)]
    others += [("s", {"a": True, "b": 0.5}, 3), ("s", {"a": "1", "b": 0.5}, 3), ("s", {"b": 0.5}, 3)]
    assert len({key_of("s", {"a": 1, "b": 0.5}, 3), *(key_of(*other) for other in others)}) == 7


def test_seeds_beyond_the_last_are_refused() -> None:
    late = load(SCENARIO).model_copy(update={"seed": 2**31 - 2})
    spec = parse_spec({"scenario": "s", "seeds": 2}, Path("mine.toml"))
    assert [cell.seed for cell in cells_of(spec, "s", late)] == [2**31 - 2, 2**31 - 1]
    with pytest.raises(ConfigError, match="go beyond"):
        cells_of(parse_spec({"scenario": "s", "seeds": 3}, Path("mine.toml")), "s", late)


BOX = {"a": {"min": -1.0, "max": 3.0}, "b": {"min": 0.01, "max": 100.0, "log": True}, "c": ["x", "y", "z"]}


def expected(design: str, count: int, seed: int) -> np.ndarray:
    chance = np.random.default_rng(seed)
    if design == "sobol":
        return qmc.Sobol(3, rng=chance).random_base2(math.ceil(math.log2(count)))[:count]
    return qmc.LatinHypercube(3, rng=chance).random(count) if design == "latin_hypercube" else chance.random((count, 3))


@pytest.mark.thorough
@pytest.mark.parametrize("design", ["latin_hypercube", "sobol", "random"])
def test_drawn_designs_are_scipys(design: str) -> None:
    drawn = cells({"design": design, "samples": 5000, "design_seed": 5, "parameters": BOX})
    unit, rows = expected(design, 5000, 5), [cell.values for cell in drawn]
    assert len(rows) == drawn.count == 5000
    assert [row["a"] for row in rows] == pytest.approx((-1.0 + 4.0 * unit[:, 0]).tolist(), abs=1e-12)
    assert [row["b"] for row in rows] == pytest.approx((0.01 * 1e4 ** unit[:, 1]).tolist(), rel=1e-12)
    assert [row["c"] for row in rows] == [BOX["c"][int(3.0 * share)] for share in unit[:, 2]]
    assert len({cell.key for cell in drawn}) == 5000


def test_a_latin_hypercube_puts_one_point_into_each_slice() -> None:
    points = np.array(list(shares("latin_hypercube", 2, 50, 1)))
    for column in points.T:
        assert sorted((column * 50).astype(int).tolist()) == list(range(50))


TABLE: dict[str, Any] = {
    "ego": {"speed_mps": 5.0},
    "actors": [{"id": "lead", "at_m": 9.0, "events": [{"speed_mps": 0.0}]}, {"id": "other", "at_m": 1.0}],
    "parameters": {"both": {"sets": ["actors.lead.at_m", "actors.other.at_m"]}},
}


def test_values_land_where_their_keys_say() -> None:
    before = copy.deepcopy(TABLE)
    changed = apply_overrides(
        TABLE, {"ego.car.gnss_delay_s": 0.2, "both": 7.0, "actors.lead.events.0.speed_mps": 3.0, "controller.name": "x"}
    )
    assert before == TABLE
    assert changed["ego"] == {"speed_mps": 5.0, "car": {"gnss_delay_s": 0.2}}
    assert [actor["at_m"] for actor in changed["actors"]] == [7.0, 7.0]
    assert changed["actors"][0]["events"] == [{"speed_mps": 3.0}]
    assert changed["controller"] == {"name": "x"}


parts = st.sampled_from(["a", "b", "c"])
tables = st.recursive(st.integers(), lambda inner: st.dictionaries(parts, inner, max_size=3), max_leaves=8)


@given(st.dictionaries(parts, tables, max_size=3), st.lists(parts, min_size=1, max_size=4), st.integers())
def test_a_laid_value_is_found_again_and_nothing_else_changes(
    table: dict[str, Any], way: list[str], value: int
) -> None:
    place = ".".join(way)
    inner: Any = table
    blocked = False
    for part in way[:-1]:
        inner = inner.get(part, {})
        blocked = blocked or not isinstance(inner, dict)
        if blocked:
            break
    if blocked:
        with pytest.raises(ConfigError, match=place):
            apply_overrides(table, {place: value})
        return
    leaves = _leaves(apply_overrides(table, {place: value}))
    assert leaves.pop(place) == value
    kept = {key: leaf for key, leaf in _leaves(table).items() if key != place and not key.startswith(f"{place}.")}
    assert {key: leaf for key, leaf in leaves.items() if leaf != {}} == {k: v for k, v in kept.items() if v != {}}


def _leaves(table: Any, before: str = "") -> dict[str, Any]:
    if not isinstance(table, dict) or not table:
        return {before[:-1]: table} if before else {}
    return {key: leaf for name, inner in table.items() for key, leaf in _leaves(inner, f"{before}{name}.").items()}


@pytest.mark.parametrize(
    ("place", "why"),
    [
        ("actors.leed.at_m", "no 'leed' in actors, did you mean 'lead'"),
        ("actors.2.at_m", "no '2' in actors, there are lead, other"),
        ("actors.lead.events.1.speed_mps", "no '1' in actors.lead.events, there are 1"),
        ("ego.speed_mps.more", "'speed_mps' is a value"),
    ],
)
def test_a_key_that_leads_nowhere_is_named(place: str, why: str) -> None:
    with pytest.raises(ConfigError, match=why):
        apply_overrides(TABLE, {place: 1.0})


def test_a_laid_table_is_a_scenario() -> None:
    table = tomllib.loads(SCENARIO.read_text(encoding="utf-8"))
    varied = apply_overrides(
        table, {"obstacles.parked_car.at_m": 500.0, "criteria.stop_gap_m.min": 4.0, "weather.friction": 0.5}
    )
    scenario = parse(varied, SCENARIO)
    assert scenario.obstacles[0].at_m == 500.0
    assert scenario.criteria.stop_gap_m is not None
    assert scenario.criteria.stop_gap_m.min == 4.0
    assert scenario.weather.friction == 0.5
