"""UBX: written and read by pyubx2, streams as bad as lines make them, and which heading and time are believed."""

from __future__ import annotations

import datetime
import io
import math
from dataclasses import replace
from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pyubx2 import GET, UBXMessage, UBXReader

from tests.pose.stream_bench import DELAY, FIXES, fed, hold_in_noise, hold_without_delay, sent
from tests.pose.test_trust import EPOCH, drive
from vve_sumo.frames import wrap_angle
from vve_sumo.pose import ubx
from vve_sumo.pose.stream import Outcome
from vve_sumo.pose.trust import UBX, TrustGate
from vve_sumo.pose.ubx_encoder import Encoder, framed
from vve_sumo.values import Fix, FixQuality

#: 2018-05-06 00:00:00 GPS, when week 2000 began, was 23:59:42 UTC of the day before
WEEK_2000 = 2000 * 604_800.0
QUALITIES = {0: FixQuality.SINGLE, 1: FixQuality.RTK_FLOAT, 2: FixQuality.RTK_FIXED}


def pvt(seconds: float, *, leap_seconds: int = 18, **changes: object) -> bytes:
    """NAV-PVT at a GPS time, as pyubx2 writes it."""
    utc = datetime.datetime(1980, 1, 6) + datetime.timedelta(seconds=seconds - leap_seconds)
    fields: dict[str, object] = {
        "iTOW": round(1000 * seconds) % 604_800_000, "year": utc.year, "month": utc.month, "day": utc.day,
        "hour": utc.hour, "min": utc.minute, "second": utc.second, "validDate": 1, "validTime": 1, "fullyResolved": 1,
        "nano": utc.microsecond * 1000, "fixType": 3, "gnssFixOk": 1, "diffSoln": 1, "carrSoln": 2,
        "numSV": 20, "lon": -83.0, "lat": 40.0, "height": 200_000, "hMSL": 233_000, "hAcc": 14, "vAcc": 20,
        "velN": 3000, "velE": 4000, "velD": -100, "gSpeed": 5000, "headMot": 53.13, "sAcc": 40, "headAcc": 0.5,
        "lastCorrectionAge": 2,
    }  # fmt: skip
    return UBXMessage("NAV", "NAV-PVT", GET, **(fields | changes)).serialize()


def relposned(seconds: float, **changes: object) -> bytes:
    """NAV-RELPOSNED of a moving baseline at a GPS time, as pyubx2 writes it."""
    fields: dict[str, object] = {
        "version": 1, "iTOW": round(1000 * seconds) % 604_800_000, "relPosHeading": 60.0, "accHeading": 0.2,
        "relPosLength": 100, "gnssFixOK": 1, "diffSoln": 1, "relPosValid": 1, "carrSoln": 2, "isMoving": 1,
        "relPosHeadingValid": 1,
    }  # fmt: skip
    return UBXMessage("NAV", "NAV-RELPOSNED", GET, **(fields | changes)).serialize()


@settings(deadline=None, max_examples=40)
@given(fix=FIXES)
def test_messages_as_pyubx2_reads_them(fix: Fix) -> None:
    position, baseline = (message for _raw, message in UBXReader(io.BytesIO(Encoder().encode(fix))))
    assert (position.identity, baseline.identity) == ("NAV-PVT", "NAV-RELPOSNED")
    assert position.lat == pytest.approx(math.degrees(fix.latitude), abs=6e-8)
    assert position.lon == pytest.approx(math.degrees(fix.longitude), abs=6e-8)
    assert (position.velN, position.velE) == (round(1e3 * fix.velocity_north), round(1e3 * fix.velocity_east))
    assert position.carrSoln == {FixQuality.RTK_FLOAT: 1, FixQuality.RTK_FIXED: 2}.get(fix.quality, 0)
    utc = datetime.datetime(1980, 1, 6) + datetime.timedelta(milliseconds=round(1e3 * fix.time) - 18_000)
    assert (position.year, position.month, position.day) == (utc.year, utc.month, utc.day)
    assert (position.hour, position.min, position.second) == (utc.hour, utc.minute, utc.second)
    assert position.iTOW == baseline.iTOW
    turn = math.radians(90.0 - baseline.relPosHeading) - fix.heading
    assert abs(wrap_angle(turn)) < 1e-7


@settings(deadline=None, max_examples=40)
@given(
    latitude=st.floats(-89.0, 89.0),
    longitude=st.floats(-179.0, 179.0),
    heading=st.floats(0.0, 359.9),
    speeds=st.tuples(*[st.integers(-60_000, 60_000)] * 3),
    carrier=st.sampled_from([0, 1, 2]),
    milliseconds=st.integers(1_000_000_000_000, 1_640_000_000_000),
)
def test_messages_that_pyubx2_wrote(latitude, longitude, heading, speeds, carrier, milliseconds) -> None:
    seconds, (north, east, down) = 1e-3 * milliseconds, speeds
    position = pvt(
        seconds, lat=latitude, lon=longitude, velN=north, velE=east, velD=down, carrSoln=carrier, diffSoln=carrier > 0
    )
    (fix,) = ubx.Decoder().feed(position + relposned(seconds, relPosHeading=heading), 1.0)
    assert fix.time == pytest.approx(seconds, abs=1e-4)
    assert fix.latitude == pytest.approx(math.radians(latitude), abs=2e-9)
    assert fix.longitude == pytest.approx(math.radians(longitude), abs=2e-9)
    assert (fix.velocity_north, fix.velocity_east, fix.velocity_down) == pytest.approx(
        (north / 1e3, east / 1e3, down / 1e3)
    )
    assert abs(wrap_angle(fix.heading - math.radians(90.0 - heading))) < 2e-7
    assert fix.quality is QUALITIES[carrier]
    assert fix.altitude == pytest.approx(233.0)
    assert (fix.position_sigma, fix.velocity_sigma) == pytest.approx((0.014, 0.040))
    assert fix.heading_sigma == pytest.approx(math.radians(0.2))
    assert fix.differential_age == 2.0


@pytest.mark.parametrize("seed", range(20))
def test_a_bad_line_makes_no_wrong_fix_and_costs_no_whole_one(seed: int) -> None:
    hold_in_noise(ubx.Decoder, Encoder().encode, seed)


def test_what_was_cut_short_delays_no_whole_message_after_it() -> None:
    hold_without_delay(ubx.Decoder, Encoder().encode)


@pytest.mark.parametrize("first", [pvt, relposned])
def test_the_messages_of_one_time_belong_together_in_either_order(first) -> None:
    second = relposned if first is pvt else pvt
    decoder = ubx.Decoder()
    assert decoder.feed(first(WEEK_2000), 0.0) == []
    assert decoder.feed(second(WEEK_2000 + 0.1), 0.1) == [], "of another time"
    (fix,) = decoder.feed(second(WEEK_2000), 0.12)
    assert fix.time == WEEK_2000
    (fix,) = decoder.feed(first(WEEK_2000 + 0.1), 0.13)
    assert fix.time == WEEK_2000 + 0.1


def test_an_epoch_that_lacks_a_message_is_counted_and_no_fix() -> None:
    decoder = ubx.Decoder()
    decoder.feed(pvt(WEEK_2000), 0.0)
    assert len(decoder.feed(pvt(WEEK_2000 + 0.1) + relposned(WEEK_2000 + 0.1), 0.1)) == 1
    assert decoder.counts[Outcome.INCOMPLETE] == 1
    assert decoder.feed(relposned(WEEK_2000), 0.2) == []


@pytest.mark.parametrize("leap_seconds", [17, 18, 19, 25])
def test_the_week_turns_and_leap_seconds_move_nothing(leap_seconds: int) -> None:
    """The date is that of UTC, which is in the old week for as many seconds after the turn."""
    decoder, times = ubx.Decoder(), [WEEK_2000 + k for k in range(-30, 30)]
    rows = [(t - WEEK_2000, pvt(t, leap_seconds=leap_seconds) + relposned(t)) for t in times]
    fixes = fed(decoder, rows)
    assert [fix.time for fix in fixes] == pytest.approx(times, abs=1e-4)


def test_a_leap_second_itself_is_a_time_like_any_other() -> None:
    seconds = 1_167_264_017.0  # 2016-12-31 23:59:60 UTC
    late = pvt(seconds, leap_seconds=17, year=2016, month=12, day=31, hour=23, min=59, second=60)
    (fix,) = ubx.Decoder().feed(late + relposned(seconds), 0.0)
    assert fix.time == seconds


@pytest.mark.parametrize(
    ("changes", "outcome"),
    [
        ({"validDate": 0}, Outcome.NO_TIME),
        ({"validTime": 0}, Outcome.NO_TIME),
        ({"month": 13}, Outcome.MALFORMED),
        ({"iTOW": 604_800_000}, Outcome.MALFORMED),
        ({"fixType": 0}, Outcome.NO_POSITION),
        ({"fixType": 5}, Outcome.NO_POSITION),
        ({"invalidLlh": 1}, Outcome.NO_POSITION),
    ],
)
def test_what_is_no_fix(changes: dict[str, int], outcome: Outcome) -> None:
    decoder = ubx.Decoder()
    assert decoder.feed(pvt(WEEK_2000, **changes) + relposned(WEEK_2000), 0.0) == []
    assert decoder.counts[outcome] == 1


@pytest.mark.parametrize("changes", [{"carrSoln": 1}, {"carrSoln": 0}, {"relPosValid": 0}, {"relPosHeadingValid": 0}])
def test_a_baseline_that_is_not_fixed_or_not_valid_gives_no_heading(changes: dict[str, int]) -> None:
    (fix,) = ubx.Decoder().feed(pvt(WEEK_2000) + relposned(WEEK_2000, **changes), 0.0)
    assert math.isnan(fix.heading)
    assert "heading_invalid" in TrustGate(UBX, WEEK_2000).step(0.0, fix).reasons


def test_the_direction_from_a_base_station_is_no_heading() -> None:
    """An RTK rover's NAV-RELPOSNED, without a moving base, is valid and says where the car lies, not how it points."""
    decoder = ubx.Decoder()
    assert decoder.feed(pvt(WEEK_2000) + relposned(WEEK_2000, isMoving=0), 0.0) == []
    assert ubx.OF_STILL_BASE in decoder.census.counts


def test_the_course_is_no_heading_and_that_of_the_vehicle_counts_where_there_is_no_baseline() -> None:
    decoder = ubx.Decoder()
    assert decoder.feed(pvt(WEEK_2000), 0.0) == []
    (fix,) = decoder.feed(pvt(WEEK_2000 + 0.1, headVehValid=1, headVeh=30.0, fixType=4), 0.1)
    assert fix.heading == pytest.approx(math.radians(60.0))
    assert fix.heading_sigma == pytest.approx(math.radians(0.5), abs=2e-7)
    both = pvt(WEEK_2000 + 0.2, headVehValid=1, headVeh=30.0) + relposned(WEEK_2000 + 0.2)
    assert len(decoder.feed(both, 0.2)) == 1, "as it had none until now"
    (fix,) = decoder.feed(pvt(WEEK_2000 + 0.3, headVehValid=1, headVeh=30.0) + relposned(WEEK_2000 + 0.3), 0.3)
    assert fix.heading == pytest.approx(math.radians(30.0))


@pytest.mark.parametrize(
    ("fix_type", "ok", "carrier", "differential", "locked", "quality"),
    [
        (3, 1, 2, 1, True, FixQuality.RTK_FIXED),
        (3, 0, 2, 1, False, FixQuality.RTK_FIXED),
        (3, 1, 1, 1, True, FixQuality.RTK_FLOAT),
        (3, 1, 0, 1, True, FixQuality.DIFFERENTIAL),
        (3, 1, 0, 0, True, FixQuality.SINGLE),
        (2, 1, 2, 1, False, FixQuality.DIFFERENTIAL),
        (3, 1, 3, 1, True, FixQuality.UNKNOWN),
    ],
)
def test_types_of_fix(fix_type, ok, carrier, differential, locked, quality) -> None:
    message = pvt(WEEK_2000, fixType=fix_type, gnssFixOk=ok, carrSoln=carrier, diffSoln=differential)
    (fix,) = ubx.Decoder().feed(message + relposned(WEEK_2000), 0.0)
    assert (fix.locked, fix.quality) == (locked, quality)


@pytest.mark.parametrize(("code", "age"), [(1, 1.0), (3, 5.0), (4, 10.0), (5, 15.0), (11, 120.0), (15, 120.0)])
def test_corrections_are_as_old_as_their_class_allows(code: int, age: float) -> None:
    (fix,) = ubx.Decoder().feed(pvt(WEEK_2000, lastCorrectionAge=code) + relposned(WEEK_2000), 0.0)
    assert fix.differential_age == age
    assert ("corrections_old" in TrustGate(UBX, WEEK_2000).step(0.0, fix).reasons) == (age > 10.0)


def test_rates_are_differences_as_of_nmea() -> None:
    """At 0.2 rad/s and 1 m/s2."""
    fixes = []
    decoder = ubx.Decoder()
    for k in range(60):
        t = 0.05 * k
        speed, compass = 5.0 + t, (60.0 - math.degrees(0.2 * t)) % 360.0
        north, east = (round(1e3 * speed * of(math.radians(compass))) for of in (math.cos, math.sin))
        data = pvt(WEEK_2000 + t, velN=north, velE=east) + relposned(WEEK_2000 + t, relPosHeading=compass)
        fixes += decoder.feed(data, t)
    assert math.isnan(fixes[0].yaw_rate)
    assert math.isnan(fixes[0].acceleration)
    assert [fix.yaw_rate for fix in fixes[1:]] == pytest.approx([0.2] * 59, abs=1e-4)
    assert [fix.acceleration for fix in fixes[1:]] == pytest.approx([1.0] * 59, abs=0.03)


def test_other_messages_and_formats_between_are_passed_over() -> None:
    other = UBXMessage("NAV", "NAV-DOP", GET, iTOW=1000, gDOP=1.0).serialize()
    rows = [(at, b"$GNGGA,1,2*00\r\n" + other + data + other) for at, data in sent(Encoder().encode, 30)]
    decoder = ubx.Decoder()
    fixes = fed(decoder, rows)
    assert [fix.time for fix in fixes] == pytest.approx([fix.time for fix in drive(30)], abs=1e-3)
    assert all(b.time > a.time for a, b in pairwise(fixes))
    assert fixes[0].time_received == pytest.approx(drive(1)[0].time - EPOCH + DELAY)
    assert decoder.counts[Outcome.OTHER] == 60
    assert decoder.census.epoch() == ("0x01 0x04", "NAV-PVT", "NAV-RELPOSNED", "0x01 0x04")


def test_a_receiver_of_two_versions_ago_is_not_read() -> None:
    """Version 0 of NAV-RELPOSNED, of 40 bytes, has no heading."""
    decoder = ubx.Decoder()
    payload = relposned(WEEK_2000)[6:46]
    assert decoder.feed(pvt(WEEK_2000) + framed(ubx.RELPOSNED, payload), 0.0) == []
    assert decoder.counts[Outcome.READ] == 1


def test_a_time_that_is_not_newer_gives_no_fix() -> None:
    decoder = ubx.Decoder()
    data = pvt(WEEK_2000) + relposned(WEEK_2000)
    assert len(decoder.feed(data, 0.0)) == 1
    assert decoder.feed(data, 0.01) == []
    assert decoder.counts[Outcome.NOT_INCREASING] == 1


def test_a_fix_worth_nothing_says_so() -> None:
    for change in ({"latitude": math.nan}, {"quality": FixQuality.NONE}, {"locked": False}):
        position, _baseline = UBXReader(io.BytesIO(Encoder().encode(replace(drive(1)[0], **change))))
        assert position[1].gnssFixOk == 0


@pytest.mark.parametrize("lag", [0, 1])
def test_two_receivers_that_both_send_a_position_lock_no_fix(lag: int) -> None:
    """Moving base and rover both send NAV-PVT, the rover a metre ahead, at once or an epoch later."""
    decoder, fixes = ubx.Decoder(), []
    for k in range(10):
        t, late = WEEK_2000 + 0.1 * k, WEEK_2000 + 0.1 * (k - lag)
        fixes += decoder.feed(pvt(t) + pvt(late, lat=40.00001) + relposned(late), 0.1 * k)
    assert [fix.locked for fix in fixes[2:]] == [False] * len(fixes[2:])
    assert len(fixes) >= 9
    assert decoder.census.counts[ubx.SECOND_NAME] == 10 - lag


def test_a_message_that_comes_twice_is_no_second_receiver() -> None:
    decoder, fixes = ubx.Decoder(), []
    for k in range(10):
        fixes += decoder.feed(2 * pvt(WEEK_2000 + 0.1 * k) + relposned(WEEK_2000 + 0.1 * k), 0.1 * k)
    assert [fix.locked for fix in fixes] == [True] * 10


def test_a_receiver_without_a_fix_may_set_its_clock_back() -> None:
    decoder, fixes = ubx.Decoder(), []
    for k in (0, 1, 2, 1, 2, 3):
        decoder.feed(pvt(WEEK_2000 + 0.1 * k, gnssFixOk=0, fixType=0, tAcc=k), 0.1 * k)
    for k in range(4, 8):
        fixes += decoder.feed(pvt(WEEK_2000 + 0.1 * k) + relposned(WEEK_2000 + 0.1 * k), 0.1 * k)
    assert [fix.locked for fix in fixes] == [True] * 4
