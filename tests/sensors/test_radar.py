"""The cycle, the noise, the quanta and the misses of the radar against what its configuration declares."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from tests.sensors.scenes import BUMPER, FUSION, Row, actors, car, rear_axle
from vve_sumo.errors import ConfigError
from vve_sumo.sensors.echo import Mount
from vve_sumo.sensors.radar import (
    BEFORE_FIRST_SCAN,
    ESR_MODES,
    Radar,
    RadarConfig,
    RadarMode,
    RadarScan,
    detection_probability,
)
from vve_sumo.values import Pose

TICK = 0.02
#: what comes out is what was measured at the same tick: whoever tests the latency says so
PROMPT = replace(RadarConfig(), latency=0.0)


def radar(config: RadarConfig, seed: int = 1) -> Radar:
    return Radar(config, FUSION, np.random.default_rng(seed))


def scan(config: RadarConfig, rows: Sequence[Row], pose: Pose | None = None) -> RadarScan:
    result = radar(config).step(0.0, pose or rear_axle(), actors(rows))
    assert result is not None
    return result


def scans(config: RadarConfig, rows: Sequence[Row], count: int, seed: int = 1) -> list[RadarScan]:
    sensor, street, pose = radar(config, seed), actors(rows), rear_axle(speed=10.0)
    results = [sensor.step(index * 0.05, pose, street) for index in range(count)]
    return [result for result in results if result is not None]


@pytest.mark.thorough
def test_scans_come_40_and_60_ms_apart_and_are_dated_at_their_tick() -> None:
    sensor, street = radar(PROMPT), actors([car(30.0, 0.0)])
    results = [sensor.step(tick * TICK, rear_axle(), street) for tick in range(50_000)]
    dates = [result.detections.time for result in results if result]
    assert dates == [tick * TICK for tick, result in enumerate(results) if result]
    assert [round(1e3 * date) for date in dates[:6]] == [0, 60, 100, 160, 200, 260]
    gaps = np.diff(np.rint(np.array(dates) * 1e3).astype(int)).tolist()
    assert gaps == [60, 40] * (len(gaps) // 2) + [60] * (len(gaps) % 2)


def test_a_scan_comes_out_at_the_first_tick_after_its_latency_dated_when_it_was_measured() -> None:
    """A car ahead of an ideal antenna backs away by 1 m a tick: its range says at which tick it was measured."""
    sensor = radar(replace(RadarConfig().ideal(), latency=0.09, mount=Mount(0.0)))
    gaps = [20.0 + tick for tick in range(20)]
    out = [
        (tick, result)
        for tick, gap in enumerate(gaps)
        if (result := sensor.step(tick * TICK, rear_axle(), actors([car(BUMPER + gap + 2.25, 0.0)])))
    ]
    assert [tick for tick, _result in out] == [5, 8, 10, 13, 15, 18]
    assert [round(result.detections.time / TICK) for _tick, result in out] == [0, 3, 5, 8, 10, 13]
    for _tick, result in out:
        assert result.detections.range.tolist() == [pytest.approx(gaps[round(result.detections.time / TICK)])]


def test_latency_moves_scans_and_changes_nothing_else() -> None:
    rows = [car(40.0, 3.0), car(25.0, -9.0)]
    prompt, late = radar(PROMPT), radar(replace(RadarConfig(), latency=0.2))
    street = actors(rows)
    first, second = (
        [result for tick in range(500) if (result := sensor.step(tick * TICK, rear_axle(), street))]
        for sensor in (prompt, late)
    )
    assert len(first) - len(second) == 4
    assert [columns_of(one) for one in second] == [columns_of(one) for one in first[:-4]]
    assert [one.detections.time for one in second] == [one.detections.time for one in first[:-4]]


def test_who_has_left_the_street_since_is_still_named() -> None:
    sensor = radar(RadarConfig().ideal())
    late = radar(replace(RadarConfig().ideal(), latency=0.09))
    assert sensor.step(0.0, rear_axle(), actors([car(20.0, 0.0)], ["gone"])) is not None
    assert late.step(0.0, rear_axle(), actors([car(20.0, 0.0)], ["gone"])) is None
    result = late.step(0.10, rear_axle(), actors([]))
    assert result is not None
    assert result.actors == ("gone",)


def test_of_two_scans_that_wait_for_a_late_tick_the_newer_comes_out() -> None:
    sensor, street = radar(RadarConfig()), actors([car(20.0, 0.0)])
    assert [sensor.step(time, rear_axle(), street) for time in (0.0, 0.06)] == [None, None]
    result = sensor.step(0.20, rear_axle(), street)
    assert result is not None
    assert result.detections.time == 0.06


def test_a_scan_comes_out_also_where_the_pose_has_been_lost_since() -> None:
    sensor, street = radar(RadarConfig()), actors([car(20.0, 0.0)])
    assert sensor.step(0.0, rear_axle(), street) is None
    result = sensor.step(0.1, replace(rear_axle(), x=math.nan), street)
    assert result is not None
    assert result.detections.time == 0.0


def test_a_late_tick_scans_at_once_and_the_grid_stays() -> None:
    sensor, street = radar(PROMPT), actors([])
    due = [time for time in (0.0, 0.24, 0.26, 0.28, 0.30) if sensor.step(time, rear_axle(), street)]
    assert due == [0.0, 0.24, 0.26, 0.30]


def test_an_ideal_scan_counts_from_the_bumper() -> None:
    config = replace(PROMPT, mount=Mount(x=-0.4, y=0.5, yaw=0.1)).ideal()
    result = scan(config, [car(BUMPER + 20.0 + 2.25, 0.0)], rear_axle(speed=9.0))
    seen = result.detections
    # The antenna sees the point of the rear face straight ahead of it, 0.5 m to the left of the car's axis.
    assert seen.range.tolist() == [pytest.approx(math.hypot(20.0, 0.5), abs=1e-12)]
    assert seen.azimuth.tolist() == [pytest.approx(math.atan2(0.5, 20.0), abs=1e-12)]
    assert seen.range_rate.tolist() == [pytest.approx(-9.0, abs=1e-12)]
    assert seen.mode.tolist() == [0]
    assert result.actors == ("car0",)


def test_an_ideal_radar_misses_nothing_it_could_see() -> None:
    faint = (165.0, 0.0, 0.0, 0.0, 4.5, 1.8, 0.0)
    assert all(result.actors == ("car0",) for result in scans(PROMPT.ideal(), [faint], 200))


def test_rows_come_nearest_first_with_the_row_of_their_actor() -> None:
    result = scan(PROMPT.ideal(), [car(80.0, 6.0), car(30.0, -10.0), car(50.0, 0.0)])
    assert result.actors == ("car1", "car2", "car0")
    assert result.detections.mode.tolist() == [1, 0, 0]
    assert np.all(np.diff(result.detections.range) > 0.0)


def test_the_nearest_are_kept_where_there_are_too_many() -> None:
    posts = [(10.0 + 0.5 * row, -8.0 + 1.0 * row, 0.0, 0.0, 0.2, 0.2, 10.0) for row in range(17)]
    everything = scan(PROMPT.ideal(), posts)
    capped = scan(replace(PROMPT.ideal(), max_targets=5), posts)
    assert len(everything.actors) > 5
    assert capped.actors == everything.actors[:5]


def test_a_radar_with_modes_of_18_m_is_blind_until_then() -> None:
    config = replace(PROMPT, modes=tuple(replace(mode, range_max=18.0) for mode in ESR_MODES)).ideal()
    antenna = BUMPER - 0.1
    for gap, expected in ((18.01, ()), (17.99, ("car0",))):
        assert scan(config, [car(antenna + gap + 2.25, 0.0)]).actors == expected


def test_an_obstacle_behind_the_bumper_is_reported_behind_it() -> None:
    """5 cm ahead of an antenna that sits 10 cm back: contact has been made, and range times cosine says so."""
    seen = scan(PROMPT.ideal(), [car(BUMPER - 0.05 + 2.25, 0.0)]).detections
    assert seen.range * np.cos(seen.azimuth) == pytest.approx([-0.05])


def test_noise_is_unbiased_normal_and_as_wide_as_declared() -> None:
    """Quanta off. Kolmogorov-Smirnov for the shape, chi-squared and z at 5 sigma for width and bias."""
    config = replace(
        PROMPT, range_quantum=0.0, range_rate_quantum=0.0, azimuth_quantum=0.0, mount=Mount(0.0), range_sigma=0.4
    )
    count = 4000
    columns = [result.detections for result in scans(config, [car(40.0, 3.0)], count) if result.actors]
    assert len(columns) > 0.99 * count
    (truth,) = [result.detections for result in scans(config.ideal(), [car(40.0, 3.0)], 1)]
    for name, sigma in (("range", 0.4), ("azimuth", math.radians(0.5)), ("range_rate", 0.12)):
        error = np.array([getattr(column, name)[0] for column in columns]) - getattr(truth, name)[0]
        assert abs(error.mean()) < 5.0 * sigma / math.sqrt(len(error))
        assert error.std() == pytest.approx(sigma, rel=5.0 / math.sqrt(2.0 * len(error)))
        assert stats.kstest(error / sigma, "norm").pvalue > 1e-4


def test_noise_of_one_column_says_nothing_of_another_nor_of_the_next_scan() -> None:
    """A correlation of 4000 independent pairs stays below 0.08 at 5 sigma."""
    columns = [result.detections for result in scans(PROMPT, [car(40.0, 3.0)], 4000) if result.actors]
    noise = np.array([(seen.range[0], seen.azimuth[0], seen.range_rate[0]) for seen in columns]).T
    assert np.abs(np.corrcoef(noise) - np.eye(3)).max() < 0.08
    assert max(abs(np.corrcoef(column[:-1], column[1:])[0, 1]) for column in noise) < 0.08


def test_values_come_in_the_quanta_of_the_track_messages() -> None:
    config = replace(PROMPT, mount=Mount(0.0))
    for result in scans(config, [car(40.0, 3.0), car(25.0, -9.0, 0.4, 7.0)], 200):
        seen = result.detections
        for values, quantum in ((seen.range, 0.1), (seen.range_rate, 0.01), (seen.azimuth, math.radians(0.1))):
            steps = values / quantum
            assert steps == pytest.approx(np.rint(steps), abs=1e-6)


def test_a_noisy_range_never_throws_a_target_behind_the_antenna() -> None:
    config = replace(PROMPT, mount=Mount(0.0), range_sigma=5.0)
    results = scans(config, [car(BUMPER + 2.3, 0.0)], 200)
    assert all(np.all(np.abs(result.detections.azimuth) < 0.1) for result in results)
    assert any(result.detections.range[0] == 0.0 for result in results)


@pytest.mark.parametrize(
    ("cross_section", "range_"), [(10.0, 174.0), (1.0, 174.0), (0.3, 120.0), (10.0, 100.0), (0.0, 9.0)]
)
def test_detection_probability_is_swerling_1(cross_section: float, range_: float) -> None:
    """Same signal-to-noise ratio written out in decibels: 0.9 at 10 dBsm and 174 m, falling by 40 dB a decade."""
    needed_db = 10.0 * math.log10(math.log(1e-6) / math.log(0.9) - 1.0)
    strength_db = 10.0 * math.log10(cross_section) if cross_section else -math.inf
    snr = 10.0 ** (0.1 * (needed_db + strength_db - 10.0 - 40.0 * math.log10(range_ / 174.0)))
    probability = detection_probability(cross_section, range_, ESR_MODES[0], PROMPT)
    assert probability == pytest.approx(1e-6 ** (1.0 / (1.0 + snr)), rel=1e-9)


@pytest.mark.thorough(witnesses=1)
@pytest.mark.parametrize(("cross_section", "x"), [(10.0, 170.0), (2.0, 150.0), (0.5, 150.0)])
def test_hits_come_as_often_as_the_detection_probability_says(cross_section: float, x: float) -> None:
    rows = [(x, 0.0, 0.0, 0.0, 4.5, 1.8, cross_section)]
    count = 4000
    hits = sum(len(result.actors) for result in scans(PROMPT, rows, count))
    probability = detection_probability(cross_section, x - 2.25 - BUMPER + 0.1, ESR_MODES[0], PROMPT)
    assert stats.binomtest(hits, count, probability).pvalue > 1e-4


def columns_of(result: RadarScan) -> dict[str, object]:
    seen = result.detections
    names = ("range", "azimuth", "range_rate", "mode")
    return {name: getattr(seen, name).tolist() for name in names} | {"actors": result.actors}


def test_the_same_seed_gives_the_same_bits_and_another_seed_others() -> None:
    rows = [car(40.0, 3.0), car(60.0, -3.0), car(25.0, -9.0)]
    first, again, other = (scans(PROMPT, rows, 40, seed) for seed in (7, 7, 8))
    assert [columns_of(one) for one in first] == [columns_of(one) for one in again]
    assert [columns_of(one) for one in first] != [columns_of(one) for one in other]


def test_another_car_does_not_change_the_noise_on_this_one() -> None:
    """Also where it comes first in the table and moves this one's row."""
    pose = rear_axle(speed=10.0)
    alone, joined = radar(PROMPT), radar(PROMPT)
    street = actors([car(40.0, 3.0)], ["ours"])
    with_other = actors([car(25.0, -9.0), car(40.0, 3.0)], ["other", "ours"])
    for index in range(50):
        one, both = alone.step(index * 0.05, pose, street), joined.step(index * 0.05, pose, with_other)
        assert one is not None
        assert both is not None
        ours = np.array(both.actors) == "ours"
        assert both.detections.range[ours].tolist() == one.detections.range.tolist()
        assert both.detections.azimuth[ours].tolist() == one.detections.azimuth.tolist()
        assert both.detections.range_rate[ours].tolist() == one.detections.range_rate.tolist()


def test_actors_that_are_not_finite_are_left_out_counted_and_hide_nothing() -> None:
    """They are counted at the tick that looked at them, however late its scan comes out."""
    sensor = radar(replace(RadarConfig(), detection_probability=1.0))
    assert (
        sensor.step(0.0, rear_axle(), actors([car(20.0, 0.0, speed=math.nan), car(40.0, 0.0), car(math.inf, 0.0)]))
        is None
    )
    assert sensor.refused == 2
    street = actors([car(40.0, 0.0)])
    later = [(sensor.step(tick * TICK, rear_axle(), street), sensor.refused) for tick in range(1, 6)]
    assert [refused for _result, refused in later] == [0] * 5
    (result,) = [result for result, _refused in later if result]
    assert result.actors == ("car1",)


@pytest.mark.parametrize("field", ["x", "y", "heading", "speed", "lateral_speed", "yaw_rate"])
def test_without_a_finite_pose_there_is_no_scan_until_one_comes(field: str) -> None:
    sensor, street = radar(PROMPT), actors([car(20.0, 0.0)])
    assert sensor.step(0.0, replace(rear_axle(), **{field: math.nan}), street) is None
    assert sensor.step(0.02, rear_axle(), street) is not None


def test_an_empty_street_gives_an_empty_scan_and_no_scan_is_older_than_any() -> None:
    result = scan(PROMPT, [])
    assert result.detections.range.size == len(result.actors) == 0
    assert result.detections.mode.dtype == np.int8
    assert BEFORE_FIRST_SCAN.time < result.detections.time


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("modes", ()),
        ("period", 0.0),
        ("period", math.nan),
        ("range_sigma", -0.1),
        ("azimuth_quantum", math.inf),
        ("max_targets", -1),
        ("detection_probability", 1.1),
        ("false_alarm_probability", 0.0),
        ("latency", -0.01),
        ("latency", math.nan),
        ("noise_correlation", 1.0),
        ("noise_correlation", -0.1),
        ("noise_correlation", math.nan),
        ("false_alarms", -0.1),
        ("false_alarms", math.inf),
    ],
)
def test_a_configuration_that_no_radar_can_have_is_refused_by_name(field: str, value: object) -> None:
    with pytest.raises(ConfigError, match=field):
        replace(RadarConfig(), **{field: value})


@pytest.mark.parametrize(("range_max", "half_angle"), [(0.0, 0.1), (math.nan, 0.1), (60.0, 0.0), (60.0, 1.6)])
def test_a_mode_that_no_radar_can_have_is_refused(range_max: float, half_angle: float) -> None:
    with pytest.raises(ConfigError, match="radar mode"):
        RadarMode(range_max, half_angle)
