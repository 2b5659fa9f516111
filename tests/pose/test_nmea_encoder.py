"""NMEA sentences: read by pynmea2, and by our own decoder, which was tested on recordings of receivers."""

from __future__ import annotations

import math
from dataclasses import replace

import pynmea2
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.fixes import GOOD
from tests.vehicles import FUSION
from vve_sumo.frames import wrap_angle
from vve_sumo.pose import nmea_encoder as nmea
from vve_sumo.pose.nmea import Decoder
from vve_sumo.values import Fix, FixQuality
from vve_sumo.wire.outputs import KINDS, Context
from vve_sumo.wire.sample import Sample

BEGIN = 1_400_000_000.0  # [s] of GPS time
QUALITIES = st.sampled_from([FixQuality.SINGLE, FixQuality.DIFFERENTIAL, FixQuality.RTK_FLOAT, FixQuality.RTK_FIXED])

DRIVING = replace(
    GOOD,
    latitude=math.radians(40.0),
    longitude=math.radians(-83.0),
    heading=0.3,
    velocity_north=3.0,
    velocity_east=4.0,
)


def _fix(time: float, **other: object) -> Fix:
    return replace(DRIVING, time=time, time_received=time, **other)  # type: ignore[arg-type]


FIXES = st.builds(
    lambda cents, latitude, longitude, heading, north, east, quality: _fix(
        BEGIN + cents / 100.0,
        latitude=latitude,
        longitude=longitude,
        heading=heading,
        velocity_north=north,
        velocity_east=east,
        quality=quality,
    ),
    st.integers(0, 100_000_000),
    st.floats(-1.5, 1.5),
    st.floats(-math.pi, math.pi),
    st.floats(-math.pi, math.pi),
    st.floats(-50.0, 50.0),
    st.floats(-50.0, 50.0),
    QUALITIES,
)


@given(fix=FIXES)
def test_sentences_as_pynmea2_reads_them(fix: Fix) -> None:
    lines = nmea.encode(fix).decode("ascii").splitlines()
    read = {sentence.sentence_type: sentence for sentence in (pynmea2.parse(line, check=True) for line in lines)}
    assert read["GGA"].gps_qual == nmea.QUALITIES[fix.quality]
    for type_ in ("GGA", "RMC"):
        assert read[type_].latitude == pytest.approx(math.degrees(fix.latitude), abs=2e-10)
        assert read[type_].longitude == pytest.approx(math.degrees(fix.longitude), abs=2e-10)
    speed = math.hypot(fix.velocity_north, fix.velocity_east)
    assert float(read["RMC"].spd_over_grnd) * nmea.KNOT == pytest.approx(speed, abs=1e-4)
    assert float(read["VTG"].spd_over_grnd_kmph) == pytest.approx(3.6 * speed, abs=1e-3)
    turn = math.radians(float(read["HDT"].heading)) - (math.pi / 2.0 - fix.heading)
    assert abs(wrap_angle(turn)) < 2e-5
    assert float(read["GST"].std_dev_latitude) == pytest.approx(fix.position_sigma)


@given(fix=FIXES)
def test_our_decoder_gives_the_fix_back(fix: Fix) -> None:
    decoder = Decoder()
    fixes = [
        found
        for step in range(3)
        for found in decoder.feed(nmea.encode(replace(fix, time=fix.time + 0.1 * step)), 100.0 + 0.1 * step)
    ]
    assert fixes
    back = fixes[-1]
    assert min(abs(back.time - fix.time - 0.1 * step) for step in range(3)) < 0.00051
    assert back.latitude == pytest.approx(fix.latitude, abs=1e-11)
    assert back.longitude == pytest.approx(fix.longitude, abs=1e-11)
    assert back.velocity_north == pytest.approx(fix.velocity_north, abs=2e-3)
    assert back.velocity_east == pytest.approx(fix.velocity_east, abs=2e-3)
    assert abs(wrap_angle(back.heading - fix.heading)) < 2e-5
    assert back.quality is fix.quality


@pytest.mark.parametrize("lost", [{"locked": False}, {"quality": FixQuality.NONE}, {"latitude": math.nan}])
def test_a_fix_that_is_worth_nothing_says_so_and_shows_no_place(lost: dict[str, object]) -> None:
    lines = nmea.encode(_fix(BEGIN, **lost)).decode("ascii").splitlines()
    read = {sentence.sentence_type: sentence for sentence in (pynmea2.parse(line, check=True) for line in lines)}
    assert read["GGA"].gps_qual == 0
    assert read["RMC"].status == "V"
    assert not any((read["GGA"].lat, read["GGA"].lon, read["RMC"].lat, read["RMC"].lon, read["HDT"].heading))


@pytest.mark.parametrize("begin", [BEGIN, BEGIN + 0.037, BEGIN + 0.999])
def test_the_date_is_sent_with_the_first_fix_of_every_second(begin: float) -> None:
    """A live drive begins at any fraction of a GNSS second."""
    output = KINDS["nmea"].make(Context(FUSION.vehicle, ""))
    heard = b"".join(
        portion
        for tick in range(250)
        for portion in output.step(Sample(tick, begin + 0.02 * tick, 0.02 * tick, None))
        if isinstance(portion, bytes)
    )
    read = [pynmea2.parse(line, check=True) for line in heard.decode("ascii").splitlines()]
    fixes = [sentence.timestamp.replace(microsecond=0) for sentence in read if sentence.sentence_type == "GGA"]
    dates = [sentence for sentence in read if sentence.sentence_type == "ZDA"]
    assert len(fixes) == 50
    assert [sentence.timestamp.replace(microsecond=0) for sentence in dates] == sorted(set(fixes))
    assert {(sentence.day, sentence.month, sentence.year) for sentence in dates} == {(17, 5, 2024)}


def test_a_receiver_of_ths_is_heard_as_one_of_hdt() -> None:
    """pynmea2 does not know the sentence: its fields are read here by the standard's order."""
    heard, plain = (Decoder(velocity_sigma=0.05, heading_sigma=0.004) for _ in range(2))
    encoder, other = nmea.Encoder(heading_status=True), nmea.Encoder()
    for step in range(3):
        fix = _fix(BEGIN + 0.1 * step)
        lines = encoder.encode(fix)
        (sentence,) = (line for line in lines.splitlines() if line.startswith(b"$GPTHS"))
        assert b"HDT" not in lines
        heading, status = sentence.partition(b"*")[0].split(b",")[1:]
        assert float(heading) == pytest.approx(90.0 - math.degrees(fix.heading), abs=6e-4)
        assert status == b"A"
        assert repr(heard.feed(lines, 0.1 * step)) == repr(plain.feed(other.encode(fix), 0.1 * step))
    assert b"$GPTHS,,V*" in encoder.encode(_fix(BEGIN + 1.0, heading=math.nan))
