"""Who tells the time: locked fixes only, at the start, in the drive and for the doctor."""

from __future__ import annotations

import contextlib
import dataclasses
import math
import os
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.fixes import GOOD
from vve_sumo.errors import RigError
from vve_sumo.live import alignment
from vve_sumo.live.alignment import AVERAGING_TIME, standing_pose
from vve_sumo.pose.dating import FixDater, Undated
from vve_sumo.pose.ncom import Decoder, Encoder
from vve_sumo.pose.trust import DRIVE, TrustGate
from vve_sumo.values import Fix

#: GNSS second of drive time 0, and how long a packet takes [s]
EPOCH, DELAY = 1_300_000_010.0, 0.012
PERIOD = 0.01


def fixes(begin: float, end: float, behind: float = 0.0, *, locked: bool = True) -> Iterator[tuple[float, Fix]]:
    """Arrivals and fixes of a standing car's receiver, whose time is `behind` the true one [s]."""
    for k in range(round(begin / PERIOD), round(end / PERIOD)):
        yield k * PERIOD + DELAY, replace(GOOD, time=EPOCH + k * PERIOD - behind, locked=locked)


@dataclass
class Played:
    """A source that has everything at once, with the arrival of each portion; `t0` of the drive is 0."""

    waiting: Sequence[tuple[float, bytes]]
    lost: bool = False
    _end: int = field(default_factory=lambda: os.open(os.devnull, os.O_RDONLY))

    def fileno(self) -> int:
        return self._end

    def next_due(self) -> float:
        return math.inf

    def receive(self) -> list[tuple[float, bytes]]:
        now, self.waiting = self.waiting[:50], self.waiting[50:]
        return list(now)

    def sender_faults(self) -> tuple[str, ...]:
        return ()

    def sender_report(self) -> dict[str, Any]:
        return {}

    def close(self) -> None:
        os.close(self._end)


def sent(*phases: Iterator[tuple[float, Fix]]) -> Played:
    """The packets of a receiver that goes through these phases."""
    encoder = Encoder()
    return Played([(received, encoder.encode(fix)) for phase in phases for received, fix in phase])


@pytest.mark.parametrize("behind", [5.0, -5.0, 0.3])
def test_a_start_takes_no_time_from_an_unlocked_receiver(behind: float) -> None:
    """The receiver runs on a clock that is seconds off until it locks; NCOM says so in its navigation status."""
    source = sent(fixes(0.0, 1.0, behind, locked=False), fixes(1.0, 12.0))
    standing = standing_pose(source, Decoder(), DRIVE, DELAY, 0.0)
    source.close()
    assert standing.epoch == pytest.approx(EPOCH, abs=1e-3)
    assert standing.fix.time - EPOCH > 1.0 + AVERAGING_TIME


def test_a_locked_receiver_whose_clock_is_set_during_the_start_is_believed_afterwards() -> None:
    source = sent(fixes(0.0, 1.0, 5.0), fixes(1.0, 12.0))
    standing = standing_pose(source, Decoder(), DRIVE, DELAY, 0.0)
    source.close()
    assert standing.epoch == pytest.approx(EPOCH, abs=1e-3)


class Late(Played):
    """A receiver of which nothing comes for a while."""

    until = 0.0

    def receive(self) -> list[tuple[float, bytes]]:
        return [] if time.monotonic() < self.until else super().receive()


@pytest.mark.parametrize("settling", [0.0, 5.0])
def test_a_receiver_that_has_to_settle_is_waited_for_as_much_longer(
    settling: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(alignment, "TIMEOUT", 0.1)
    source = Late(sent(fixes(0.0, 5.0)).waiting)
    source.until = time.monotonic() + 0.3
    with contextlib.closing(source), pytest.raises(RigError) if not settling else contextlib.nullcontext():
        standing = standing_pose(source, Decoder(), DRIVE, DELAY, 0.0, settling=settling)
        assert standing.epoch == pytest.approx(EPOCH, abs=1e-3)


@given(
    wrong=st.lists(st.floats(-30.0, 30.0), max_size=20),
    behind=st.floats(-1.0, 1.0),
    delay=st.floats(0.0, 0.05),
)
def test_what_unlocked_fixes_say_changes_no_later_date(wrong: list[float], behind: float, delay: float) -> None:
    dater, alone = FixDater(delay), FixDater(delay)
    unlocked = [(DELAY, replace(GOOD, time=EPOCH + error, locked=False)) for error in wrong]
    assert {dater.date(*fix) for fix in unlocked} <= {Undated("status_not_locked")}
    assert math.isnan(dater.epoch)
    assert math.isnan(dater.measured_epoch)
    for number, (received, fix) in enumerate(fixes(0.1, 0.4, behind)):
        for error in wrong[number : number + 1]:
            dater.date(received, replace(fix, time=fix.time + error, locked=False))
        assert dater.date(received, fix) == alone.date(received, fix)
    assert dater.epoch == alone.epoch == pytest.approx(EPOCH - behind + delay - DELAY, abs=1e-6)


def test_an_unlocked_fix_between_locked_ones_is_dated_by_them_and_refused_by_the_gate() -> None:
    dater, gate = FixDater(DELAY, EPOCH), TrustGate(DRIVE, EPOCH)
    for received, fix in fixes(0.0, 0.2):
        dated = dater.date(received, fix)
        assert isinstance(dated, Fix)
        assert dated.time == pytest.approx(fix.time, abs=1e-6)
        assert gate.step(received, dated).trusted
    ((received, fix),) = fixes(0.2, 0.2 + PERIOD, locked=False)
    dated = dater.date(received, fix)
    assert isinstance(dated, Fix)
    assert gate.step(received, dated).reasons == ("status_not_locked",)


def test_nothing_of_a_fix_is_changed_but_its_time() -> None:
    sent = replace(
        GOOD, **{one.name: 0.001 * n for n, one in enumerate(dataclasses.fields(Fix)) if one.type == "float"}
    )
    dated = FixDater(DELAY, 0.0).date(5.0, sent)
    assert isinstance(dated, Fix)
    assert dated.time != sent.time
    assert replace(dated, time=sent.time) == sent


def test_a_locked_fix_that_is_ahead_has_no_date_and_no_number_is_no_time() -> None:
    dater = FixDater(DELAY)
    assert dater.date(0.0, replace(GOOD, time=math.nan)) == Undated("status_not_locked")
    for received, fix in fixes(0.0, 0.2):
        dater.date(received, fix)
    ((received, fix),) = fixes(0.2, 0.2 + PERIOD, behind=-12.0)
    assert dater.date(received, fix) == Undated("fix_ahead")
    assert dater.measured_epoch == pytest.approx(EPOCH, abs=1e-6)


def test_a_host_with_gnss_time_of_its_own_needs_no_fix_for_the_epoch() -> None:
    dater = FixDater(DELAY, EPOCH, absolute=True)
    assert dater.epoch == dater.measured_epoch == EPOCH
    ((received, fix),) = fixes(0.0, PERIOD, behind=5.0)
    dated = dater.date(received, fix)
    assert isinstance(dated, Fix)
    assert dated.time == fix.time, "what a locked receiver says stands, and the gate finds its age"
