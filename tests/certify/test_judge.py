"""The judge against drives in closed form: a car that brakes evenly from a known speed, at a known time."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.certify.courses import CASE, ONSET, SPEED, TICK, course
from vve_sumo.certify.cases import CASES, NAMES, Case, Reaction, inapplicable, select_cases
from vve_sumo.certify.diagnosis import NOT_ANSWERING, NOT_DRIVING, RATE_UNIT, REFUSED, RULES, SIGN, Rule, diagnose
from vve_sumo.certify.judge import Judgement, Rules
from vve_sumo.certify.judge import judge as judge_by
from vve_sumo.certify.limits import CertificateLimits, limits_of
from vve_sumo.certify.link import Window
from vve_sumo.certify.results import CaseDrive, CaseResult, CaseVerdict, Defect
from vve_sumo.errors import ConfigError


def judge(case: Case, window: Window | None, found: CaseDrive, nominal: CaseDrive | None, **limits: float) -> Judgement:
    """Judge a drive by the certificate's own limits, some of them set otherwise."""
    return judge_by(case, window, found, nominal, Rules(limits_of(limits), SPEED))


@pytest.mark.parametrize(("after", "passes"), [(0.0, True), (0.06, True), (0.10, True), (0.14, False), (1.0, False)])
def test_silence_is_timed_to_the_tick(after: float, passes: bool) -> None:
    window = Window(5.0, math.inf)
    found = judge(CASE["radar_invalid"], window, course(onset=7.0, silent=5.0 + after), course())
    assert found.reaction == pytest.approx(after)
    assert (found.verdict is CaseVerdict.PASSED) is passes
    assert found.distance_left == 5.0


def test_braking_counts_as_a_reaction_and_driving_on_does_not() -> None:
    window = Window(5.0, math.inf)
    assert judge(CASE["radar_freeze"], window, course(onset=5.1), course()).verdict is CaseVerdict.PASSED
    late = judge(CASE["radar_freeze"], window, course(onset=ONSET), course())
    assert late.verdict is CaseVerdict.FAILED
    assert late.reaction == pytest.approx(ONSET - 5.0)
    moving = course()
    cut = round(7.0 / TICK)
    moving = replace(moving, time=moving.time[:cut], speed=moving.speed[:cut], gap=moving.gap[:cut])
    never = judge(CASE["radar_freeze"], window, moving, course())
    assert (never.verdict, never.reaction) == (CaseVerdict.FAILED, math.inf)


def test_a_contact_fails_whatever_was_required() -> None:
    hit = replace(course(silent=5.0), collision=True, impact_speed=3.0)
    for case in CASES:
        assert judge(case, Window(5.0, math.inf), hit, course()).verdict is CaseVerdict.FAILED, case.name


@pytest.mark.parametrize(("gap", "passes"), [(1.01, True), (0.99, False)])
def test_a_distance_must_be_left(gap: float, passes: bool) -> None:
    found = judge(CASE["target_missing"], Window(9.0, 9.5), course(gap=gap), course())
    assert (found.verdict is CaseVerdict.PASSED) is passes


def test_braking_for_a_ghost_is_what_the_nominal_drive_did_not_do() -> None:
    ghost, window = CASE["target_ghost"], Window(3.0, 4.0)
    assert judge(ghost, window, course(), course()).reaction == math.inf
    assert judge(ghost, window, course(onset=3.3), course()).reaction == pytest.approx(0.3)
    assert judge(ghost, window, course(onset=3.3), course()).verdict is CaseVerdict.PASSED
    late = judge(ghost, window, course(onset=3.5), course())
    assert (late.verdict, late.reaction) == (CaseVerdict.FAILED, pytest.approx(0.5))
    both = judge(ghost, window, course(onset=3.3), course(onset=3.0))
    assert both.reaction == math.inf


@pytest.mark.parametrize("name", ["nominal", "radar_gap"])
def test_driving_on_means_to_stop_within_limits_that_are_no_scenarios(name: str) -> None:
    """A stop 2.5 m before the car would fail parked_car's own criterion of 4.5 to 5.5 m."""
    window, nominal = (None, None) if name == "nominal" else (Window(9.0, 9.04), course())
    for gap, passes in ((2.5, True), (0.9, False), (29.0, True), (31.0, False)):
        found = judge(CASE[name], window, course(gap=gap), nominal)
        assert (found.verdict is CaseVerdict.PASSED) is passes, gap
    assert judge(CASE[name], window, course(gap=2.5), nominal, min_left_m=3.0).verdict is CaseVerdict.FAILED
    cut_short = replace(course(), outcome="fault", reasons=("brain_silent",))
    assert "brain_silent" in judge(CASE[name], window, cut_short, nominal).why


def test_every_case_is_held_to_the_path_and_to_the_speed() -> None:
    nominal = course()
    aside = replace(nominal, deviation=np.where(nominal.time > 4.0, -0.51, 0.0))
    for case in CASES:
        window = Window(5.0, 6.0) if case.injects else None
        found = judge(case, window, aside, nominal if case.injects else None)
        assert "0.51 m from the path, allowed 0.5 m" in found.why, case.name
    assert judge(CASE["nominal"], None, aside, None, max_deviation_m=0.52).verdict is CaseVerdict.PASSED
    fast = judge_by(CASE["nominal"], None, nominal, None, Rules(CertificateLimits(), SPEED - 1.1))
    assert "1.1 m/s faster" in fast.why


def test_who_asks_for_more_steering_than_there_is_has_another_unit() -> None:
    nominal = course()
    for asked, passes in ((0.7, True), (-0.8, False), (28.0, False)):
        steered = [one._replace(steering=asked) if one.time > 5.0 else one for one in nominal.answers]
        rules = Rules(CertificateLimits(), SPEED, steering=0.5)
        found = judge_by(CASE["nominal"], None, replace(nominal, answers=steered), None, rules)
        assert (found.verdict is CaseVerdict.PASSED) is passes, asked


def test_limits_are_refused_where_nothing_could_keep_them() -> None:
    for values, said in (
        ({"min_left": 1.0}, "'min_left' is no limit.*min_left_m"),
        ({"min_left_m": 0.0}, "above 0"),
        ({"min_left_m": math.nan}, "above 0"),
        ({"max_deviation_m": "0.3 m"}, "above 0, got '0.3 m'"),
        ({"min_left_m": 40.0}, "max_left_m: expected more than min_left_m"),
    ):
        with pytest.raises(ConfigError, match=said):
            limits_of(values)


@pytest.mark.parametrize(("name", "demand"), [("target_ghost_receding", 1.0), ("target_ghost_slower", 2.2)])
def test_what_is_none_of_its_business_is_not_braked_for(name: str, demand: float) -> None:
    case, window, nominal = CASE[name], Window(3.0, 4.0), course()

    def braked(by: float, since: float, lasts: float) -> CaseDrive:
        answers = [
            a._replace(acceleration=-by) if since <= a.time < since + lasts - 1e-9 else a for a in nominal.answers
        ]
        return replace(nominal, answers=answers)

    assert judge(case, window, nominal, nominal).verdict is CaseVerdict.PASSED
    assert judge(case, window, braked(demand + 0.05, 3.2, 0.1), nominal).verdict is CaseVerdict.PASSED
    assert judge(case, window, braked(demand + 0.05, 3.2, 0.14), nominal).verdict is CaseVerdict.FAILED
    assert judge(case, window, braked(demand - 0.05, 3.2, 0.8), nominal).verdict is CaseVerdict.PASSED
    assert judge(case, window, braked(demand + 0.05, 5.0, 0.8), nominal).verdict is CaseVerdict.PASSED
    # The same braking a little earlier than without a fault is no braking for the target.
    late = Window(ONSET - 0.5, ONSET + 0.5)
    assert judge(case, late, course(onset=ONSET - 0.2), nominal).verdict is CaseVerdict.PASSED


def test_a_single_setpoint_is_no_braking_for_a_ghost() -> None:
    nominal = course()
    blip = [a._replace(acceleration=-3.0) if 3.2 <= a.time < 3.3 else a for a in nominal.answers]
    found = judge(CASE["target_ghost"], Window(3.0, 4.0), replace(nominal, answers=blip), nominal)
    assert (found.verdict, found.reaction) == (CaseVerdict.FAILED, math.inf)


@pytest.mark.parametrize("name", ["radar_invalid", "gnss_freeze", "both_freeze", "target_missing", "radar_delay_short"])
def test_a_drive_that_was_over_before_the_fault_began_passes_nothing(name: str) -> None:
    """A brain that dies by itself at 3 s is stopped by the gateway; what is injected at 9 s hits nobody any more."""
    case, window = CASE[name], Window(9.0, 9.0 + CASE[name].lasts)
    died = replace(course(onset=3.1, silent=3.0), outcome="fault", reasons=("brain_silent",), stop_gap=math.nan)
    found = judge(case, window, died, course())
    assert (found.verdict, "was silent before" in found.why) == (CaseVerdict.FAILED, True)
    stood = judge(case, window, replace(course(onset=3.0), stop_gap=math.nan), course())
    assert (stood.verdict, "at rest" in stood.why) == (CaseVerdict.FAILED, True)


def test_who_says_the_same_twice_a_tick_brakes_no_longer_for_that() -> None:
    def twice(found: CaseDrive) -> CaseDrive:
        return replace(found, answers=[answer for answer in found.answers for _ in range(2)])

    def braking(lasts: float) -> CaseDrive:
        nominal = course()
        answers = [
            answer._replace(acceleration=-2.0) if 3.3 - 1e-9 <= answer.time < 3.3 + lasts - 1e-9 else answer
            for answer in nominal.answers
        ]
        return replace(nominal, answers=answers)

    window = Window(3.0, 4.0)
    for name, lasts in (("target_ghost", 0.2), ("target_ghost", 0.4), ("target_ghost_receding", 0.08)):
        once, doubled = (judge(CASE[name], window, each, course()) for each in (braking(lasts), twice(braking(lasts))))
        assert (once.verdict, once.reaction) == (doubled.verdict, doubled.reaction), name


def test_a_brain_that_says_nothing_or_moves_nothing_fails_even_where_no_criterion_says_so() -> None:
    silent = judge(CASE["nominal"], None, replace(course(), answers=()), None)
    assert (silent.verdict, silent.why) == (CaseVerdict.FAILED, "it gave no answer")
    standing = judge(CASE["nominal"], None, replace(course(), speed=0.0 * course().speed), None)
    assert (standing.verdict, standing.why) == (CaseVerdict.FAILED, "the car never moved")
    assert judge(CASE["nominal"], None, course(), None).verdict is CaseVerdict.PASSED


def result(name: str, failed: bool, extra: float = 0.0, answers: bool = True) -> CaseResult:
    """What came of a case."""
    verdict = CaseVerdict.FAILED if failed else CaseVerdict.PASSED
    seen = course() if answers else replace(course(), answers=())
    return CaseResult(CASE[name], 1, verdict, extra_braking=extra, drive=seen)


@pytest.mark.thorough(witnesses=7)
@pytest.mark.parametrize("rule", RULES, ids=lambda rule: rule.case)
def test_a_case_that_fails_alone_names_its_defect(rule: Rule) -> None:
    results = [result(name, name == rule.case) for name in NAMES]
    never = [replace(one, reaction=math.inf) for one in results]
    assert [defect.name for defect in diagnose(never)] == [rule.defect]
    late = [replace(one, reaction=0.6) for one in results]
    assert [defect.name for defect in diagnose(late)] == [rule.late or rule.defect]


def test_every_case_but_the_nominal_one_has_a_rule() -> None:
    assert {rule.case for rule in RULES} == set(NAMES) - {"nominal"}
    assert len(RULES) == len(NAMES) - 1
    assert all(set(rule.unless) <= set(NAMES) for rule in RULES)


def test_who_drives_on_without_radar_is_not_told_the_consequences() -> None:
    blind = {"radar_drop_out", "radar_invalid", "radar_ageing", "radar_bit_flips", "radar_not_a_number"}
    found = diagnose([result(name, name in blind) for name in NAMES])
    assert found == (Defect("drives on without radar", ("radar_drop_out",)),)


def test_without_a_nominal_drive_only_ghosts_say_something() -> None:
    nominal, sign = result("nominal", True), result("target_ghost_receding", True, 3.0)
    assert diagnose([nominal, result("target_ghost", True), sign])[0].name == SIGN
    assert diagnose([nominal, result("target_ghost", False, 3.0), sign])[0].name == NOT_DRIVING
    assert diagnose([result("nominal", True, answers=False)])[0].name == NOT_ANSWERING
    slower = result("target_ghost_slower", True, 3.0)
    blind = result("target_ghost", True)
    assert diagnose([nominal, blind, result("target_ghost_receding", False), slower])[0].name == RATE_UNIT
    refused = replace(course(), answers=(), refused={"setpoint_lifetime": 40}, taken=0)
    assert diagnose([replace(nominal, drive=refused)])[0].name == REFUSED["setpoint_lifetime"]
    assert diagnose([result(name, False) for name in NAMES]) == ()


def test_the_table_of_cases_is_consistent() -> None:
    assert len(set(NAMES)) == len(NAMES)
    for case in CASES:
        assert math.isfinite(case.within) == (case.reaction in (Reaction.STOP, Reaction.BRAKE)), case.name
        assert case.injects == (case.name != "nominal")
        assert not (case.make_wire_fault and case.make_scan_fault), case.name


def test_cases_are_chosen_by_name_and_by_wire() -> None:
    names: list[Case] = list(select_cases(["radar_gap"]))
    assert [case.name for case in names] == ["nominal", "radar_gap"]
    with pytest.raises(ConfigError, match=r"--cases: 'radar_gab' is no case.*did you mean 'radar_gap'"):
        select_cases(["radar_gab"])
    assert [case.name for case in select_cases(["radar_gap", "target_ghost"], ["radar_gap"])] == [
        "nominal",
        "target_ghost",
    ]
    assert {case.name for case in CASES} - {case.name for case in select_cases([], ["nominal", "radar_gap"])} == {
        "radar_gap"
    }
    with pytest.raises(ConfigError, match=r"--without: 'gap' is no case"):
        select_cases([], ["gap"])
    assert not inapplicable(CASE["gnss_drop_out"], ("nmea", "radar"))
    assert "no wire of ncom" in inapplicable(CASE["gnss_invalid"], ("nmea", "radar"))
    assert "tells the brain the time" in inapplicable(CASE["radar_delay"], ("radar",))
    assert not inapplicable(CASE["radar_delay"], ("radar", "nmea"))
