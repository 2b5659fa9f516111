"""A real car and a simulated ego on one street, live: the ego waits for the car, drives, and its record replays."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.live.stage import rows
from tests.live.two_cars import TwoCars
from vve_sumo.drive.lockstep import lone_steps
from vve_sumo.drive.verify import alterations
from vve_sumo.live import review
from vve_sumo.vehicle.arming import WAITING


def test_skipped_ticks_are_steps_a_period_apart_and_none_is_after_the_next_tick() -> None:
    assert lone_steps(4, 1.0, 5, 1.02) == []
    assert lone_steps(4, 1.0, 8, 1.08) == [(5, 1.02), (6, 1.04), (7, 1.06)]
    assert lone_steps(4, 1.0, 8, 1.05) == [(5, 1.02), (6, 1.04)]


@pytest.mark.live
@pytest.mark.thorough
def test_a_simulated_ego_waits_for_the_real_car_and_its_record_replays(tmp_path: Path) -> None:
    outcome = TwoCars("", tmp_path / "drive", both=False, duration=8.0).run()
    record, second = outcome.record, outcome.record / "egos" / "second"
    assert not outcome.alive
    real, simulated = rows(record, "ticks"), rows(second, "ticks")
    went = next(row["time_s"] for row in real if row["state"] == "engaged" and not row["reasons"])
    states = {row["state"] for row in simulated if row["time_s"] < went}
    assert states <= {"disarmed", "ready"}, "held until the real car goes"
    assert all(row["shell_faults"] == "first_car_waits" for row in simulated if row["time_s"] < went)
    driven = [row for row in simulated if row["state"] == "engaged" and WAITING not in row["reasons"]]
    assert max(row["speed_mps"] for row in driven) > 3.0
    # Both have the bodies of the other, each in its own table of actors.
    for folder, other in ((record, "second"), (second, "ego")):
        assert other in {row["actor"] for row in rows(folder, "actors")}
    for folder in (record, second):
        assert alterations(folder) == []
        inspected = review.inspect(folder, record.parent)
        assert review.replay(inspected, record.parent).differences == []
    summary = json.loads((record / "summary.json").read_text(encoding="utf-8"))
    assert summary["egos"]["second"]["outcome"] in ("timeout", "completed")
