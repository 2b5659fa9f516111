"""NCOM packets that lie under right checksums: one wrong minute or date displaces no true packet."""

from __future__ import annotations

import struct

import pytest

from tests.pose.ncom_packets import START, arrived, drive, fix_at, lie, minute_channel, sealed
from vve_sumo.pose.ncom import Decoder, Outcome, pack


@pytest.mark.parametrize("minutes", [-1000, -1, 1, 2, 31, 100_000])
def test_one_wrong_minute_costs_its_packet_and_no_other(minutes):
    rows = drive(5.0)
    rows[200] = (rows[200][0], lie(START + 2.0, minutes, channel=0))
    decoder = Decoder()
    times = [fix.time - START for fix in arrived(rows, decoder)]
    assert times == pytest.approx([0.01 * k for k in range(500) if k != 200], abs=1e-6)
    assert decoder.counts[Outcome.MINUTE_DOUBTED] == 1


def with_minute(packet: bytes, low: int, high: int) -> bytes:
    """The packet with the two lower bytes of the minute in its channel 0 replaced, under right sums."""
    assert packet[62] == 0
    return sealed(packet[:63] + bytes((low, high)) + packet[65:])


@pytest.fixture(scope="module")
def ten_minutes() -> list[tuple[float, bytes]]:
    return drive(600.0)


@pytest.mark.thorough
@pytest.mark.parametrize(("low", "high", "days"), [(0xFF, 0xFF, 17.9), (0x00, 0x00, -27.6)])
def test_two_wrong_bytes_of_one_minute_cost_one_fix_of_sixty_thousand(ten_minutes, low, high, days):
    rows = list(ten_minutes)
    received, packet = rows[1000]
    rows[1000] = (received, with_minute(packet, low, high))
    true, forged = (int.from_bytes(p[63:67], "little") for p in (packet, rows[1000][1]))
    assert (forged - true) / 1440.0 == pytest.approx(days, abs=0.05)
    decoder = Decoder()
    times = [round((fix.time - START) * 1000.0) for fix in arrived(rows, decoder)]
    assert times == [10 * k for k in range(60_000) if k != 1000]
    assert decoder.counts[Outcome.MINUTE_DOUBTED] == 1


@pytest.mark.parametrize(("low", "high"), [(0xFF, 0xFF), (0x00, 0x00)])
def test_a_first_minute_that_is_wrong_is_put_right_by_the_third_that_contradicts_it(low, high):
    """Nothing speaks against it before; a channel 0 comes every 0.2 s here."""
    rows = drive(5.0)
    rows[0] = (rows[0][0], with_minute(rows[0][1], low, high))
    true = [fix for fix in arrived(rows) if abs(fix.time - START) < 10.0]
    assert [fix.time - START for fix in true] == pytest.approx([0.01 * k for k in range(60, 500)], abs=1e-6)


@pytest.mark.parametrize("ahead", [-20.0, -1.0, 0.01, 0.05, 0.9, 12.0, 29.0])
@pytest.mark.parametrize("channel", [0, 3, 16])
def test_one_packet_that_is_dated_wrongly_displaces_no_other(ahead, channel):
    """It comes between two true ones; nor do the accuracies that travel in it outlive it."""
    truth = START + 10.0
    rows = drive(15.0)
    payload = minute_channel(truth + ahead) if channel == 0 else struct.pack("<HHHBB", 11, 17, 99, 0, 0)
    wrong = (10.0, pack(fix_at(truth + ahead, latitude=0.7), channel, payload))
    decoder = Decoder()
    fixes = arrived(sorted([*rows, wrong]), decoder)
    assert [fix.time - START for fix in fixes] == pytest.approx([0.01 * k for k in range(1500)], abs=1e-6)
    assert {fix.latitude for fix in fixes} == {0.6983}
    assert decoder.counts[Outcome.AHEAD] + decoder.counts[Outcome.NOT_INCREASING] == 1


def test_a_stream_that_is_dated_10_ms_ahead_displaces_no_true_packet():
    """Whoever forges it is a little faster than the truth, packet by packet."""
    true = drive(20.0)
    forged = [(k * 0.01 + 0.004, lie(START + 0.01 * (k + 1))) for k in range(1000, 2000)]
    decoder = Decoder()
    fixes = arrived(sorted([*true, *forged]), decoder)
    assert [fix.time - START for fix in fixes] == pytest.approx([0.01 * k for k in range(2000)], abs=1e-6)
    assert decoder.counts[Outcome.AHEAD] == 1000


def test_a_unit_whose_clock_is_set_forth_is_believed_after_half_a_second():
    moved = [(received + 10.0, packet) for received, packet in drive(5.0, START + 17.0)]
    decoder = Decoder()
    times = [fix.time - START for fix in arrived([*drive(10.0), *moved], decoder)]
    assert times[:1000] == pytest.approx([0.01 * k for k in range(1000)], abs=1e-6)
    assert times[1000] == pytest.approx(17.5, abs=0.011)
    assert times[1000:] == pytest.approx([17.0 + 0.01 * k for k in range(50, 500)], abs=1e-6)


def test_a_path_that_becomes_faster_costs_two_packets():
    rows = [(received - (0.03 if received > 5.0 else 0.0), packet) for received, packet in drive(10.0)]
    assert len(arrived(rows)) == 998
