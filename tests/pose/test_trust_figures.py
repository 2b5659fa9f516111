"""The trust gate's figures: each profile written down a second time, and what happens just inside and outside a limit.

Cases are worked out by hand; times and speeds are binary fractions where a limit is met exactly.
"""

from __future__ import annotations

import ast
import inspect
import math
from dataclasses import asdict, replace

import pytest

from tests.fixes import GOOD as STANDING
from vve_sumo.pose import trust
from vve_sumo.pose.trust import DRIVE, NMEA, PLAYBACK, REASONS, TrustGate, TrustProfile
from vve_sumo.values import Fix

RADIUS = 6_371_000.0
STEP = 0.125  # [s]; below every profile's gap limit and a binary fraction

#: Drive: a setpoint lives 100 ms, and so may a fix; accuracies of RTK. NMEA 0183: ten fixes a second of which one may
#: be lost, 50 ms late. Playback: recordings of 2 fixes a second without quality.
FIGURES = {
    "drive": {
        "may_arm": True, "live": True, "position_sigma_limit": 0.10, "velocity_sigma_limit": 0.10,
        "heading_sigma_limit": 0.01, "pitch_needed": True, "corrections_age_limit": 10.0, "age_limit": 0.10,
        "gap_limit": 0.15, "stale_limit": 0.15, "jump_limit": 0.25, "heading_jump_limit": 0.05, "course_limit": 0.20,
        "course_speed": 3.0, "settling": 0.5, "altitude_jump_limit": 0.5, "yaw_rate_jump_limit": 0.1,
        "acceleration_jump_limit": 12.0, "position_step": 0.0,
    },
    "nmea": {
        "may_arm": True, "live": True, "position_sigma_limit": 0.10, "velocity_sigma_limit": 0.10,
        "heading_sigma_limit": 0.01, "pitch_needed": False, "corrections_age_limit": 10.0, "age_limit": 0.15,
        "gap_limit": 0.25, "stale_limit": 0.25, "jump_limit": 0.25, "heading_jump_limit": 0.08, "course_limit": 0.20,
        "course_speed": 3.0, "settling": 0.5, "altitude_jump_limit": 0.5, "yaw_rate_jump_limit": 0.8,
        "acceleration_jump_limit": 12.0, "position_step": 0.0186,
    },
    "playback": {
        "may_arm": False, "live": False, "position_sigma_limit": math.inf, "velocity_sigma_limit": math.inf,
        "heading_sigma_limit": math.inf, "pitch_needed": False, "corrections_age_limit": math.inf,
        "age_limit": math.inf, "gap_limit": 1.0, "stale_limit": 1.0, "jump_limit": 1.0,
        "heading_jump_limit": math.inf, "course_limit": 0.35, "course_speed": 3.0, "settling": 0.0,
        "altitude_jump_limit": math.inf, "yaw_rate_jump_limit": math.inf, "acceleration_jump_limit": math.inf,
        "position_step": 0.0,
    },
}  # fmt: skip


def judged(fixes: list[Fix], profile: TrustProfile = DRIVE, late: float = 0.0) -> list[tuple[str, ...]]:
    gate = TrustGate(profile, 0.0)
    return [gate.step(fix.time + late, fix).reasons for fix in fixes]


def fixes(count: int) -> list[Fix]:
    """A standing car's fixes, one a step."""
    return [replace(STANDING, time=k * STEP) for k in range(count)]


def moved(these: list[Fix], start: int, north: float = 0.0, east: float = 0.0, turn: float = 0.0) -> list[Fix]:
    """The same with everything from fix `start` on elsewhere."""
    there = [
        replace(
            fix,
            latitude=fix.latitude + north / RADIUS,
            longitude=fix.longitude + east / RADIUS,
            heading=fix.heading + turn,
        )
        for fix in these[start:]
    ]
    return these[:start] + there


@pytest.mark.parametrize("profile", [DRIVE, NMEA, PLAYBACK])
def test_a_profile_has_the_figures_of_the_second_list(profile):
    assert asdict(profile) == {"name": profile.name, **FIGURES[profile.name]}
    assert TrustGate(profile, 0.0).profile is profile


@pytest.mark.plain
def test_the_reasons_are_those_that_the_source_gives():
    """Every string in the module that is alone in a list, a tuple or a call of append, and no other."""
    tree = ast.parse(inspect.getsource(trust))
    gate = [n for n in tree.body if isinstance(n, (ast.FunctionDef, ast.ClassDef)) and n.name != "TrustProfile"]
    given = {n.value for body in gate for n in ast.walk(body) if isinstance(n, ast.Constant) and type(n.value) is str}
    of_the_chain = {"fix_ahead"}
    assert {code for code in given if " " not in code and "\n" not in code} | of_the_chain == set(REASONS)


# One fix.


@pytest.mark.parametrize("profile", [DRIVE, NMEA])
@pytest.mark.parametrize(
    ("field", "limit", "reason"),
    [
        ("position_sigma", 0.10, "position_sigma"),
        ("velocity_sigma", 0.10, "velocity_sigma"),
        ("heading_sigma", 0.01, "heading_sigma"),
        ("differential_age", 10.0, "corrections_old"),
    ],
)
def test_an_accuracy_is_good_from_none_up_to_its_limit(profile, field, limit, reason):
    for value, reasons in ((0.0, ()), (0.5 * limit, ()), (limit, ()), (1.001 * limit, (reason,)), (-1e-9, (reason,))):
        assert judged([replace(STANDING, **{field: value})], profile) == [reasons]


@pytest.mark.parametrize(("profile", "oldest"), [(DRIVE, 0.10), (NMEA, 0.15)])
def test_a_fix_may_be_a_little_ahead_of_now_and_so_old_at_most(profile, oldest):
    ages = {-0.0201: "fix_from_future", oldest + 0.0001: "fix_too_old"}
    for age in (-0.0201, -0.02, 0.0, 0.01, oldest, oldest + 0.0001):
        fix = replace(STANDING, time=-age if age < 0.0 else 0.0)
        reasons = TrustGate(profile, 0.0).step(max(age, 0.0), fix).reasons
        assert reasons == ((ages[age],) if age in ages else ())


@pytest.mark.parametrize(("profile", "limit"), [(DRIVE, 0.15), (NMEA, 0.25), (PLAYBACK, 1.0)])
def test_a_trusted_fix_counts_until_its_limit(profile, limit):
    gate = TrustGate(profile, 0.0)
    assert gate.step(0.0, STANDING).trusted
    assert gate.stale(limit) == ()
    assert gate.stale(limit + 1e-9) == ("pose_stale",)


@pytest.mark.parametrize(
    ("fields", "reasons"),
    [
        ({"yaw_rate": 2.0}, ()),
        ({"yaw_rate": -2.0}, ()),
        ({"yaw_rate": 2.001}, ("motion_absurd",)),
        ({"acceleration": 20.0}, ()),
        ({"acceleration": -20.0}, ()),
        ({"acceleration": 20.001}, ("motion_absurd",)),
        ({"acceleration": -20.001}, ("motion_absurd",)),
        ({"altitude": -600.0}, ()),
        ({"altitude": -600.1}, ("altitude_absurd",)),
        ({"altitude": 7000.0}, ()),
        ({"altitude": 7000.1}, ("altitude_absurd",)),
        ({"altitude": math.inf}, ("altitude_absurd",)),
        ({"altitude": math.nan, "roll": math.nan, "velocity_down": math.nan}, ()),  # a receiver need not say them
        ({"pitch": 0.7}, ()),
        ({"pitch": -0.7}, ()),
        ({"pitch": 0.701}, ("tilt_absurd",)),
        ({"pitch": -0.701}, ("tilt_absurd",)),
        ({"roll": 0.7}, ()),
        ({"roll": -0.7}, ()),
        ({"roll": 0.701}, ("tilt_absurd",)),
        ({"roll": -0.701}, ("tilt_absurd",)),
        ({"velocity_north": math.nan}, ("not_finite",)),
        ({"heading": math.nan}, ("heading_invalid",)),
    ],
)
def test_one_standing_fix(fields, reasons):
    assert judged([replace(STANDING, **fields)]) == [reasons]


def test_only_those_who_need_it_ask_for_the_pitch():
    level_unknown = replace(STANDING, pitch=math.nan)
    assert judged([level_unknown], DRIVE) == [("pitch_invalid",)]
    assert judged([level_unknown], NMEA) == judged([level_unknown], PLAYBACK) == [()]


@pytest.mark.parametrize(
    ("east", "yaw_rate", "heading", "reasons"),
    [
        (3.0, 0.0, 1.0, ()),  # not faster than the speed from which on the course is judged
        (3.001, 0.0, 1.0, ("heading_off_course",)),
        (10.0, 0.0, 0.20, ()),
        (10.0, 0.0, -0.20, ()),
        (10.0, 0.0, 0.201, ("heading_off_course",)),
        (10.0, 0.0, -0.201, ("heading_off_course",)),
        (10.0, 0.0, math.tau + 0.1, ()),  # an angle is an angle however often it went round
        # A point 4 m from the rear axle is carried sideways in a bend: 0.20 + 4 * 0.7 / 8 = 0.55.
        (8.0, 0.7, 0.549, ()),
        (8.0, -0.7, 0.549, ()),
        (8.0, 0.7, 0.551, ("heading_off_course",)),
        (8.0, -0.7, -0.551, ("heading_off_course",)),
        (10.0, math.nan, 0.0, ("not_finite", "heading_off_course")),  # nothing is known of the bend
    ],
)
def test_heading_against_course(east, yaw_rate, heading, reasons):
    fix = replace(STANDING, velocity_east=east, yaw_rate=yaw_rate, heading=heading)
    assert judged([fix]) == [reasons]


# From fix to fix.


@pytest.mark.parametrize(("profile", "limit"), [(DRIVE, 0.15), (NMEA, 0.25), (PLAYBACK, 1.0)])
def test_a_gap_is_longer_than_its_limit(profile, limit):
    assert judged([STANDING, replace(STANDING, time=limit)], profile) == [(), ()]
    assert judged([STANDING, replace(STANDING, time=limit + 1e-9)], profile) == [(), ("gap",)]


@pytest.mark.parametrize(("speed", "reasons"), [(2.0, ()), (2.001, ("velocity_jump",))])
@pytest.mark.parametrize("axis", ["velocity_north", "velocity_east"])
def test_a_velocity_changes_by_what_a_car_can_and_noise(axis, speed, reasons):
    """12 m/s2 for 0.125 s and 0.5 m/s of noise are 2 m/s."""
    assert judged([STANDING, replace(STANDING, time=STEP, **{axis: speed})]) == [(), reasons]


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_heading_changes_by_its_limit_at_most(sign):
    three = fixes(3)
    assert judged(moved(three, 2, turn=sign * 0.05)) == [(), (), ()]
    assert judged(moved(three, 2, turn=sign * 0.051)) == [(), (), ("heading_jump",)]
    assert judged(moved(three, 2, turn=sign * 0.051), NMEA) == [(), (), ()]


def test_a_missing_heading_is_its_own_reason_and_no_jump():
    three = fixes(3)
    three[1] = replace(three[1], heading=math.nan)
    assert judged(three) == [(), ("heading_invalid",), ()]


@pytest.mark.parametrize(("metres", "reasons"), [(0.2967, ()), (0.2971, ("pose_jump",))])
@pytest.mark.parametrize(("north", "east"), [(1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0), (0.6, 0.8)])
def test_a_position_jumps_by_its_limit_and_what_braking_explains(north, east, metres, reasons):
    """0.25 m, and a quarter of 12 m/s2 times 0.125 s squared: the two velocities' mean is wrong by no more."""
    verdicts = judged(moved(fixes(2), 1, north * metres, east * metres))
    assert verdicts == [(), reasons]


def test_finite_numbers_beyond_all_reason_are_refused():
    """The way between the fixes and the way that the velocities lead are infinite both, and their difference is NaN."""
    absurd = {"velocity_north": 1.7e308, "heading": math.pi / 2.0}
    one, two = replace(STANDING, latitude=-1e303, **absurd), replace(STANDING, time=STEP, latitude=1e303, **absurd)
    assert "pose_jump" in judged([one, two])[1]


def test_the_date_line_is_no_jump():
    these = [
        replace(fix, velocity_east=10.0, longitude=math.remainder(math.pi + 10.0 * (fix.time - 1.0) / RADIUS, math.tau))
        for fix in fixes(20)
    ]
    assert these[0].longitude > 0.0 > these[-1].longitude
    assert judged(these) == [()] * 20


def test_a_fix_from_the_future_leaves_no_trace():
    gate = TrustGate(DRIVE, 0.0)
    assert gate.step(0.0, STANDING).trusted
    assert gate.step(STEP, replace(STANDING, time=100.0)).reasons == ("fix_from_future",)
    assert gate.step(STEP, replace(STANDING, time=STEP)).trusted


# What is neither position, horizontal velocity nor heading: a jump costs its fix alone.


def close(count: int) -> list[Fix]:
    """A standing car's fixes, two a step: where one is refused, the next is no gap yet."""
    return [replace(STANDING, time=8.0 + 0.5 * k * STEP) for k in range(count)]


@pytest.mark.parametrize(
    ("field", "limit", "reason"),
    [
        ("altitude", 0.51171875, "altitude_jump"),  # 0.5 m, and a quarter of 12 m/s2 times 0.0625 s squared
        ("velocity_down", 1.25, "altitude_jump"),  # 12 m/s2 for 0.0625 s and 0.5 m/s of noise
        ("pitch", 0.0625 + 0.01, "tilt_jump"),  # 1 rad/s for 0.0625 s and 0.01 rad of noise
        ("roll", 0.0625 + 0.01, "tilt_jump"),
        ("yaw_rate", 0.625 + 0.1, "motion_jump"),  # 10 rad/s2 for 0.0625 s and 0.1 rad/s of noise
        ("acceleration", 12.0, "motion_jump"),
    ],
)
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_one_step_is_refused_alone(field, limit, reason, sign):
    for size, reasons in ((limit - 1e-4, ()), (limit, ()), (limit + 1e-4, (reason,))):
        three = close(3)
        three[1] = replace(three[1], **{field: getattr(STANDING, field) + sign * size})
        assert judged(three) == [(), reasons, ()]


@pytest.mark.parametrize(
    ("fields", "jumped", "reasons"),
    [
        ({"pitch": 0.3}, {"pitch": 0.37}, ()),
        ({"pitch": 0.3}, {"pitch": 0.22}, ("tilt_jump",)),
        ({"roll": -0.3}, {"roll": -0.37}, ()),
        ({"roll": -0.3}, {"roll": -0.38}, ("tilt_jump",)),
        ({"acceleration": 8.0}, {"acceleration": 19.0}, ()),
        ({"acceleration": 8.0}, {"acceleration": -5.0}, ("motion_jump",)),
    ],
)
def test_a_step_is_counted_from_the_fix_before(fields, jumped, reasons):
    one, two = close(2)
    assert judged([replace(one, **fields), replace(two, **jumped)]) == [(), reasons]


def test_such_a_step_is_one_up_to_the_limit_of_a_gap():
    there = {"altitude": 255.0}
    assert judged([STANDING, replace(STANDING, time=0.15, **there)]) == [(), ("altitude_jump",)]
    assert judged([STANDING, replace(STANDING, time=0.15 + 1e-9, **there)]) == [(), ("gap",)]


@pytest.mark.parametrize(("rate", "reasons"), [(2.0, ()), (2.3, ("motion_jump",))])
def test_the_yaw_rate_of_differenced_headings_may_jump_farther(rate, reasons):
    """10 rad/s2 for 0.125 s and 0.8 rad/s of noise are 2.05 rad/s."""
    one, two = replace(STANDING, yaw_rate=0.5 * rate), replace(STANDING, time=STEP, yaw_rate=-0.5 * rate)
    assert judged([one, two], NMEA) == [(), reasons]


@pytest.mark.parametrize(("down", "altitude", "reasons"), [
    (-4.0, 1.0, ()), (-4.0, 0.5, ()), (-4.0, 0.04, ()), (-4.0, -0.06, ("altitude_jump",)),
    (4.0, -1.04, ()), (4.0, -1.06, ("altitude_jump",)), (4.0, 0.06, ("altitude_jump",)),
])  # fmt: skip
def test_the_altitude_is_where_the_vertical_velocities_lead(down, altitude, reasons):
    """4 m/s for 0.125 s are 0.5 m, give or take 0.547 m."""
    one, two = (replace(STANDING, time=k * STEP, velocity_down=down) for k in range(2))
    assert judged([one, replace(two, altitude=STANDING.altitude + altitude)]) == [(), reasons]


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(("east", "limit"), [(0.0, 0.546875), (8.0, 1.046875)])
def test_where_no_vertical_velocity_is_said_the_altitude_is_within_the_steepest_road(east, limit, sign):
    """8 m/s for 0.125 s are 1 m; half of it may be climbed."""
    one = replace(STANDING, velocity_east=east, velocity_down=math.nan)
    for size, reasons in ((limit - 1e-4, ()), (limit + 1e-4, ("altitude_jump",))):
        there = replace(one, time=STEP, longitude=east * STEP / RADIUS, altitude=STANDING.altitude + sign * size)
        assert judged([one, there]) == [(), reasons]


@pytest.mark.parametrize("field", ["altitude", "pitch", "roll", "velocity_down"])
def test_what_is_not_said_is_nothing_to_compare_with(field):
    three = fixes(3)
    three[1] = replace(three[1], **{field: math.nan})
    assert judged(three, NMEA) == [(), (), ()]


@pytest.mark.parametrize(
    ("lie", "reason"),
    [
        ({"velocity_north": math.nan}, "not_finite"),
        ({"altitude": 300.0}, "altitude_jump"),
        ({"altitude": 9000.0}, "altitude_absurd"),
        ({"velocity_down": 3.0}, "altitude_jump"),
        ({"pitch": 0.3}, "tilt_jump"),
        ({"roll": -1.0}, "tilt_absurd"),
        ({"yaw_rate": 1.9}, "motion_jump"),
        ({"yaw_rate": -50.0}, "motion_absurd"),
        ({"acceleration": 15.0}, "motion_jump"),
        ({"acceleration": -500.0}, "motion_absurd"),
    ],
)
def test_such_a_fix_leaves_no_trace_whatever_else_it_says(lie, reason):
    """Its position and heading, 5 m and 1 rad off, are not compared with anything: the next true one is trusted."""
    three = close(3)
    three[1] = replace(three[1], latitude=5.0 / RADIUS, heading=1.0, **lie)
    assert judged(three) == [(), (reason,), ()]


def test_such_a_step_that_stays_is_a_gap_and_then_settles():
    """Two are refused, the third comes 0.1875 s after the last that counted."""
    these = [replace(fix, altitude=250.0 if k < 5 else 255.0) for k, fix in enumerate(close(20))]
    assert judged(these) == [()] * 5 + [("altitude_jump",)] * 2 + [("gap",)] + [("settling",)] * 7 + [()] * 5


def test_such_a_step_of_a_recording_is_judged_by_its_own_limits():
    steps = {"altitude": 400.0, "yaw_rate": 1.9, "acceleration": 19.0}
    assert judged([STANDING, replace(STANDING, time=STEP, **steps)], PLAYBACK) == [(), ()]


# Over half a second.


@pytest.mark.parametrize(("north", "east"), [(1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0), (0.6, 0.8)])
def test_two_small_steps_within_half_a_second_are_a_drift(north, east):
    """At 1.0 s the car is here, at 1.125 s 0.15 m away, at 1.5 s another 0.15 m: from 1.0 to 1.5 it is 0.30 m."""
    once = moved(fixes(20), 9, 0.15 * north, 0.15 * east)
    assert judged(once) == [()] * 20
    twice = moved(once, 12, 0.15 * north, 0.15 * east)
    assert judged(twice)[:13] == [()] * 12 + [("pose_drift",)]
    # From 1.125 to 1.625 it is 0.15 m.
    apart = moved(once, 13, 0.15 * north, 0.15 * east)
    assert judged(apart) == [()] * 20


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_two_small_turns_within_half_a_second_are_a_drift(sign):
    once = moved(fixes(20), 9, turn=sign * 0.03)
    assert judged(once) == [()] * 20
    assert judged(moved(once, 12, turn=sign * 0.03))[:13] == [()] * 12 + [("heading_drift",)]
    assert judged(moved(once, 13, turn=sign * 0.03)) == [()] * 20


@pytest.mark.parametrize(("north", "east", "turn"), [(0.4, 0.0, 0.0), (0.0, 0.4, 0.0), (0.0, 0.0, 0.08)])
def test_what_creeps_slower_than_the_limit_in_half_a_second_is_no_drift_however_long(north, east, turn):
    """0.4 m/s are 0.2 m in half a second, 0.08 rad/s are 0.04 rad."""
    these = fixes(80)
    for k in range(1, 80):
        these = moved(these, k, north * STEP, east * STEP, turn * STEP)
    assert judged(these) == [()] * 80


# What a history makes of it.


def settled_after(verdicts: list[tuple[str, ...]], start: int) -> int:
    """How many fixes from `start` on are refused for settling alone, before the first trusted one."""
    number = 0
    while verdicts[start + number] == ("settling",):
        number += 1
    assert verdicts[start + number] == ()
    return number


@pytest.mark.parametrize(
    ("steps", "at", "last"),
    [
        ({9: {"north": 0.5}}, ("pose_jump",), 9),
        ({9: {"turn": -0.03}, 11: {"turn": 0.06}, 12: {"turn": -0.02}}, ("heading_jump",), 11),  # in all no drift
        ({9: {"north": 0.15}, 12: {"north": 0.15}}, ("pose_drift",), 12),
        ({9: {"turn": 0.03}, 12: {"turn": 0.03}}, ("heading_drift",), 12),
    ],
)
def test_after_each_of_these_fixes_must_agree_for_half_a_second(steps, at, last):
    """Half a second is four fixes; the one that comes after it to the tick is trusted."""
    these = fixes(40)
    for start, offset in steps.items():
        these = moved(these, start, **offset)
    verdicts = judged(these)
    assert verdicts[last] == at
    assert settled_after(verdicts, last + 1) == 3


def test_after_a_jump_of_the_velocity_fixes_must_agree_for_half_a_second():
    these = [
        replace(fix, velocity_east=2.5, longitude=2.5 * (fix.time - 1.0) / RADIUS) if fix.time >= 1.0 else fix
        for fix in fixes(40)
    ]
    verdicts = judged(these)
    assert verdicts[8] == ("velocity_jump",)
    assert settled_after(verdicts, 9) == 3


def test_after_a_gap_fixes_must_agree_for_half_a_second():
    these = fixes(40)
    verdicts = judged(these[:9] + these[11:])
    assert verdicts[9] == ("gap",)
    assert settled_after(verdicts, 10) == 3


@pytest.mark.parametrize("break_", ["gap", "pose_jump", "heading_jump", "velocity_jump"])
def test_after_a_gap_or_a_jump_drift_is_counted_anew(break_):
    """0.15 m before and 0.15 m after it, less than 0.5 s apart: neither is compared with the other."""
    these = moved(moved(fixes(20), 9, north=0.15), 12, north=0.15)
    if break_ == "gap":
        del these[10]
    elif break_ == "pose_jump":
        these = moved(these, 10, north=5.0)
    elif break_ == "heading_jump":
        these = moved(these, 10, turn=0.06)
    else:
        rolling = {"velocity_east": 2.5}
        these[10:] = [replace(f, longitude=2.5 * (f.time - 1.25) / RADIUS, **rolling) for f in these[10:]]
    verdicts = judged(these)
    assert verdicts[10] == (break_,)
    assert "pose_drift" not in {reason for verdict in verdicts for reason in verdict}
