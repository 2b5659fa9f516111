"""CSV files read back by pandas, without options, are the tables of the analysis."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from tests.export.made import ACTORS, TIME, away, box_at, record
from tests.sweep.test_dataset import fill
from vve_sumo.analysis import Run, Sweep, over_time
from vve_sumo.export.write import export
from vve_sumo.metrics.metric import unit_of


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    return Run(record(tmp_path_factory.mktemp("csv") / "mine", {"outcome": "timeout"}))


@pytest.fixture(scope="module")
def files(run: Run, tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    return export(run, "csv", tmp_path_factory.mktemp("out"))


def assert_same(read: pd.DataFrame, expected: pd.DataFrame) -> None:
    assert [*read.columns] == [*expected.columns]
    for name in expected.columns:
        want, came = expected[name], read[name]
        if pd.api.types.is_numeric_dtype(want):  # truth values too
            numbers = (one.to_numpy(np.float64, na_value=np.nan) for one in (came, want))
            np.testing.assert_allclose(*numbers, rtol=1e-14, err_msg=name)
        else:
            texts = (["" if pd.isna(value) else str(value) for value in one] for one in (came, want))
            assert next(texts) == next(texts), name


def test_the_files_are_named_after_the_record(files: list[Path]) -> None:
    assert [file.name for file in files] == ["mine.csv", "mine.actors.csv", "mine.columns.csv"]


def test_a_row_a_tick_is_what_the_analysis_measures(run: Run, files: list[Path]) -> None:
    read = pd.read_csv(files[0])
    measured = over_time(run)
    assert_same(read[[*measured.columns]], measured.reset_index(drop=True))
    np.testing.assert_allclose(read["time_s"], TIME, rtol=1e-14)
    np.testing.assert_allclose(read["x_m"], run.ticks["true_x_m"], rtol=1e-14)
    assert read["note"][3] == 'he said "on, on"'
    assert read["emergency"].dtype == bool


def test_a_row_an_actor_and_tick_is_what_was_recorded(run: Run, files: list[Path]) -> None:
    read = pd.read_csv(files[1])
    for actor in ACTORS:
        own = read[read["actor"] == actor].set_index("tick")
        wanted = [box_at(actor, tick) for tick in range(len(TIME)) if not away(actor, tick)]
        assert own.index.tolist() == [row["tick"] for row in wanted]
        for name in ("x_m", "y_m", "heading_rad", "speed_mps", "length_m", "width_m"):
            np.testing.assert_allclose(own[name], [row[name] for row in wanted], rtol=1e-14)
    kinds = read.groupby("actor")["kind"].unique()
    assert {actor: [*kind] for actor, kind in kinds.items()} == {
        "ego": ["car"], "parked": ["car"], "walker": ["pedestrian"], "lorry.7": ["truck"]
    }  # fmt: skip
    ego = read[read["actor"] == "ego"]
    rear = np.hypot(ego["x_m"].to_numpy() - run.motion.x, ego["y_m"].to_numpy() - run.motion.y)
    np.testing.assert_allclose(rear, run.vehicle.rear_axle_to_bumper - 0.5 * run.vehicle.length)


def test_every_column_has_its_unit_and_its_meaning(files: list[Path]) -> None:
    about = pd.read_csv(files[2], keep_default_na=False)
    for table, file in (("ticks", files[0]), ("actors", files[1])):
        rows = about[about["table"] == table]
        assert rows["column"].tolist() == [*pd.read_csv(file, nrows=1).columns]
        assert rows["unit"].tolist() == [unit_of(name) for name in rows["column"]]
        assert all(rows["meaning"])
        assert all(rows["label"])


def test_a_sweeps_rows(tmp_path: Path) -> None:
    fill(tmp_path / "speeds")
    sweep = Sweep(tmp_path / "speeds")
    rows, columns = export(sweep, "csv", tmp_path)
    assert (rows.name, columns.name) == ("speeds.csv", "speeds.columns.csv")
    # A key of digits alone would be read as a number.
    read = pd.read_csv(rows, dtype={"key": str, "record_sha256": str})
    assert_same(read, sweep.rows())
    about = pd.read_csv(columns, keep_default_na=False).set_index("column")
    assert about["meaning"].to_dict() == sweep.rows().attrs["meanings"]
