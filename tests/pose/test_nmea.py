"""NMEA decoder: sentences built by pynmea2 and by hand, real receivers' own, and streams as bad as lines make them."""

from __future__ import annotations

import datetime
import itertools
import math
import random

import pynmea2
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vve_sumo.pose.nmea import Decoder, Outcome
from vve_sumo.pose.trust import DRIVE, NMEA, TrustGate
from vve_sumo.values import Fix, FixQuality

MIDNIGHT = datetime.datetime(2026, 11, 21, tzinfo=datetime.UTC)
#: 2026-11-21 00:00:00 UTC in GPS seconds: 17121 days since 1980-01-06, and 18 leap seconds
MIDNIGHT_GPS = 17_121 * 86_400 + 18
NOON = 12 * 3600.0
PERIOD = 0.1


def sealed(body: str) -> bytes:
    """The sentence of `body`, with the checksum by its definition: exclusive or of what is between $ and *."""
    checksum = 0
    for byte in body.encode():
        checksum ^= byte
    return f"${body}*{checksum:02X}\r\n".encode()


def clock_text(seconds: float) -> str:
    time = MIDNIGHT + datetime.timedelta(seconds=round(seconds, 3))
    return time.strftime("%H%M%S.") + f"{time.microsecond // 10_000:02d}"


def gga(seconds=NOON, latitude=39.99805, longitude=-82.98321, quality=4, age="1.2") -> bytes:
    def degrees_minutes(angle: float, digits: int) -> str:
        whole = int(abs(angle))
        return f"{whole:0{digits}d}{(abs(angle) - whole) * 60:010.7f}"

    fields = (clock_text(seconds), degrees_minutes(latitude, 2), "N" if latitude >= 0 else "S")
    fields += (degrees_minutes(longitude, 3), "E" if longitude >= 0 else "W", str(quality))
    return f"{pynmea2.GGA('GP', 'GGA', (*fields, '14', '0.7', '231.4', 'M', '-33.9', 'M', age, '0001'))}\r\n".encode()


def gst(seconds=NOON, latitude="0.011", longitude="0.014") -> bytes:
    fields = (clock_text(seconds), "1.1", "0.01", "0.01", "12.0", latitude, longitude, "0.02")
    return f"{pynmea2.GST('GP', 'GST', fields)}\r\n".encode()


def hdt(compass=65.0) -> bytes:
    return f"{pynmea2.HDT('GP', 'HDT', (f'{compass % 360:.3f}', 'T'))}\r\n".encode()


def vtg(course: float | None = 65.0, speed=10.0) -> bytes:
    track = "" if course is None else f"{course % 360:.3f}"
    fields = (track, "T", "", "M", f"{speed * 3600 / 1852:.4f}", "N", f"{speed * 3.6:.4f}", "K", "R")
    return f"{pynmea2.VTG('GP', 'VTG', fields)}\r\n".encode()


def rmc(seconds=NOON, course=65.0, speed=10.0, status="A", date: str | None = None) -> bytes:
    day = date or (MIDNIGHT + datetime.timedelta(seconds=seconds)).strftime("%d%m%y")
    head = f"GNRMC,{clock_text(seconds)},{status},3959.8830,N,08258.9926,W"
    return sealed(f"{head},{speed * 3600 / 1852:.4f},{course:.3f},{day},,,R,V")


def zda(seconds=NOON) -> bytes:
    day = MIDNIGHT + datetime.timedelta(seconds=seconds)
    return sealed(f"GPZDA,{clock_text(seconds)},{day:%d},{day:%m},{day:%Y},00,00")


def pashr(seconds=NOON, compass=65.0, pitch=1.5, roll=-0.4, sigma=0.08, quality=2) -> bytes:
    body = f"PASHR,{clock_text(seconds)}0,{compass % 360:.2f},T,{roll:+.2f},{pitch:+.2f},+0.00"
    return sealed(f"{body},0.020,0.020,{sigma:.3f},{quality},1")


def epoch(seconds: float, **changes) -> list[bytes]:
    """What a receiver sends for one time, along an easterly road at 10 m/s."""
    moved = (seconds - NOON) * 10.0 * math.sin(math.radians(65.0)) / (111_195.0 * math.cos(math.radians(39.99805)))
    north = (seconds - NOON) * 10.0 * math.cos(math.radians(65.0)) / 111_195.0
    where = {"latitude": 39.99805 + north, "longitude": -82.98321 + moved} | changes
    return [gga(seconds, **where), gst(seconds), hdt(), vtg()]


def drive(count: int, start: float = NOON) -> list[tuple[float, bytes]]:
    """Rows of arrival and sentence, 30 ms on the wire for each epoch."""
    rows = [(start - PERIOD, rmc(start - PERIOD)), (start - PERIOD, gga(start - PERIOD))]
    for k in range(count):
        seconds = start + k * PERIOD
        rows += [(seconds + 0.01 * n, sentence) for n, sentence in enumerate(epoch(seconds))]
    return rows


def decoder() -> Decoder:
    return Decoder(velocity_sigma=0.05, heading_sigma=0.004)


def fed(rows, to: Decoder | None = None) -> list[Fix]:
    to = to or decoder()
    return [fix for received, data in rows for fix in to.feed(data, received)]


# --- what is read -----------------------------------------------------------------------------------------------------


def test_an_epoch_becomes_a_fix_with_all_that_nmea_says():
    *_, fix = fed(drive(3))
    assert fix.time == pytest.approx(MIDNIGHT_GPS + NOON + 0.2, abs=1e-9)
    assert fix.time_received == pytest.approx(NOON + 0.2 + 0.03)
    assert math.degrees(fix.latitude) == pytest.approx(39.99805 + 2 * math.cos(math.radians(65)) / 111_195, abs=2e-9)
    assert math.degrees(fix.longitude) < -82.98321 + 3e-5
    assert fix.altitude == 231.4
    assert math.degrees(fix.heading) == pytest.approx(25.0)
    assert fix.velocity_north == pytest.approx(10 * math.cos(math.radians(65)), abs=1e-3)
    assert fix.velocity_east == pytest.approx(10 * math.sin(math.radians(65)), abs=1e-3)
    assert (fix.locked, fix.quality) == (True, FixQuality.RTK_FIXED)
    assert (fix.position_sigma, fix.velocity_sigma, fix.heading_sigma) == (0.014, 0.05, 0.004)
    assert fix.differential_age == 1.2
    assert fix.yaw_rate == pytest.approx(0.0, abs=1e-9)
    assert fix.acceleration == pytest.approx(0.0, abs=1e-2)
    assert math.isnan(fix.pitch)
    assert math.isnan(fix.velocity_down)


def test_known_seconds_of_gps_time():
    """GPS week 2000 began on 2018-05-06 at 00:00:00 GPS, 23:59:42 UTC of the day before."""
    before = sealed("GNRMC,235941.90,A,3959.8830,N,08258.9926,W,0.0,,050518,,,R,V")
    sentences = (before, *(sealed(f"GPGGA,235942.00,{POSITION}"), hdt(), vtg()))
    assert [fix.time for fix in fed((0.01 * k, one) for k, one in enumerate(sentences))] == [2000 * 604_800]


POSITION = "3959.8830000,N,08258.9926000,W,4,14,0.7,231.4,M,-33.9,M,1.0,0001"


@pytest.mark.parametrize(("latitude", "longitude"), [(-33.865, 151.21), (51.5, -0.001), (-0.5, -70.0), (0.5, 0.25)])
def test_hemispheres(latitude, longitude):
    rows = drive(1)[:2]
    rows += [(NOON + 0.01 * n, one) for n, one in enumerate(epoch(NOON, latitude=latitude, longitude=longitude))]
    (fix,) = fed(rows)
    assert math.degrees(fix.latitude) == pytest.approx(latitude, abs=1e-8)
    assert math.degrees(fix.longitude) == pytest.approx(longitude, abs=1e-8)


@pytest.mark.parametrize(
    ("said", "quality"),
    [
        (1, FixQuality.SINGLE),
        (2, FixQuality.DIFFERENTIAL),
        (3, FixQuality.UNKNOWN),
        (4, FixQuality.RTK_FIXED),
        (5, FixQuality.RTK_FLOAT),
        (6, FixQuality.UNKNOWN),
        (7, FixQuality.UNKNOWN),
        (8, FixQuality.UNKNOWN),
    ],
)
def test_a_receiver_that_says_a_known_quality_is_in_real_time(said, quality):
    (fix,) = fed([*drive(1)[:2], *((NOON, one) for one in epoch(NOON, quality=said))])
    assert (fix.quality, fix.locked) == (quality, quality is not FixQuality.UNKNOWN)


def test_rmc_alone_gives_velocity_and_date():
    to = decoder()
    rows = [(NOON + k * PERIOD, rmc(NOON + k * PERIOD) + gga(NOON + k * PERIOD) + hdt()) for k in range(3)]
    fixes = fed(rows, to)
    assert len(fixes) == 3
    assert fixes[-1].velocity_east == pytest.approx(10 * math.sin(math.radians(65)), abs=1e-3)
    assert math.isnan(fixes[-1].position_sigma)


def test_pashr_says_pitch_and_accuracy_and_is_waited_for():
    to, fixes = decoder(), []
    for k in range(4):
        seconds = NOON + k * PERIOD
        sentences = [rmc(seconds), gga(seconds), hdt(30.0), pashr(seconds, sigma=0.5)]
        fixes += fed([(seconds + 0.005 * n, one) for n, one in enumerate(sentences)], to)
    assert math.degrees(fixes[-1].heading) == pytest.approx(25.0)
    assert math.degrees(fixes[-1].pitch) == pytest.approx(1.5)
    assert math.degrees(fixes[-1].roll) == pytest.approx(-0.4)
    assert math.degrees(fixes[-1].heading_sigma) == pytest.approx(0.5)
    assert fixes[-1].acceleration == pytest.approx(9.80665 * math.sin(math.radians(1.5)), abs=1e-2)


@pytest.mark.parametrize("said", [pashr(NOON, quality=0), sealed("GPHDT,,T"), sealed("GPHDT,12.3,M")])
def test_a_heading_that_the_receiver_does_not_vouch_for_is_invalid(said):
    (fix,) = fed([*drive(1)[:2], *((NOON, one) for one in (gga(), said, vtg()))])
    assert math.isnan(fix.heading)
    assert "heading_invalid" in TrustGate(NMEA, 0.0).step(fix.time, fix).reasons


@pytest.mark.parametrize(
    "said",
    [
        sealed("GPVTG,65.0,T,,M,,N,,K,R"),
        sealed("GPVTG,65.0,T,,M,5.0,N,9.3,K,N"),
        sealed("GPVTG,,T,,M,5.0,N,9.3,K,R"),
        rmc(NOON, status="V"),
        sealed("GPVTG,65.0,T,,M,nan,N,inf,K,R"),
    ],
)
def test_a_velocity_that_is_not_measured_is_not_a_number(said):
    (fix,) = fed([*drive(1)[:2], *((NOON, one) for one in (gga(), hdt(), said))])
    assert math.isnan(fix.velocity_north)
    assert "not_finite" in TrustGate(NMEA, 0.0).step(fix.time, fix).reasons


def test_at_rest_receivers_leave_the_course_empty():
    (fix,) = fed([*drive(1)[:2], *((NOON, one) for one in (gga(), hdt(), vtg(None, 0.01)))])
    assert math.hypot(fix.velocity_north, fix.velocity_east) == pytest.approx(0.01, abs=1e-4)


def test_reversing_has_a_negative_speed_along_the_heading():
    rows = drive(1)[:2]
    for k in range(4):
        seconds = NOON + k * PERIOD
        rows += [(seconds, one) for one in (gga(seconds), hdt(65.0), vtg(245.0, 1.0 + 0.5 * k * PERIOD))]
    *_, fix = fed(rows)
    assert fix.acceleration == pytest.approx(-0.5, abs=0.02)


def test_rates_are_differences_over_the_last_tenth_of_a_second():
    rows = drive(1)[:2]
    for k in range(20):
        seconds = NOON + k * PERIOD
        compass, speed = 350.0 + 10.0 * k * PERIOD * 2, 5.0 + 1.5 * k * PERIOD  # over north
        rows += [(seconds, one) for one in (gga(seconds), hdt(compass), vtg(compass, speed))]
    first, *fixes = fed(rows)
    assert math.isnan(first.yaw_rate)
    assert all(fix.yaw_rate == pytest.approx(math.radians(-20.0), abs=1e-3) for fix in fixes)
    assert all(fix.acceleration == pytest.approx(1.5, abs=5e-3) for fix in fixes)


def test_after_a_gap_there_are_no_rates():
    fixes = fed([*drive(3), *drive(3, NOON + 1.0)[2:]])
    assert [math.isnan(fix.yaw_rate) for fix in fixes] == [True, False, False, True, False, False]


def test_an_accuracy_said_long_ago_says_nothing():
    rows = [(received, one) for received, one in drive(40) if b"GST" not in one or received < NOON + 0.05]
    known = [fix.time - MIDNIGHT_GPS - NOON for fix in fed(rows) if not math.isnan(fix.position_sigma)]
    assert max(known) == pytest.approx(2.5, abs=0.11)


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


# --- what other people's receivers send -------------------------------------------------------------------------------


def test_sentences_of_real_receivers():
    """One each as printed in receiver manuals (u-blox, NovAtel, Trimble): checksums and odd fields as they are."""
    to = decoder()
    samples = (
        b"$GPGGA,092725.00,4717.11399,N,00833.91590,E,1,08,1.01,499.6,M,48.0,M,,*5B\r\n"
        b"$GPVTG,77.52,T,,M,0.004,N,0.008,K,A*06\r\n"
        b"$GPGSV,3,1,10,23,38,230,44,29,71,156,47,07,29,116,41,08,09,081,36*7F\r\n"
        b"$PASHR,163029.000,158.09,T,-0.30,+0.31,+0.01,0.029,0.029,0.059,1,1*3B\r\n"
        b"$GPHDT,75.5664,T*36\r\n"
        b"$GPZDA,082710.00,16,09,2002,00,00*64\r\n"
    )
    to.feed(samples, 0.0)
    assert to.counts[Outcome.WRONG_CHECKSUM] == 0
    assert to.counts[Outcome.OTHER] == 1
    assert to.counts[Outcome.MALFORMED] == 0
    assert to.discarded == 0


# --- and the gate -----------------------------------------------------------------------------------------------------


def judged(fixes, profile):
    gate = TrustGate(profile, MIDNIGHT_GPS)
    return [gate.step(fix.time_received, fix) for fix in fixes]


def test_a_good_drive_is_trusted_by_the_nmea_profile_but_for_its_first_fix_and_never_by_drive():
    fixes = fed(drive(50))
    first, *rest = judged(fixes, NMEA)
    assert "not_finite" in first.reasons
    assert all(trust.trusted for trust in rest)
    assert all("pitch_invalid" in trust.reasons for trust in judged(fixes, DRIVE))


def test_accuracies_that_nobody_declares_are_refused():
    reasons = {reason for trust in judged(fed(drive(50), Decoder()), NMEA) for reason in trust.reasons}
    assert {"velocity_sigma", "heading_sigma"} <= reasons


@pytest.mark.parametrize(
    ("without", "reason"), [(b"GST", "position_sigma"), (b"quality", "not_rtk_fixed"), (b"age", "corrections_old")]
)
def test_what_the_nmea_profile_demands(without, reason):
    rows = [row for row in drive(20) if without not in row[1]]
    if without != b"GST":
        changed = {"quality": 5} if without == b"quality" else {"age": ""}
        rows = rows[:2] + [(NOON + k * PERIOD, b"".join(epoch(NOON + k * PERIOD, **changed))) for k in range(20)]
    assert all(reason in trust.reasons for trust in judged(fed(rows), NMEA))


@pytest.mark.parametrize(("step_deg", "found"), [(4.0, False), (12.0, True), (90.0, True), (180.0, True)])
def test_a_step_of_the_heading_that_the_nmea_profile_finds(step_deg, found):
    """At rest, where no course tells: the yaw rate is made of the same heading and hides half of the step."""
    rows = drive(1)[:2]
    for k in range(40):
        seconds = NOON + k * PERIOD
        moved = gga(seconds, latitude=39.99805 + 1e-9 * k)
        rows += [(seconds, one) for one in (moved, gst(seconds), hdt(65.0 + step_deg * (k >= 20)), vtg(None, 0.0))]
    trusts = judged(fed(rows), NMEA)
    assert all(trust.trusted for trust in trusts[1:20])
    assert all(trust.trusted for trust in trusts[20:26]) is not found


def test_a_bend_entered_quickly_is_no_heading_jump():
    """Yaw rate from 0 to 0.6 rad/s in 0.35 s at 6 m/s, 0.15 deg of heading noise."""
    chance = random.Random(5)
    rows, heading, x, y, rate = drive(1)[:2], 0.0, 0.0, 0.0, 0.0
    for k in range(400):  # the truth, 10 ms apart
        rate = min(max((k - 100) * 0.01 / 0.35 * 0.6, 0.0), 0.6)
        heading += rate * 0.01
        x, y = x + 0.06 * math.cos(heading), y + 0.06 * math.sin(heading)
        if k % 10 == 0:
            seconds, compass = NOON + k * 0.01, 90.0 - math.degrees(heading)
            latitude = 39.99805 + math.degrees(y / 6_371_000)
            longitude = -82.98321 + math.degrees(x / 6_371_000) / math.cos(math.radians(39.99805))
            noisy = compass + chance.gauss(0.0, 0.15)
            sentences = (gga(seconds, latitude, longitude), gst(seconds), hdt(noisy), vtg(compass, 6.0))
            rows += [(seconds + 0.03, one) for one in sentences]
    assert [trust.reasons for trust in judged(fed(rows), NMEA)[1:] if not trust.trusted] == []


# --- sentences that lie under a right checksum ------------------------------------------------------------------------


def without(rows: list[tuple[float, bytes]], *lies: tuple[float, bytes]) -> tuple[list[float], list[float]]:
    """Times of the fixes with lies among the sentences, and without."""
    return [fix.time for fix in fed(sorted([*rows, *lies], key=lambda row: row[0]))], [fix.time for fix in fed(rows)]


@pytest.mark.parametrize("ahead", [-40_000.0, -1.0, 0.1, 0.25, 12.0, 3600.0, 40_000.0])
@pytest.mark.parametrize("sentence", [gga, gst, rmc, zda, pashr])
def test_one_wrong_time_of_day_costs_no_epoch(sentence, ahead):
    """It comes while no epoch is open; nor does it take the accuracy or the date of the others away."""
    rows = drive(150)
    at = NOON + 10.0 + 0.06
    told, true = without(rows, (at, sentence(NOON + 10.0 + ahead)))
    assert told == true
    fixes = fed(sorted([*rows, (at, sentence(NOON + 10.0 + ahead))], key=lambda row: row[0]))
    assert not any(math.isnan(fix.position_sigma) for fix in fixes[1:])


@pytest.mark.parametrize("date", ["010180", "201126", "221126", "311279"])
def test_one_wrong_date_moves_nothing(date):
    rows = drive(150)
    told, true = without(rows, (NOON + 10.031, rmc(NOON + 10.0, date=date)))
    assert told == true


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
