"""Another controller on a record's inputs, against what its code says and against numpy over the record's own table."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet as pq
import pytest

from tests.drive.street import REPOSITORY, recorded
from vve_sumo import cli
from vve_sumo.drive.lockstep import assemble
from vve_sumo.drive.redrive import BRAKING_THRESHOLD, comparison_of, side_by_side
from vve_sumo.drive.replay import read_pipeline_inputs, recorded_scenario, replayed_ticks
from vve_sumo.record.reader import read_table

#: steers by a constant, says what it sees, and knows the tick at which to fail
OTHER = """
from vve_sumo.values import ControlCommand


class Other:
    def step(self, observation):
        if observation.tick == 200:
            raise ValueError("no idea")
        near = observation.tick >= 150
        note, emergency = "near" if near else "free", observation.tick >= 180
        return ControlCommand(0.01, -2.0 if near else 0.25, emergency=emergency, note=note)


def make(vehicle, tuning):
    assert tuning == {}
    return Other()
"""


@pytest.fixture(scope="module")
def record(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A record of a drive that stops by its emergency layer, with tuning of its own."""
    folder = tmp_path_factory.mktemp("redrive") / "r"
    changes = {
        "obstacles": [{"id": "parked_car", "at_m": 60.0}],
        "radar.range_limit_m": 12.0,
        "ego.speed_mps": 7.0,
        "controller.tuning": {"gap_m": 4.0},
        "road.demand": [],
    }
    return recorded(tmp_path_factory, changes, folder)


@pytest.fixture
def other(tmp_path: Path) -> str:
    """The name of a controller in a file of its own."""
    (tmp_path / "other.py").write_text(OTHER, encoding="utf-8")
    return f"{tmp_path / 'other.py'}:make"


def redriven(record: Path, controller: str) -> pa.Table:
    """Return both answers of every tick."""
    resolved = recorded_scenario(record, REPOSITORY)
    resolved = resolved.with_controller(controller)
    return side_by_side(replayed_ticks(assemble(resolved, REPOSITORY).pipeline, read_pipeline_inputs(record)))


@pytest.mark.thorough
def test_the_same_controller_answers_the_same(record: Path) -> None:
    """With the tuning that it had."""
    table = redriven(record, "follow_and_stop")
    result = comparison_of(table)
    assert result.first_difference is None
    assert set(result.greatest.values()) == set(result.rms.values()) == {0.0}
    assert result.recorded == result.other
    assert result.recorded.first_failure is None
    assert result.ticks == np.isfinite(read_table(record, "ticks")["steering_setpoint_rad"].to_numpy()).sum()


def test_another_answers_as_its_code_says(record: Path, other: str) -> None:
    table, ticks = redriven(record, other), read_table(record, "ticks")
    result = comparison_of(table)
    steering, asked = (ticks[f"{name}_setpoint_{unit}"].to_numpy() for name, unit in NAMES)
    tick, time = ticks["tick"].to_numpy(), ticks["time_s"].to_numpy()
    there = np.isfinite(steering) & (tick != 200)
    acceleration = np.where(tick >= 150, -2.0, 0.25)
    assert result.ticks == there.sum()
    assert result.greatest["steering_rad"] == np.abs(0.01 - steering[there]).max()
    assert result.greatest["acceleration_mps2"] == np.abs(acceleration - asked)[there].max()
    assert result.rms["steering_rad"] == pytest.approx(np.sqrt(np.mean((0.01 - steering[there]) ** 2)))
    assert result.rms["acceleration_mps2"] == pytest.approx(np.sqrt(np.mean((acceleration - asked)[there] ** 2)))
    assert result.first_difference == tick[there][0]
    assert (result.other.first_braking_time, result.other.first_emergency_time) == (
        time[tick == 150][0],
        time[tick == 180][0],
    )
    assert (result.other.notes, result.other.first_failure) == (("free", "near"), 200)
    assert result.recorded.first_braking_time == time[asked < -BRAKING_THRESHOLD][0]
    emergency = ticks["emergency"].to_numpy(zero_copy_only=False)
    assert result.recorded.first_emergency_time == time[emergency][0]
    assert set(result.recorded.notes) == set(ticks["note"].to_pylist()) - {""}


NAMES = (("steering", "rad"), ("acceleration", "mps2"))


def test_what_never_comes_is_never(record: Path) -> None:
    result = comparison_of(redriven(record, "follow_and_stop").slice(0, 2))
    assert result.ticks == 0
    assert math.isnan(result.other.first_braking_time)
    assert math.isnan(result.other.first_emergency_time)
    assert result.greatest == result.rms == {"steering_rad": 0.0, "acceleration_mps2": 0.0}


@pytest.mark.thorough
@pytest.mark.parametrize("ending", [".parquet", ".csv"])
def test_the_command_says_draws_and_writes(
    record: Path, other: str, tmp_path: Path, ending: str, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / f"both{ending}"
    assert cli.main(["redrive", str(record), "--controller", other, "--out", str(out)]) == 0
    said = capsys.readouterr().out
    for words in ("open loop", "3.00 s", "3.60 s", "free, near", "tick 200", "ValueError: no idea", str(out)):
        assert words in said
    table = pq.read_table(out) if ending == ".parquet" else pa.csv.read_csv(out)
    assert table["tick"].to_pylist() == read_table(record, "ticks")["tick"].to_pylist()
    assert (record / "redrive.png").read_bytes().startswith(b"\x89PNG")
    (record / "redrive.png").unlink()
    assert cli.main(["replay", str(record)]) == 0


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--controller", "no_such"], "no_such"),
        (["--controller", "follow_and_stop", "--out", "table.txt"], "table.txt"),
        (["--controller", "follow_and_stop", "--out", "gone/table.csv"], "gone"),
    ],
)
def test_wrong_uses_are_one_line(
    record: Path, arguments: list[str], words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(["redrive", str(record), *arguments]) == 2
    said = capsys.readouterr().err
    assert words in said
    assert len(said.splitlines()) == 1
    assert not (record / "redrive.png").exists()
