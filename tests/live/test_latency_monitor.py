"""The latency monitor against numpy, and its budget against counting by hand."""

from __future__ import annotations

import math
from dataclasses import fields, replace

import numpy as np
import pyarrow as pa
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vve_sumo.live.latency_monitor import ANSWER_TIMEOUT_TICKS, LatencyMonitor
from vve_sumo.record.latencies import LEGS, TOTAL, latency_summary, legs, quantile
from vve_sumo.record.rows import LatencyRow

PERIOD = 0.02


def row(tick: int, took: float = 0.002, by: str = "datagram", sequence: int | None = None, missed: int = 0):
    """A tick whose six legs take `took` together when its frame goes out at `gateway_answered`."""
    due = tick * PERIOD
    begin = due if by == "datagram" else due + 0.003
    step = took / 6.0
    moments = [begin + step * (i + (by == "datagram")) for i in range(5)]
    return LatencyRow(
        tick=tick,
        sequence=tick if sequence is None else sequence,
        due_s=due,
        epoch_s=due - 0.004,
        received_s=due if by == "datagram" else due - 0.02,
        woken_s=moments[0],
        decoded_s=moments[1],
        sensed_s=moments[2],
        decided_s=moments[3],
        handed_s=moments[4],
        framed_s=math.nan,
        simulated_s=moments[4] + 0.005,
        woken_by=by,
        missed=missed,
    )


def run(
    monitor: LatencyMonitor, rows: list[LatencyRow], frame: float = 0.002, behind: int = 2
) -> list[tuple[str, ...]]:
    """Have each row answered `behind` ticks later: its frame went out `frame` after its fix came."""
    said = []
    for i, one in enumerate(rows):
        if i >= behind:
            answered = rows[i - behind]
            begin = answered.received_s if answered.woken_by == "datagram" else answered.woken_s
            monitor.gateway_answered(answered.sequence, begin + frame)
        said.append(monitor.step(one))
    return said


def test_rows_are_given_out_once_complete():
    monitor = LatencyMonitor(0.005, 3)
    run(monitor, [row(tick) for tick in range(10)])
    done = monitor.completed()
    assert [one.tick for one in done] == list(range(8))
    assert all(one.framed_s == pytest.approx(one.received_s + 0.002) for one in done)
    assert monitor.completed() == []
    rest = monitor.close()
    assert [one.tick for one in rest] == [8, 9]
    assert all(math.isnan(one.framed_s) for one in rest)
    assert monitor.summary()["ticks"] == 10


def test_a_tick_without_a_setpoint_waits_for_nobody():
    monitor = LatencyMonitor(0.005, 0)
    assert monitor.step(row(0, sequence=-1)) == ()
    assert [one.tick for one in monitor.completed()] == [0]


def test_within_the_budget_nothing_is_said():
    said = run(LatencyMonitor(0.005, 0), [row(tick) for tick in range(200)], frame=0.0049)
    assert set(said) == {()}


def test_more_slow_ticks_within_a_second_than_allowed_are_a_breach_and_the_window_forgets():
    monitor = LatencyMonitor(0.005, 3)
    said = []
    for tick in range(200):
        monitor.gateway_answered(tick - 1, (tick - 1) * PERIOD + (0.008 if 10 < tick <= 14 else 0.002))
        said.append(monitor.step(row(tick)))
    first = said.index(("latency_budget",))
    assert first == 14  # the fourth slow tick was tick 13, answered one tick later
    last = max(i for i, faults in enumerate(said) if faults)
    assert last * PERIOD == pytest.approx(10 * PERIOD + 1.0, abs=1.5 * PERIOD)


@pytest.mark.parametrize("took", [math.inf, 0.00501])
def test_no_budget_is_kept_by_chance(took):
    said = run(LatencyMonitor(0.005, 0), [row(tick) for tick in range(10)], frame=took, behind=1)
    assert said[-1] == ("latency_budget",)


@pytest.mark.parametrize(("every", "said"), [(3, True), (5, False)])
def test_commands_that_come_after_the_next_tick_is_due_are_late_within_any_budget(every, said):
    """30 ms of a budget of 40, every third time: 16 or 17 in a second, and 12 are allowed; every fifth are 10."""
    monitor, found = LatencyMonitor(0.040, 10), []
    rows = [row(tick, 0.030 if tick % every == 0 else 0.002) for tick in range(200)]
    for i, one in enumerate(rows):
        if i >= 2:
            answered = rows[i - 2]
            took = 0.030 if answered.tick % every == 0 else 0.002
            monitor.gateway_answered(answered.sequence, answered.received_s + took)
        found.append(monitor.step(one))
    assert (("latency_budget",) in found) is said
    if said:
        assert found.index(("latency_budget",)) * PERIOD < 1.0


def test_a_gateway_that_does_not_answer_is_a_breach():
    monitor = LatencyMonitor(0.005, 0)
    said = [monitor.step(row(tick)) for tick in range(10)]
    assert said.index(("latency_budget",)) == ANSWER_TIMEOUT_TICKS
    assert [one.tick for one in monitor.completed()] == list(range(10 - ANSWER_TIMEOUT_TICKS))


def test_an_answer_without_frames_is_none():
    monitor = LatencyMonitor(0.005, 0)
    for tick in range(50):
        assert monitor.step(row(tick)) == ()
        monitor.gateway_answered(tick, math.nan)
    summary = monitor.summary()
    assert summary["without_frame"] == 50
    assert summary["legs_ms"][TOTAL]["max"] is None
    assert summary["worst_tick"] is None


def test_a_tick_woken_by_its_deadline_is_measured_from_its_beginning():
    took = legs(row(5, by="deadline"))
    assert took["wake"] == 0.0
    fresh = legs(row(5))
    assert fresh["wake"] == pytest.approx(0.002 / 6)


def test_a_moment_that_is_not_a_number_is_a_breach():
    monitor = LatencyMonitor(0.005, 0)
    monitor.step(replace(row(0), received_s=math.nan))
    monitor.gateway_answered(0, 0.002)
    assert monitor.step(row(1)) == ("latency_budget",)


def test_an_answer_to_an_unknown_setpoint_is_nobodys():
    monitor = LatencyMonitor(0.005, 0)
    monitor.gateway_answered(77, 1.0)
    assert monitor.completed() == []


@settings(deadline=None)
@given(st.lists(st.floats(0.0, 0.05), min_size=1, max_size=80), st.integers(0, 3))
def test_figures_are_those_of_numpy_and_of_the_record(totals, missed):
    monitor = LatencyMonitor(0.005, 1000)
    rows = []
    for tick, total in enumerate(totals):
        one = row(tick, by="deadline" if tick % 3 == 2 else "datagram", missed=missed)
        monitor.step(one)
        begin = one.received_s if one.woken_by == "datagram" else one.woken_s
        monitor.gateway_answered(one.sequence, begin + total)
        rows += monitor.completed()
    summary = monitor.summary()
    for share in (50, 95, 99):
        expected = 1e3 * np.percentile(totals, share, method="inverted_cdf")
        assert summary["legs_ms"][TOTAL][f"p{share}"] == pytest.approx(expected, abs=1e-3)
    assert summary["legs_ms"][TOTAL]["max"] == pytest.approx(1e3 * max(totals), abs=1e-3)
    assert summary["worst_tick"]["total_ms"] == summary["legs_ms"][TOTAL]["max"]
    assert summary["missed"] == missed * len(totals)
    assert summary["woken_by_deadline"] == len(totals) // 3
    table = pa.table({field.name: [getattr(one, field.name) for one in rows] for field in fields(LatencyRow)})
    assert latency_summary(table) | {"budget_ms": 5.0} == summary


def test_the_legs_add_up_to_the_total():
    monitor = LatencyMonitor(0.005, 0)
    monitor.step(row(3))
    monitor.gateway_answered(3, 3 * PERIOD + 0.004)
    took = legs(monitor.completed()[0])
    assert sum(took[name] for name in LEGS) == pytest.approx(took[TOTAL]) == pytest.approx(0.004)


def test_the_screen_shows_the_last_ticks():
    monitor = LatencyMonitor(1.0, 0)
    run(monitor, [row(tick, missed=tick == 0) for tick in range(500)], frame=0.03)
    run(monitor, [row(tick) for tick in range(500, 900)], frame=0.003)
    screen = monitor.screen()
    assert screen["p50"] == pytest.approx(0.003)
    assert screen["p99"] == pytest.approx(0.003)
    assert screen["missed"] == 1


@given(st.lists(st.floats(0, 1), max_size=30).map(sorted), st.floats(0.01, 1.0))
def test_quantiles(ordered, share):
    found = quantile(ordered, share)
    if not ordered:
        assert math.isnan(found)
    else:
        assert sum(sample <= found for sample in ordered) >= share * len(ordered) - 1e-9
        assert sum(sample < found for sample in ordered) < share * len(ordered) + 1e-9
