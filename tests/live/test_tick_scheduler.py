"""The scheduler against simulated streams: a loop that waits, is woken and works, on a clock of numbers."""

from __future__ import annotations

import math
import random
from dataclasses import dataclass, field
from itertools import pairwise
from statistics import fmean, median

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vve_sumo.live.tick_scheduler import (
    LOST_TIME,
    MAX_CATCH_UP,
    OVERRUN_LIMIT,
    OVERRUN_WINDOW,
    ScheduledTick,
    TickScheduler,
)

PERIOD = 0.02


@dataclass
class Stream:
    """A receiver as the drive's clock sees it: (arrival, epoch) pairs, in order of arrival."""

    rate: float = 100.0
    duration: float = 10.0
    drift: float = 0.0  #: the receiver's seconds are so much longer than the drive's
    phase: float = 0.0071
    latency: float = 0.004
    jitter: float = 0.0
    burst: float = 0.0  #: what comes within such an interval comes at its end
    loss: float = 0.0
    outages: list[tuple[float, float]] = field(default_factory=list)
    seed: int = 1

    def arrivals(self) -> list[tuple[float, float]]:
        """Return what arrives and when."""
        drawn = random.Random(self.seed)
        interval = (1.0 + self.drift) / self.rate
        found = []
        for k in range(int(self.duration / interval)):
            epoch = self.phase + k * interval
            arrival = epoch + self.latency + drawn.expovariate(1.0) * self.jitter
            if self.burst:
                arrival = math.ceil(arrival / self.burst) * self.burst
            lost = drawn.random() < self.loss or any(a <= epoch < b for a, b in self.outages)
            if not lost:
                found.append((arrival, epoch))
        return sorted(found)


@dataclass
class Run:
    """What a loop did."""

    begins: list[tuple[float, ScheduledTick]]
    waits: list[float]  #: from the arrival of the fix that a tick was due for to its beginning
    scheduler: TickScheduler


def drive(stream: Stream, stalls: list[tuple[float, float]] = (), work: float = 0.005, late: float = 0.0) -> Run:
    """Run the loop over a stream; it works `work` [s] a tick and sleeps through stalls (begin, length).

    `late` is how long it takes to wake up.
    """
    scheduler, now, begins, waits = TickScheduler(0.0, PERIOD), 0.0, [], []
    arrivals, next_one = stream.arrivals(), 0
    stalls = sorted(stalls)
    while now < stream.duration:
        while next_one < len(arrivals) and arrivals[next_one][0] <= now:
            scheduler.fix_arrived(*arrivals[next_one])
            next_one += 1
        if (deadline := scheduler.wait_until()) > now:
            coming = arrivals[next_one][0] if next_one < len(arrivals) else math.inf
            now = min(deadline, coming) + late
            continue
        begun = scheduler.begin(now)
        if begun.woken_by == "datagram":
            waits.append(now - arrivals[next_one - 1][0])
        begins.append((now, begun))
        now += work
        while stalls and stalls[0][0] <= now:
            now += stalls.pop(0)[1]
    return Run(begins, waits, scheduler)


def check(run: Run) -> None:
    """What holds for every stream and every loop."""
    for (earlier, one), (later, two) in pairwise(run.begins):
        assert two.tick == one.tick + 1 + two.missed
        assert two.due > one.due
        assert later - earlier >= 0.5 * PERIOD - 1e-9
        assert two.due <= later
        assert two.awaited <= later
        assert later - two.due < PERIOD + 0.003 + 1e-9
        assert 0 <= two.catch_up == min(two.missed, MAX_CATCH_UP)
        assert ("overrun" in two.faults) >= (two.missed > MAX_CATCH_UP)
    assert run.scheduler.missed == sum(begun.missed for _, begun in run.begins)


streams = st.builds(
    Stream,
    rate=st.sampled_from([10.0, 20.0, 50.0, 60.0, 100.0, 200.0, 250.0]),
    duration=st.just(6.0),
    drift=st.floats(-1e-4, 1e-4),
    phase=st.floats(0.0, 1.5),
    latency=st.floats(0.0, 0.06),
    jitter=st.sampled_from([0.0, 0.0002, 0.002, 0.01]),
    burst=st.sampled_from([0.0, 0.0, 0.048]),
    loss=st.sampled_from([0.0, 0.02, 0.3]),
    outages=st.lists(st.tuples(st.floats(0.0, 3.0), st.floats(3.0, 6.0)), max_size=1),
    seed=st.integers(0, 2**32),
)
stalls = st.lists(st.tuples(st.floats(0.0, 6.0), st.floats(0.0, 2.0)), max_size=3)


@pytest.mark.thorough
@settings(max_examples=150, deadline=None)
@given(streams, stalls, st.floats(0.0, 0.015), st.floats(0.0, 0.002))
def test_ticks_count_up_and_keep_their_distance_whatever_comes(stream, stalls, work, late):
    run = drive(stream, stalls, work, late)
    check(run)
    # Ticks are time: their number tells how much of it went by, however much of it was slept through.
    (_, first), (_, last) = run.begins[0], run.begins[-1]
    assert (last.tick - first.tick) * PERIOD == pytest.approx(last.due - first.due, abs=0.12)


@pytest.mark.thorough
@settings(max_examples=40, deadline=None)
@given(
    st.sampled_from([50.0, 100.0, 200.0, 250.0]),
    st.floats(-1e-4, 1e-4),
    st.floats(0.0, 1.0),
    st.floats(0.0, 0.05),
    st.integers(0, 2**32),
)
def test_a_punctual_stream_is_the_pace(rate, drift, phase, latency, seed):
    stream = Stream(rate, 12.0, drift, phase, latency, jitter=0.0002, seed=seed)
    run = drive(stream)
    check(run)
    settled = [(now, begun) for now, begun in run.begins if phase + 3.0 < now < stream.duration - 0.1]
    assert {begun.woken_by for _, begun in settled} == {"datagram"}
    assert sum(begun.missed for _, begun in run.begins) == 0
    assert median(run.waits) < 0.0005
    spacing = fmean(later - earlier for (earlier, _), (later, _) in pairwise(settled))
    assert spacing == pytest.approx(PERIOD * (1.0 + drift), abs=1e-5)


@pytest.mark.thorough
@pytest.mark.parametrize("drift", [-1e-4, 1e-4])
@pytest.mark.parametrize("rate", [10.0, 100.0])
def test_ten_minutes_of_a_drifting_clock(rate, drift):
    run = drive(Stream(rate, 600.0, drift, jitter=0.0003))
    check(run)
    late = run.begins[len(run.begins) // 2 :]
    # 100 ppm are 60 ms in ten minutes, three ticks; the lock takes them along.
    ticks = late[-1][1].tick - late[0][1].tick
    assert (late[-1][0] - late[0][0]) / ticks == pytest.approx(PERIOD * (1.0 + drift), rel=1e-5)
    woken = [begun.woken_by for _, begun in late]
    share = woken.count("datagram") / len(woken)
    assert share == pytest.approx(min(1.0, rate / 50.0), abs=0.01)
    assert sum(begun.missed for _, begun in run.begins) == 0
    assert median(run.waits) < 0.0005


def test_of_a_100_hz_stream_every_second_fix_is_due():
    arrivals = Stream().arrivals()
    epochs = dict(arrivals)
    run = drive(Stream())
    due = [epochs[now] for now, begun in run.begins if begun.woken_by == "datagram" and now in epochs]
    assert len(due) > 490
    assert all(later - earlier == pytest.approx(PERIOD) for earlier, later in pairwise(due))


def test_of_a_20_hz_stream_two_ticks_in_five_are_woken_by_a_fix():
    run = drive(Stream(rate=20.0))
    woken = [begun.woken_by for now, begun in run.begins if now > 2.0]
    assert woken.count("datagram") / len(woken) == pytest.approx(0.2, abs=0.01)  # every 100 ms one falls on a tick
    spacings = [later - earlier for (earlier, _), (later, _) in pairwise(run.begins[20:])]
    assert max(spacings) < 0.025


def test_bursts_leave_the_cadence_as_it_is():
    run = drive(Stream(burst=0.048, duration=20.0))
    check(run)
    assert sum(begun.missed for _, begun in run.begins) == 0
    spacings = [later - earlier for (earlier, _), (later, _) in pairwise(run.begins[100:])]
    assert min(spacings) >= 0.5 * PERIOD - 1e-9
    assert max(spacings) <= 1.5 * PERIOD + 1e-9


@pytest.mark.parametrize("late", [0.0, 0.002])
@pytest.mark.parametrize("burst", [0.0, 0.048])
def test_a_tick_that_waits_for_its_fix_is_awaited_by_then_and_not_by_its_due_time(late, burst):
    """A loop that is woken late is late by as much, however late its fixes are."""
    run = drive(Stream(burst=burst, duration=6.0), late=late)
    behind = [now - begun.awaited for now, begun in run.begins[100:] if not begun.missed]
    assert max(behind) <= late + 1e-9
    # Where a fix of its burst has come during the wake-up, the tick is said to have been awaited from then on.
    assert sum(behind) >= 0.4 * late * len(behind)
    if burst:
        assert max(now - begun.due for now, begun in run.begins[100:]) > 0.003 - 1e-9


def test_without_any_fix_ticks_run_on_their_deadlines():
    run = drive(Stream(duration=2.0, loss=1.1))
    assert len(run.begins) == 100
    assert not run.scheduler.locked
    assert [begun.tick for _, begun in run.begins] == list(range(100))
    assert all(begun.woken_by == "deadline" for _, begun in run.begins)
    assert run.begins[50][0] == pytest.approx(50 * PERIOD + 0.003)


def test_a_lost_fix_costs_the_grace_only():
    whole = Stream(duration=6.0)
    gone = {round(whole.phase + k * 0.01, 9) for k in (400, 401)}
    arrivals = [pair for pair in whole.arrivals() if round(pair[1], 9) not in gone]

    class Lossy(Stream):
        def arrivals(self):
            return arrivals

    run = drive(Lossy(duration=6.0))
    late = [(now, begun) for now, begun in run.begins if begun.woken_by == "deadline" and now > 2.0]
    assert len(late) == 1
    assert late[0][0] - late[0][1].due == pytest.approx(0.003, abs=1e-4)


@pytest.mark.parametrize("length", [0.05, 0.5, 2.0, 3.0])
def test_a_stall_is_counted_made_up_for_at_most_five_times_and_named(length):
    run = drive(Stream(duration=8.0), [(4.0, length)])
    check(run)
    skipped = [begun for _, begun in run.begins if begun.missed]
    assert len(skipped) == 1
    assert skipped[0].missed == pytest.approx((length - 0.5 * PERIOD) / PERIOD, abs=1)
    assert skipped[0].catch_up == min(skipped[0].missed, MAX_CATCH_UP)
    assert skipped[0].faults == (("overrun",) if skipped[0].missed > MAX_CATCH_UP else ())
    after = [begun for now, begun in run.begins if now > 4.1 + length]
    assert {begun.woken_by for begun in after} == {"datagram"}


def test_a_loop_that_is_always_too_slow_is_an_overrun():
    run = drive(Stream(duration=2.0), work=0.035)
    check(run)
    faulty = [i for i, (_, begun) in enumerate(run.begins) if begun.faults]
    first = faulty[0]
    assert sum(begun.missed > 0 for _, begun in run.begins[:first]) == OVERRUN_LIMIT - 1
    assert first < 2 * OVERRUN_WINDOW


def test_a_tick_that_is_30_ms_late_every_third_time_is_an_overrun_within_a_second():
    """The loop is not run for 30 ms before every third tick, as where another program has its processor."""
    stalls = [(1.0 + 0.08 * k, 0.045) for k in range(36)]
    run = drive(Stream(duration=4.0), stalls)
    check(run)
    skipped = [now for now, begun in run.begins if begun.missed]
    assert max(begun.missed for _, begun in run.begins) == 1
    first = next(now for now, begun in run.begins if begun.faults)
    assert skipped[0] < first < skipped[0] + 1.0
    counts = [sum(one[1].missed > 0 for one in run.begins[i : i + OVERRUN_WINDOW]) for i in range(len(run.begins))]
    assert max(counts) < OVERRUN_LIMIT, "the short window alone would say nothing"


def test_a_fifth_of_the_last_second_is_the_limit():
    """Counted by hand: a skip before every fifth of fifty ticks is one, before every sixth none."""
    for every, said in ((5, True), (6, False)):
        scheduler, now, faults = TickScheduler(0.0, PERIOD), 0.0, set()
        for number in range(300):
            now = max(scheduler.wait_until(), now) + (PERIOD if number % every == 0 else 0.0)
            faults |= set(scheduler.begin(now).faults)
        assert bool(faults) is said


def test_one_slow_tick_now_and_then_is_none():
    run = drive(Stream(duration=6.0), [(1.0 + 0.5 * k, 0.045) for k in range(8)])
    check(run)
    assert sum(begun.missed for _, begun in run.begins) >= 8
    assert not any(begun.faults for _, begun in run.begins)


@pytest.mark.parametrize("outage", [0.5, LOST_TIME + 1.0])
def test_after_an_outage_the_fixes_are_the_pace_again(outage):
    run = drive(Stream(duration=12.0, drift=1e-4, outages=[(4.0, 4.0 + outage)]))
    check(run)
    assert sum(begun.missed for _, begun in run.begins) == 0
    meanwhile = [begun.woken_by for now, begun in run.begins if 4.1 < now < 4.0 + outage]
    assert set(meanwhile) == {"deadline"}
    after = [begun.woken_by for now, begun in run.begins if now > 4.2 + outage]
    assert set(after) == {"datagram"}


def test_times_that_cannot_be_change_nothing():
    scheduler = TickScheduler(0.0, PERIOD)
    for received, epoch in ((math.nan, 1.0), (1.0, math.nan), (1.0, 5.0), (1.0, -3.0), (math.inf, math.inf)):
        scheduler.fix_arrived(received, epoch)
    assert not scheduler.locked
    assert scheduler.wait_until() == pytest.approx(0.003)


def test_duplicates_and_late_fixes_change_nothing():
    def both(extra):
        scheduler, said = TickScheduler(0.0, PERIOD), []
        for received, epoch in Stream(duration=3.0).arrivals():
            scheduler.fix_arrived(received, epoch)
            if extra:
                scheduler.fix_arrived(received + 0.0005, epoch)
                scheduler.fix_arrived(received + 0.001, epoch - 0.03)
            if scheduler.wait_until() <= received:
                said.append(scheduler.begin(received))
        return said

    assert both(extra=True) == both(extra=False)
