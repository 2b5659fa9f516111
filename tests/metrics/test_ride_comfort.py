"""The comfort of rides against closed forms, on arrays and on the tables of a drive."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad

from tests.metrics.tables import PERIOD, actors_of, drive_of, ticks_of
from tests.metrics.test_frequency_weighting import GOALS_WD, GOALS_WF
from vve_sumo.metrics.drive_data import DriveData
from vve_sumo.metrics.per_drive import OF_RIDE, PER_DRIVE
from vve_sumo.metrics.per_tick import PER_TICK
from vve_sumo.metrics.ride_comfort import (
    MARGIN,
    REACTIONS,
    Ride,
    RideComfort,
    lateral_acceleration,
    reactions,
    ride_comfort,
    ride_of,
)
from vve_sumo.values import Floats

FORWARD, LEFT = 1.5, 0.8  #: amplitudes [m/s2]


def ride(longitudinal: Floats, lateral: Floats) -> Ride:
    return Ride(PERIOD, PERIOD * np.arange(len(longitudinal)), longitudinal, lateral)


def swaying(duration: float, hertz: float) -> Ride:
    """Both accelerations as sines in phase that begin at 0."""
    sine = np.sin(2.0 * math.pi * hertz * PERIOD * np.arange(round(duration / PERIOD) + 1))
    return ride(FORWARD * sine, LEFT * sine)


def of_arrays(time: Floats, speed: Floats, longitudinal: Floats) -> RideComfort:
    """The comfort of a ride that goes straight."""
    found = ride_of(time, speed, longitudinal, np.zeros_like(time), PERIOD)
    assert found is not None
    return ride_comfort(found)


def test_a_long_sine_has_the_root_mean_squares_of_the_standards_factors() -> None:
    """1 Hz, where Wd is 1.011, for ten minutes; the start costs less than a thousandth."""
    felt, size = ride_comfort(swaying(600.0, 1.0)), GOALS_WD[0] / math.sqrt(2.0)
    assert felt.longitudinal == pytest.approx(FORWARD * size, rel=2e-3)
    assert felt.lateral == pytest.approx(LEFT * size, rel=2e-3)
    assert felt.total == pytest.approx(math.hypot(FORWARD, LEFT) * size, rel=2e-3)
    # Over whole periods of one sine every second has the same root mean square, once the start is forgotten.
    assert felt.running[-1] == pytest.approx(felt.total, rel=2e-3)


@pytest.mark.thorough
def test_the_sickness_dose_grows_with_the_root_of_time() -> None:
    """10^(-0.7) = 0.1995 Hz, where Wf is 0.9928."""
    for duration in (600.0, 2400.0):
        felt = ride_comfort(swaying(duration, 10.0**-0.7))
        dose = math.hypot(FORWARD, LEFT) * GOALS_WF[-7] * math.sqrt(0.5 * duration)
        assert felt.sickness_dose == pytest.approx(dose, rel=0.01)


def test_a_steady_acceleration_is_felt_as_it_begins_and_not_for_long() -> None:
    """Wd is 0 at 0 Hz: of a long braking it knows the beginning, whose energy is Parseval's integral."""

    def density(hertz: float) -> float:
        band, ratio = hertz**4 / (hertz**4 + 0.4**4), (hertz / 2.0) ** 2
        transition = (1.0 + ratio) / ((1.0 - ratio) ** 2 + ratio / 0.63**2)
        return 2.0 * 3.0**2 * band * transition / (2.0 * math.pi * hertz) ** 2

    felt = ride_comfort(ride(np.full(5000, -3.0), np.zeros(5000)))
    energy = quad(density, 1e-6, 25.0, limit=200)[0]
    assert felt.longitudinal**2 * 5000 * PERIOD == pytest.approx(energy, rel=0.01)
    assert felt.running[:100].max() == felt.max_transient == pytest.approx(math.sqrt(energy), rel=0.07)
    assert felt.running[-1] < 1e-6
    assert felt.lateral == 0.0


def test_a_short_event_stands_out_in_mtvv_however_long_the_ride_is() -> None:
    values = np.zeros(60_000)
    values[500:525] = -4.0
    short, long = (ride_comfort(ride(values[:count], np.zeros(count))) for count in (1000, 60_000))
    assert short.max_transient == pytest.approx(long.max_transient, rel=1e-9)
    assert long.total == pytest.approx(short.total * math.sqrt(1000 / 60_000), rel=1e-3)
    assert long.max_transient > 10.0 * long.total


def test_the_jerk_is_that_of_the_vector() -> None:
    """Exact of two ramps; a ride below eleven samples has no slope."""
    time = PERIOD * np.arange(50)
    assert ride_comfort(ride(3.0 * time, -4.0 * time)).max_jerk == pytest.approx(5.0)
    assert math.isnan(ride_comfort(ride(time[:10], time[:10])).max_jerk)


@pytest.mark.thorough
@given(
    st.lists(st.tuples(st.floats(-9.0, 9.0), st.floats(-9.0, 9.0)), min_size=160, max_size=200),
    st.floats(-math.pi, math.pi),
    st.floats(0.1, 5.0),
)
def test_it_knows_no_direction_and_scales_with_the_acceleration(
    values: list[tuple[float, float]], turn: float, factor: float
) -> None:
    """Fore and aft weighs as much as sideways: what both come to is the same for whoever sits across."""
    one, other = np.array(values).T
    turned = math.cos(turn) * one - math.sin(turn) * other, math.sin(turn) * one + math.cos(turn) * other
    felt, across, more = (ride_comfort(ride(*axes)) for axes in ((one, other), turned, (factor * one, factor * other)))
    for name in ("total", "max_transient", "max_jerk"):
        value = getattr(felt, name)
        assert getattr(across, name) == pytest.approx(value, rel=1e-6, abs=1e-6)
        assert getattr(more, name) == pytest.approx(factor * value, rel=1e-6, abs=1e-6)


# --- what is a ride ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("samples", "rms", "dose"), [(125, False, False), (126, True, False), (626, True, True)])
def test_what_is_too_short_for_a_weighting_is_not_said(samples: int, rms: bool, dose: bool) -> None:
    """One period of the lower limit: 2.5 s of Wd, 12.5 s of Wf; n samples last n - 1 periods."""
    felt = ride_comfort(ride(np.sin(np.arange(samples)), np.zeros(samples)))
    for value in (felt.longitudinal, felt.lateral, felt.total, felt.max_transient):
        assert math.isfinite(value) is rms
    assert np.isfinite(felt.running).all() == rms
    assert math.isfinite(felt.sickness_dose) is dose
    assert math.isfinite(felt.max_jerk)


def trip(before: float, after: float) -> tuple[Floats, Floats, Floats]:
    """20 s of motion with swinging speed between two rests; time [s], speed [m/s], acceleration [m/s2]."""
    time = PERIOD * np.arange(round((before + 20.0 + after) / PERIOD) + 1)
    since = time - before
    moving = (since > 0.0) & (since < 20.0)
    speed = np.where(moving, 2.0 * (1.0 - np.cos(0.2 * math.pi * since)), 0.0)
    return time, speed, np.where(moving, 0.4 * math.pi * np.sin(0.2 * math.pi * since), 0.0)


def test_a_rest_before_and_after_is_no_part_of_the_ride() -> None:
    expected = of_arrays(*trip(MARGIN, MARGIN))
    waited = of_arrays(*trip(70.0, 300.0))
    for name in ("longitudinal", "total", "max_transient", "sickness_dose", "max_jerk"):
        assert getattr(waited, name) == pytest.approx(getattr(expected, name), rel=2e-3), name
    assert waited.time[[0, -1]] == pytest.approx([70.0 - MARGIN, 90.0 + MARGIN], abs=0.5)


def test_a_stop_on_the_way_is_part_of_it() -> None:
    """At 10 s the car stands for a moment; a longer stand is as much of a ride."""
    time, speed, acceleration = trip(1.0, 1.0)
    waits = np.insert(speed, 551, np.zeros(500)), np.insert(acceleration, 551, np.zeros(500))
    felt = of_arrays(PERIOD * np.arange(len(waits[0])), *waits)
    assert felt.time[-1] - felt.time[0] == pytest.approx(31.5, abs=0.6)
    assert felt.longitudinal < of_arrays(time, speed, acceleration).longitudinal


@pytest.mark.parametrize("lost", [1, 4])
def test_a_few_lost_ticks_do_not_change_what_was_felt(lost: int) -> None:
    time, speed, acceleration = trip(1.0, 1.0)
    whole = of_arrays(time, speed, acceleration)
    kept = np.ones(len(time), bool)
    for begin in range(100, 1000, 90):
        kept[begin : begin + lost] = False
    some = of_arrays(time[kept], speed[kept], acceleration[kept])
    unknown = of_arrays(time, speed, np.where(kept, acceleration, np.nan))
    assert len(some.time) == len(whole.time)
    for felt in (some, unknown):
        assert felt.longitudinal == pytest.approx(whole.longitudinal, rel=1e-3)
        assert felt.sickness_dose == pytest.approx(whole.sickness_dose, rel=1e-3)


def test_more_lost_ticks_make_it_unknown() -> None:
    time, speed, acceleration = trip(1.0, 1.0)
    straight = np.zeros_like(time)
    for name in ("ticks", "values"):
        kept = np.ones(len(time), bool)
        kept[300:306] = False
        rows = kept if name == "ticks" else np.ones(len(time), bool)
        columns = time[rows], speed[rows], np.where(kept, acceleration, np.nan)[rows], straight[rows]
        assert ride_of(*columns, PERIOD) is None, name


def test_what_is_not_known_while_the_car_stands_does_not_matter() -> None:
    """The first fix comes late, the last one is long ago; but the first and the last motion are known."""
    time, speed, acceleration = trip(3.0, 3.0)
    unknown = (time < 2.5) | (time > 23.3)
    blank = np.where(unknown, np.nan, speed), np.where(unknown, np.nan, acceleration)
    felt = of_arrays(time, *blank)
    # What the weighting still makes of the last motion when the record has ended is all that is lost.
    assert felt.sickness_dose == pytest.approx(of_arrays(time, speed, acceleration).sickness_dose, rel=0.03)
    late = np.where((time > 3.0) & (time < 5.0), np.nan, acceleration)
    assert ride_of(time, speed, late, np.zeros_like(time), PERIOD) is None


def test_without_motion_there_is_no_ride() -> None:
    time, nothing = PERIOD * np.arange(500), np.zeros(500)
    assert ride_of(time, nothing, nothing, nothing, PERIOD) is None
    assert ride_of(time, nothing + 0.04, nothing, nothing, PERIOD) is None
    assert ride_of(time[:0], time[:0], time[:0], time[:0], PERIOD) is None
    assert ride_of(time, nothing + 5.0, np.full(500, np.nan), nothing, PERIOD) is None
    assert ride_of(time, np.full(500, np.nan), nothing, nothing, PERIOD) is None


# --- the lateral acceleration -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("left", [1.0, -1.0])
def test_on_a_circle_it_is_the_centripetal_one(left: float) -> None:
    speed, radius = 8.0, 20.0
    time = PERIOD * np.arange(400)
    turned = speed * time / radius
    found = lateral_acceleration(time, radius * np.sin(turned), -left * radius * np.cos(turned), left * turned)
    assert np.isnan(found[[0, -1]]).all()
    np.testing.assert_allclose(found[1:-1], left * speed * speed / radius, rtol=1e-4)


def test_straight_on_it_is_none_whatever_the_direction_and_the_speed() -> None:
    time = PERIOD * np.arange(200)
    way = 3.0 * time + 0.7 * time**2
    for heading in (0.0, 2.0, -1.3):
        found = lateral_acceleration(time, way * np.cos(heading), way * np.sin(heading), np.full(200, heading))
        np.testing.assert_allclose(found[1:-1], 0.0, atol=1e-8)


def test_a_slide_without_turning_is_seen_and_uneven_ticks_do_not_matter() -> None:
    time = np.delete(PERIOD * np.arange(200), [40, 41, 90])
    found = lateral_acceleration(time, 5.0 * time, 0.35 * time**2, np.zeros(len(time)))
    np.testing.assert_allclose(found[1:-1], 0.7, atol=1e-8)
    assert not np.isfinite(lateral_acceleration(np.zeros(5), time[:5], time[:5], np.zeros(5))).any()
    assert np.isnan(lateral_acceleration(time[:2], time[:2], time[:2], time[:2])).all()


# --- words ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("total", "words"),
    [
        (0.0, "not uncomfortable"),
        (0.314, "not uncomfortable"),
        (0.4, "a little uncomfortable"),
        (0.55, "a little uncomfortable to fairly uncomfortable"),
        (0.7, "fairly uncomfortable"),
        (0.9, "fairly uncomfortable to uncomfortable"),
        (1.1, "uncomfortable"),
        (1.3, "uncomfortable to very uncomfortable"),
        (1.9, "very uncomfortable"),
        (2.2, "very uncomfortable to extremely uncomfortable"),
        (9.0, "extremely uncomfortable"),
    ],
)
def test_the_words_are_those_of_the_standard(total: float, words: str) -> None:
    assert reactions(total) == words


def test_there_is_a_word_for_every_value() -> None:
    for value in np.arange(0.0, 5.0, 0.005):
        assert 1 <= sum(low <= value < high for low, high, _ in REACTIONS) <= 2


# --- drives -----------------------------------------------------------------------------------------------------------


def slalom(count: int = 1000, *, known: bool = True) -> list[dict[str, Any]]:
    """Ticks at 10 m/s with a lateral acceleration of 1 m/s2 at 0.5 Hz, from the start on; truth and estimate alike."""
    turns = 2.0 * math.pi * 0.5
    rows = []
    for now in (PERIOD * np.arange(count)).tolist():
        rate = 0.1 * math.sin(turns * now)
        heading = 0.1 / turns * (1.0 - math.cos(turns * now))
        # Small angles: y' = v sin(heading), of which the bend is all but a thousandth.
        y = 10.0 * 0.1 / turns * (now - math.sin(turns * now) / turns)
        moved = {"x_m": 10.0 * now, "y_m": y, "heading_rad": heading, "speed_mps": 10.0, "acceleration_mps2": 0.0}
        row = {"time_s": now, "s_m": 10.0 * now, "yaw_rate_radps": rate} | moved
        rows.append(row | {f"true_{name}": value if known else math.nan for name, value in moved.items()})
    return rows


def data(rows: list[dict[str, Any]]) -> DriveData:
    return drive_of(ticks_of(rows), actors_of([]))


def test_truth_and_estimate_of_one_motion_feel_the_same() -> None:
    true, estimated = data(slalom(3000)), data(slalom(3000, known=False))
    assert true.motion.true
    assert not estimated.motion.true
    one, other = PER_DRIVE.measure(true), PER_DRIVE.measure(estimated)
    size = GOALS_WD[-3] / math.sqrt(2.0)
    assert one["weighted_rms_y_mps2"] == pytest.approx(size, rel=0.02)
    assert other["weighted_rms_y_mps2"] == pytest.approx(one["weighted_rms_y_mps2"], rel=0.01)
    assert other["msdv_xy_mps1p5"] == pytest.approx(one["msdv_xy_mps1p5"], rel=0.01)
    assert one["weighted_rms_x_mps2"] == 0.0
    assert one["weighted_rms_xy_mps2"] == one["weighted_rms_y_mps2"]


def test_the_truth_counts_where_the_estimate_differs() -> None:
    rows = [row | {"acceleration_mps2": 9.0, "yaw_rate_radps": 5.0} for row in slalom()]
    assert PER_DRIVE.measure(data(rows))["mtvv_xy_mps2"] == PER_DRIVE.measure(data(slalom()))["mtvv_xy_mps2"]


def test_every_figure_of_a_drive_without_a_ride_is_missing_and_so_is_its_curve() -> None:
    standing = [row | {"speed_mps": 0.0, "true_speed_mps": 0.0} for row in slalom(50)]
    lost = [row | {"speed_mps": math.nan, "acceleration_mps2": math.nan} for row in slalom(50, known=False)]
    for rows in (standing, lost, []):
        drive = data(rows)
        measured = PER_DRIVE.measure(drive)
        assert all(math.isnan(measured[name]) for name in OF_RIDE)
        assert np.isnan(PER_TICK.measure(drive)["weighted_acceleration_mps2"]).all()


def test_a_contact_with_what_is_virtual_is_not_felt() -> None:
    hit = [row | {"contacts": "lead"} for row in slalom()]
    untouched, touched = (PER_DRIVE.measure(data(rows)) for rows in (slalom(), hit))
    assert touched["collision"]
    assert all(touched[name] == untouched[name] for name in OF_RIDE)


def test_the_curve_is_the_running_root_mean_square_and_its_peak_is_mtvv() -> None:
    """Nothing is known of the first and the last tick: there the truth has no second difference."""
    drive = data(slalom())
    curve, felt = PER_TICK.measure(drive)["weighted_acceleration_mps2"], drive.ride_comfort
    assert felt is not None
    assert np.isnan(curve[[0, -1]]).all()
    assert np.nanmax(curve) == pytest.approx(felt.max_transient)
    assert curve[500] == pytest.approx(felt.running[499])
    weighed = np.interp(drive.motion.time[450:500], felt.time, felt.running)
    assert weighed.std() < 0.05 * weighed.mean()
