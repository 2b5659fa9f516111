"""Faults under way: the car comes to rest by itself, the reason is in the record, nothing escapes."""

from __future__ import annotations

import dataclasses
import math
import tempfile
from pathlib import Path
from typing import Any

import pytest

from tests.drive.street import REPOSITORY, altered
from tests.exhaustive import with_slow
from tests.isolated import isolated
from vve_sumo.values import Fix, FixQuality

BEGIN = 8.0  #: drive time at which the fault begins; the car is then at about 11 m/s [s]
EPOCH = 1_451_260_818.0


class Fault:
    """A receiver that goes wrong at BEGIN."""

    def __init__(self, kind: str) -> None:
        self.kind = kind
        self.frozen: Fix | None = None

    def __call__(self, fix: Fix) -> Fix | None:
        if fix.time - EPOCH < BEGIN:
            self.frozen = fix
            return fix
        return getattr(self, self.kind)(fix)

    def lost(self, fix: Fix) -> None:
        return None

    def stuck(self, fix: Fix) -> Fix:
        """The position stands still while the velocity says that the car moves."""
        assert self.frozen is not None
        return dataclasses.replace(fix, latitude=self.frozen.latitude, longitude=self.frozen.longitude)

    def jumped(self, fix: Fix) -> Fix:
        return dataclasses.replace(fix, latitude=fix.latitude + 5.0 / 6_371_000.0)

    def no_rtk(self, fix: Fix) -> Fix:
        return dataclasses.replace(fix, quality=FixQuality.RTK_FLOAT)

    def no_heading(self, fix: Fix) -> Fix:
        return dataclasses.replace(fix, heading=math.nan)

    def not_locked(self, fix: Fix) -> Fix:
        return dataclasses.replace(fix, locked=False)

    def back_in_time(self, fix: Fix) -> Fix:
        return dataclasses.replace(fix, time=fix.time - 2.0)

    def running_away(self, fix: Fix) -> Fix:
        """0.24 m north a fix, with a velocity that says nothing of it."""
        steps = round((fix.time - EPOCH - BEGIN) * 100)
        return dataclasses.replace(fix, latitude=fix.latitude + 0.24 * steps / 6_371_000.0)

    def flipped(self, fix: Fix) -> Fix:
        return dataclasses.replace(fix, heading=math.remainder(fix.heading + math.pi, math.tau))

    def poor(self, fix: Fix) -> Fix:
        return dataclasses.replace(fix, position_sigma=0.5)

    def drifting_speed(self, fix: Fix) -> Fix:
        """Satellite speed and position agree with each other and not with the wheels."""
        ahead = 4.0 * (fix.time - EPOCH - BEGIN)
        north, east = ahead * math.sin(fix.heading), ahead * math.cos(fix.heading)
        return dataclasses.replace(
            fix,
            latitude=fix.latitude + north / 6_371_000.0,
            longitude=fix.longitude + east / 6_371_000.0 / math.cos(fix.latitude),
            velocity_north=fix.velocity_north + 4.0 * math.sin(fix.heading),
            velocity_east=fix.velocity_east + 4.0 * math.cos(fix.heading),
        )


REASONS = {
    "lost": "pose_stale",
    "stuck": "pose_stale",
    "jumped": "pose_stale",
    "no_rtk": "pose_stale",
    "no_heading": "pose_stale",
    "not_locked": "pose_stale",
    "back_in_time": "pose_stale",
    "poor": "pose_stale",
    "running_away": "pose_stale",
    "flipped": "pose_stale",
    "drifting_speed": "position_mismatch",
}


def drive_with(kind: str) -> tuple[dict[str, Any], list[float], list[str]]:
    """Return summary, true speeds and states of a drive with a receiver that goes wrong."""
    from vve_sumo.drive.lockstep import Lockstep
    from vve_sumo.drive.summary import summarise
    from vve_sumo.record.reader import read_table
    from vve_sumo.record.writer import RecordWriter

    resolved = altered({"road.demand": [], "obstacles": [], "duration_s": 40.0})
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch) / "record"
        shell = Lockstep(resolved, REPOSITORY, Fault(kind))
        record = RecordWriter(folder, resolved.to_dict(REPOSITORY), EPOCH)
        (done,) = shell.run([record], lambda tick, now, speed, s: None)
        shell.close()
        summary = summarise(resolved, done, folder, record.close())
        ticks = read_table(folder, "ticks")
        return summary, ticks["true_speed_mps"].to_pylist(), ticks["state"].to_pylist()


@pytest.mark.thorough(witnesses=1)
@pytest.mark.parametrize("kind", with_slow(REASONS, lambda kind: kind in ("lost", "flipped", "drifting_speed")))
def test_a_receiver_that_goes_wrong_stops_the_car(kind: str) -> None:
    summary, speeds, states = isolated(drive_with, kind)
    assert summary["outcome"] == "fault"
    assert REASONS[kind] in summary["reasons"]
    assert speeds[-1] == pytest.approx(0.0, abs=0.01)
    if kind == "drifting_speed":
        assert states[-1] == "stopping", "the receiver says that the car moves: held, and never parked"
    else:
        assert "stopped" in states
        assert states[-1] in ("stopped", "disarmed", "ready"), "held, and let go once it is parked"
    assert "engaged" not in states[states.index("stopping") :], "nothing re-engages by itself"
    at_fault = speeds[round(BEGIN / 0.02)]
    bound = 0.5 + at_fault / 2.4 + 1.0  # until it is found, at the gateway's lowest stop, and the ramp
    stopped = next(n for n, speed in enumerate(speeds) if n > BEGIN / 0.02 and speed < 0.05)
    assert stopped * 0.02 - BEGIN <= bound


CONTROLLERS = {
    "controller_raised": "raise RuntimeError('out of ideas')",
    "off_path": "return ControlCommand(0.05, 0.5)",
    "controller_not_finite": "return ControlCommand(float('nan'), 0.0)",
    "controller_wrong_type": "return 'left a bit'",
}


@pytest.mark.thorough(witnesses=1)
@pytest.mark.parametrize("reason", CONTROLLERS)
def test_a_controller_that_fails_stops_the_car(reason: str, tmp_path: Path) -> None:
    (tmp_path / "bad.py").write_text(
        "from vve_sumo.values import ControlCommand\n"
        "class Bad:\n"
        "    def step(self, observation):\n"
        "        if observation.time < 6.0:\n"
        "            return ControlCommand(0.0, 1.0)\n"
        f"        {CONTROLLERS[reason]}\n"
        "def make(vehicle, tuning):\n"
        "    return Bad()\n",
        encoding="utf-8",
    )
    changes = {
        "road.demand": [],
        "obstacles": [],
        "duration_s": 40.0,
        "controller": {"name": f"{tmp_path / 'bad.py'}:make"},
    }
    from tests.drive.street import drive_once

    summary = isolated(drive_once, changes)
    assert summary["outcome"] == "fault"
    assert reason in summary["reasons"]
    assert summary["text"] or reason == "off_path"
    assert summary["max_deceleration_mps2"] >= 2.0
