"""NMEA decoder: the date and time of a fix, and which sentences belong to it."""

from __future__ import annotations

import itertools
import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.pose.nmea_sentences import (
    MIDNIGHT_GPS,
    NOON,
    PERIOD,
    POSITION,
    decoder,
    drive,
    epoch,
    fed,
    gga,
    gst,
    hdt,
    rmc,
    sealed,
    vtg,
    zda,
)
from vve_sumo.pose.nmea import Outcome

# --- time -------------------------------------------------------------------------------------------------------------


def test_no_fix_before_the_date_is_known():
    to = decoder()
    rows = [row for row in drive(5) if b"RMC" not in row[1]]
    assert fed(rows, to) == []
    assert to.counts[Outcome.DATE_UNKNOWN] == 5
    assert len(fed([(NOON + 0.5, zda(NOON + 0.5)), *drive(3, NOON + 0.5)[2:]], to)) == 3


def test_a_date_of_a_receiver_that_has_no_position_is_not_believed():
    to = decoder()
    fed([(0.0, sealed("GNRMC,115959.90,V,,,,,,,060180,,,N,V")), (0.0, gga(NOON - 0.05, quality=0)), (0.0, zda())], to)
    assert fed([row for row in drive(5) if b"RMC" not in row[1]], to) == []


@pytest.mark.parametrize("date_first", [True, False])
def test_midnight(date_first):
    """The date turns with the time of day, whether or not a sentence says so, and whichever comes first."""
    to, fixes = decoder(), []
    for k in range(-10, 10):
        seconds = 86_400.0 + k * PERIOD
        dated = [rmc(seconds)] if k < 0 else []
        sentences = [*dated, *epoch(seconds)] if date_first else [*epoch(seconds)[:3], *dated, vtg()]
        fixes += fed([(seconds + 0.005 * n, one) for n, one in enumerate(sentences)], to)
    assert len(fixes) >= 18
    assert fixes[-1].time == pytest.approx(MIDNIGHT_GPS + 86_400.9)
    steps = [after.time - before.time for before, after in itertools.pairwise(fixes)]
    assert steps == pytest.approx([PERIOD] * len(steps), abs=1e-6)


@pytest.mark.parametrize("text", ["235960.00", "999999.99", "12", "", "1x0000.00", "120000"])
def test_impossible_times_are_malformed_or_whole_seconds(text):
    to = decoder()
    to.feed(sealed(f"GPGGA,{text},{POSITION}"), 0.0)
    assert to.counts[Outcome.READ if text == "120000" else Outcome.MALFORMED] == 1


# --- whose sentence is it? --------------------------------------------------------------------------------------------


def test_a_receiver_that_sends_the_heading_first_gives_no_fix_rather_than_an_old_heading():
    """Heading 25 deg older each epoch: had one been taken for the wrong epoch, it would show."""
    to, rows = decoder(), []
    for k in range(20):
        seconds = NOON + k * PERIOD
        rows += [(seconds + 0.005 * n, one) for n, one in enumerate((hdt(k), rmc(seconds), gga(seconds)))]
    assert fed(rows, to) == []
    assert to.counts[Outcome.INCOMPLETE] == 19


@pytest.mark.thorough
@settings(max_examples=150, deadline=None)
@given(st.sets(st.integers(0, 79)), st.integers(0, 3))
def test_lost_sentences_never_mix_epochs(lost, order):
    """Each epoch's heading, course and latitude are its own number; with 30 % lost, a fix holds one number only.

    Two losses next to each other can make a heading look like the epoch's before, so none of these is next to another.
    """
    alone = {k for k in lost if k - 1 not in lost and k - 2 not in lost and k - 3 not in lost}
    rows = [(NOON - PERIOD, rmc(NOON - PERIOD))]
    for k in range(20):
        seconds = NOON + k * PERIOD
        body = [gst(seconds), hdt(k + 1), vtg(k + 1)]
        sentences = [gga(seconds, latitude=39.0 + k), *body[order:], *body[:order]]
        rows += [(seconds + 0.008 * n, one) for n, one in enumerate(sentences) if 4 * k + n not in alone]
    for fix in fed(rows):
        k = round((fix.time - MIDNIGHT_GPS - NOON) / PERIOD)
        assert 90.0 - math.degrees(fix.heading) == pytest.approx(k + 1)
        assert math.degrees(math.atan2(fix.velocity_east, fix.velocity_north)) == pytest.approx(k + 1)
        assert math.degrees(fix.latitude) == pytest.approx(39.0 + k)


def test_a_late_position_does_not_land_in_the_epoch_after():
    to, now = decoder(), NOON + 0.2
    late = [gga(now, latitude=41.0), gga(now - PERIOD, latitude=40.0), hdt(), vtg()]
    *_, fix = fed([*drive(1), *((now, one) for one in late)], to)
    assert math.degrees(fix.latitude) == pytest.approx(41.0)
    assert to.counts[Outcome.STRAY] == 1


def test_one_date_that_goes_back_counts_for_nothing():
    yesterday = [(NOON + 0.55, rmc(NOON + 0.55, date="201126"))]
    times = [fix.time for fix in fed([*drive(5), *yesterday, *drive(5, NOON + 0.6)[2:]])]
    assert len(times) == 10
    assert times[-1] == pytest.approx(MIDNIGHT_GPS + NOON + 1.0)


def test_duplicates_make_no_second_fix():
    to = decoder()
    rows = [row for row in drive(10) for _ in range(2)]
    assert len(fed(rows, to)) == 10
    assert to.counts[Outcome.STRAY] > 0


def test_a_receiver_without_a_position_gives_no_fix():
    to = decoder()
    empty = sealed("GPGGA,120000.00,,,,,0,00,99.99,,,,,,")
    assert fed([*drive(1)[:2], *((NOON, one) for one in (empty, hdt(), vtg()))], to) == []
    assert to.counts[Outcome.NO_POSITION] == 1


@pytest.mark.parametrize(
    "fields",
    ["3959.8,,08258.9,W,4", "3959.8,N,08258.9,,4", "9959.8,N,08258.9,W,4", "3959.8,N,99958.9,W,4", "x,N,y,W,4"],
)
def test_half_a_position_is_none(fields):
    to = decoder()
    sentence = sealed(f"GPGGA,120000.00,{fields},14,0.7,231.4,M,-33.9,M,1.0,0001")
    assert fed([*drive(1)[:2], *((NOON, one) for one in (sentence, hdt(), vtg()))], to) == []
    assert to.counts[Outcome.NO_POSITION] + to.counts[Outcome.MALFORMED] == 1
