"""Which messages came, how often and in which order, by arrivals made by hand and by the decoders."""

from __future__ import annotations

from collections import Counter

import pytest

from tests.pose import nmea_sentences as nmea
from tests.pose.stream_bench import fed, sent
from vve_sumo.pose import novatel, novatel_encoder, sbf, sbf_encoder, ubx, ubx_encoder
from vve_sumo.pose.census import MAX_NAMES, MessageCensus, Needed

NEEDED = (Needed("place", ("A",)), Needed("turn", ("B", "C")), Needed("day", ("D",), every_fix=False))


def census_of(*rows: tuple[float, str], first: tuple[str, ...] = ()) -> MessageCensus:
    census = MessageCensus(NEEDED, first)
    for received, name in rows:
        census.note(name, received)
    return census


@pytest.mark.parametrize("order", ["ABX", "BAX", "XAB", "XBA"])
def test_an_epoch_begins_after_the_longest_pause(order: str) -> None:
    rows = [(0.1 * k + 0.005 * n, name) for k in range(5) for n, name in enumerate(order)]
    assert census_of(*rows).epoch() == tuple(order)


@pytest.mark.parametrize("order", ["ABX", "BAX"])
def test_datagrams_that_hold_whole_epochs_show_the_order_too(order: str) -> None:
    rows = [(0.1 * k, name) for k in range(5) for name in order]
    assert census_of(*rows).epoch() == tuple(order)


def test_a_reader_that_was_busy_does_not_change_the_order() -> None:
    """Of every third epoch the second message is read with the next one's."""
    rows = []
    for k in range(20):
        rows += [(0.1 * k, "A"), (0.1 * k + (0.095 if k % 3 == 1 else 0.002), "B")]
    assert census_of(*rows).epoch() == ("A", "B")


@pytest.mark.parametrize("order", ["ABX", "BAX"])
def test_several_epochs_in_one_portion_show_the_order_too(order: str) -> None:
    rows = [(0.03 * (k // 3), name) for k in range(30) for name in order]
    assert census_of(*rows).epoch() == tuple(order)


def test_there_is_no_epoch_before_a_needed_message_came_twice() -> None:
    assert census_of((0.0, "A"), (0.1, "X"), (0.2, "X")).epoch() == ()


def test_what_is_missing_or_seldom_is_named() -> None:
    census = census_of(*[(0.1 * k, "A") for k in range(10)])
    assert list(census.missing(Counter(A=10), 9.0)) == ["no B or C (turn)", "no D (day)"]
    assert list(census.missing(Counter(A=10, B=4, C=5, D=1), 9.0)) == []
    assert list(census.missing(Counter(A=10, B=2, D=1), 9.0)) == ["B or C (turn) too seldom"]


def test_an_epoch_that_begins_with_a_message_without_a_time_is_named() -> None:
    rows = [(0.1 * k + 0.005 * n, name) for k in range(5) for n, name in enumerate("BAD")]
    counts = Counter(A=5, B=5, D=5)
    (said,) = census_of(*rows, first=("A",)).missing(counts, 1.0)
    assert said == "an epoch begins with B, which carries no time: send A first"
    assert list(census_of(*rows).missing(counts, 1.0)) == []


def test_a_line_of_garbage_makes_no_endless_list_of_names() -> None:
    census = census_of(*[(0.0, str(k)) for k in range(10 * MAX_NAMES)])
    assert len(census.counts) == MAX_NAMES


def test_of_nmea() -> None:
    decoder = nmea.decoder()
    nmea.fed(nmea.drive(20), decoder)
    census = decoder.census
    assert census.epoch() == ("GGA", "GST", "HDT", "VTG")
    assert list(census.missing(census.counts, 18.0)) == []
    other = nmea.decoder()
    rows = [(at, data) for at, data in nmea.drive(20) if b"HDT" not in data and b"GST" not in data]
    nmea.fed(rows, other)
    said = list(other.census.missing(other.census.counts, 18.0))
    assert said == ["no HDT or THS or PASHR (heading)", "no GST (accuracy of the position)"]


@pytest.mark.parametrize("heading", [nmea.hdt(), nmea.ths()])
def test_of_nmea_whose_heading_comes_first(heading: bytes) -> None:
    decoder, rows = nmea.decoder(), []
    for k in range(20):
        first, accuracy, _hdt, velocity = nmea.epoch(nmea.NOON + 0.1 * k)
        rows += [(nmea.NOON + 0.1 * k + 0.005 * n, one) for n, one in enumerate((heading, first, accuracy, velocity))]
    assert nmea.fed([*nmea.drive(1)[:2], *rows], decoder) == []
    said = list(decoder.census.missing(decoder.census.counts, 18.0))
    assert said[-1].startswith(f"an epoch begins with {heading[3:6].decode()}, which carries no time: send GGA or ")


@pytest.mark.parametrize(
    ("make", "encode", "names"),
    [
        (ubx.Decoder, ubx_encoder.Encoder().encode, ("NAV-PVT", "NAV-RELPOSNED")),
        (
            sbf.Decoder,
            sbf_encoder.Encoder().encode,
            ("PVTGeodetic", "PosCovGeodetic", "VelCovGeodetic", "AttEuler", "AttCovEuler"),
        ),
        (novatel.Decoder, novatel_encoder.Encoder().encode, ("BESTPOS", "INSPVAX")),
    ],
)
def test_of_what_the_simulated_receivers_send(make, encode, names) -> None:
    decoder = make()
    fed(decoder, sent(encode, 20))
    assert decoder.census.epoch() == names
    assert list(decoder.census.missing(decoder.census.counts, 20.0)) == []
    assert len(list(decoder.census.missing(Counter(), 1.0))) == len(decoder.census.needed)
