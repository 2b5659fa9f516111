"""What a suite measures of a drive, by records written by hand."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from tests.analysis.made import BOX, put, write
from tests.vehicles import FUSION
from vve_sumo.suite import catalogue
from vve_sumo.suite.measured import RowMeasurement, measure
from vve_sumo.suite.row import CutIn
from vve_sumo.suite.run import invalidity

ROW = next(row for row in catalogue.rows("r152", FUSION) if row.approach is not None)


def made(folder: Path, speeds: list[float]) -> Path:
    """A record of a car with these true speeds, tick by tick."""
    model = FUSION.to_dict()
    vehicle = model.pop("vehicle")
    return write(folder, [{"true_speed_mps": speed} for speed in speeds], vehicle_model=model, vehicle=vehicle)


@pytest.mark.parametrize("cuts_in", [False, True])
def test_a_target_that_enters_as_the_drive_ends_has_tested_nothing(tmp_path: Path, cuts_in: bool) -> None:
    """What the street held after a tick stands under the next one, which the last tick has not."""
    assert ROW.approach is not None
    row = replace(ROW, cut_in=CutIn(ROW.approach.target, 2.0, 1.0, 0.1)) if cuts_in else ROW
    record = made(tmp_path / "r", [ROW.approach.speed] * 5)
    put(record, "actors", [BOX | {"actor": ROW.approach.target, "x_m": 40.0, "tick": 5}])
    assert measure(row, record) == RowMeasurement()
    assert "never entered" in invalidity(row, *measure(row, record)[:2])


def test_the_approach_is_measured_from_the_entry_on(tmp_path: Path) -> None:
    assert ROW.approach is not None
    speeds = [1.0, 5.0, 5.5, 5.25]
    record = made(tmp_path / "r", speeds)
    put(record, "actors", [BOX | {"actor": ROW.approach.target, "x_m": 40.0, "tick": tick} for tick in range(1, 5)])
    assert measure(ROW, record).approach == (5.0, 5.5)
