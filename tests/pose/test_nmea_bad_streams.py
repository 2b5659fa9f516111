"""NMEA streams as bad as lines make them, and sentences that lie under a right checksum."""

from __future__ import annotations

import itertools
import math
import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.pose.nmea_sentences import MIDNIGHT_GPS, NOON, PERIOD, decoder, drive, fed, gga, gst, pashr, rmc, sealed, zda
from vve_sumo.pose.nmea import Outcome
from vve_sumo.values import Fix

# --- bad streams ------------------------------------------------------------------------------------------------------

STREAM = b"".join(data for _, data in drive(8))


def content(fix: Fix) -> str:
    """All but the moment of arrival, NaN comparable."""
    return repr((fix.time, fix.latitude, fix.longitude, fix.heading, fix.velocity_north, fix.quality))


def whole(data: bytes) -> list[str]:
    return [content(fix) for fix in decoder().feed(data, 0.0)]


@given(st.lists(st.integers(1, 200), max_size=40), st.binary(max_size=60))
def test_the_cut_of_the_stream_does_not_matter(cuts, garbage):
    data, to, fixes, position = garbage + STREAM, decoder(), [], 0
    for cut in [*cuts, len(data)]:
        fixes += to.feed(data[position : position + cut], 0.0)
        position += cut
    once = decoder()
    assert [content(fix) for fix in fixes] == [content(fix) for fix in once.feed(data, 0.0)]
    assert (to.discarded, to.counts) == (once.discarded, once.counts)


@given(st.binary(max_size=400))
def test_any_bytes_are_survived_and_cost_no_later_fix(garbage):
    to = decoder()
    assert to.feed(garbage, 0.0) == []
    assert to.discarded <= len(garbage)
    assert [content(fix) for fix in to.feed(b"\r\n" + STREAM, 0.0)] == whole(STREAM)


FIELDS = st.text(st.sampled_from("0123456789.,-+NSEWTAVM eEnaif_"), max_size=80)
HEADS = st.sampled_from(
    ["GPGGA", "GNRMC", "GPVTG", "GPHDT", "GNGST", "GPZDA", "PASHR", "PASHR,HPR", "PUBX", "GPGSV", "P"]
)


@pytest.mark.thorough
@settings(max_examples=500)
@given(st.lists(st.tuples(HEADS, FIELDS), min_size=1, max_size=6))
def test_any_fields_under_a_right_checksum_are_survived(sentences):
    to = decoder()
    fixes = to.feed(STREAM + b"".join(sealed(f"{head},{fields}") for head, fields in sentences) + STREAM, 0.0)
    assert all(math.isfinite(fix.time + fix.latitude + fix.longitude) for fix in fixes)
    assert all(before.time < after.time for before, after in itertools.pairwise(fixes))
    assert sum(to.counts[one] for one in list(Outcome)[:5]) == to.sentences == 2 * STREAM.count(b"$") + len(sentences)


@settings(max_examples=200)
@given(st.integers(0, 2**32))
def test_one_wrong_byte_costs_its_epoch_and_makes_no_wrong_fix(seed):
    chance = random.Random(seed)
    broken = bytearray(STREAM)
    index = chance.randrange(len(broken))
    broken[index] ^= 1 << chance.randrange(8)
    assert set(whole(bytes(broken))) <= set(whole(STREAM))


def test_a_checksum_is_required_and_must_be_right():
    to = decoder()
    to.feed(gga().replace(b"*", b"*0"), 0.0)
    to.feed(b"$GPHDT,12.0,T\r\n", 0.0)
    assert to.sentences == 0
    assert to.counts[Outcome.WRONG_CHECKSUM] == 1
    assert to.discarded > 10


# --- sentences that lie under a right checksum ------------------------------------------------------------------------


def without(rows: list[tuple[float, bytes]], *lies: tuple[float, bytes]) -> tuple[list[float], list[float]]:
    """Times of the fixes with lies among the sentences, and without."""
    return [fix.time for fix in fed(sorted([*rows, *lies], key=lambda row: row[0]))], [fix.time for fix in fed(rows)]


@pytest.mark.thorough(witnesses=6)
@pytest.mark.parametrize("ahead", [-40_000.0, -1.0, 0.1, 0.25, 12.0, 3600.0, 40_000.0])
@pytest.mark.parametrize("sentence", [gga, gst, rmc, zda, pashr])
def test_one_wrong_time_of_day_costs_no_epoch(sentence, ahead):
    """It comes while no epoch is open; nor does it take the accuracy or the date of the others away."""
    rows = drive(150)
    at = NOON + 10.0 + 0.06
    with_lie, true = without(rows, (at, sentence(NOON + 10.0 + ahead)))
    assert with_lie == true
    fixes = fed(sorted([*rows, (at, sentence(NOON + 10.0 + ahead))], key=lambda row: row[0]))
    assert not any(math.isnan(fix.position_sigma) for fix in fixes[1:])


@pytest.mark.parametrize("date", ["010180", "201126", "221126", "311279"])
def test_one_wrong_date_moves_nothing(date):
    rows = drive(150)
    with_lie, true = without(rows, (NOON + 10.031, rmc(NOON + 10.0, date=date)))
    assert with_lie == true


def test_a_first_date_that_was_wrong_is_corrected_by_the_next_three():
    rows = drive(100)
    rows[0] = (rows[0][0], rmc(NOON - PERIOD, date="221126"))
    rows += [(NOON + k + 0.032, rmc(NOON + k)) for k in range(1, 9)]
    times = [fix.time for fix in fed(sorted(rows, key=lambda row: row[0]))]
    assert times[0] == pytest.approx(MIDNIGHT_GPS + 86_400 + NOON)
    assert times[-1] == pytest.approx(MIDNIGHT_GPS + NOON + 9.9)
    assert len(times) == 100


def test_a_receiver_whose_time_of_day_was_set_forth_is_believed_after_half_a_second():
    moved = [(received, sentence) for received, sentence in drive(50, NOON + 20.0)][2:]
    rows = [*drive(100), *((received - 10.0, sentence) for received, sentence in moved)]
    times = [fix.time - MIDNIGHT_GPS - NOON for fix in fed(rows)]
    assert times[99] == pytest.approx(9.9)
    assert 20.4 < times[100] < 20.7
