"""NMEA decoder: what is read of each sentence, of those of real receivers too."""

from __future__ import annotations

import math

import pytest

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
    hdt,
    pashr,
    rmc,
    sealed,
    ths,
    vtg,
)
from vve_sumo.pose.nmea import Outcome
from vve_sumo.pose.trust import NMEA, TrustGate
from vve_sumo.values import FixQuality


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


# --- THS --------------------------------------------------------------------------------------------------------------


def epochs_with(*headings, count=4):
    """Fixes of some epochs with these sentences in the place of HDT, after the date."""
    rows = drive(1)[:2]
    for k in range(count):
        first, accuracy, _hdt, velocity = epoch(NOON + k * PERIOD)
        sentences = (first, accuracy, *headings, velocity)
        rows += [(NOON + k * PERIOD + 0.005 * n, one) for n, one in enumerate(sentences)]
    return fed(rows)


def test_ths_is_a_heading_where_it_is_valid():
    fixes = epochs_with(ths(40.0))
    assert [math.degrees(fix.heading) for fix in fixes] == pytest.approx([50.0] * 4)
    assert fixes[-1].heading_sigma == 0.004


@pytest.mark.parametrize(
    ("compass", "status"), [(40.0, "V"), (40.0, "E"), (40.0, "M"), (40.0, "S"), ("", "A"), (40.0, "")]
)
def test_a_heading_that_ths_calls_estimated_or_not_valid_is_none(compass, status):
    gate, fixes = TrustGate(NMEA, MIDNIGHT_GPS), epochs_with(ths(compass, status))
    assert len(fixes) == 4
    assert all(math.isnan(fix.heading) for fix in fixes)
    assert "heading_invalid" in gate.step(fixes[-1].time_received, fixes[-1]).reasons


@pytest.mark.parametrize("order", [(hdt(10.0), ths(40.0)), (ths(40.0), hdt(10.0))])
def test_ths_counts_more_than_hdt_because_it_says_whether_it_is_valid(order):
    assert [math.degrees(fix.heading) for fix in epochs_with(*order)] == pytest.approx([50.0] * 4)
    invalid = [ths(40.0, "V") if b"THS" in one else one for one in order]
    assert all(math.isnan(fix.heading) for fix in epochs_with(*invalid))


def test_a_receiver_whose_ths_comes_last_is_waited_for_from_the_second_epoch_on():
    rows = drive(1)[:2]
    for k in range(3):
        first, accuracy, _hdt, velocity = epoch(NOON + k * PERIOD)
        for n, one in enumerate((first, accuracy, velocity, hdt(10.0), ths(40.0))):
            rows.append((NOON + k * PERIOD + 0.005 * n, one))
    assert [math.degrees(fix.heading) for fix in fed(rows)] == pytest.approx([80.0, 50.0, 50.0])


def test_pashr_counts_more_than_ths():
    rows = drive(1)[:2]
    for seconds in (NOON, NOON + PERIOD, NOON + 2 * PERIOD):
        rows += [(seconds, one) for one in (gga(seconds), ths(40.0), pashr(seconds), vtg())]
    fixes = fed(rows)
    assert math.degrees(fixes[-1].heading) == pytest.approx(25.0)
    assert math.degrees(fixes[-1].pitch) == pytest.approx(1.5)
