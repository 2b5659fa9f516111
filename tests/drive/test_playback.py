"""Real recordings through the whole pipeline, laid on a street of Linden: to the end, and nobody obeys."""

from __future__ import annotations

import csv
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.drive.street import REPOSITORY, altered
from tests.isolated import isolated
from tests.pose import recordings
from vve_sumo.errors import ConfigError
from vve_sumo.record.reader import read_table
from vve_sumo.vehicle.dataspeed import codec
from vve_sumo.vehicle.dataspeed.messages import BrakeCommand, SteeringCommand, ThrottleCommand


def play(file: str, folder: str, changes: dict[str, Any]) -> dict[str, Any]:
    """Play a recording in the default scenario and return the summary; call it through `isolated`."""
    from vve_sumo.drive import run as drives

    return drives.run(altered(changes), Path(folder), REPOSITORY, pose=Path(file)).summary


def played(file: Path, folder: Path, **changes: Any) -> tuple[dict[str, Any], Any]:
    """Return the summary and the ticks of a recording played without traffic."""
    summary = isolated(play, str(file), str(folder), {"road.demand": []} | changes, timeout=600.0)
    return summary, read_table(folder, "ticks")


def duration(file: Path) -> float:
    """Return the time from the first row to the last [s]."""
    with file.open(encoding="utf-8", newline="") as rows:
        times = [float(row["time_s"]) for row in csv.DictReader(rows)]
    return times[-1] - times[0]


def enabled(folder: Path) -> int:
    """Return how many commands in the log had their enable bit set."""
    count = 0
    for line in (folder / "can.log").read_text(encoding="ascii").splitlines():
        identifier, _, data = line.split()[2].partition("#")
        message = codec.decode(codec.Frame(int(identifier, 16), bytes.fromhex(data)), codec.Variant.DBW1_2024)
        if isinstance(message, BrakeCommand | ThrottleCommand | SteeringCommand):
            count += message.enable
    return count


def check(file: Path, folder: Path, summary: dict[str, Any], ticks: Any) -> None:
    """Assert that a drive was played whole, that SUMO followed it, and that nothing was enabled."""
    assert summary["outcome"] == "played"
    assert summary["duration_s"] == pytest.approx(duration(file), abs=0.2)
    assert summary["ego_sync_position_error_m"] <= 1e-6
    assert summary["ego_sync_speed_error_mps"] <= 1e-6
    assert set(ticks["state"].to_pylist()) == {"disarmed"}
    assert enabled(folder) == 0
    assert np.isfinite(ticks["x_m"].to_numpy()[5:]).all()
    assert np.isfinite(ticks["steering_setpoint_rad"].to_numpy()[5:]).all()


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("name", "mean", "greatest", "metres"),
    [("comma2k19", 0.02, 0.1, None), pytest.param("boreas", 0.03, 0.3, 8000.0, marks=pytest.mark.slow)],
)
def test_a_recorded_drive_runs_to_the_end(
    shared_data: Path, tmp_path: Path, name: str, mean: float, greatest: float, metres: float | None
) -> None:
    file = getattr(recordings, name)(shared_data, tmp_path / f"{name}.csv")
    summary, ticks = played(file, tmp_path / "record")
    check(file, tmp_path / "record", summary, ticks)
    assert summary["prediction_error_100ms_mean_m"] < mean
    assert summary["prediction_error_100ms_max_m"] < greatest
    if metres is not None:
        travelled = np.abs(np.diff(ticks["x_m"].to_numpy()) + 1j * np.diff(ticks["y_m"].to_numpy()))
        assert np.nansum(travelled) == pytest.approx(metres, rel=0.1)


def write_circle(file: Path, seconds: float) -> None:
    """Write a made-up drive: a slow circle of 30 m radius, 10 fixes a second."""
    lines = ["time_s,latitude_deg,longitude_deg,heading_deg,speed_mps"]
    for n in range(round(seconds * 10)):
        angle = 0.1 * n * 6.0 / 30.0
        north, east = 30.0 * math.sin(angle), 30.0 * (1.0 - math.cos(angle))
        latitude = 43.0 + north / 111_111.0
        longitude = -79.0 + east / (111_320.0 * math.cos(math.radians(43.0)))
        lines.append(f"{1000.0 + 0.1 * n:.3f},{latitude:.10f},{longitude:.10f},{math.degrees(angle) % 360.0:.6f},6.0")
    file.write_text("\n".join(lines) + "\n", encoding="utf-8")


@pytest.mark.thorough
def test_a_drive_is_laid_where_the_path_starts(tmp_path: Path) -> None:
    """Matched start: the first pose is the path's start; the way travelled keeps its length and its turning sense."""
    write_circle(tmp_path / "circle.csv", 12.0)
    summary, ticks = played(tmp_path / "circle.csv", tmp_path / "record")
    assert summary["outcome"] == "played"
    begin = altered({}).path.at(0.0)
    assert ticks["x_m"][0].as_py() == pytest.approx(begin.x, abs=0.2)
    assert ticks["y_m"][0].as_py() == pytest.approx(begin.y, abs=0.2)
    assert ticks["heading_rad"][0].as_py() == pytest.approx(begin.heading, abs=0.05)
    turned = np.unwrap(ticks["heading_rad"].to_numpy())
    assert turned[-1] - turned[0] == pytest.approx(-12.0 * 6.0 / 30.0, abs=0.15)


def test_a_recording_without_a_usable_fix_is_named(tmp_path: Path) -> None:
    (tmp_path / "empty.csv").write_text("time_s,latitude_deg,longitude_deg,heading_deg,speed_mps\n", encoding="utf-8")
    (tmp_path / "noise.ncom").write_bytes(bytes(range(256)) * 10)
    from vve_sumo.drive import run as drives

    for name in ("empty.csv", "noise.ncom"):
        with pytest.raises(ConfigError, match=name):
            drives.run(altered({}), tmp_path / "record", REPOSITORY, pose=tmp_path / name)
    assert not (tmp_path / "record").exists()
