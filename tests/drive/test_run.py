"""From names to a drive: what a scenario is resolved to, and how a drive ends that nobody foresaw."""

from __future__ import annotations

import dataclasses
import hashlib
from pathlib import Path

import pytest

from tests.drive.street import REPOSITORY, altered
from tests.record.declared import RESOLVED
from vve_sumo.controller import Guarded
from vve_sumo.drive import run as drives
from vve_sumo.drive.assembly import sensors_of
from vve_sumo.drive.pipeline import Pipeline
from vve_sumo.drive.virtual_road import pose_at_rest
from vve_sumo.errors import ConfigError
from vve_sumo.frames import Alignment, Mounting, Placement, local_frame
from vve_sumo.pose.ncom import Decoder
from vve_sumo.pose.predict import Predictor
from vve_sumo.pose.trust import PLAYBACK, TrustGate
from vve_sumo.record.writer import RecordWriter
from vve_sumo.values import ArmingState, ControlCommand
from vve_sumo.vehicle.arming_machine import OperatorCommand
from vve_sumo.vehicle.dataspeed import codec, messages
from vve_sumo.vehicle.gateway import Gateway
from vve_sumo.world.surroundings import table


def test_the_command_line_lays_over_the_scenario() -> None:
    resolved = drives.resolve_by_name("parked_car", REPOSITORY, seed=7, controller="follow_and_stop")
    assert resolved.scenario.seed == 7
    with pytest.raises(ConfigError, match="seed: expected 0 to 2147483647"):
        drives.resolve_by_name("parked_car", REPOSITORY, seed=-1)


def test_another_controller_does_not_get_the_tuning_of_the_scenarios_own(tmp_path: Path) -> None:
    text = (REPOSITORY / "scenarios" / "parked_car.toml").read_text(encoding="utf-8")
    control = '[controller]\nname = "follow_and_stop"\ntuning = { gap_m = 6.0 }\n\n[criteria]'
    (tmp_path / "mine.toml").write_text(text.replace("[criteria]", control), encoding="utf-8")
    same = drives.resolve_by_name(str(tmp_path / "mine.toml"), REPOSITORY, controller="follow_and_stop")
    other = drives.resolve_by_name(str(tmp_path / "mine.toml"), REPOSITORY, controller="mine.py:make")
    assert same.scenario.controller.tuning == {"gap_m": 6.0}
    assert other.scenario.controller.tuning == {}


def test_the_record_names_the_controllers_files_that_were_read_and_no_other(tmp_path: Path) -> None:
    (tmp_path / "near.py").write_text("GAIN = 1.0\n", encoding="utf-8")
    (tmp_path / "unused.py").write_text("", encoding="utf-8")
    (tmp_path / "mine.py").write_text(
        "from .near import GAIN\nclass Mine:\n    def step(self, observation):\n        return GAIN\n"
        "def make(vehicle, tuning):\n    return Mine()\n",
        encoding="utf-8",
    )
    resolved = altered({"controller": {"name": f"{tmp_path / 'mine.py'}:make"}})
    resolved.controller(REPOSITORY)
    hashes = resolved.to_dict(REPOSITORY)["files_sha256"]
    assert {role for role in hashes if role.startswith("controller_")} == {"controller_mine", "controller_near"}
    assert hashes["controller_near"] == hashlib.sha256(b"GAIN = 1.0\n").hexdigest()


def test_a_mistake_of_ours_under_way_is_an_outcome_with_its_story(tmp_path: Path) -> None:
    """A shell that raises: the record is finished, says broken, and holds the traceback."""
    record = RecordWriter(tmp_path / "r", RESOLVED, 0.0)

    class TickHost:
        def run(self, records: list[RecordWriter], watch: object) -> None:
            raise ZeroDivisionError("in the middle")

    (done,) = drives.run_guarded(TickHost(), [record], print)  # type: ignore[arg-type]
    assert done.outcome == "broken"
    assert "in the middle" in done.text
    assert "ZeroDivisionError" in (tmp_path / "r" / "traceback.txt").read_text(encoding="utf-8")


class _Straight:
    def step(self, observation: object) -> ControlCommand:
        return ControlCommand(0.0, 1.0)


def test_the_playback_profile_can_never_arm() -> None:
    """The operator's act is refused whatever the car reports, and no frame ever enables anything."""
    resolved = altered({})
    frame = local_frame(0.7, -1.4)
    pipeline = Pipeline(
        decoder=Decoder(),
        gate=TrustGate(PLAYBACK, 0.0),
        placement=Placement(frame, Alignment(), Mounting(0.0, 0.0), 0.0),
        predictor=Predictor(),
        sensors=sensors_of(resolved),
        controller=Guarded(_Straight()),
        vehicle=resolved.vehicle,
        path=resolved.path,
        desired_speed=5.0,
    )
    gateway = Gateway(resolved.vehicle, resolved.model.calibration)
    placement = Placement(frame, Alignment(), Mounting(0.0, 0.0), 0.0)
    reports = [
        codec.encode(codec.BrakeReport(messages.BrakeReportKind.TORQUE, 0.0, 0.0, 0.0, enabled=False)),
        codec.encode(codec.WheelSpeeds(0.0, 0.0, 0.0, 0.0)),
    ]
    for tick in range(200):
        now = 0.02 * tick
        pose = pose_at_rest(0.0, 0.0, 0.0)
        pipeline.accept(now, dataclasses.replace(placement.unplace(pose), time=now, pitch=0.0, altitude=0.0))
        pipeline.see(now, table(now, ()))
        decided = pipeline.decide(tick, now, gateway.monitor.measured_steering)
        output = gateway.step(now, decided.setpoint, reports, OperatorCommand.ENGAGE)
        assert output.status.state is not ArmingState.ENGAGED
        assert "profile_may_not_arm" in decided.faults
        commands = [codec.decode(each, codec.Variant.DBW1_2024) for each in output.frames]
        assert not any(getattr(each, "enable", False) for each in commands)
