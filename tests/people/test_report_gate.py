"""What of a phone's positions is believed."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.people.persons import report
from vve_sumo.people.report_gate import REASONS, Place, ReportGate

NUMBERS = st.floats(allow_nan=True, allow_infinity=True)


def gate() -> ReportGate:
    return ReportGate(max_speed=3.0, max_accuracy=15.0, max_age=5.0)


def judged(of: ReportGate, received: float, time: float, x: float = 0.0, accuracy: float = 4.0) -> str:
    return of.step(received, report(time, x, accuracy=accuracy), Place(time, x, 0.0, accuracy))


def test_a_walk_is_believed() -> None:
    one = gate()
    assert [judged(one, k + 0.3, float(k), 1.4 * k) for k in range(60)] == [""] * 60


@pytest.mark.parametrize(
    ("received", "time", "x", "accuracy", "reason"),
    [
        (1.3, 1.0, 0.0, 4.0, ""),
        (1.3, 0.0, 0.0, 4.0, "report_out_of_order"),
        (1.3, -1.0, 0.0, 4.0, "report_out_of_order"),
        (6.01, 1.0, 0.0, 4.0, "report_old"),
        (6.0, 1.0, 0.0, 4.0, ""),
        (1.3, 1.36, 0.0, 4.0, "report_from_future"),
        (1.3, 1.0, 0.0, 15.1, "report_inaccurate"),
        (1.3, 1.0, 11.1, 4.0, "report_jumped"),
        (1.3, 1.0, 10.9, 4.0, ""),
        (1.3, 1.0, 30.0, 4.0, "report_jumped"),
        (1.3, 1.0, 2001.0, 4.0, "report_elsewhere"),
        (1.3, 1.0, 0.0, 0.0, "report_not_finite"),
        (1.3, 1.0, 0.0, -1.0, "report_not_finite"),
        (1.3, 1.0, 0.0, math.nan, "report_not_finite"),
        (1.3, math.nan, 0.0, 4.0, "report_not_finite"),
        (1.3, 1.0, math.nan, 4.0, "report_not_finite"),
        (math.nan, 1.0, 0.0, 4.0, "report_not_finite"),
        (1.3, 1.0, math.inf, 4.0, "report_not_finite"),
    ],
)
def test_each_reason_at_its_limit(received: float, time: float, x: float, accuracy: float, reason: str) -> None:
    """After a position of the anchor at time 0 with 4 m: a person reaches 4 + 4 + 3 m within a second."""
    one = gate()
    assert judged(one, 0.3, 0.0) == ""
    assert judged(one, received, time, x, accuracy) == reason
    assert reason in ("", *REASONS)


def test_one_position_far_off_changes_nothing() -> None:
    one = gate()
    said = [judged(one, k + 0.3, float(k), 30.0 if k == 3 else 0.0) for k in range(6)]
    assert said == ["", "", "", "report_jumped", "", ""]


def test_a_person_who_was_lost_may_be_anywhere_in_the_field() -> None:
    one = gate()
    assert judged(one, 0.3, 0.0) == ""
    one.forget()
    assert judged(one, 1.3, 1.0, 300.0) == ""


@given(st.lists(st.tuples(NUMBERS, NUMBERS, NUMBERS, NUMBERS), max_size=12))
def test_nothing_that_is_no_number_is_ever_believed(steps: list[tuple[float, float, float, float]]) -> None:
    one, newest = gate(), -math.inf
    for received, time, x, accuracy in steps:
        if one.step(received, report(0.0), Place(time, x, 0.0, accuracy)) == "":
            assert all(map(math.isfinite, (received, time, x, accuracy)))
            assert 0.0 < accuracy <= 15.0
            assert received - 5.0 <= time <= received + 0.05
            assert time > newest
            newest = time
