"""What a suite measures of a drive, by records written by hand."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from tests.analysis.made import BOX, put, write
from tests.vehicles import FUSION
from vve_sumo.suite import catalogue
from vve_sumo.suite.judge import amplified, invalidity, unevaded
from vve_sumo.suite.measured import RowMeasurement, measure
from vve_sumo.suite.row import CutIn, RequiredEvasion, RequiredString

ROW = next(row for row in catalogue.rows("r152", FUSION) if row.approach is not None)


def made(folder: Path, speeds: list[float]) -> Path:
    """A record of a car with these true speeds, tick by tick."""
    model = FUSION.to_dict()
    vehicle = model.pop("vehicle")
    return write(folder, [{"true_speed_mps": speed} for speed in speeds], vehicle_model=model, vehicle=vehicle)


@pytest.mark.parametrize("cuts_in", [False, True])
def test_a_target_that_enters_as_the_drive_ends_has_tested_nothing(tmp_path: Path, cuts_in: bool) -> None:
    """What the virtual road held after a tick stands under the next one, which the last tick has not."""
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


def test_the_clearance_is_that_of_the_bodies_and_the_way_back_that_of_the_last_tick(tmp_path: Path) -> None:
    """A car that passes a box 3 m aside; boxes are 2 m wide, the car is in the middle of its path until the end."""
    model = FUSION.to_dict()
    vehicle = model.pop("vehicle")
    ticks = [{"true_speed_mps": 10.0, "true_x_m": 2.0 * tick, "lateral_deviation_m": -0.1 * tick} for tick in range(20)]
    record = write(tmp_path / "r", ticks, vehicle_model=model, vehicle=vehicle)
    assert ROW.approach is not None
    boxes = [BOX | {"actor": name, "x_m": 20.0, "y_m": y, "tick": tick}
             for tick in range(21) for name, y in ((ROW.approach.target, 3.0), ("other", -9.0))]  # fmt: skip
    put(record, "actors", boxes)
    row = replace(ROW, demand=0.0, evasion=RequiredEvasion(0.8, 0.15))
    measured = measure(row, record)
    assert measured.clearance == pytest.approx(3.0 - 1.0 - 0.5 * FUSION.vehicle.width)
    assert measured.off_path == pytest.approx(1.9)
    assert unevaded(row, measured) == ["1.90 m off its path at the end, expected 0.15 or less"]
    near = measured._replace(clearance=0.79, off_path=0.14)
    assert unevaded(row, near) == ["clearance 0.79 m, expected 0.8 or more"]
    assert unevaded(ROW, near) == []


def test_a_platoon_that_never_settles_does_not_pass() -> None:
    row = replace(ROW, string=RequiredString("leader", ("ego",), 15.0, 0.0, 1.0))
    assert amplified(row, RowMeasurement(head_to_tail=1.0)) == ""
    assert amplified(row, RowMeasurement(head_to_tail=1.01)) == "head to tail: 1.010, expected 1 or less"
    assert amplified(row, RowMeasurement()) == "head to tail: never settled, expected 1 or less"
    assert amplified(ROW, RowMeasurement()) == ""


def cuts_in(folder: Path, brakes: int) -> RowMeasurement:
    """Measure a car at 20 m/s that brakes from a tick on with 5 m/s2; another at 10 m/s comes over from 3.1 m aside.

    The other's near side is 1 m beside its middle: at 2 m/s it is over the edge at 2 m aside after 0.05 s.
    """
    assert ROW.approach is not None
    period, ego, x = 0.02, [], 0.0
    for tick in range(20):
        late = max(tick - brakes, 0) * period
        braked = {"true_acceleration_mps2": -5.0} if tick >= brakes else {}
        ego.append({"true_x_m": x - 2.5 * late * late, "true_speed_mps": 20.0 - 5.0 * late} | braked)
        x += 20.0 * period
    model = FUSION.to_dict()
    record = write(folder, ego, vehicle_model=model, vehicle=model.pop("vehicle"))
    target = BOX | {"actor": ROW.approach.target, "speed_mps": 10.0}
    places = [{"tick": i, "x_m": 30.0 + 10.0 * i * period, "y_m": 3.1 - 2.0 * i * period} for i in range(20)]
    put(record, "actors", [target | place for place in places])
    return measure(replace(ROW, cut_in=CutIn(ROW.approach.target, 2.0, 1.0, 0.1)), record)


@pytest.mark.parametrize("brakes", [0, 1, 2, 19])
def test_a_cut_in_is_placed_by_how_the_other_car_drives_not_by_how_early_it_is_braked_for(
    tmp_path: Path, brakes: int
) -> None:
    """The moment lies between two ticks: after 0.05 s the gap is 0.5 m less than the first one."""
    gap = 30.0 - 0.5 * BOX["length_m"] - FUSION.vehicle.rear_axle_to_bumper
    assert cuts_in(tmp_path / "r", brakes).ttc == pytest.approx((gap - 0.5) / 10.0)
