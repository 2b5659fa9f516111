"""NCOM: how the decoder finds the minute, and keeps it through gaps, wraps and packets out of order."""

from __future__ import annotations

import math
import struct

import pytest

from tests.pose.ncom_packets import (
    NOTHING,
    PACKETS,
    START,
    arrived,
    decoded,
    fix_at,
    lie,
    minute_channel,
    sealed,
    stream,
)
from vve_sumo.pose.ncom import Decoder, Outcome, pack
from vve_sumo.values import FixQuality


def test_no_fix_before_the_minute_is_known():
    packets = stream(8)
    decoder = Decoder()
    assert decoder.feed(b"".join(packets[1:6]), 0.0) == []
    assert decoder.counts[Outcome.MINUTE_UNKNOWN] == 5
    assert [fix.time for fix in decoder.feed(packets[6] + packets[7], 0.0)] == [START + 0.06, START + 0.07]


def test_minute_not_set_is_not_a_minute():
    packet = pack(fix_at(START), 0, struct.pack("<iBBBB", 999, 12, 6, 6, 6))
    assert decoded(packet) == []


@pytest.mark.parametrize("lost", [0, 3, 100, 1500])
def test_minute_wraps_without_status_channel_0(lost):
    first = pack(fix_at(START + 59.5), 0, minute_channel(START))
    times = [START + 59.5 + 0.01 * k for k in range(lost + 1, lost + 200)]
    rest = [(time - START, pack(fix_at(time), 16, NOTHING)) for time in times]
    assert [fix.time for fix in arrived([(59.5, first), *rest])][1:] == pytest.approx(times, abs=1e-6)


@pytest.mark.parametrize(("lost", "missed"), [(3, 0), (90, 0), (100, 2), (1500, 2)])
def test_after_a_long_gap_in_a_file_the_first_two_packets_are_lost(lost, missed):
    """A file says nothing of arrivals, so a jump could be a lie until a third packet agrees."""
    times = [START, *(START + 0.01 * k for k in range(lost + 1, lost + 200))]
    data = b"".join(pack(fix_at(time), 0, minute_channel(time)) for time in times)
    assert [fix.time for fix in decoded(data)] == pytest.approx([times[0], *times[1 + missed :]], abs=1e-6)


def test_late_packets_about_the_wrap_do_not_add_a_minute():
    order = (59.98, 59.99, 60.01, 60.00, 60.02, 59.97, 60.03, 62.005, 61.995, 62.015)
    packets = [(max(order[: k + 1]), pack(fix_at(START + t), 16, NOTHING)) for k, t in enumerate(order)]
    packets[0] = (59.98, pack(fix_at(START + 59.98), 0, minute_channel(START)))
    decoder = Decoder()
    times = [fix.time - START for fix in arrived(packets, decoder)]
    assert times == pytest.approx([59.98, 59.99, 60.01, 60.02, 60.03, 62.005, 62.015], abs=1e-6)
    assert decoder.counts[Outcome.NOT_INCREASING] == 3


@pytest.mark.parametrize(("said", "needed"), [(1, 3), (2, 4), (50, 12)])
@pytest.mark.parametrize("moved", [125.0, -3600.0])
def test_a_minute_is_set_anew_where_enough_channels_0_agree(moved, said, needed):
    """The first of all may have been the lie; one that was said often takes longer to be doubted."""
    decoder = Decoder()
    for begin, offset, missed, count in ((0.0, 0.0, 0, said), (1.0, moved, needed - 1, 20)):
        times = [begin + 0.01 * k for k in range(count)]
        packets = [(t, lie(START + t + offset, channel=0)) for t in times]
        believed = [START + t + offset for t in times][missed:]
        assert [fix.time for fix in arrived(packets, decoder)] == pytest.approx(believed, abs=1e-6)
    assert decoder.counts[Outcome.MINUTE_DOUBTED] == needed - 1


def test_a_silence_longer_than_a_minute_is_dated_by_the_receiving_clock():
    """Garbage is no sign of the unit's clock: 65 s of it are a silence as well."""
    decoder = Decoder()
    decoder.feed(pack(fix_at(START), 0, minute_channel(START)), 0.0)
    for k in range(65):
        decoder.feed(b"x" * 50, float(k))
    assert decoder.feed(pack(fix_at(START + 65.0), 16, NOTHING), 65.0) == []
    (fix,) = decoder.feed(pack(fix_at(START + 65.01), 0, minute_channel(START + 65.0)), 65.01)
    assert fix.time == START + 65.01


def test_long_silence_forgets_the_minute_until_channel_0_comes_again():
    decoder = Decoder()
    assert len(decoder.feed(pack(fix_at(START), 0, minute_channel(START)), 0.0)) == 1
    later = START + 65.0  # on the packet's own clock this looks like 5 s
    assert decoder.feed(pack(fix_at(later), 16, NOTHING), 65.0) == []
    (fix,) = decoder.feed(pack(fix_at(later + 0.01), 0, minute_channel(later)), 65.01)
    assert fix.time == later + 0.01


def test_a_stream_in_which_packets_overtake_each_other_keeps_its_qualities():
    """Each pair turned round, for longer than a status channel is believed: half of them travel in late packets."""
    packets = stream(1000)
    turned = [packet for pair in zip(packets[1::2], packets[::2], strict=True) for packet in pair]
    fixes = decoded(b"".join(turned))
    straight = decoded(b"".join(packets))
    qualities = ("quality", "position_sigma", "velocity_sigma", "heading_sigma", "differential_age")
    assert len(fixes) == pytest.approx(500, abs=10)
    assert [getattr(fixes[-1], name) for name in qualities] == [getattr(straight[-1], name) for name in qualities]
    assert not any(math.isnan(getattr(fixes[-1], name)) for name in qualities[1:])
    assert fixes[-1].quality is FixQuality.RTK_FIXED


def test_duplicates_are_reported_and_not_emitted():
    packets = stream(12)
    decoder = Decoder()
    assert len(decoder.feed(b"".join(packets + packets), 0.0)) == 12
    assert decoder.counts[Outcome.NOT_INCREASING] == 12


def test_milliseconds_beyond_the_minute_are_refused():
    packet = bytearray(pack(fix_at(START), 0, minute_channel(START)))
    packet[1:3] = (60_000).to_bytes(2, "little")
    decoder = Decoder()
    assert decoder.feed(sealed(bytes(packet)), 0.0) == []
    assert decoder.counts[Outcome.NO_TIME] == 1


def test_received_time_is_the_caller_s():
    (fix,) = Decoder().feed(PACKETS[0], 12.5)
    assert fix.time_received == 12.5
