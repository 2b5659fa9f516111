"""From names to a drive, and from figures to a judgement."""

from __future__ import annotations

import dataclasses
import hashlib
import math
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest

from tests.drive.street import REPOSITORY, altered
from vve_sumo.controller import Guarded
from vve_sumo.drive import command
from vve_sumo.drive.pipeline import Pipeline
from vve_sumo.drive.virtual_road import standing
from vve_sumo.errors import ConfigError
from vve_sumo.frames import Alignment, Mounting, Placement, local_frame
from vve_sumo.pose.ncom import Decoder
from vve_sumo.pose.predict import Predictor
from vve_sumo.pose.trust import PLAYBACK, TrustGate
from vve_sumo.record.record import Record
from vve_sumo.scenario.schema import Band, Criteria
from vve_sumo.sensors.radar import Radar
from vve_sumo.values import ArmingState, Setpoint
from vve_sumo.vehicle.dataspeed import codec
from vve_sumo.vehicle.gateway import Gateway, OperatorCommand
from vve_sumo.world.surroundings import table

GOOD = {
    "outcome": "stopped",
    "collision": False,
    "stop_gap_m": 5.1,
    "min_ttc_s": 2.0,
    "max_lateral_deviation_m": 0.1,
    "max_deceleration_mps2": 2.2,
    "duration_s": 60.0,
}


def judged(criteria: Criteria, **changes: Any) -> list[str]:
    return command.judge(criteria, GOOD | changes)


STRICT = Criteria(
    outcome="stopped",
    collision=False,
    stop_gap_m=Band(min=4.5, max=5.5),
    max_lateral_deviation_m=Band(max=0.15),
)


def test_a_drive_that_meets_its_criteria_passes() -> None:
    assert judged(STRICT) == []


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"outcome": "fault"}, "outcome is fault, expected stopped"),
        ({"collision": True}, "collision is True, expected False"),
        ({"stop_gap_m": 5.6}, "stop_gap_m is 5.600, expected 4.5 to 5.5"),
        ({"stop_gap_m": 4.4}, "stop_gap_m is 4.400"),
        ({"stop_gap_m": math.nan}, "stop_gap_m is nan"),
        ({"max_lateral_deviation_m": 0.16}, "expected at most 0.15"),
        ({"max_lateral_deviation_m": math.nan}, "max_lateral_deviation_m is nan"),
    ],
)
def test_each_criterion_fails_by_itself(changes: dict[str, Any], words: str) -> None:
    (line,) = judged(STRICT, **changes)
    assert words in line


def test_nothing_ahead_meets_a_limit_on_the_time_to_collision_only_from_below() -> None:
    """No time to collision at all is as good as an endless one."""
    assert judged(Criteria(min_ttc_s=Band(min=1.5)), min_ttc_s=math.nan) == []
    assert judged(Criteria(min_ttc_s=Band(min=1.5)), min_ttc_s=1.2)


@pytest.mark.parametrize(
    ("name", "met", "missed"),
    [
        ("max_drac_mps2", Band(max=3.0), Band(min=0.5)),
        ("min_gap_m", Band(min=1.0), Band(max=20.0)),
        ("min_ttc_s", Band(min=1.0), Band(max=5.0)),
        ("stop_gap_m", None, Band(min=1.0)),
        ("impact_speed_mps", None, Band(max=9.0)),
    ],
)
def test_what_nothing_ahead_is_as_good_as(name: str, met: Band | None, missed: Band) -> None:
    """No need to brake, an endless gap, an endless time; a figure that is missing for another reason fails."""
    if met is not None:
        assert judged(Criteria(**{name: met}), **{name: math.nan}) == []
    assert judged(Criteria(**{name: missed}), **{name: math.nan})


def test_the_figures_of_conflicts_are_judged() -> None:
    wanted = Criteria(
        outcome="aborted",
        collision=True,
        impact_speed_mps=Band(max=5.0),
        emergency_used=True,
        max_drac_mps2=Band(max=4),
    )
    good = {"outcome": "aborted", "collision": True, "impact_speed_mps": 4.9, "emergency_used": True}
    assert judged(wanted, **good, max_drac_mps2=3.0) == []
    assert judged(wanted, **good | {"impact_speed_mps": 5.1}, max_drac_mps2=3.0) == [
        "impact_speed_mps is 5.100, expected at most 5"
    ]
    assert judged(wanted, **good | {"emergency_used": False}, max_drac_mps2=3.0) == [
        "emergency_used is False, expected True"
    ]
    assert len(judged(wanted, **good, max_drac_mps2=4.1)) == 1


def test_a_broken_drive_never_passes() -> None:
    for outcome in ("broken", "interrupted"):
        assert judged(Criteria(), outcome=outcome)


def test_a_drive_that_a_fault_ended_passes_only_where_that_was_asked_for() -> None:
    assert judged(Criteria(), outcome="fault") == ["a fault ended the drive"]
    assert judged(Criteria(outcome="fault"), outcome="fault") == []


def test_a_band_that_nothing_can_meet_is_refused() -> None:
    with pytest.raises(ValueError, match="least 6"):
        Band(min=6.0, max=5.0)


def test_the_command_line_lays_over_the_scenario() -> None:
    setting = command.choose("parked_car", REPOSITORY, seed=7, controller="follow_and_stop")
    assert setting.scenario.seed == 7
    with pytest.raises(ConfigError, match="--seed"):
        command.choose("parked_car", REPOSITORY, seed=-1)


def test_another_controller_does_not_get_the_tuning_of_the_scenarios_own(tmp_path: Path) -> None:
    text = (REPOSITORY / "scenarios" / "parked_car.toml").read_text(encoding="utf-8")
    control = '[controller]\nname = "follow_and_stop"\ntuning = { gap_m = 6.0 }\n\n[criteria]'
    (tmp_path / "mine.toml").write_text(text.replace("[criteria]", control), encoding="utf-8")
    same = command.choose(str(tmp_path / "mine.toml"), REPOSITORY, controller="follow_and_stop")
    other = command.choose(str(tmp_path / "mine.toml"), REPOSITORY, controller="mine.py:make")
    assert same.scenario.controller.tuning == {"gap_m": 6.0}
    assert other.scenario.controller.tuning == {}


def test_the_record_names_the_controllers_files_that_were_read_and_no_other(tmp_path: Path) -> None:
    (tmp_path / "near.py").write_text("GAIN = 1.0\n", encoding="utf-8")
    (tmp_path / "unused.py").write_text("", encoding="utf-8")
    (tmp_path / "mine.py").write_text(
        "from .near import GAIN\nclass Mine:\n    def step(self, situation):\n        return GAIN\n"
        "def make(vehicle, tuning):\n    return Mine()\n",
        encoding="utf-8",
    )
    setting = altered({"controller": {"name": f"{tmp_path / 'mine.py'}:make"}})
    setting.controller(REPOSITORY)
    hashes = setting.resolved(REPOSITORY)["files_sha256"]
    assert {role for role in hashes if role.startswith("controller_")} == {"controller_mine", "controller_near"}
    assert hashes["controller_near"] == hashlib.sha256(b"GAIN = 1.0\n").hexdigest()


def rows(**columns: list[Any]) -> pa.Table:
    return pa.table(columns)


def test_the_emergency_layer_counts_only_where_somebody_obeyed() -> None:
    asked = {"emergency": [False, True, False]}
    for state, used in (("engaged", True), ("disarmed", False), ("stopping", False)):
        summary_rows = rows(**asked, state=[state] * 3)
        assert command.emergency_used(summary_rows) is used
    assert command.emergency_used(rows(emergency=[True, False], state=["ready", "engaged"])) is False


def test_the_greatest_of_a_column_leaves_out_what_is_no_number() -> None:
    assert command.greatest(rows(x=[math.nan, 1.0, 3.0, 2.0])["x"]) == 3.0
    assert math.isnan(command.greatest(rows(x=[math.nan])["x"]))


def test_a_mistake_of_ours_under_way_is_an_outcome_with_its_story(tmp_path: Path) -> None:
    """A shell that raises: the record is finished, says broken, and holds the traceback."""
    record = Record(tmp_path / "r", {}, 0.0)

    class Shell:
        def run(self, record: Record, watch: object) -> None:
            raise ZeroDivisionError("in the middle")

    done = command.guarded(Shell(), record, print)  # type: ignore[arg-type]
    assert done.outcome == "broken"
    assert "in the middle" in done.text
    assert "ZeroDivisionError" in (tmp_path / "r" / "traceback.txt").read_text(encoding="utf-8")


class _Straight:
    def step(self, situation: object) -> Setpoint:
        return Setpoint(0.0, 1.0)


def test_the_playback_profile_can_never_arm() -> None:
    """The operator's act is refused whatever the car reports, and no frame ever enables anything."""
    setting = altered({})
    frame = local_frame(0.7, -1.4)
    chain = Pipeline(
        decoder=Decoder(),
        gate=TrustGate(PLAYBACK, 0.0),
        placement=Placement(frame, Alignment(), Mounting(0.0, 0.0), 0.0),
        predictor=Predictor(),
        radar=Radar(setting.radar(), setting.vehicle, np.random.default_rng(1)),
        controller=Guarded(_Straight()),
        vehicle=setting.vehicle,
        path=setting.path,
        desired_speed=5.0,
    )
    gateway = Gateway(setting.vehicle, setting.model.calibration)
    placement = Placement(frame, Alignment(), Mounting(0.0, 0.0), 0.0)
    reports = [
        codec.encode(codec.BrakeReport(codec.BrakeReportKind.TORQUE, 0.0, 0.0, 0.0, enabled=False)),
        codec.encode(codec.WheelSpeeds(0.0, 0.0, 0.0, 0.0)),
    ]
    for tick in range(200):
        now = 0.02 * tick
        pose = standing(0.0, 0.0, 0.0)
        chain.accept(now, dataclasses.replace(placement.unplace(pose), time=now, pitch=0.0, altitude=0.0))
        chain.see(now, table(now, ()))
        decided = chain.decide(tick, now, gateway.measured_steering)
        output = gateway.step(now, decided.setpoint, reports, OperatorCommand.ENGAGE)
        assert output.verdict.state is not ArmingState.ENGAGED
        assert "profile_may_not_arm" in decided.faults
        commands = [codec.decode(each, codec.Variant.DBW1_2024) for each in output.frames]
        assert not any(getattr(each, "enable", False) for each in commands)
