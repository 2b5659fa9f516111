"""When faults begin, by nominal drives in closed form: what a brain does anyway must not pass for its reaction."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.certify.courses import BRAKING, CASE, ONSET, SPEED, TICK, course
from vve_sumo.certify.cases import CASES, SAFE_DEMAND, UNBRAKED, FaultMoment, ghost_distance
from vve_sumo.certify.judge import Rules, judge
from vve_sumo.certify.limits import CertificateLimits
from vve_sumo.certify.moments import AT_REST, FAST, onset_of, rest_time, timing_of, track_of
from vve_sumo.certify.results import CaseDrive, CaseVerdict

BUMPER = 3.8
STOPS = [case for case in CASES if case.name.startswith(("gnss_", "radar_")) and case.reaction.value == "stop"]


def asking(found: CaseDrive, acceleration: float, begins: float, lasts: float) -> CaseDrive:
    """The same course with another answer for some time."""
    answers = [
        one._replace(acceleration=acceleration) if begins - 1e-9 <= one.time < begins + lasts - 1e-9 else one
        for one in found.answers
    ]
    return replace(found, answers=answers)


def test_moments_follow_the_nominal_drive() -> None:
    nominal = course()
    assert onset_of(nominal) == pytest.approx(ONSET, abs=2 * TICK)
    assert rest_time(nominal) == pytest.approx(ONSET + SPEED / BRAKING, abs=2 * TICK)
    found = timing_of(CASE["radar_drop_out"], nominal, BUMPER).window
    assert found is not None
    assert (found.begins, found.ends) == (pytest.approx(ONSET - 1.0, abs=2 * TICK), math.inf)
    assert timing_of(CASE["nominal"], nominal, BUMPER).window is None


@settings(deadline=None)
@given(after=st.integers(2, 100), lasts=st.integers(1, 14))
def test_an_interruption_of_braking_does_not_move_its_onset(after: int, lasts: int) -> None:
    """A scan that is lost lets a brain ask for 0 for some ticks; the episode of braking has begun before."""
    interrupted = asking(course(), 0.0, ONSET + TICK * after, TICK * lasts)
    assert onset_of(interrupted) == pytest.approx(ONSET, abs=2 * TICK)


def test_who_lets_go_for_long_has_begun_to_brake_anew() -> None:
    again = asking(course(), 0.0, ONSET + 1.0, 0.4)
    assert onset_of(again) == pytest.approx(ONSET + 1.4, abs=2 * TICK)


@pytest.mark.parametrize("goes_on", [0.0, 4.0])
def test_after_a_contact_the_onset_is_reckoned_back_from_the_contact(goes_on: float) -> None:
    """The record of a drive goes on behind a contact, until the gateway has stopped the car."""
    found = course()
    hit = replace(found, collision=True, stop_gap=math.nan, contact=float(found.time[-1]) - goes_on)
    assert onset_of(hit) == pytest.approx(hit.contact - SPEED / (2.0 * 1.8))


@pytest.mark.thorough(witnesses=4)
@pytest.mark.parametrize("case", STOPS, ids=lambda case: case.name)
@settings(deadline=None)
@given(begins=st.integers(5, 85), lasts=st.integers(1, 30))
def test_a_brain_that_ignores_a_fault_never_passes(case, begins: int, lasts: int) -> None:
    """Whatever the brain brakes for without the fault: the same drive with the fault is no reaction to it."""
    nominal = asking(course(), -1.5, 0.1 * begins, 0.1 * lasts)
    timing = timing_of(case, nominal, BUMPER)
    if timing.window is None:
        assert "nowhere" in timing.void
        return
    begun = timing.window.begins
    during = [one for one in nominal.answers if begun <= one.time < begun + case.within]
    assert min(one.acceleration for one in during) > SAFE_DEMAND
    assert judge(case, timing.window, nominal, nominal, Rules(CertificateLimits(), SPEED)).verdict is CaseVerdict.FAILED


@pytest.mark.parametrize("name", ["radar_gap", "target_missing"])
def test_a_short_fault_hits_a_car_that_moves_however_hard_the_brain_brakes(name: str) -> None:
    """At 9 m/s2 a car of 8 m/s stands in less than the second that the moment lies behind the onset."""
    whole = course(braking=9.0)
    hard = replace(whole, speed=np.minimum(whole.speed, 8.0 / SPEED * whole.speed))
    window = timing_of(CASE[name], hard, BUMPER).window
    assert window is not None
    assert float(np.interp(window.begins, hard.time, hard.speed)) > FAST
    slow = replace(whole, speed=0.2 * whole.speed)
    assert timing_of(CASE[name], slow, BUMPER).void == f"the nominal drive is nowhere faster than {FAST:g} m/s"


def test_without_a_moment_a_case_is_void() -> None:
    creeping = replace(course(), speed=np.minimum(course().speed, FAST - 0.1))
    braking = asking(course(), -1.0, 0.0, ONSET)
    silent = course(silent=0.0)
    for nominal in (creeping, braking, silent):
        for case in CASES:
            timing = timing_of(case, nominal, BUMPER)
            if case.reaction in UNBRAKED:
                assert timing.window is None
                assert timing.void, case.name


@pytest.mark.parametrize("curvature", [1.0 / 60.0, -1.0 / 60.0])
def test_in_a_bend_the_other_side_of_the_axis_is_not_in_the_way(curvature: float) -> None:
    nominal = course(curvature=curvature)
    timing = timing_of(CASE["target_bend_in_way"], nominal, BUMPER)
    assert timing.window is not None
    track = track_of(nominal)
    ahead = ghost_distance(SPEED) + BUMPER
    forward, aside = track.position_ahead(track.driven(timing.window.begins), ahead)
    # Of a circle: the place at an arc from here.
    assert (forward, aside) == pytest.approx(
        (math.sin(curvature * ahead) / curvature, (1.0 - math.cos(curvature * ahead)) / curvature), abs=0.05
    )
    assert math.copysign(1.0, aside) == math.copysign(1.0, curvature)
    assert 2.0 * abs(aside) >= 4.0


@pytest.mark.parametrize("name", ["target_bend_in_way", "target_bend_mirrored"])
def test_a_straight_way_and_one_that_hardly_bends_are_void(name: str) -> None:
    assert "no bend" in timing_of(CASE[name], course(), BUMPER).void
    assert "no bend" in timing_of(CASE[name], course(curvature=1e-3), BUMPER).void


def test_targets_on_the_straight_are_not_shown_in_a_bend() -> None:
    for case in CASES:
        if case.make_scan_fault is not None and case.begins is FaultMoment.CRUISE:
            assert "straight" in timing_of(case, course(curvature=1.0 / 60.0), BUMPER).void, case.name
            assert timing_of(case, course(), BUMPER).window is not None, case.name


def test_rest_is_where_the_car_stays() -> None:
    nominal = course()
    assert abs(float(np.interp(rest_time(nominal), nominal.time, nominal.speed))) <= AT_REST
