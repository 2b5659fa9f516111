"""Drives with SUMO whose controller goes around a parked car and commands its way: record, replay, figures, stop."""

from __future__ import annotations

import json
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
import shapely
from matplotlib.figure import Figure

from tests.drive.street import REPOSITORY, recorded
from tests.isolated import isolated
from tests.view.made import taken_apart
from vve_sumo import cli
from vve_sumo.analysis.run import Run
from vve_sumo.drive.replay import read_car_frames, read_pipeline_inputs, recorded_scenario, replay
from vve_sumo.drive.resolved_scenario import DEFAULT_EPOCH
from vve_sumo.drive.verify import alterations
from vve_sumo.plotting.birds_eye import MapWindow, draw_map
from vve_sumo.plotting.drive_record import page_of
from vve_sumo.record.hashes import hash_parts
from vve_sumo.record.reader import read_commanded
from vve_sumo.values import EGO
from vve_sumo.view.frames import Frames

#: where the setpoints end, in the middle of the swerve [m]
MIDDLE = 40.0


def changes(**tuning: Any) -> dict[str, Any]:
    return {
        "obstacles": [{"id": "parked_car", "at_m": 66.0}],
        "road.demand": [],
        "ego.speed_mps": 6.0,
        "ego.deviation_limit_m": 6.0,
        "duration_s": 27.0,
        "controller": {"name": f"{REPOSITORY / 'tests' / 'drive' / 'around.py'}:make", "tuning": tuning},
    }


@pytest.fixture(scope="module")
def record(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return recorded(tmp_path_factory, changes(), tmp_path_factory.mktemp("around") / "r")


@pytest.mark.thorough
def test_the_record_holds_the_paths_and_replays_bit_for_bit(record: Path) -> None:
    inputs = read_pipeline_inputs(record)
    asked = [row["tick"] for row in inputs.ticks if np.isfinite(row["steering_setpoint_rad"])]
    assert list(inputs.commanded) == asked
    assert {len(path.x) for path in inputs.commanded.values()} == {30}
    resolved, frames = recorded_scenario(record, REPOSITORY), read_car_frames(record, DEFAULT_EPOCH)
    assert replay(resolved, inputs, frames, REPOSITORY) is None
    tick = asked[200]
    path = inputs.commanded[tick]
    inputs.commanded[tick] = type(path)((np.nextafter(path.x[0], 1e9), *path.x[1:]), path.y, path.speed)
    difference = replay(resolved, inputs, frames, REPOSITORY)
    assert difference is not None
    assert (difference.number, difference.item) == (tick, "commanded path")


@pytest.mark.thorough
def test_the_paths_are_in_the_records_hash(record: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    parts = json.loads((record / "summary.json").read_text())["record_parts_sha256"]
    assert hash_parts(record) == parts
    assert "commanded_paths" in parts
    assert alterations(record) == []
    file = record / "commanded_paths.parquet"
    whole, table = file.read_bytes(), pq.read_table(file)
    try:
        pq.write_table(table.slice(0, table.num_rows - 1), file)
        assert {found.part for found in alterations(record) or ()} == {"commanded_paths"}
        file.unlink()
        assert {found.part for found in alterations(record) or ()} == {"commanded_paths"}
    finally:
        file.write_bytes(whole)
    assert cli.main(["replay", str(record)]) == 0


@pytest.mark.thorough
def test_who_goes_around_what_stands_had_no_conflict_with_it(record: Path, tmp_path_factory: Any) -> None:
    """The same drive whose commands do not say where they lead counts one, until the car has left its path."""
    said = Run(record)
    assert said.summary is not None
    assert said.summary["outcome"] == "timeout"
    assert not any(said.arrow("ticks")["contacts"].to_pylist())
    assert not np.isfinite(said.data.conflict.time).any()
    silent = Run(recorded(tmp_path_factory, changes(says=False), tmp_path_factory.mktemp("around") / "s"))
    assert silent.arrow("commanded_paths").num_rows == 0
    assert not silent.holds("commanded_paths")
    assert "commanded_paths" not in hash_parts(silent.folder)
    assert "parked_car" in silent.data.conflict.actor


@pytest.mark.thorough
def test_the_picture_draws_the_path_at_the_moment_shown(record: Path) -> None:
    run = Run(record)
    page = page_of(run)
    assert page.moment is not None
    path = read_pipeline_inputs(record).commanded[run.ticks.tick[page.moment.row]]
    assert page.commanded.tolist() == [[x, y] for x, y in zip(path.x, path.y, strict=True)]
    axes, view = Figure().add_subplot(), MapWindow(path.x[0], path.y[0], 0.3, 100.0, 50.0)
    draw_map(axes, page, view, "#ffffff", end=page.moment.row)
    (drawn,) = (line for line in axes.get_lines() if line.get_label() == "commanded path")
    np.testing.assert_allclose(drawn.get_xydata(), view.place(np.array(path.x), np.array(path.y)))
    whole = Figure().add_subplot()
    draw_map(whole, page, view, "#ffffff")
    assert "commanded path" not in [line.get_label() for line in whole.get_lines()]


def test_the_page_gets_the_path_of_every_tick(record: Path) -> None:
    _head, columns = taken_apart(Frames(Run(record)).packed())
    paths = read_pipeline_inputs(record).commanded
    ticks = pq.read_table(record / "ticks.parquet")["tick"].to_pylist()
    assert [ticks[at] for at in columns["commanded_tick"].tolist()] == list(paths)
    bounds = pairwise(columns["commanded_first"].tolist())
    for (begin, end), path in zip(bounds, paths.values(), strict=True):
        np.testing.assert_allclose(columns["commanded_x"][begin:end], path.x, atol=5e-4)
        np.testing.assert_allclose(columns["commanded_y"][begin:end], path.y, atol=5e-4)


class Deaf:
    """A gateway that gets no setpoint from a place of the drive on."""

    def __init__(self, gateway: Any) -> None:
        self._gateway, self.silent = gateway, False

    def __getattr__(self, name: str) -> Any:
        return getattr(self._gateway, name)

    def step(self, now: float, setpoint: Any, *others: Any) -> Any:
        return self._gateway.step(now, None if self.silent else setpoint, *others)


def stopped(says: bool) -> tuple[Any, Any, Any]:
    """Return the tick at rest, the last path before the setpoints ended, and the states."""
    from tests.drive.street import altered
    from vve_sumo.drive.lockstep import Lockstep
    from vve_sumo.record.writer import MemoryRecorder

    resolved = altered(changes(says=says))
    shell = Lockstep(resolved, REPOSITORY)
    deaf = shell.egos[0].gateway = Deaf(shell.egos[0].gateway)
    record = MemoryRecorder(resolved.to_dict(REPOSITORY), DEFAULT_EPOCH)
    states, path = [], None
    for ticked in (ticks[EGO] for ticks in shell.ticks(record)):
        deaf.silent |= ticked.result.s >= MIDDLE
        path = path if deaf.silent else ticked.result.commanded_path
        states.append(ticked.output.status.state.value)
        if deaf.silent and ticked.truth.speed < 0.01:
            break
    shell.close()
    return ticked.truth, path, states


@pytest.mark.thorough
def test_without_setpoints_the_car_comes_to_rest_on_the_commanded_path() -> None:
    truth, path, states = isolated(stopped, True)
    assert states[-1] in ("stopping", "stopped")
    line, rest = shapely.LineString([*zip(path.x, path.y, strict=True)]), shapely.Point(truth.x, truth.y)
    assert shapely.distance(line, rest) < 0.3
    assert shapely.line_locate_point(line, rest) > 5.0
    elsewhere, _, _ = isolated(stopped, False)
    assert shapely.distance(line, shapely.Point(elsewhere.x, elsewhere.y)) > 0.8


@pytest.mark.thorough
def test_a_drive_cut_off_between_two_writes_replays_up_to_there(record: Path) -> None:
    """The paths are on the disk before the ticks: rows beyond the last tick are left alone."""
    inputs = read_pipeline_inputs(record)
    inputs.ticks[:] = inputs.ticks[:300]
    frames = read_car_frames(record, DEFAULT_EPOCH)
    assert replay(recorded_scenario(record, REPOSITORY), inputs, frames, REPOSITORY) is None
    assert read_commanded(record)["tick"].to_pylist()[-1] > 300
