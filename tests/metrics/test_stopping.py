"""The last stop, found in tables made from closed forms, and in a real drive with many."""

from __future__ import annotations

import csv
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.analysis.made import CAR
from vve_sumo import laws
from vve_sumo.metrics.stopping import AT_REST, DRIVE_LAG, Stop, last_stop
from vve_sumo.values import Floats

PERIOD = 0.02
KMH = 1.0 / 3.6
Columns = tuple[Floats, Floats, Floats]


def find(
    granted: Floats, speed: Floats, acceleration: Floats, state: str | list[str] = "engaged", limit: float = 9.0
) -> Stop | None:
    """The last stop in a table of these columns."""
    time = PERIOD * np.arange(len(speed))
    columns = {
        "time_s": time,
        "granted_acceleration_mps2": granted,
        "state": [state] * len(speed) if isinstance(state, str) else state,
    }
    return last_stop(pa.table(columns), speed, acceleration, limit)


def braked(speed: float, a: float, delay: float = 0.0, build_up: float = 0.0, lead_in: float = 1.0) -> Columns:
    """Granted, speed and acceleration of a car that is granted a after `lead_in` and does what the closed form says."""
    end = lead_in + laws.stopping_time(speed, a, delay, build_up) + 1.0
    time = PERIOD * np.arange(round(end / PERIOD)) - lead_in
    since = np.maximum(time - delay, 0.0)
    ramp = np.minimum(since, build_up)
    jerk = a / build_up if build_up else 0.0
    lost = 0.5 * jerk * ramp**2 + a * (since - ramp)
    left = np.maximum(speed - lost, 0.0)
    braking = np.where(since > 0.0, a if not build_up else jerk * ramp, 0.0)
    return np.where(time > -1e-9, -a, 0.0), left, np.where(left > 0.0, -braking, 0.0)


def found(*columns: Floats, state: str = "engaged", limit: float = 9.0) -> Stop:
    stop = find(*columns, state=state, limit=limit)
    assert stop is not None
    return stop


@pytest.mark.parametrize(
    ("tau", "a", "jerk", "kmh", "metres"),
    [
        (0.1, 9.0, 30.0, 20.0, 3.07),
        (0.1, 9.0, 30.0, 40.0, 9.60),
        (0.1, 9.0, 30.0, 60.0, 19.57),
        (0.1, 9.0, 30.0, 80.0, 32.96),
        (0.3, 6.0, 12.0, 20.0, 5.57),
        (0.3, 6.0, 12.0, 40.0, 16.34),
        (0.3, 6.0, 12.0, 60.0, 32.25),
        (0.3, 6.0, 12.0, 80.0, 53.31),
    ],
)
def test_a_delay_a_ramp_and_a_plateau_come_out_as_they_went_in(
    tau: float, a: float, jerk: float, kmh: float, metres: float
) -> None:
    v, rise = kmh * KMH, a / jerk
    stop = found(*braked(v, a, tau, rise))
    assert (stop.onset, stop.onset_speed) == (50, pytest.approx(v))
    assert stop.demand == pytest.approx(a, rel=1e-9)
    assert stop.reaction == pytest.approx((tau, v * tau), abs=1e-9)
    assert stop.build_up.duration == pytest.approx(rise, abs=1e-9)
    # The speed is taken as straight between two ticks: half a thousandth of a metre here, and the last tick's piece.
    assert stop.build_up.distance == pytest.approx(v * rise - a * rise**2 / 6.0, abs=5e-4)
    assert stop.braking.distance == pytest.approx((v - 0.5 * a * rise) ** 2 / (2.0 * a), abs=2e-3)
    assert stop.distance == pytest.approx(metres, abs=0.0075)
    assert stop.distance == stop.reaction.distance + stop.build_up.distance + stop.braking.distance
    assert stop.duration == pytest.approx(laws.stopping_time(v, a, tau, rise), abs=PERIOD)


@given(v=st.floats(2.0, 40.0), a=st.floats(1.0, 9.0), lead_in=st.floats(0.0, 2.0))
def test_a_constant_course_is_its_own_demand_and_its_own_mfdd(v: float, a: float, lead_in: float) -> None:
    stop = found(*braked(v, a, lead_in=PERIOD * round(lead_in / PERIOD)))
    assert stop.demand == pytest.approx(a, rel=1e-9)
    assert stop.mfdd == pytest.approx(a, rel=1e-9)
    assert stop.distance == pytest.approx(v * v / (2.0 * a), abs=0.5 * a * PERIOD**2 + AT_REST**2 / (2.0 * a))


@given(
    v=st.floats(3.0, 30.0),
    course=st.lists(st.floats(0.6, 12.0), min_size=1, max_size=200),
    limit=st.floats(1.0, 9.0),
)
def test_the_demand_stops_where_the_granted_course_would(v: float, course: list[float], limit: float) -> None:
    """Step by step, by a car that takes a minute to come to rest; each deceleration holds until the next tick."""
    course += [course[-1]] * 3000
    left, driven = v, 0.0
    for a in (min(a, limit) for a in course):
        if left <= a * PERIOD:
            driven += left * left / (2.0 * a)
            break
        driven += left * PERIOD - 0.5 * a * PERIOD**2
        left -= a * PERIOD
    speed = np.linspace(v, 0.0, len(course))
    stop = found(-np.array(course), speed, np.full(len(course), -0.4), limit=limit)
    assert stop.onset == 0
    assert stop.demand == pytest.approx(v * v / (2.0 * driven), rel=1e-9)


def test_a_car_that_brakes_harder_than_it_was_told_was_told_no_more() -> None:
    granted, speed, acceleration = braked(10.0, 4.0)
    assert found(0.5 * granted, speed, acceleration).demand == pytest.approx(2.0, rel=1e-9)


def test_a_car_that_never_gives_what_was_granted_has_risen_when_it_gives_its_most() -> None:
    """A tenth of the way in there is no telling how far it goes: the rise is that of what came."""
    granted, speed, acceleration = braked(15.0, 3.0, delay=0.2, build_up=0.4)
    stop = found(2.0 * granted, speed, acceleration)
    assert (stop.reaction.duration, stop.build_up.duration) == pytest.approx((0.2, 0.4), abs=1e-9)


def joined(*parts: Columns) -> Columns:
    granted, speed, acceleration = (np.concatenate(columns) for columns in zip(*parts, strict=True))
    return granted, speed, acceleration


def steady(granted: float, speed: float, to: float, seconds: float) -> Columns:
    """A stretch over which the speed goes straight from one to another."""
    ticks = round(seconds / PERIOD)
    return np.full(ticks, granted), np.linspace(speed, to, ticks), np.full(ticks, (to - speed) / seconds)


def test_of_several_stops_it_is_the_last() -> None:
    again = joined(braked(10.0, 5.0), steady(1.5, 0.0, 6.0, 4.0), braked(6.0, 3.0))
    stop = found(*again)
    assert (stop.onset_speed, stop.demand) == pytest.approx((6.0, 3.0))
    gone_on = joined(again, steady(1.5, 0.0, 6.0, 4.0))
    assert found(*gone_on) == stop


def test_a_speed_that_trembles_at_rest_is_no_new_stop() -> None:
    first = braked(10.0, 5.0)
    standing = steady(-2.0, 0.0, 0.0, 4.0)
    standing[1][:] = 0.2 * np.abs(np.sin(np.arange(len(standing[1]))))
    assert found(*joined(first, standing)) == found(*first)


def test_trim_far_ahead_is_no_braking_and_easing_off_is_part_of_it() -> None:
    """What goes before and after leaves the onset where it was; the rise of a course belongs to it."""
    trim = steady(-0.3, 10.9, 10.1, 3.0)
    rise, braking = steady(0.0, 10.1, 9.8, 0.2), steady(-2.0, 9.8, 1.0, 4.4)
    rise[0][:] = -np.linspace(0.35, 1.9, len(rise[0]))
    eased, hold = steady(-0.35, 1.0, 0.5, 1.5), steady(-0.6, 0.5, 0.0, 1.0)
    stop = found(*joined(steady(0.0, 11.0, 10.9, 1.0), trim, rise, braking, eased, hold))
    assert stop.onset in (50 + 149, 50 + 150)
    assert stop.rest >= stop.onset + 10 + 220 + 75


def test_a_trim_that_creeps_up_is_no_onset() -> None:
    """A speed keeper asks for a little more every tick before the brake sets in."""
    creeping, braking = steady(0.0, 11.0, 11.0, 1.0), braked(11.0, 3.0, lead_in=0.0)
    creeping[0][:] = -np.linspace(1e-4, 5e-3, len(creeping[0]))
    assert found(*joined(steady(0.0, 11.0, 11.0, 1.0), creeping, braking)).onset == 100


def test_a_demand_that_creeps_up_is_trim_until_it_sets_in() -> None:
    creeping, rise = steady(0.0, 11.0, 10.5, 3.0), steady(0.0, 10.5, 10.2, 0.2)
    creeping[0][:], rise[0][:] = -np.linspace(0.0, 0.3, 150), -np.linspace(0.4, 2.0, 10)
    assert found(*joined(creeping, rise, steady(-2.0, 10.2, 0.0, 5.0))).onset == 150


def test_a_gentle_stop_is_found_and_one_without_command_is_not() -> None:
    gentle = steady(-0.3, 5.0, 0.0, 16.0)
    assert found(*joined(steady(0.0, 5.0, 5.0, 1.0), gentle)).onset == 50
    assert find(*joined(steady(0.0, 5.0, 5.0, 1.0), steady(-0.05, 5.0, 0.0, 30.0))) is None


def test_coasting_to_rest_is_no_stop_whatever_was_braked_before() -> None:
    earlier = steady(0.0, 9.0, 9.0, 1.0), steady(-3.0, 9.0, 3.0, 2.0), steady(1.0, 3.0, 5.0, 2.0)
    assert find(*joined(*earlier, steady(-0.05, 5.0, 0.0, 30.0))) is None


@pytest.mark.parametrize("rest", [0.0, 0.02])
def test_a_brake_that_only_holds_the_car_at_rest_is_no_stop(rest: float) -> None:
    assert find(*joined(steady(0.0, 2.0, rest, 2.0), steady(-1.0, rest, rest, 1.0))) is None


def test_mfdd_counts_over_distance_from_eight_tenths_to_one_tenth() -> None:
    """From 10 m/s at 2 down to 5 m/s, then at 5: (0.64 - 0.25) v^2 / 4 and (0.25 - 0.01) v^2 / 10 of way."""
    parts = steady(-2.0, 10.0, 5.04, 2.5), braked(5.0, 5.0, lead_in=0.0)
    parts[0][1][:] = 10.0 - 2.0 * PERIOD * np.arange(125)
    stop = found(*joined(*parts))
    assert stop.mfdd == pytest.approx(63.0 / (2.0 * (39.0 / 4.0 + 24.0 / 10.0)), rel=1e-9)


def test_a_long_creep_parts_two_brakings() -> None:
    first, creep = steady(-4.0, 12.0, 2.0, 2.5), steady(0.0, 2.0, 2.0, 5.0)
    stop = found(*joined(steady(0.0, 12.0, 12.0, 1.0), first, creep, braked(2.0, 2.0, lead_in=0.0)))
    assert (stop.onset_speed, stop.demand) == pytest.approx((2.0, 2.0))


@pytest.mark.parametrize(
    ("state", "is_one"), [("stopping", True), ("stopped", True), ("fault", False), ("ready", False)]
)
def test_the_gateways_own_stop_counts_and_a_drivers_does_not(state: str, is_one: bool) -> None:
    assert (find(*braked(10.0, 2.4), state=state) is not None) == is_one


def test_a_stop_that_the_driver_finished_is_none() -> None:
    granted, speed, acceleration = braked(10.0, 5.0)
    states = ["engaged"] * 100 + ["fault"] * (len(speed) - 100)
    assert find(granted, speed, acceleration, states[0]) is not None
    assert find(granted, speed, acceleration, states) is None


def test_a_push_in_the_middle_of_a_braking_is_part_of_its_course() -> None:
    """A second at 3 from 6 m/s, half a second at -1, then 3 to rest: ways of 4.5, 1.625 and 3.5^2 / 6."""
    parts = steady(-3.0, 6.0, 3.0, 1.0), steady(1.0, 3.0, 3.2, 0.5), steady(-3.0, 3.2, 0.0, 3.0)
    stop = found(*joined(*parts))
    assert stop.onset == 0
    assert stop.demand == pytest.approx(6.0**2 / (2.0 * (4.5 + 1.625 + 3.5**2 / 6.0)), rel=1e-9)


def test_a_drive_without_a_rest_after_motion_has_no_stop() -> None:
    granted, speed, acceleration = braked(10.0, 5.0)
    moving = slice(0, 100)
    assert speed[99] > 0.05
    assert find(granted[moving], speed[moving], acceleration[moving]) is None
    assert find(*steady(-2.0, 0.0, 0.0, 2.0)) is None
    assert find(*steady(math.nan, math.nan, math.nan, 2.0)) is None


def test_a_car_that_gains_speed_until_late_brakes_answer_was_to_brake_from_the_command_on() -> None:
    late = steady(1.5, 4.0, 7.0, 2.0), steady(-3.0, 7.0, 7.75, 0.5), steady(-3.0, 7.75, 0.0, 3.0)
    stop = found(*joined(*late))
    assert (stop.onset, stop.onset_speed) == (100, 7.0)
    assert stop.distance == pytest.approx(0.5 * (7.0 + 7.75) * 0.5 + 0.5 * 7.75 * 3.0, rel=0.02)


def test_a_speed_that_nobody_knew_in_the_middle_of_a_braking_leaves_no_distance() -> None:
    granted, speed, acceleration = braked(10.0, 2.4)
    speed[80:120], acceleration[80:120] = math.nan, math.nan
    stop = found(granted, speed, acceleration)
    assert (stop.onset, stop.onset_speed) == (50, 10.0)
    assert math.isnan(stop.distance)


def test_what_nobody_knew_before_the_stop_does_not_hide_it() -> None:
    unknown = steady(math.nan, math.nan, math.nan, 0.5)
    one, other = found(*braked(10.0, 5.0)), found(*joined(unknown, braked(10.0, 5.0)))
    assert (other.onset, other.distance, other.mfdd) == (one.onset + 25, one.distance, one.mfdd)


def test_stops_of_a_real_drive(shared_data: Path) -> None:
    """Of a suburban drive with many stops, cut after each; distances against the positions, nobody's integral."""
    file = shared_data / "drives" / "boreas" / "boreas-2021-09-02-11-42_lidar_poses.csv"
    with file.open(encoding="utf-8") as lines:
        rows = [
            [float(row[n]) for n in ("GPSTime", "easting", "northing", "vel_east", "vel_north")]
            for row in csv.DictReader(lines)
        ]
    columns = np.array(rows).T
    time, speed = (columns[0] - columns[0, 0]) / 1e6, np.hypot(columns[3], columns[4])
    driven = np.concatenate(([0.0], np.cumsum(np.hypot(np.diff(columns[1]), np.diff(columns[2])))))
    acceleration = np.append(np.diff(speed) / np.diff(time), 0.0)
    table = pa.table({"time_s": time, "granted_acceleration_mps2": acceleration, "state": ["engaged"] * len(time)})
    ends = np.flatnonzero((speed < AT_REST) & (np.append(speed[1:], 1.0) >= AT_REST))
    stops = {
        stop
        for end in ends.tolist()
        if (stop := last_stop(table[: end + 1], speed[: end + 1], acceleration[: end + 1]))
    }
    assert len(stops) == 8
    for stop in stops:
        assert stop.distance == pytest.approx(driven[stop.rest] - driven[stop.onset], rel=0.01, abs=0.1)
        assert stop.demand == pytest.approx(stop.onset_speed**2 / (2.0 * stop.distance), rel=0.05)
        fast, slow = (passed(speed, driven, stop, share * stop.onset_speed) for share in (0.8, 0.1))
        expected = 0.63 * stop.onset_speed**2 / (2.0 * (slow - fast))
        assert stop.mfdd == pytest.approx(expected, rel=0.04)


def passed(speed: Floats, driven: Floats, stop: Stop, level: float) -> float:
    """Distance at which the speed first falls to a level after the onset, straight between two poses."""
    after = next(i for i in range(stop.onset, len(speed)) if speed[i] <= level)
    return float(np.interp(level, speed[[after, after - 1]], driven[[after, after - 1]]))


def test_the_bound_is_the_closed_form_and_a_lag_stays_within_it() -> None:
    """A first-order lag T costs v T - a T^2 / 2 of way; the ramp that stands for it, no less."""
    v, a = 12.0, 5.0
    stop = found(*braked(v, a))
    lag, delay, latency = CAR.brake_lag, CAR.brake_delay, 0.03
    bound = stop.bound(CAR, latency)
    assert bound == laws.stopping_distance(v, stop.demand, latency + delay, 2.0 * lag)
    needed = v * (latency + delay) + v * v / (2.0 * a) + v * lag - 0.5 * a * lag**2
    assert needed <= bound <= needed + a * lag**2


def test_a_car_that_still_gains_speed_is_granted_what_its_throttle_leaves() -> None:
    """Against such a car stepped through: dead time at full push, then the push fades while the brakes hold at once."""
    v, a, push, step = 6.5, 5.0, 1.5, 1e-4
    granted, speed, acceleration = braked(v, a)
    acceleration[:51] = push
    left, driven, time = v, 0.0, 0.0
    while left > 0.0:
        since = time - CAR.brake_delay
        left += step * (push if since < 0.0 else push * math.exp(-since / DRIVE_LAG) - a)
        driven, time = driven + step * left, time + step
    bound = found(granted, speed, acceleration).bound(replace(CAR, brake_lag=0.0))
    assert driven <= bound <= 1.05 * driven
