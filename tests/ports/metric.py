"""What every file of metrics must hold to, whoever wrote it: subclass, name the file, run pytest.

    from tests.ports.metric import MetricConformance

    class TestMine(MetricConformance):
        name = "my_metrics.py:make"
        expected = {"max_speed_of_mine_mps": 10.0}

The metrics are measured of a car that drives at 10 m/s, swings to both sides, brakes with 2.5 m/s² and stands before a
parked car; of the same drive without a pose; of a car that stands on an empty road; and of a drive without a tick.
`expected` are values of the first, by a closed form or by hand.
"""

from __future__ import annotations

import json
import math
import time
from typing import Any, ClassVar, Final

import numpy as np
import pytest

from tests.metrics.tables import actors_of, drive_of, ticks_of
from vve_sumo.metrics.drive_data import DriveData
from vve_sumo.metrics.metric import MetricTable
from vve_sumo.metrics.own import DeclaredMetrics, Measured, OwnMetrics
from vve_sumo.metrics.port import load

PERIOD: Final = 0.02
TICKS: Final = 600
#: of the approach: speed [m/s], tick of the onset, deceleration [m/s2], greatest yaw rate [rad/s]
SPEED, ONSET, BRAKING, YAW_RATE = 10.0, 200, 2.5, 0.08
PARKED_AT: Final = 75.0  #: middle of the parked car [m]
#: of measuring all metrics of a file on the approach: a sweep waits so long for each run [s]
LONGEST: Final = 2.0


def approach(*, known: bool = True) -> DriveData:
    """Return the drive up to the parked car; without the truth and the estimate where they are not `known`."""
    rows, x = [], 0.0
    for tick in range(TICKS):
        now = PERIOD * tick
        since = now - PERIOD * ONSET
        speed = max(SPEED - BRAKING * max(since, 0.0), 0.0)
        x += PERIOD * speed
        braking = -BRAKING if since > 0.0 and speed > 0.0 else 0.0
        rate = YAW_RATE * math.sin(math.pi * now) if since < 0.0 else 0.0
        moved = {"x_m": x, "y_m": 0.0, "heading_rad": 0.0, "speed_mps": speed, "acceleration_mps2": braking}
        row: dict[str, Any] = {"time_s": now, "s_m": x, "yaw_rate_radps": rate, "requested_acceleration_mps2": braking}
        row |= {"state": "engaged"} | moved | {f"true_{name}": value for name, value in moved.items()}
        rows.append(row if known else row | dict.fromkeys([*moved, *(f"true_{name}" for name in moved)], math.nan))
    parked = [{"tick": tick, "actor": "parked", "x_m": PARKED_AT} for tick in range(TICKS)]
    return drive_of(ticks_of(rows), actors_of(parked))


def standing() -> DriveData:
    """Return the drive of a car that stands on an empty road."""
    return drive_of(ticks_of([{"time_s": PERIOD * tick} for tick in range(50)]), actors_of([]))


def nothing() -> DriveData:
    """Return the drive without a tick."""
    return drive_of(ticks_of([]), actors_of([]))


class MetricConformance:
    """The suite."""

    name: ClassVar[str]
    expected: ClassVar[dict[str, Any]] = {}

    def metrics(self) -> OwnMetrics:
        return OwnMetrics({self.name: load(self.name)})

    def tables(self) -> tuple[MetricTable[DriveData], MetricTable[DriveData]]:
        offered = load(self.name)
        return offered.per_drive, offered.per_tick

    def measured(self, drive: DriveData) -> Measured:
        """Return what the metrics say of a drive; they must not fail."""
        measured = self.metrics().measure(drive)
        assert not measured.errors, next(iter(measured.errors.values()))
        return measured

    # --- what is declared ---------------------------------------------------------------------------------------------

    def test_every_row_says_what_it_is(self) -> None:
        for table in self.tables():
            for name, row in table.items():
                assert row.name == name
                assert "_" not in row.label
                assert not row.meaning.endswith(".")

    def test_rows_survive_their_record(self) -> None:
        per_drive, per_tick = self.tables()
        declared = DeclaredMetrics(dict(per_drive), dict(per_tick)).to_dict()
        kept = json.loads(json.dumps(declared, allow_nan=False))
        for table, rows in (({**per_drive}, kept["per_drive"]), ({**per_tick}, kept["per_tick"])):
            assert [repr(type(one).from_dict(row)) for one, row in zip(table.values(), rows, strict=True)] == [
                repr(one) for one in table.values()
            ]

    # --- what is measured ---------------------------------------------------------------------------------------------

    def test_an_approach_is_measured(self) -> None:
        measured = self.measured(approach())
        per_drive, per_tick = self.tables()
        assert [*measured.per_drive] == [*per_drive]
        assert [*measured.per_tick] == [*per_tick]
        values = [*measured.per_drive.values(), *(value for column in measured.per_tick.values() for value in column)]
        assert any(value == value for value in values), "nothing was measured of a whole drive"

    def test_values_are_those_expected(self) -> None:
        measured = self.measured(approach()).per_drive
        for name, value in self.expected.items():
            assert measured[name] == pytest.approx(value, rel=1e-6, abs=1e-6, nan_ok=True), name

    @pytest.mark.parametrize("drive", [lambda: approach(known=False), standing, nothing])
    def test_a_drive_that_holds_little_is_no_failure(self, drive: Any) -> None:
        self.measured(drive())

    def test_the_same_drive_measures_the_same(self) -> None:
        one = self.measured(approach())
        np.random.seed(3)  # noqa: NPY002
        other = self.measured(approach())
        assert repr(one) == repr(other)

    def test_the_drive_stays_as_it_is(self) -> None:
        drive, untouched = approach(), approach()
        self.measured(drive)
        assert drive.ticks.equals(untouched.ticks)
        assert drive.actors.equals(untouched.actors)
        for name in ("time", "x", "y", "heading", "speed", "acceleration"):
            found, before = getattr(drive.motion, name), getattr(untouched.motion, name)
            assert np.array_equal(found, before, equal_nan=True), name
        assert np.array_equal(drive.lead.gap, untouched.lead.gap, equal_nan=True)

    def test_a_drive_is_measured_in_a_moment(self) -> None:
        drive, begun = approach(), time.process_time()
        self.measured(drive)
        assert time.process_time() - begun < LONGEST
