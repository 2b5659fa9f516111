"""What the trust gate makes of NMEA fixes."""

from __future__ import annotations

import math
import random

import pytest

from tests.pose.nmea_sentences import MIDNIGHT_GPS, NOON, PERIOD, drive, epoch, fed, gga, gst, hdt, vtg
from vve_sumo.pose.nmea import Decoder
from vve_sumo.pose.trust import DRIVE, NMEA, TrustGate


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
