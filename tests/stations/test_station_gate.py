"""What of stations' reports is believed: each reason at its limit."""

from __future__ import annotations

import math
from dataclasses import replace as changed
from typing import Any

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vve_sumo.stations.reports import StationReport
from vve_sumo.stations.station_gate import MAX_NEW, REASONS, GateLimits, Place, StationGate

REPORT = StationReport(4711, 2, "car", 10.0, 0.7, -1.4, 2.25, 1.0, 0.0, 10.0, 0.0, 4.5, 1.8)
HERE = Place(20.0, 0.0)
NUMBERS = st.floats(allow_nan=True, allow_infinity=True)


def replace(report: StationReport, **changes: Any) -> StationReport:
    return msgspec.structs.replace(report, **changes)


@pytest.mark.parametrize(
    ("changes", "received", "place", "reason"),
    [
        ({}, 10.05, HERE, ""),
        ({}, 11.0, HERE, ""),
        ({}, 11.01, HERE, "old"),
        ({}, 9.91, HERE, ""),
        ({}, 9.89, HERE, "from_future"),
        ({"accuracy": 5.0}, 10.0, HERE, ""),
        ({"accuracy": 5.01}, 10.0, HERE, "inaccurate"),
        ({"accuracy": math.nan}, 10.0, HERE, "inaccurate"),
        ({"speed": 70.0}, 10.0, HERE, ""),
        ({"speed": 70.1}, 10.0, HERE, "too_fast"),
        ({"speed": 25.1, "kind": "bicycle"}, 10.0, HERE, "too_fast"),
        ({"speed": 12.1, "kind": "child"}, 10.0, HERE, "too_fast"),
        ({"speed": math.nan}, 10.0, HERE, "unknown_motion"),
        ({"heading": math.nan}, 10.0, HERE, "unknown_motion"),
        ({"heading": math.nan, "speed": 0.0}, 10.0, HERE, ""),
        ({}, 10.0, Place(499.0, 0.0), ""),
        ({}, 10.0, Place(400.0, 301.0), "elsewhere"),
        ({}, 10.0, Place(math.inf, 0.0), "not_finite"),
        ({}, math.nan, HERE, "not_finite"),
        ({"measured": math.nan}, 10.0, HERE, "not_finite"),
        ({"heading": math.inf}, 10.0, HERE, "not_finite"),
        ({"speed": -0.1}, 10.0, HERE, "not_finite"),
        ({"latitude": 1.6}, 10.0, HERE, "not_finite"),
        ({"length": 0.0}, 10.0, HERE, "not_finite"),
        ({"width": math.nan}, 10.0, HERE, "not_finite"),
        ({"accuracy": 0.0}, 10.0, HERE, "not_finite"),
        ({"station": 1}, 10.0, HERE, "ignored"),
    ],
)
def test_each_reason_of_a_first_report_at_its_limit(
    changes: dict[str, Any], received: float, place: Place, reason: str
) -> None:
    gate = StationGate(GateLimits(ignored=frozenset({1})))
    assert gate.judge(received, replace(REPORT, **changes), place, None, 0) == reason
    assert reason in ("", *REASONS)


@pytest.mark.parametrize(
    ("changes", "x", "reason"),
    [
        ({"measured": 10.0}, 20.0, "out_of_order"),
        ({"measured": 9.9}, 20.0, "out_of_order"),
        ({"measured": 10.5}, 25.0, ""),
        # Within 0.5 s: 1 + 1 m of both circles, half of both lengths, 5 m, and 0.5 x 12 m/s2 x 0.25 s2.
        ({"measured": 10.5}, 20.0 + 2.0 + 4.5 + 5.0 + 1.49, ""),
        ({"measured": 10.5}, 20.0 + 2.0 + 4.5 + 5.0 + 1.51, "jumped"),
        ({"measured": 10.5}, 20.0 - 2.0 - 4.5 - 5.0 - 1.51, "jumped"),
        ({"measured": 10.5, "speed": 16.9}, 25.0, ""),
        ({"measured": 10.5, "speed": 17.1}, 25.0, "jumped"),
        ({"measured": 10.5, "speed": 2.9}, 25.0, "jumped"),
        ({"measured": 10.5, "kind": "bus"}, 25.0, "jumped"),
    ],
)
def test_each_reason_of_a_later_report_at_its_limit(changes: dict[str, Any], x: float, reason: str) -> None:
    gate = StationGate(GateLimits())
    assert gate.judge(10.5, replace(REPORT, **changes), Place(x, 0.0), (REPORT, HERE), 1) == reason


def test_there_are_no_more_stations_than_the_rig_takes() -> None:
    gate = StationGate(GateLimits(stations=3))
    assert gate.judge(10.0, REPORT, HERE, None, 2) == ""
    assert gate.judge(10.0, REPORT, HERE, None, 3) == "too_many"
    assert gate.judge(10.1, replace(REPORT, measured=10.1), HERE, (REPORT, HERE), 3) == ""


def test_who_takes_ever_new_names_is_not_believed() -> None:
    """A spoofer with a new ID each 0.1 s: ten, and no more until ten seconds are over."""
    gate, believed = StationGate(GateLimits(stations=200)), []
    for number in range(300):
        received = 0.1 * number
        report = replace(REPORT, station=number, measured=received)
        if gate.judge(received, report, HERE, None, len(believed)) == "":
            believed.append(received)
    assert len([time for time in believed if time < 10.0]) == MAX_NEW
    for begin in believed:
        assert len([time for time in believed if begin <= time <= begin + 10.0 - 1e-9]) <= MAX_NEW
    assert len(believed) == 30


@given(
    st.builds(
        StationReport, st.integers(0, 2**32 - 1), st.sampled_from((2, 16)),
        st.sampled_from(("car", "child", "bicycle")), *(NUMBERS,) * 10,
    ),
    NUMBERS, NUMBERS, NUMBERS, st.booleans(),
)  # fmt: skip
def test_whatever_comes_what_is_believed_is_sound(
    report: StationReport, received: float, x: float, y: float, later: bool
) -> None:
    gate, last = StationGate(GateLimits()), (REPORT, HERE) if later else None
    if gate.judge(received, report, Place(x, y), last, 1) == "":
        assert math.hypot(x, y) <= 500.0
        assert -0.1 <= received - report.measured <= 1.0
        assert 0.0 <= report.speed <= 70.0
        assert 0.0 < report.accuracy <= 5.0
        assert math.isfinite(report.length * report.width + report.yaw_rate + report.ahead)
        assert not later or report.measured > REPORT.measured


def test_limits_are_those_that_were_given() -> None:
    near = StationGate(changed(GateLimits(), reach=10.0))
    assert near.judge(10.0, REPORT, HERE, None, 0) == "elsewhere"
