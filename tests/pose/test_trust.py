"""The trust gate: rows of one spoilt thing and the reason it must give, and what a history may hide."""

from __future__ import annotations

import csv
import itertools
import math
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.fixes import GOOD
from tests.pose.recordings import BOREAS_COURSE
from vve_sumo.pose.trust import DRIVE, PLAYBACK, REASONS, TrustGate
from vve_sumo.values import Fix, FixQuality

EPOCH = 1_300_000_000.0
PERIOD = 0.01
RADIUS = 6_371_000.0


def drive(count: int = 200, speed: float = 10.0, course: float = 0.4, period: float = PERIOD) -> list[Fix]:
    """A straight drive at constant speed, every fix good."""
    north, east = speed * math.sin(course), speed * math.cos(course)
    return [
        replace(
            GOOD,
            time=EPOCH + k * period,
            time_received=k * period,
            latitude=0.6983 + north * k * period / RADIUS,
            longitude=-1.4483 + east * k * period / (RADIUS * math.cos(0.6983)),
            heading=course,
            velocity_north=north,
            velocity_east=east,
        )
        for k in range(count)
    ]


def judged(fixes, profile=DRIVE, delay=0.03):
    gate = TrustGate(profile, EPOCH)
    return [gate.step(fix.time - EPOCH + delay, fix) for fix in fixes]


@pytest.mark.parametrize("course", [-3.1, -1.0, 0.0, 0.4, 1.6, 3.1])
@pytest.mark.parametrize("speed", [0.0, 0.1, 10.0, 30.0])
def test_a_good_drive_is_trusted_throughout(speed, course):
    assert all(trust.trusted for trust in judged(drive(speed=speed, course=course)))


@pytest.mark.parametrize(
    ("spoilt", "reason"),
    [
        ({"locked": False}, "status_not_locked"),
        ({"quality": FixQuality.RTK_FLOAT}, "not_rtk_fixed"),
        ({"quality": FixQuality.UNKNOWN}, "not_rtk_fixed"),
        ({"quality": FixQuality.SINGLE}, "not_rtk_fixed"),
        ({"position_sigma": 0.11}, "position_sigma"),
        ({"position_sigma": math.nan}, "position_sigma"),
        ({"position_sigma": -1.0}, "position_sigma"),
        ({"velocity_sigma": math.nan}, "velocity_sigma"),
        ({"heading_sigma": 0.02}, "heading_sigma"),
        ({"heading_sigma": math.nan}, "heading_sigma"),
        ({"differential_age": 11.0}, "corrections_old"),
        ({"differential_age": math.nan}, "corrections_old"),
        ({"heading": math.nan}, "heading_invalid"),
        ({"pitch": math.nan}, "pitch_invalid"),
        ({"latitude": math.nan}, "not_finite"),
        ({"longitude": math.inf}, "not_finite"),
        ({"velocity_north": math.nan}, "not_finite"),
        ({"yaw_rate": math.nan}, "not_finite"),
        ({"acceleration": math.nan}, "not_finite"),
        ({"time": math.nan}, "not_finite"),
        ({"heading": 0.7}, "heading_off_course"),
        ({"heading": 0.4 + math.pi}, "heading_off_course"),
        ({"latitude": 0.6983 + 1e-6}, "pose_jump"),
    ],
)
def test_one_spoilt_fix_is_refused_with_its_reason(spoilt, reason):
    fixes = drive()
    fixes[100] = replace(fixes[100], **spoilt)
    verdicts = judged(fixes)
    assert all(trust.trusted for trust in verdicts[:100])
    assert not verdicts[100].trusted
    assert reason in verdicts[100].reasons
    assert reason in REASONS


@pytest.mark.parametrize("quality", FixQuality)
def test_only_fixed_ambiguities_count(quality):
    (verdict,) = judged([replace(drive()[0], quality=quality)])
    assert verdict.trusted == (quality == "RTK fixed")


@pytest.mark.parametrize(
    ("delay", "reason"), [(0.11, "fix_too_old"), (-0.03, "fix_from_future"), (math.nan, "fix_too_old")]
)
def test_a_fix_of_the_wrong_age_is_refused(delay, reason):
    assert all(trust.reasons == (reason,) for trust in judged(drive(), delay=delay))


def test_duplicates_and_late_fixes_are_refused_and_disturb_nothing():
    fixes = drive(100)
    verdicts = judged([*fixes[:50], fixes[49], fixes[40], *fixes[50:]])
    assert [v.reasons for v in verdicts[50:52]] == [("time_not_increasing",)] * 2
    assert all(v.trusted for v in verdicts[:50] + verdicts[52:])


def test_after_a_jump_fixes_must_agree_for_a_while():
    fixes = drive(200)
    moved = [replace(fix, latitude=fix.latitude + 1e-6) for fix in fixes[100:]]
    verdicts = judged(fixes[:100] + moved)
    assert verdicts[100].reasons == ("pose_jump",)
    assert all(v.reasons == ("settling",) for v in verdicts[101:150])
    assert all(v.trusted for v in verdicts[151:])


def test_after_a_gap_fixes_must_agree_for_a_while():
    fixes = drive(200)
    verdicts = judged(fixes[:80] + fixes[100:])
    assert verdicts[80].reasons == ("gap",)
    assert all(v.reasons == ("settling",) for v in verdicts[81:130])
    assert all(v.trusted for v in verdicts[131:])


@pytest.mark.parametrize(("metres", "trusted"), [(0.05, True), (0.2, True), (0.3, False), (5.0, False)])
def test_jump_limit_in_metres(metres, trusted):
    fixes = drive(3)
    fixes[2] = replace(fixes[2], latitude=fixes[2].latitude + metres / RADIUS)
    assert judged(fixes)[2].trusted is trusted


def test_hard_braking_and_a_tight_bend_are_no_jumps():
    """12 m/s2 and 1 rad/s between fixes 50 ms apart stay within what the velocity explains."""
    fixes, north, east, x, y = [], 0.0, 0.0, 0.0, 0.0
    speed, heading = 12.0, 0.0
    for k in range(1000):  # the truth, 1 ms apart
        north, east = speed * math.sin(heading), speed * math.cos(heading)
        if k % 50 == 0:
            template = drive(1)[0]
            fixes.append(
                replace(
                    template,
                    time=EPOCH + k * 0.001,
                    latitude=template.latitude + y / RADIUS,
                    longitude=template.longitude + x / (RADIUS * math.cos(template.latitude)),
                    velocity_north=north,
                    velocity_east=east,
                    heading=heading,
                    yaw_rate=1.0,
                )
            )
        x, y = x + east * 0.001, y + north * 0.001
        speed, heading = max(speed - 0.010, 0.0), heading + 0.001
    assert all(trust.trusted for trust in judged(fixes))


def test_frozen_pose_is_seen_as_soon_as_the_car_moves():
    fixes = drive(20)
    frozen = replace(fixes[9], time=fixes[10].time)
    assert "frozen_pose" in judged([*fixes[:10], frozen])[-1].reasons
    standing = drive(20, speed=0.0)
    assert all(trust.trusted for trust in judged(standing))


def test_course_is_not_judged_when_slow_and_allows_for_a_bend():
    sideways = [replace(fix, heading=1.4) for fix in drive(5, speed=2.9)]
    assert all(trust.trusted for trust in judged(sideways))
    # A point 3.5 m ahead of the rear axle at 4 m/s and 0.7 rad/s travels atan(3.5 * 0.7 / 4) off the heading.
    slip = math.atan(3.5 * 0.7 / 4.0)
    bend = [replace(fix, heading=0.4 - slip, yaw_rate=0.7) for fix in drive(5, speed=4.0)]
    assert all(trust.trusted for trust in judged(bend))
    straight = [replace(fix, heading=0.4 - slip) for fix in drive(5, speed=4.0)]
    assert not any(trust.trusted for trust in judged(straight))


def test_staleness_counts_from_the_last_trusted_fix_s_own_time():
    gate = TrustGate(DRIVE, EPOCH)
    assert gate.stale(0.0) == ("pose_stale",)
    for fix in drive(11):
        gate.step(fix.time - EPOCH + 0.03, fix)
    assert gate.stale(0.2499) == ()
    assert gate.stale(0.2501) == ("pose_stale",)
    assert gate.stale(math.nan) == ("pose_stale",)
    for fix in drive(40)[11:]:
        gate.step(fix.time - EPOCH + 0.03, replace(fix, quality=FixQuality.RTK_FLOAT))
    assert gate.stale(0.42) == ("pose_stale",)


def test_playback_lets_recordings_through_and_may_never_arm():
    bare = {"locked": False, "quality": FixQuality.UNKNOWN, "pitch": math.nan, "differential_age": math.nan}
    bare |= {"position_sigma": math.nan, "velocity_sigma": math.nan, "heading_sigma": math.nan}
    fixes = [replace(fix, **bare) for fix in drive(50, period=0.25)]
    assert all(trust.trusted for trust in judged(fixes, PLAYBACK, delay=1e6))
    assert not any(trust.trusted for trust in judged(fixes, DRIVE))
    assert not PLAYBACK.may_arm
    assert DRIVE.may_arm


def test_playback_still_refuses_what_is_wrong():
    fixes = drive(50, period=0.25)
    fixes[20] = replace(fixes[20], latitude=math.nan)
    fixes[30] = replace(fixes[30], latitude=fixes[30].latitude + 1e-5)
    fixes[40] = replace(fixes[40], heading=math.nan)
    refused = [k for k, trust in enumerate(judged(fixes, PLAYBACK)) if not trust.trusted]
    assert refused == [20, 30, 31, 40]


READ = [f.name for f in fields(Fix) if f.name not in ("time_received", "altitude", "roll", "velocity_down")]


@pytest.mark.plain
@given(st.sampled_from(READ), st.sampled_from([math.nan, math.inf, -math.inf]), st.integers(0, 30))
def test_what_is_not_a_number_never_passes_as_good(name, value, index):
    fixes = drive(31)
    fixes[index] = replace(fixes[index], **{name: value})
    assert not judged(fixes)[index].trusted


@given(st.permutations(range(12)))
def test_trusted_times_increase_whatever_the_order(order):
    fixes = drive(12)
    gate = TrustGate(PLAYBACK, EPOCH)
    times = [fixes[k].time for k in order if gate.step(0.0, fixes[k]).trusted]
    assert all(a < b for a, b in itertools.pairwise(times))


# What grows little by little, and what no car can do.


def test_a_position_that_runs_away_by_steps_too_small_to_tell_is_found():
    """0.24 m a fix at rest: each step is below the jump limit, half a second of them is 12 m."""
    fixes = [
        replace(fix, latitude=fix.latitude + 0.24 * max(k - 100, 0) / RADIUS)
        for k, fix in enumerate(drive(300, speed=0.0))
    ]
    trusts = judged(fixes)
    assert all(trust.trusted for trust in trusts[:101])
    assert trusts[102].reasons == ("pose_drift",)
    assert not any(trust.trusted for trust in trusts[102:])


@pytest.mark.parametrize("speed", [0.0, 2.0, 10.0])
def test_noise_and_an_offset_velocity_within_its_accuracy_are_no_drift(speed):
    random = np.random.default_rng(1)
    fixes = [
        replace(
            fix,
            latitude=fix.latitude + random.normal(0.0, 0.02) / RADIUS,
            velocity_north=fix.velocity_north + 0.05 + random.normal(0.0, 0.03),
        )
        for fix in drive(1000, speed=speed)
    ]
    assert all(trust.trusted for trust in judged(fixes))


@pytest.mark.parametrize("speed", [0.0, 2.3, 10.0])
def test_a_heading_that_flips_is_found_at_every_speed(speed):
    fixes = drive(200, speed=speed)
    fixes[100:] = [replace(fix, heading=fix.heading + math.pi) for fix in fixes[100:]]
    trusts = judged(fixes)
    assert all(trust.trusted for trust in trusts[:100])
    assert "heading_jump" in trusts[100].reasons
    assert not any(trust.trusted for trust in trusts[100 : 100 + round(DRIVE.settling / PERIOD)])


def test_a_heading_that_spins_while_the_car_stands_is_found():
    """3 rad/s with a yaw rate of 0: 0.03 rad a fix is below the jump limit, two of them are above."""
    fixes = [
        replace(fix, heading=math.remainder(0.4 + 3.0 * max(k - 100, 0) * PERIOD, math.tau))
        for k, fix in enumerate(drive(300, speed=0.0))
    ]
    trusts = judged(fixes)
    assert all(trust.trusted for trust in trusts[:101])
    assert not any(trust.trusted for trust in trusts[102:])
    assert "heading_drift" in trusts[102].reasons


def test_turning_on_the_spot_of_the_yaw_rate_is_no_jump():
    fixes = [
        replace(fix, heading=math.remainder(0.4 + 1.0 * k * PERIOD, math.tau), yaw_rate=1.0)
        for k, fix in enumerate(drive(400, speed=0.0))
    ]
    assert all(trust.trusted for trust in judged(fixes))


def test_a_velocity_that_no_car_can_reach_in_one_step_is_found():
    fixes = drive(200)
    fixes[100:] = [replace(fix, velocity_north=fix.velocity_north + 20.0) for fix in fixes[100:]]
    assert "velocity_jump" in judged(fixes)[100].reasons


@pytest.mark.parametrize("absurd", [{"yaw_rate": 50.0}, {"yaw_rate": -3.0}, {"acceleration": 500.0}])
def test_motion_that_no_car_can_do_is_found(absurd):
    fixes = drive(50)
    fixes[20] = replace(fixes[20], **absurd)
    assert "motion_absurd" in judged(fixes)[20].reasons


def test_a_profile_that_judges_no_quality_can_never_arm():
    with pytest.raises(ValueError, match="may never arm"):
        replace(PLAYBACK, may_arm=True)
    with pytest.raises(AttributeError):
        TrustGate(PLAYBACK, EPOCH).profile = DRIVE


# One bad fix, whatever it says, and a crowd of them from the future.

ALONE = ["altitude", "velocity_down", "pitch", "roll", "yaw_rate", "acceleration"]
LYING = ["latitude", "longitude", "heading", "velocity_north", "velocity_east", "locked", *ALONE]


@pytest.mark.thorough
@pytest.mark.plain
@settings(max_examples=400, deadline=None)
@given(
    st.sampled_from([0.01, 0.05]),
    st.sampled_from([0.0, 2.0, 10.0]),
    st.dictionaries(st.sampled_from(LYING), st.floats(-1.0, 1.0), min_size=1),
    st.sampled_from([1e-7, 1e-6, 1e-2, 0.5, 1.0, 4.0, 30.0, 800.0]),
    st.sampled_from([0.0, 0.005, 0.019, 0.03, 12.0]),
)
def test_one_bad_fix_keeps_true_ones_out_for_no_longer_than_they_settle(period, speed, lies, size, ahead):
    """Beside the bad one: as long as fixes must agree, and the interval to the next after that."""
    fixes = drive(round(4.0 / period), speed=speed, period=period)
    bad = round(1.0 / period)
    lie = {name: getattr(fixes[bad], name) + size * value for name, value in lies.items()}
    wrong = replace(fixes[bad], time=fixes[bad].time + 1e-4 + ahead, **lie)
    gate, refused = TrustGate(DRIVE, EPOCH), []
    for k, fix in enumerate(fixes):
        if not gate.step(fix.time - EPOCH + 0.005, fix).trusted:
            refused.append(fix.time - wrong.time)
        if k == bad:
            gate.step(fixes[bad].time - EPOCH + 0.005, wrong)
    assert max(refused, default=0.0) <= DRIVE.settling + 2 * period + 1e-6


@pytest.mark.thorough
@settings(max_examples=200, deadline=None)
@given(
    st.sampled_from([0.01, 0.05]),
    st.sampled_from([0.0, 2.0, 10.0]),
    st.dictionaries(st.sampled_from(ALONE), st.floats(-1.0, 1.0), min_size=1),
    st.sampled_from([1e-3, 1e-2, 0.1, 1.0, 30.0, 800.0, 1e30]),
)
def test_one_bad_fix_of_these_keeps_no_true_one_out_and_stops_no_drive(period, speed, lies, size):
    fixes = drive(round(2.0 / period), speed=speed, period=period)
    bad = round(1.0 / period)
    lie = {name: getattr(fixes[bad], name) + size * value for name, value in lies.items()}
    gate = TrustGate(DRIVE, EPOCH)
    for k, fix in enumerate(fixes):
        said = replace(fix, **lie) if k == bad else fix
        now = fix.time - EPOCH + 0.02
        assert gate.step(now, said).trusted or k == bad
        assert gate.stale(now) == ()


@pytest.mark.parametrize("name", ["altitude", "roll"])
@pytest.mark.parametrize("value", [math.inf, -math.inf])
def test_infinity_of_what_nobody_needs_is_refused_from_the_first_fix_on(name, value):
    (verdict,) = judged([replace(drive(1)[0], **{name: value})])
    assert not verdict.trusted


# Real drives: none of them is damaged.

OF_A_JUMP = {"altitude_absurd", "tilt_absurd", "motion_absurd", "altitude_jump", "tilt_jump", "motion_jump"}


def reported(fixes: list[Fix]) -> set[str]:
    """All that the gate of a real car says of them."""
    gate = TrustGate(DRIVE, 0.0)
    return {reason for fix in fixes for reason in gate.step(fix.time, fix).reasons}


def table(path: Path) -> list[dict[str, float]]:
    with path.open(newline="") as file:
        return [{name: float(cell or "nan") for name, cell in row.items()} for row in csv.DictReader(file)]


def test_a_suburban_drive_with_height_tilt_and_rates_jumps_nowhere(shared_data):
    """17 minutes at 9.64 Hz; positions and headings are those of the UTM grid."""
    rows = table(shared_data / "drives" / "boreas" / "boreas-2021-09-02-11-42_lidar_poses.csv")
    begin, template = rows[0], drive(1)[0]
    fixes = [
        replace(
            template,
            time=(row["GPSTime"] - begin["GPSTime"]) * 1e-6,
            latitude=0.764 + (row["northing"] - begin["northing"]) / RADIUS,
            longitude=-1.387 + (row["easting"] - begin["easting"]) / (RADIUS * math.cos(0.764)),
            altitude=row["altitude"],
            heading=math.remainder(math.pi / 2 - BOREAS_COURSE + row["heading"], -math.tau),
            pitch=row["pitch"],
            roll=row["roll"],
            velocity_north=row["vel_north"],
            velocity_east=row["vel_east"],
            velocity_down=-row["vel_up"],
            yaw_rate=row["angvel_z"],
        )
        for row in rows
    ]
    assert len(fixes) > 9000
    assert OF_A_JUMP.isdisjoint(reported(fixes))
    assert OF_A_JUMP.isdisjoint(reported([replace(fix, velocity_down=math.nan) for fix in fixes]))


def test_a_minute_of_traffic_with_height_jumps_nowhere(shared_data):
    """20 Hz; its vertical velocity is not told."""
    rows = table(shared_data / "drives" / "comma2k19" / "tidy_pose_20hz.csv")
    fixes = [
        replace(
            drive(1)[0],
            time=row["gps_tow"] - rows[0]["gps_tow"],
            latitude=math.radians(row["lat"]),
            longitude=math.radians(row["lon"]),
            altitude=row["h"],
            heading=math.radians(90.0 - row["course_deg"]),
            velocity_north=row["vn"],
            velocity_east=row["ve"],
            velocity_down=math.nan,
        )
        for row in rows
    ]
    assert len(fixes) > 1000
    assert OF_A_JUMP.isdisjoint(reported(fixes))


@pytest.mark.parametrize("name", ["car_50km", "car_60km", "collision_assist_activated", "lkast_activated"])
@pytest.mark.parametrize("felt", ["ax_raw_mps2", "ax_comp_mps2"])
def test_a_ford_fusion_s_own_rates_jump_nowhere(shared_data, name, felt):
    """About 80 Hz, emergency braking among them; position and heading are left out of it."""
    fixes = [
        replace(drive(1)[0], time=row["t"], yaw_rate=row["yaw_rate_radps"], acceleration=row[felt])
        for row in table(shared_data / "drives" / "ford_fusion" / f"tidy_{name}.csv")
    ]
    fixes = [fix for fix in fixes if math.isfinite(fix.yaw_rate + fix.acceleration)]
    assert len(fixes) > 400
    assert OF_A_JUMP.isdisjoint(reported(fixes))
