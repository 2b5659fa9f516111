"""When a position that stays the same counts as frozen, on fine wires and on those that say positions in steps."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.fixes import GOOD as STANDING
from tests.pose.test_trust_figures import RADIUS, STEP, fixes, judged
from vve_sumo.pose.trust import DRIVE, NMEA, OXTS_CAN, UBX, TrustProfile
from vve_sumo.values import Fix


@pytest.mark.parametrize(
    ("before", "after", "reasons"),
    [
        (0.2, 0.2, ()),
        (0.201, 0.201, ("frozen_pose",)),
        (0.0, 0.5, ()),  # it begins to move
        (0.5, 0.0, ()),  # it has come to rest
    ],
)
def test_a_pose_is_frozen_when_both_fixes_say_that_the_car_moves(before, after, reasons):
    one, two = (replace(STANDING, time=k * STEP, velocity_east=v) for k, v in enumerate((before, after)))
    assert judged([one, two]) == [(), reasons]


#: 1e-7 degrees, and the fifth decimal of a minute, along a meridian [m]
STEPS = {"oxts_can": math.radians(1e-7) * 6_378_137.0, "nmea": math.radians(1e-5 / 60.0) * 6_378_137.0}
STEPS["ubx"] = STEPS["oxts_can"]

DRIVES = {
    "profile": st.sampled_from([OXTS_CAN, NMEA, UBX]),
    "course": st.floats(-math.pi, math.pi),
    "rate": st.sampled_from([10.0, 20.0, 50.0, 100.0]),
    "seed": st.integers(0, 2**32 - 1),
}


def test_a_step_of_positions_is_that_of_the_wire():
    assert {profile.name: profile.position_step for profile in (OXTS_CAN, NMEA, UBX)} == pytest.approx(STEPS, abs=1e-4)
    assert replace(OXTS_CAN, name="drive", position_step=0.0) == DRIVE


def coarse(profile: TrustProfile, speed: float, course: float, rate: float, seed: int, frozen_at: int = 0) -> list[Fix]:
    """Five seconds of a straight drive as a wire with steps says them, with 3 mm of noise; frozen from a fix on."""
    random, step = np.random.default_rng(seed), STEPS[profile.name] / RADIUS
    said, north, east = [], 0.37 * step, 0.0
    for k in range(round(5.0 * rate)):
        noise = 0.003 * random.standard_normal(2) / RADIUS
        place = [round((one + off) / step) * step for one, off in zip((north, east), noise, strict=True)]
        if frozen_at and k >= frozen_at:
            place = [said[-1].latitude, said[-1].longitude]
        velocity = {"velocity_north": speed * math.sin(course), "velocity_east": speed * math.cos(course)}
        fix = replace(STANDING, time=k / rate, latitude=place[0], longitude=place[1], heading=course, **velocity)
        said.append(fix)
        north, east = (north + fix.velocity_north / rate / RADIUS, east + fix.velocity_east / rate / RADIUS)
    return said


@given(speed=st.floats(0.15, 6.0), **DRIVES)
def test_a_car_whose_wire_says_positions_in_steps_is_not_frozen(profile, speed, course, rate, seed):
    found = [reasons for reasons in judged(coarse(profile, speed, course, rate, seed), profile) if reasons]
    assert not any("frozen_pose" in reasons for reasons in found)


@given(speed=st.floats(0.3, 6.0), **DRIVES)
def test_a_position_in_steps_that_freezes_is_found_within_a_few_steps(profile, speed, course, rate, seed):
    """Once the car has gone three diagonals of a step: 5 cm of an OXTS unit, 8 cm of NMEA."""
    at = round(2.0 * rate)
    verdicts = judged(coarse(profile, speed, course, rate, seed, frozen_at=at), profile)
    found = next(k for k, reasons in enumerate(verdicts) if k >= at and "frozen_pose" in reasons)
    assert (found - at) * speed / rate <= 3.0 * math.sqrt(2.0) * STEPS[profile.name] + speed / rate


def staying(speeds: list[float]) -> list[Fix]:
    """Fixes with one position, a hundredth of a second apart."""
    return [replace(STANDING, time=0.01 * k, velocity_east=speed) for k, speed in enumerate(speeds)]


def test_a_way_without_another_position_counts_anew_after_the_car_was_slow():
    verdicts = judged(staying([0.26] * 10 + [0.19] * 3 + [0.26] * 10), OXTS_CAN)
    assert verdicts == [()] * 23


def test_a_way_without_another_position_counts_anew_after_a_gap():
    stays = staying([0.26] * 20)
    late = [replace(fix, time=fix.time + 1.0) for fix in stays]
    first = [k for k, reasons in enumerate(judged(stays, OXTS_CAN)) if "frozen_pose" in reasons]
    both = [k for k, reasons in enumerate(judged([*stays, *late], OXTS_CAN)) if "frozen_pose" in reasons]
    assert first == list(range(13, 20)), "0.0026 m a step, beyond 0.0317 m"
    assert both == [*first, *(20 + k for k in first)]


@pytest.mark.parametrize("axis", ["north", "east"])
def test_driving_along_a_meridian_or_a_parallel_is_not_frozen(axis):
    speed = {f"velocity_{axis}": 10.0, "heading": math.pi / 2.0 if axis == "north" else 0.0}
    these = [
        replace(fix, **speed, **{"latitude" if axis == "north" else "longitude": 10.0 * fix.time / RADIUS})
        for fix in fixes(20)
    ]
    assert judged(these) == [()] * 20
