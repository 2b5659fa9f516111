"""A receiver whose quality comes and goes, and what is borne without a word, by hand and by the injector."""

from __future__ import annotations

from collections import deque
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.fixes import GOOD
from tests.plant.faulty_ride import AT, Ride
from tests.plant.test_car import EPOCH
from vve_sumo.plant.injected_faults import InjectedFault
from vve_sumo.pose.dating import FixDater, Undated
from vve_sumo.pose.steadiness import MAX_INTERRUPTIONS, MAX_REFUSED_SHARE, MIN_REFUSED, WINDOW, Steadiness
from vve_sumo.pose.trust import DRIVE, NMEA, PLAYBACK, TrustGate
from vve_sumo.values import FixQuality

CODE = ("pose_unsteady",)


def said(qualities: list[bool], rate: float = 100.0, profile=DRIVE) -> list[tuple[tuple[str, ...], tuple[str, ...]]]:
    """Reason codes, unsteady and stale, after each fix of a standing car that is RTK-fixed or falls back to float."""
    gate, found = TrustGate(profile, 0.0), []
    for k, fixed in enumerate(qualities):
        now = k / rate
        quality = FixQuality.RTK_FIXED if fixed else FixQuality.RTK_FLOAT
        gate.step(now, replace(GOOD, time=now, quality=quality))
        found.append((gate.unsteady(), gate.stale(now)))
    return found


def flapping(seconds: float, on: float, off: float, rate: float = 100.0) -> list[bool]:
    """A good second, then RTK comes and goes."""
    times = [k / rate for k in range(round(seconds * rate))]
    return [True] * round(rate) + [(time + 1e-9) % (on + off) < on for time in times]


@pytest.mark.parametrize("period", [0.1, 0.05, 0.02])
def test_rtk_that_comes_and_goes_stops_the_car_though_no_pose_is_ever_stale(period: float) -> None:
    found = said(flapping(3.0, period, period))
    assert all(stale == () for _, stale in found), "which is why nothing was said before"
    first = next(k for k, (unsteady, _) in enumerate(found) if unsteady == CODE)
    assert first / 100.0 < 1.0 + 0.6
    assert all(unsteady == CODE for unsteady, _ in found[first:])


def test_one_refused_fix_in_ten_is_too_often_ten_times_a_second() -> None:
    assert CODE in [unsteady for unsteady, _ in said(flapping(3.0, 0.09, 0.01))]


@pytest.mark.parametrize(("rate", "profile"), [(100.0, DRIVE), (10.0, NMEA)])
@pytest.mark.parametrize("number", [1, 2])
def test_a_refused_fix_or_two_stop_nothing(rate: float, profile, number: int) -> None:
    for at in range(1, 30):
        qualities = [True] * 40
        qualities[at : at + number] = [False] * number
        assert {unsteady for unsteady, _ in said(qualities, rate, profile)} == {()}


def test_it_is_over_a_second_after_the_last_refused_fix() -> None:
    found = said(flapping(1.0, 0.1, 0.1) + [True] * 150)
    assert found[199][0] == CODE
    assert found[200 + 110][0] == ()


def test_before_the_first_trusted_fix_nothing_is_counted_and_recordings_are_not_judged() -> None:
    assert {unsteady for unsteady, _ in said([False] * 300 + [True] * 10)} == {()}
    assert {unsteady for unsteady, _ in said(flapping(3.0, 0.1, 0.1), profile=PLAYBACK)} == {()}


def unsteady(refused: list[bool], rate: float) -> bool:
    """Whether it is, after these fixes; one is trusted first."""
    steadiness = Steadiness()
    for number, one in enumerate([False, *refused]):
        steadiness.step(number / rate, one)
    return steadiness.unsteady


@pytest.mark.parametrize(
    ("refused", "rate", "expected"),
    [
        # At 100 Hz a window has 101 fixes, the first and the last on its edges: 25 are 24.8 %, 26 are 25.7 %.
        ([False] * 75 + [True] * 25, 100.0, False),
        ([False] * 75 + [True] * 26, 100.0, True),
        ([False, False, True, True], 4.0, False),  # two of five
        ([False, True, True, True], 4.0, True),  # three of five
        ([True, True, True], 2.0, True),  # three of three, the oldest on the edge
        ([True, *[False] * 9] * 4, 100.0, False),  # four interruptions
        ([True, *[False] * 9] * 5, 100.0, True),
        ([False] * 90 + [True] * 6, 100.0, False),  # one long interruption is one
    ],
)
def test_a_quarter_of_a_second_s_fixes_or_five_interruptions(refused: list[bool], rate: float, expected: bool) -> None:
    assert unsteady(refused, rate) is expected


@given(st.lists(st.tuples(st.floats(0.0, 0.3), st.booleans()), max_size=200))
def test_the_counts_are_those_of_the_window(steps: list[tuple[float, bool]]) -> None:
    """Against a count of the whole window at every fix."""
    steadiness, now, window, before, begun = Steadiness(), 0.0, deque[tuple[float, bool, bool]](), False, False
    for elapsed, refused in steps:
        now += elapsed
        steadiness.step(now, refused)
        begun |= not refused
        if not begun:
            assert not steadiness.unsteady
            continue
        window.append((now, refused, refused and not before))
        before = refused
        kept = [one for one in window if not one[0] < now - WINDOW]
        bad, begins = sum(one[1] for one in kept), sum(one[2] for one in kept)
        many = bad >= MIN_REFUSED and bad / len(kept) > MAX_REFUSED_SHARE
        assert steadiness.unsteady is (many or begins > MAX_INTERRUPTIONS)


#: what the fault matrix rides through
BORNE = [
    "pose_bursts", "pose_garbage", "pose_duplicates", "pose_reordered", "pose_minute_wrong", "pose_ahead_once",
    "pose_forged",
]  # fmt: skip


@pytest.mark.thorough(witnesses=2)
@pytest.mark.parametrize("kind", BORNE)
@pytest.mark.parametrize("dated", [True, False])
def test_what_is_ridden_through_stays_so(kind: str, dated: bool) -> None:
    """The packets of the simulated receiver, 3 s of each fault; live drives date fixes, those in lockstep do not."""
    ride = Ride(InjectedFault(kind, AT, 3.0), seconds=7.0)
    gate, dater, codes, fixes = TrustGate(DRIVE, EPOCH), FixDater(0.01, EPOCH), set(), 0
    for fix in ride.fixes:
        there = dater.date(fix.time_received, fix) if dated else fix
        if isinstance(there, Undated):
            continue
        gate.step(fix.time_received, there)
        codes |= {gate.unsteady()}
        fixes += 1
    assert fixes > 400
    assert codes == {()}


def test_the_same_of_a_receiver_without_faults() -> None:
    gate = TrustGate(DRIVE, EPOCH)
    ride = Ride(seconds=6.0)
    assert {(gate.step(fix.time_received, fix), gate.unsteady())[1] for fix in ride.fixes} == {()}


#: reason: drive times of arrival of fixes, and of the fixes themselves, of which some second is refused for it alone
LATE = {
    "time_not_increasing": [(0.0005 * k, 0.0) for k in range(100)],
    "fix_too_old": [(0.01 * k + 0.2, 0.01 * k) for k in range(1, 100)],
    "fix_from_future": [(0.01 * k, 0.01 * k + 0.1) for k in range(100)],
    "gap": [(0.2 * k, 0.2 * k) for k in range(1, 10)],
    "settling": [(0.3 + 0.01 * k, 0.3 + 0.01 * k) for k in range(50)],
}


@pytest.mark.parametrize("reason", LATE)
def test_messages_that_are_late_repeated_or_misdated_are_not_the_receivers_quality(reason: str) -> None:
    gate, found = TrustGate(DRIVE, 0.0), []
    for k in range(-20, 1):
        assert gate.step(0.01 * k, replace(GOOD, time=0.01 * k)).trusted
    for now, made in LATE[reason]:
        found += gate.step(now, replace(GOOD, time=made)).reasons
        assert gate.unsteady() == ()
    assert {reason} <= set(found) <= {reason, "gap"}
    assert found.count(reason) > 8


def test_a_recording_is_never_unsteady() -> None:
    gate = TrustGate(PLAYBACK, 0.0)
    gate.step(0.0, replace(GOOD, time=0.0))
    for k in range(1, 100):
        stuck = replace(GOOD, time=0.01 * k, velocity_east=5.0)
        assert k == 1 or gate.step(0.01 * k, stuck).reasons
        assert gate.unsteady() == ()
