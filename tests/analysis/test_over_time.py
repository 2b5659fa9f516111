"""The table of a drive's measures, on records made by hand whose numbers can be read off."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pytest

from tests.analysis.made import BOX, CAR, PERIOD, moving, put, write
from vve_sumo.analysis import Run, encroachment_of, exposure, over_time, zone_times
from vve_sumo.errors import ConfigError
from vve_sumo.metrics.exposure import EXPOSURE
from vve_sumo.metrics.per_drive import PER_DRIVE
from vve_sumo.metrics.per_tick import PER_TICK
from vve_sumo.metrics.slope import slope
from vve_sumo.record.layout import SCHEMAS

BUMPER = CAR.rear_axle_to_bumper
TIME = np.arange(100) * PERIOD
SPEED, BRAKING = 12.0, -2.0  #: of the leader, which is 4 m long
EGO = 15.0
GAP = 12.0


def leader(time: np.ndarray) -> list[dict[str, Any]]:
    """A leader that brakes steadily, its rear GAP before the ego's bumper at first."""
    middle = BUMPER + GAP + 2.0 + SPEED * time + 0.5 * BRAKING * time**2
    speed = SPEED + BRAKING * time
    return [
        BOX | {"tick": tick, "actor": "lead", "x_m": x, "speed_mps": v}
        for tick, (x, v) in enumerate(zip(middle.tolist(), speed.tolist(), strict=True))
    ]


@pytest.fixture
def approach(tmp_path: Path) -> Run:
    """An ego of constant speed behind the leader, and somebody far off in another lane."""
    folder = write(tmp_path / "approach", moving(TIME, EGO * TIME, np.full_like(TIME, EGO)))
    aside = [BOX | {"tick": tick, "actor": "aside", "x_m": 200.0, "y_m": 8.0} for tick in range(len(TIME))]
    put(folder, "actors", leader(TIME) + aside)
    return Run(folder)


def test_every_column_is_its_closed_form(approach: Run) -> None:
    frame = over_time(approach)
    gap = GAP - (EGO - SPEED) * TIME + 0.5 * BRAKING * TIME**2
    closing = EGO - SPEED - BRAKING * TIME
    inner = slice(5, -5)
    expected = {
        "time_s": TIME,
        "gap_m": gap,
        "closing_speed_mps": closing,
        "headway_s": gap / EGO,
        "headway_front_s": (gap + 4.0) / EGO,
        "ttc_s": gap / closing,
        "drac_mps2": closing**2 / (2.0 * gap),
        "required_deceleration_mps2": np.minimum(closing**2 / (2.0 * (gap - closing * CAR.brake_delay)), 12.0),
        "ttc_2d_s": gap / closing,
        "lateral_deviation_m": 0.0 * TIME,
        "heading_error_rad": 0.0 * TIME,
        "rss_distance_m": 15.0 + 1.75 + 18.5**2 / 8.0 - (SPEED + BRAKING * TIME) ** 2 / 16.0,
    }
    for name, values in expected.items():
        np.testing.assert_allclose(frame[name], values, atol=1e-9, err_msg=name)
    root = (np.sqrt(closing**2 + 4.0 * gap) - closing) / 2.0
    np.testing.assert_allclose(frame["mttc_s"][inner], root[inner], atol=1e-9)
    assert frame["mttc_s"].isna().sum() == 10
    assert set(frame["leader"]) == set(frame["ttc_2d_actor"]) == {"lead"}
    assert frame.index.name == "tick"


def test_units_and_meanings_go_with_the_table(approach: Run) -> None:
    frame = over_time(approach)
    assert [*frame.columns] == [*PER_TICK]
    assert frame.attrs["units"]["drac_mps2"] == "m/s²"
    assert all(frame.attrs["meanings"].values())
    added = exposure(frame)
    assert [*added.index] == [*EXPOSURE] == [*added.attrs["meanings"]]
    assert added.attrs["units"]["tit_s2"] == "s²"


def test_extremes_are_the_figures_of_the_drive(approach: Run) -> None:
    frame = over_time(approach)
    reported = PER_DRIVE.measure(approach.data)
    assert frame["ttc_s"].min() == reported["min_ttc_s"]
    assert frame["drac_mps2"].max() == reported["max_drac_mps2"]


def test_exposure_adds_up_what_the_table_holds(approach: Run) -> None:
    frame = over_time(approach)
    below = frame["ttc_s"][:-1] < 1.5
    assert 5 < below.sum() < 95
    added = exposure(frame)
    assert added["tet_s"] == pytest.approx(PERIOD * below.sum())
    assert added["tit_s2"] == pytest.approx(PERIOD * (1.5 - frame["ttc_s"][:-1][below]).sum())
    assert added["cpi_share"] == pytest.approx((frame["drac_mps2"][:-1] > CAR.deceleration_limit).mean())
    assert 0.0 < added["cpi_share"] < 1.0
    assert added["rss_share"] == pytest.approx(1.0)
    assert exposure(frame[frame["time_s"] < 0.2])["tet_s"] == 0.0
    with pytest.raises(ConfigError, match="attrs"):
        exposure(pd.DataFrame(frame.to_dict("list")))


def test_jerk_is_exact_of_a_ramp_and_of_a_parabola_and_of_uneven_ticks() -> None:
    time = np.arange(60) * PERIOD
    np.testing.assert_allclose(slope(time, 3.0 * time - 1.0, PERIOD)[5:-5], 3.0, atol=1e-9)
    np.testing.assert_allclose(slope(time, 4.0 * time**2, PERIOD)[5:-5], 8.0 * time[5:-5], atol=1e-9)
    late = time + 0.004 * np.sin(np.arange(60.0))
    np.testing.assert_allclose(slope(late, 3.0 * late, PERIOD)[5:-5], 3.0, atol=1e-9)
    assert np.isnan(slope(time, time, PERIOD)[[0, 4, 55, 59]]).all()
    assert np.isnan(slope(time[:10], time[:10], PERIOD)).all()


def test_a_live_drive_without_truth_and_with_missed_ticks_is_measured_from_the_estimate(tmp_path: Path) -> None:
    """Rows carry their own ticks: after two missed ones the actors still belong to the right rows."""
    ticks = np.array([0, 1, 2, 5, 6, 7])
    time = ticks * PERIOD
    rows = [
        row | {"tick": tick, "true_x_m": math.nan, "true_speed_mps": math.nan, "lateral_deviation_m": math.nan}
        for tick, row in zip(ticks.tolist(), moving(time, EGO * time, np.full_like(time, EGO)), strict=True)
    ]
    folder = write(tmp_path / "live", rows)
    put(folder, "actors", [row for row in leader(np.arange(8) * PERIOD) if row["tick"] in ticks])
    run = Run(folder)
    frame = over_time(run)
    assert not run.motion.true
    gap = GAP - (EGO - SPEED) * time + 0.5 * BRAKING * time**2
    np.testing.assert_allclose(frame["gap_m"], gap, atol=1e-9)
    np.testing.assert_allclose(frame["ttc_2d_s"], frame["ttc_s"], atol=1e-9)
    assert [*frame.index] == [*ticks]


def test_nothing_ahead_at_rest_and_no_pose_say_nothing(tmp_path: Path) -> None:
    rows = moving(TIME[:4], np.zeros(4), np.array([0.0, 0.0, 5.0, 5.0]))
    rows[3] |= {"x_m": math.nan, "true_x_m": math.nan, "s_m": math.nan, "true_speed_mps": math.nan}
    folder = write(tmp_path / "rest", rows)
    put(folder, "actors", [BOX | {"tick": tick, "actor": "parked", "x_m": 40.0} for tick in (1, 3)])
    frame = over_time(Run(folder))
    assert frame["gap_m"].isna().tolist() == [True, False, True, True]
    assert frame[["headway_s", "ttc_s", "mttc_s", "drac_mps2", "ttc_2d_s"]].isna().to_numpy().all()
    assert frame["leader"].tolist() == ["", "parked", "", ""]
    assert set(frame["ttc_2d_actor"]) == {""}
    assert exposure(frame)["tet_s"] == 0.0


def test_a_killed_record_and_one_without_actors_are_measured_as_far_as_they_go(approach: Run, tmp_path: Path) -> None:
    alone = Run(write(tmp_path / "alone", moving(TIME, EGO * TIME, np.full_like(TIME, EGO))))
    assert over_time(alone)["gap_m"].isna().all()
    whole = over_time(approach)
    for name in ("ticks", "actors"):
        table = approach.arrow(name).cast(SCHEMAS[name])
        (approach.folder / f"{name}.parquet").unlink()
        with pa.ipc.new_stream(approach.folder / f"{name}.arrows", table.schema) as stream:
            stream.write_table(table.slice(0, 60), max_chunksize=10)
        file = approach.folder / f"{name}.arrows"
        file.write_bytes(file.read_bytes()[:-700])
    killed = over_time(Run(approach.folder))
    assert 40 <= len(killed) < 60
    np.testing.assert_array_equal(killed["ttc_s"], whole["ttc_s"][: len(killed)])


def test_a_walker_who_crosses_behind_the_car(tmp_path: Path) -> None:
    """2 m/s across the path at x = 60 m; the ego's front reaches that strip of 0.5 m first."""
    time = np.arange(400) * PERIOD
    folder = write(tmp_path / "crossing", moving(time, 15.0 * time, np.full_like(time, 15.0)))
    across = {"actor": "walker", "x_m": 60.0, "heading_rad": math.pi / 2, "speed_mps": 2.0}
    size = {"length_m": 0.5, "width_m": 0.5}
    put(folder, "actors", [BOX | size | across | {"tick": i, "y_m": 2.0 * t - 13.0} for i, t in enumerate(time)])
    run = Run(folder)
    found = encroachment_of(run, "walker")
    rear = CAR.length - BUMPER
    enters, leaves = (59.75 - BUMPER) / 15.0, (60.25 + rear) / 15.0
    assert found.one_enters == pytest.approx(enters, abs=1e-9)
    assert found.time == pytest.approx(6.5 - (0.5 * CAR.width + 0.25) / 2.0 - leaves, abs=1e-9)
    zone = zone_times(run, "walker")
    before = zone["time_s"] < 3.0
    np.testing.assert_allclose(zone["ego_reaches_s"][before], enters - time[before], atol=1e-9)
    reaches = 6.5 - (0.5 * CAR.width + 0.25) / 2.0
    np.testing.assert_allclose(zone["actor_reaches_s"][before], reaches - time[before], atol=1e-9)
    assert zone.attrs["units"]["difference_s"] == "s"
    with pytest.raises(ConfigError, match="no actor nobody: it holds walker"):
        encroachment_of(run, "nobody")
