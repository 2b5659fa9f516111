"""The judge against drives in closed form: a car that brakes evenly from a known speed, at a known time."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from vve_sumo.certify.cases import CASES, NAMES, Case, Reaction, applies, chosen
from vve_sumo.certify.diagnosis import NOT_ANSWERING, NOT_DRIVING, RULES, SIGN, diagnose
from vve_sumo.certify.judge import judge, onset_of, rest_time, window_of
from vve_sumo.certify.link import Answer, Window
from vve_sumo.certify.results import CaseResult, Course, Defect, Verdict
from vve_sumo.errors import ConfigError

TICK, SPEED, BRAKING, ONSET = 0.02, 10.0, 2.0, 8.0
CASE = {case.name: case for case in CASES}


def course(onset: float = ONSET, silent: float = math.inf, gap: float = 5.0, braking: float = BRAKING) -> Course:
    """A car at SPEED that brakes from `onset` on to rest, by a brain that says nothing from `silent` on."""
    time = TICK * np.arange(round((onset + SPEED / braking + 3.0) / TICK))
    speed = np.clip(SPEED - braking * (time - onset), 0.0, SPEED)
    answers = [
        Answer(t, n, n, 0.0, -braking if t >= onset - 1e-9 else 0.0)
        for n, t in enumerate(time.tolist())
        if t < silent - 1e-9
    ]
    left = np.cumsum(speed[::-1])[::-1] * TICK + gap
    return Course(time, speed, left, answers, "stopped", (), False, math.nan, gap, ())


def test_moments_follow_the_nominal_drive() -> None:
    nominal = course()
    assert onset_of(nominal) == pytest.approx(ONSET, abs=2 * TICK)
    assert rest_time(nominal) == pytest.approx(ONSET + SPEED / BRAKING, abs=2 * TICK)
    found = window_of(CASE["radar_drop_out"], nominal)
    assert found is not None
    assert (found.begins, found.ends) == (pytest.approx(ONSET - 1.0, abs=2 * TICK), math.inf)
    assert window_of(CASE["nominal"], nominal) is None


def test_a_contact_has_the_onset_that_a_usual_braking_would_have_had() -> None:
    hit = replace(course(), collision=True, stop_gap=math.nan)
    assert onset_of(hit) == pytest.approx(float(hit.time[-1]) - SPEED / (2.0 * 1.8))


@pytest.mark.parametrize(("after", "passes"), [(0.0, True), (0.06, True), (0.10, True), (0.14, False), (1.0, False)])
def test_silence_is_timed_to_the_tick(after: float, passes: bool) -> None:
    window = Window(5.0, math.inf)
    found = judge(CASE["radar_invalid"], window, course(onset=7.0, silent=5.0 + after), course())
    assert found.reaction == pytest.approx(after)
    assert (found.verdict is Verdict.PASSED) is passes
    assert found.left == 5.0


def test_braking_counts_as_a_reaction_and_driving_on_does_not() -> None:
    window = Window(5.0, math.inf)
    assert judge(CASE["radar_freeze"], window, course(onset=5.1), course()).verdict is Verdict.PASSED
    late = judge(CASE["radar_freeze"], window, course(onset=ONSET), course())
    assert late.verdict is Verdict.FAILED
    assert late.reaction == pytest.approx(ONSET - 5.0)
    moving = course()
    cut = round(7.0 / TICK)
    moving = replace(moving, time=moving.time[:cut], speed=moving.speed[:cut], gap=moving.gap[:cut])
    never = judge(CASE["radar_freeze"], window, moving, course())
    assert (never.verdict, never.reaction) == (Verdict.FAILED, math.inf)


def test_a_contact_fails_whatever_was_required() -> None:
    hit = replace(course(silent=5.0), collision=True, impact_speed=3.0)
    for case in CASES:
        assert judge(case, Window(5.0, math.inf), hit, course()).verdict is Verdict.FAILED, case.name


@pytest.mark.parametrize(("gap", "passes"), [(1.01, True), (0.99, False)])
def test_a_distance_must_be_left(gap: float, passes: bool) -> None:
    found = judge(CASE["radar_missing"], Window(9.0, 9.5), course(gap=gap), course())
    assert (found.verdict is Verdict.PASSED) is passes


def test_braking_for_a_ghost_is_what_the_nominal_drive_did_not_do() -> None:
    ghost, window = CASE["radar_ghost"], Window(3.0, 4.0)
    assert judge(ghost, window, course(), course()).reaction == math.inf
    assert judge(ghost, window, course(onset=3.3), course()).reaction == pytest.approx(0.3)
    both = judge(ghost, window, course(onset=3.3), course(onset=3.0))
    assert both.reaction == math.inf


def test_carrying_on_means_no_criterion_missed_that_the_nominal_drive_met() -> None:
    case, window, missed = CASE["radar_gap"], Window(9.0, 9.04), "stop_gap_m is 2.1, expected 4.5 to 5.5"
    found = judge(case, window, replace(course(), unmet=(missed,)), course())
    assert (found.verdict, found.why) == (Verdict.FAILED, missed)
    also = replace(course(), unmet=("stop_gap_m is 2.0, expected 4.5 to 5.5",))
    assert judge(case, window, replace(course(), unmet=(missed,)), also).verdict is Verdict.PASSED
    assert judge(CASE["nominal"], None, also, None).verdict is Verdict.FAILED


def test_a_brain_that_says_nothing_or_moves_nothing_fails_even_where_no_criterion_says_so() -> None:
    silent = judge(CASE["nominal"], None, replace(course(), answers=()), None)
    assert (silent.verdict, silent.why) == (Verdict.FAILED, "it gave no answer")
    standing = judge(CASE["nominal"], None, replace(course(), speed=0.0 * course().speed), None)
    assert (standing.verdict, standing.why) == (Verdict.FAILED, "the car never moved")
    assert judge(CASE["nominal"], None, course(), None).verdict is Verdict.PASSED


def result(name: str, failed: bool, extra: float = 0.0, answers: bool = True) -> CaseResult:
    """What came of a case."""
    verdict = Verdict.FAILED if failed else Verdict.PASSED
    seen = course() if answers else replace(course(), answers=())
    return CaseResult(CASE[name], 1, verdict, extra_braking=extra, course=seen)


@pytest.mark.parametrize("rule", RULES, ids=lambda rule: rule.case)
def test_a_case_that_fails_alone_names_its_defect(rule: object) -> None:
    found = diagnose([result(name, name == rule.case) for name in NAMES])  # type: ignore[attr-defined]
    assert [defect.name for defect in found] == [rule.defect]  # type: ignore[attr-defined]


def test_every_case_but_the_nominal_one_has_a_rule() -> None:
    assert {rule.case for rule in RULES} == set(NAMES) - {"nominal"}
    assert all(set(rule.unless) <= set(NAMES) for rule in RULES)


def test_who_drives_on_without_radar_is_not_told_the_consequences() -> None:
    blind = {"radar_drop_out", "radar_invalid", "radar_ageing", "radar_bit_flips", "radar_not_a_number"}
    found = diagnose([result(name, name in blind) for name in NAMES])
    assert found == (Defect("drives on without radar", ("radar_drop_out",)),)


def test_without_a_nominal_drive_only_ghosts_say_something() -> None:
    nominal, sign = result("nominal", True), result("radar_ghost_receding", True, 3.0)
    assert diagnose([nominal, result("radar_ghost", True), sign])[0].name == SIGN
    assert diagnose([nominal, result("radar_ghost", False, 3.0), sign])[0].name == NOT_DRIVING
    assert diagnose([result("nominal", True, answers=False)])[0].name == NOT_ANSWERING
    assert diagnose([result(name, False) for name in NAMES]) == ()


def test_the_table_of_cases_is_consistent() -> None:
    assert len(set(NAMES)) == len(NAMES)
    for case in CASES:
        assert math.isfinite(case.within) == (case.reaction in (Reaction.STOP, Reaction.BRAKE)), case.name
        assert (case.make is None) == (case.name == "nominal")


def test_cases_are_chosen_by_name_and_by_wire() -> None:
    names: list[Case] = list(chosen(["radar_gap"]))
    assert [case.name for case in names] == ["nominal", "radar_gap"]
    with pytest.raises(ConfigError, match=r"--cases: 'radar_gab' is no case.*did you mean 'radar_gap'"):
        chosen(["radar_gab"])
    assert applies(CASE["gnss_drop_out"], ("nmea", "radar"))
    assert not applies(CASE["gnss_invalid"], ("nmea", "radar"))
