"""Scenarios that are driven as one until they differ: each hears its own answers, whichever process it ends in."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.drive.street import REPOSITORY, altered
from tests.isolated import isolated
from vve_sumo.controller import Guarded
from vve_sumo.drive.resolved_scenario import ResolvedScenario
from vve_sumo.drive.shared_prefix import Variants
from vve_sumo.values import ControlCommand

GAPS = (5.0, 6.0, 7.0)


def _of_gap(gap: float) -> ResolvedScenario:
    near = {"obstacles": [{"id": "parked", "at_m": 120.0, "length_m": 4.5, "width_m": 1.8}], "road.demand": []}
    resolved: ResolvedScenario = altered(near | {"controller.tuning.gap_m": gap})
    return resolved


@pytest.fixture(scope="module")
def scenarios() -> list[ResolvedScenario]:
    return [_of_gap(gap) for gap in GAPS]


class Told:
    """A controller that answers what it was told, tick by tick."""

    def __init__(self, accelerations: Sequence[float]) -> None:
        self._accelerations, self.asked = accelerations, 0

    def step(self, observation: Any) -> ControlCommand:
        self.asked += 1
        return ControlCommand(0.0, self._accelerations[self.asked - 1])


def _way_of(
    number: int, told: Sequence[Sequence[float]], scenarios: Sequence[ResolvedScenario]
) -> tuple[list[float], Variants, list[Told]]:
    """What a scenario hears in the process in which it is driven, and with whom it is there in the end."""
    controllers = [Told(answers) for answers in told]
    made = iter(controllers)
    variants = Variants(scenarios, lambda way: number in way)
    controller = variants.controller(lambda scenario: Guarded(next(made)))
    heard = []
    for _tick in told[0]:
        command, failures = controller.step(None)  # type: ignore[arg-type]
        assert not failures
        assert command is not None
        heard.append(command.acceleration)
    return heard, variants, controllers


def _bits(values: Sequence[float]) -> list[str]:
    return [value.hex() for value in values]


@given(st.data(), st.integers(1, 6))
def test_every_scenario_hears_its_own_controller(scenarios: list[ResolvedScenario], data: Any, ticks: int) -> None:
    few = st.sampled_from((0.0, -0.0, 1.0))
    told = [data.draw(st.lists(few, min_size=ticks, max_size=ticks)) for _ in GAPS]
    for number in range(len(GAPS)):
        heard, variants, _controllers = _way_of(number, told, scenarios)
        assert _bits(heard) == _bits(told[number])
        alike = tuple(other for other in range(len(GAPS)) if _bits(told[other]) == _bits(told[number]))
        assert variants.together == alike


def test_who_went_another_way_is_not_asked_any_more(scenarios: list[ResolvedScenario]) -> None:
    told = [[0.0, 1.0, 1.0, 1.0], [0.0, 2.0, 2.0, 2.0], [0.0, 1.0, 1.0, 3.0]]
    _heard, variants, controllers = _way_of(0, told, scenarios)
    assert variants.together == (0,)
    assert [one.asked for one in controllers] == [4, 2, 4]


def test_a_new_process_is_told_before_it_goes_on(scenarios: list[ResolvedScenario]) -> None:
    calls: list[str] = []

    def fork(way: tuple[int, ...]) -> bool:
        calls.append(f"fork {way}")
        return 2 in way

    variants = Variants(scenarios, fork)
    variants.forked = lambda: calls.append(f"forked {variants.together}")
    assert variants.settle([(0,), (1,), (2,)]) == 2
    assert calls == ["fork (1,)", "fork (2,)", "forked (2,)"]


def test_one_controller_answers_for_all_that_have_the_same(scenarios: list[ResolvedScenario]) -> None:
    made: list[Told] = []

    def make(scenario: ResolvedScenario) -> Guarded:
        made.append(Told([0.0]))
        return Guarded(made[-1])

    same = [scenarios[0], scenarios[1], scenarios[0]]
    variants = Variants(same, lambda way: pytest.fail(f"forked {way}"))
    variants.controller(make).step(None)  # type: ignore[arg-type]
    assert [one.asked for one in made] == [1, 1]
    assert variants.together == (0, 1, 2)


def test_a_failure_is_an_answer_and_not_a_number_is_no_difference(scenarios: list[ResolvedScenario]) -> None:
    ways: list[tuple[int, ...]] = []

    def fork(way: tuple[int, ...]) -> bool:
        ways.append(way)
        return False

    told = iter([[0.0], [math.nan], [math.nan]])
    variants = Variants(scenarios, fork)
    controller = variants.controller(lambda scenario: Guarded(Told(next(told))))
    assert controller.step(None) == (ControlCommand(0.0, 0.0), ())  # type: ignore[arg-type]
    assert controller.text == ""
    assert ways == [(1, 2)]


def _shared(gaps: Sequence[float], taken: int) -> tuple[dict[int, str], int]:
    """The record's hashes that come of the process in which one of several gaps is driven, and how often it forked."""
    from vve_sumo.drive.run import run_variants

    forks = 0

    def fork(way: tuple[int, ...]) -> bool:
        nonlocal forks
        forks += 1
        return taken in way

    summaries = run_variants(Variants([_of_gap(gap) for gap in gaps], fork), REPOSITORY)
    return {number: summary["record_sha256"] for number, summary in summaries.items()}, forks


def _alone(gap: float) -> str:
    from vve_sumo.drive.run import run

    summary = run(_of_gap(gap), REPOSITORY, REPOSITORY, keep_record=False).summary
    return str(summary["record_sha256"])


@pytest.mark.thorough(witnesses=1)
@pytest.mark.parametrize("taken", [2, 0, 1])
def test_the_record_is_that_of_the_scenario_driven_alone(taken: int) -> None:
    # Of the three, two gaps are the same: their drives never differ.
    gaps = (5.0, 7.0, 7.0)
    hashes, forks = isolated(_shared, gaps, taken)
    assert forks >= 1
    assert hashes.keys() == ({0} if taken == 0 else {1, 2})
    assert set(hashes.values()) == {isolated(_alone, gaps[taken])}


def _judged() -> tuple[list[bool], int]:
    from vve_sumo.drive.run import run_variants

    forks = 0

    def fork(way: tuple[int, ...]) -> bool:
        nonlocal forks
        forks += 1
        return False

    brief: dict[str, Any] = {"duration_s": 3.0, "road.demand": []}
    of = [altered(brief | {"criteria": its}) for its in ({"collision": False}, {"outcome": "stopped"})]
    summaries = run_variants(Variants(of, fork), REPOSITORY)
    return [summaries[number]["passed"] for number in sorted(summaries)], forks


def test_scenarios_whose_criteria_alone_differ_are_one_drive_and_each_is_judged_by_its_own() -> None:
    assert isolated(_judged) == ([True, False], 0)
