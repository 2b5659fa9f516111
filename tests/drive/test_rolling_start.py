"""Rolling starts against standing starts that have come to the same speed at the same place, and closed forms."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.drive.street import REPOSITORY, altered, drive_once, recorded
from tests.isolated import command, isolated
from vve_sumo.drive.brain import ExternalController
from vve_sumo.drive.lockstep import ScriptedOperator, assemble
from vve_sumo.drive.replay import read_car_frames, read_pipeline_inputs, recorded_scenario, replay
from vve_sumo.drive.resolved_scenario import DEFAULT_EPOCH
from vve_sumo.drive.rolling_start import SETTLING_TIME, Ramp, RollingController, RollingStart
from vve_sumo.drive.verify import alterations
from vve_sumo.errors import ConfigError
from vve_sumo.live.assembly import scenario_with_rig
from vve_sumo.path import ReferencePath
from vve_sumo.plant.injected_faults import InjectedFault
from vve_sumo.timing import PERIOD
from vve_sumo.values import ArmingState, ControlCommand, Observation, Point, Pose

#: of the straight on which the default path begins, and of the bend after it, at its tightest [m]
STRAIGHT, BEND = 60.0, 159.0
EMPTY: dict[str, Any] = {"road.demand": [], "obstacles": []}
AT_SPEED = {"ego.speed_mps": 8.0, "duration_s": 17.0}
ON_BEND = {"ego.speed_mps": 4.0, "duration_s": 46.0}


def standing(changes: dict[str, Any], factory: pytest.TempPathFactory) -> pd.DataFrame:
    record = recorded(factory, EMPTY | changes, factory.mktemp("standing") / "r")
    return pd.read_parquet(record / "ticks.parquet")


def rolling_changes(changes: dict[str, Any], s: float) -> dict[str, Any]:
    speed = changes["ego.speed_mps"]
    return EMPTY | changes | {"duration_s": 5.0, "ego.initial_speed_mps": speed, "ego.initial_s_m": s}


@pytest.fixture(scope="module")
def record(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return recorded(tmp_path_factory, rolling_changes(AT_SPEED, STRAIGHT), tmp_path_factory.mktemp("rolling") / "r")


@given(speed=st.floats(1.0, 40.0), acceleration=st.floats(0.1, 5.0), jerk=st.floats(0.2, 10.0))
def test_a_ramp_is_the_integral_of_its_own_jerk_and_acceleration(
    speed: float, acceleration: float, jerk: float
) -> None:
    ramp = Ramp.to(speed, acceleration, jerk)
    times = np.linspace(0.0, ramp.duration, 4001)
    points = np.array([ramp.at(time) for time in times.tolist()])
    step = float(times[1])

    def summed(values: np.ndarray) -> np.ndarray:
        return np.concatenate(([0.0], np.cumsum(0.5 * step * (values[1:] + values[:-1]))))

    kink = jerk * step * step  # the most that a trapezium misses of the speed where the acceleration bends
    np.testing.assert_allclose(points[:, 1], summed(points[:, 2]), atol=kink)
    np.testing.assert_allclose(points[:, 0], summed(points[:, 1]), atol=kink * ramp.duration)
    assert points[-1].tolist() == pytest.approx([ramp.length, speed, 0.0], abs=1e-6)
    assert points[:, 2].max() <= acceleration * (1.0 + 1e-12)
    assert np.abs(np.diff(points[:, 2])).max() <= jerk * step * (1.0 + 1e-6)
    later = ramp.at(ramp.duration + 2.0)
    assert later == pytest.approx((ramp.length + 2.0 * speed, speed, 0.0))


@pytest.mark.thorough
def test_the_car_has_the_steady_state_of_a_standing_start_at_that_place(
    record: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    rolled, from_rest = pd.read_parquet(record / "ticks.parquet"), standing(AT_SPEED, tmp_path_factory)
    assert rolled.tick[0] == 0
    assert rolled.time_s[0] == 0.0
    assert rolled.s_m[0] == pytest.approx(STRAIGHT, abs=0.5)
    there = from_rest[from_rest.s_m.between(STRAIGHT, rolled.s_m.iloc[-1])]
    assert len(there) == pytest.approx(len(rolled), abs=10)
    speed = np.interp(rolled.s_m, there.s_m, there.true_speed_mps)
    assert np.abs(rolled.true_speed_mps - speed).max() < 0.05
    begin = rolled[rolled.time_s < 0.5]
    asked, granted = begin.acceleration_setpoint_mps2, begin.granted_acceleration_mps2
    assert np.abs(asked - there.acceleration_setpoint_mps2.mean()).max() < 0.05
    assert (asked == granted).all()
    # Neither pedal steps: throttle moves as between two ticks of the steady drive, and the brakes stay released.
    assert begin.throttle_percent.diff().abs().max() <= there.throttle_percent.diff().abs().max() + 0.5
    assert begin.throttle_percent.between(there.throttle_percent.min() - 1.0, there.throttle_percent.max() + 1.0).all()
    assert (rolled.brake_torque_nm == 0.0).all()
    assert np.abs(begin.lateral_deviation_m - np.interp(begin.s_m, there.s_m, there.lateral_deviation_m)).max() < 0.03
    assert (rolled.state == "engaged").all()
    assert (rolled.reasons == "").all()
    assert rolled.pose_trusted.all()


@pytest.mark.thorough
def test_on_a_bend_the_wheels_are_turned_as_they_would_be(tmp_path_factory: pytest.TempPathFactory) -> None:
    folder = tmp_path_factory.mktemp("bend") / "r"
    rolled = pd.read_parquet(recorded(tmp_path_factory, rolling_changes(ON_BEND, BEND), folder) / "ticks.parquet")
    from_rest = standing(ON_BEND, tmp_path_factory)
    begin = rolled[rolled.time_s < 0.5]
    for column, tolerance in (("true_speed_mps", 0.05), ("steering_rad", 0.01), ("yaw_rate_radps", 0.02)):
        expected = np.interp(begin.s_m, from_rest.s_m.dropna(), from_rest[column][from_rest.s_m.notna()])
        assert np.abs(begin[column] - expected).max() < tolerance, column
    assert begin.steering_rad.abs().min() > 0.1  # it is a bend


def test_the_gateway_was_engaged_at_rest_by_the_ordinary_steps() -> None:
    resolved = altered(rolling_changes(AT_SPEED, 0.0))
    parts, states = assemble(resolved, REPOSITORY), []

    class Witness(ScriptedOperator):
        def observe(self, status: Any) -> None:
            super().observe(status)
            states.append((status.state, status.reasons, parts.gateway.monitor.speed))

    parts.roll(resolved, Witness())
    assert len(states) == parts.rolling.ticks
    order = list(dict.fromkeys((state, *reasons) for state, reasons, _speed in states))
    before_speed = [state for state, _reasons, speed in states if speed == 0.0]
    assert order[-4:] == [
        (ArmingState.ENGAGED, "engaging"),
        (ArmingState.ENGAGED, "shifting"),
        (ArmingState.ENGAGED, "waiting_for_go"),
        (ArmingState.ENGAGED,),
    ]
    assert {ArmingState.DISARMED, ArmingState.READY, ArmingState.ENGAGED} == {*before_speed}
    assert parts.pipeline.pose.time < 0.0


@pytest.mark.thorough(witnesses=1)
@pytest.mark.parametrize("fidelity", ["ideal", "measured"])
@pytest.mark.parametrize("speed", [1.0, 3.0, 11.176, 15.0])
def test_every_speed_is_reached_at_its_place(speed: float, fidelity: str) -> None:
    changes = {"ego.car.fidelity": fidelity, "ego.speed_mps": speed, "ego.initial_speed_mps": speed}
    resolved = altered(EMPTY | changes | {"ego.initial_s_m": 500.0})
    parts = assemble(resolved, REPOSITORY)
    parts.roll(resolved, ScriptedOperator())
    assert parts.pipeline.pose.speed == pytest.approx(speed, abs=0.1)
    rolling = parts.rolling
    assert 500.0 - rolling.stands_at == pytest.approx(0.5 * speed * rolling.ramp.duration + speed * SETTLING_TIME)
    assert rolling.begin == -rolling.ticks * PERIOD


@pytest.mark.thorough
def test_record_and_scenario_say_it_and_the_replay_is_bit_for_bit(record: Path) -> None:
    scenario = json.loads((record / "scenario.json").read_text(encoding="utf-8"))["settings"]["ego"]
    assert (scenario["initial_speed_mps"], scenario["initial_s_m"]) == (8.0, STRAIGHT)
    resolved, inputs = recorded_scenario(record, REPOSITORY), read_pipeline_inputs(record)
    frames = read_car_frames(record, DEFAULT_EPOCH)
    assert replay(resolved, inputs, frames, REPOSITORY) is None
    assert alterations(record) == []
    assert "same" in command("replay", str(record), cwd=REPOSITORY).stdout
    from_rest = altered(EMPTY | AT_SPEED)
    assert not {"initial_speed_mps", "initial_s_m"} & from_rest.to_dict(REPOSITORY)["settings"]["ego"].keys()
    difference = replay(altered(rolling_changes(AT_SPEED, STRAIGHT) | {"seed": 2}), inputs, frames, REPOSITORY)
    assert difference is not None, "what came before drive time 0 counts"


@pytest.mark.thorough
def test_outcome_and_figures_are_those_of_standing_starts() -> None:
    """Two seeds each: the means differ by less than a standing start's seeds do, or a few centimetres."""
    changes = {"road.demand": [], "ego.speed_mps": 7.0, "obstacles": [{"id": "parked_car", "at_m": 116.0}]}
    begin = {"ego.initial_speed_mps": 7.0, "ego.initial_s_m": 50.0}
    from_rest, rolled = (
        pd.DataFrame([isolated(drive_once, changes | other | {"seed": seed}) for seed in (1, 2)])
        for other in ({}, begin)
    )
    assert {*from_rest.outcome, *rolled.outcome} == {"stopped"}
    assert (from_rest.duration_s.mean() - rolled.duration_s.mean()) > 7.0
    for figure, tolerance in (("stop_gap_m", 0.15), ("min_ttc_s", 0.05), ("max_deceleration_mps2", 0.1)):
        assert rolled[figure].mean() == pytest.approx(from_rest[figure].mean(), abs=tolerance), figure


@pytest.mark.parametrize(
    ("changes", "complaint"),
    [
        ({"ego.initial_speed_mps": 12.0}, "ego: initial_speed_mps 12 is above speed_mps 11.176"),
        ({"ego.initial_speed_mps": 0.5}, "ego.initial_speed_mps: expected greater than or equal to 1, got 0.5"),
        ({"ego.initial_s_m": 5.0}, "ego: initial_s_m needs initial_speed_mps"),
    ],
)
def test_a_wrong_value_is_refused_with_its_key(changes: dict[str, Any], complaint: str) -> None:
    with pytest.raises(ConfigError, match=complaint):
        altered(changes)


def test_a_speed_may_have_a_unit() -> None:
    assert altered({"ego.initial_speed": "25 mph"}).scenario.ego.initial_speed_mps == 11.176


@pytest.mark.parametrize("said", [math.nan, math.inf, -math.inf, None])
def test_what_a_controller_says_wrongly_before_drive_time_0_is_not_replaced_by_the_ramp(said: float | None) -> None:
    class Wrong:
        def step(self, _observation: Observation) -> Any:
            return None if said is None else ControlCommand(0.0, said)

    resolved = altered(rolling_changes(AT_SPEED, STRAIGHT))
    rolling = RollingStart.of(resolved)
    assert rolling is not None
    pose = Pose(0.0, Point.REAR_AXLE, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    observation = Observation(-1, rolling.begin + 1.0, pose, resolved.path, 8.0, {}, 0.0)
    command = RollingController(Wrong(), rolling).step(observation)
    assert command is None if said is None else repr(command.acceleration) == repr(said)


def loop() -> ReferencePath:
    """A circle of 40 m radius that comes back to its start."""
    turn = np.linspace(0.0, 2.0 * np.pi, 60)
    return ReferencePath.from_points(40.0 * np.sin(turn), 40.0 - 40.0 * np.cos(turn))


def test_what_cannot_roll_is_refused_in_one_line() -> None:
    rolling, key = altered(rolling_changes(AT_SPEED, 0.0)), "/parked_car.toml: ego.initial_speed_mps:"
    with pytest.raises(ConfigError, match=r"/parked_car.toml: ego.initial_s_m: 9000 lies beyond the path's 857"):
        assemble(altered(rolling_changes(AT_SPEED, 9000.0)), REPOSITORY)
    with pytest.raises(ConfigError, match=r"ego.initial_speed_mps: a drive with a rig starts from rest"):
        scenario_with_rig(rolling, _rig(), REPOSITORY)
    with pytest.raises(ConfigError, match=f"{key} an external controller is asked from drive time 0 on"):
        assemble(rolling, REPOSITORY, ExternalController(cast(Any, object())))
    with pytest.raises(ConfigError, match=f"{key} the times of injected faults count from when the car drives off"):
        assemble(replace(rolling, faults=(InjectedFault("pose_late", 1.0, 1.0),)), REPOSITORY)
    with pytest.raises(
        ConfigError, match=rf"{key} the car would come up to speed from s -46\.6 m, where the path passes"
    ):
        RollingStart.of(replace(rolling, path=loop()))


def test_a_speed_that_the_bends_forbid_is_refused() -> None:
    too_fast = altered(rolling_changes(AT_SPEED, BEND))
    parts = assemble(too_fast, REPOSITORY)
    with pytest.raises(
        ConfigError, match=r"when the drive begins the car is engaged at 5\.\d\d m/s and s 15\d\.\d m; exp"
    ):
        parts.roll(too_fast, ScriptedOperator())


def test_a_playback_cannot_roll(tmp_path: Path) -> None:
    text = (REPOSITORY / "scenarios" / "parked_car.toml").read_text(encoding="utf-8")
    (tmp_path / "rolls.toml").write_text(text.replace("[ego]\n", '[ego]\ninitial_speed = "20 mph"\n'), encoding="utf-8")
    (tmp_path / "pose.ncom").write_bytes(b"")
    done = command("drive", "rolls.toml", "--pose", "pose.ncom", cwd=tmp_path)
    assert done.returncode == 2
    assert "rolls.toml: ego.initial_speed_mps: a recorded drive begins as it was recorded" in done.stderr
    assert not (tmp_path / "runs").exists()


def _rig() -> Any:
    from vve_sumo.rig.load import load

    return load(REPOSITORY / "rigs" / "simulated.toml", REPOSITORY)
