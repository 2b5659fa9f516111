"""An environment of gymnasium against gymnasium's own checker, an ordinary drive, and what goes wrong."""

from __future__ import annotations

import os
import signal
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import pytest

import vve_sumo as vve
from tests.bridges import law
from vve_sumo.errors import ConfigError, SimulationError

gymnasium = pytest.importorskip("gymnasium", reason="the extra gymnasium is not installed")

from gymnasium.utils.env_checker import check_env  # noqa: E402

from vve_sumo.bridges.drive_environment import DriveEnvironment  # noqa: E402
from vve_sumo.bridges.observed_numbers import FEATURES  # noqa: E402

PARKED_CAR = "vve_sumo.bridges.environments:vve_sumo/ParkedCar-v0"
#: a parked car on an empty straight road, which a drive reaches in ten seconds
NEAR = {"obstacles.parked_car.at_m": 50.0, "ego.speed_mps": 8.0}
#: over after three seconds
SHORT = NEAR | {"duration_s": 3.0}
FULL = np.array([1.0], np.float32)


@pytest.fixture(scope="module")
def short() -> Iterator[DriveEnvironment]:
    """An environment whose episodes are short."""
    environment = DriveEnvironment("delay_probe", values=SHORT)
    yield environment
    environment.close()


def driven(environment: Any, seed: int, choose: Any) -> tuple[list[np.ndarray], list[float], tuple[bool, bool], dict]:
    """Drive an episode to its end."""
    observed, _info = environment.reset(seed=seed)
    seen, rewards = [observed], []
    while True:
        observed, reward, terminated, truncated, info = environment.step(choose(observed))
        seen.append(observed)
        rewards.append(reward)
        if terminated or truncated:
            return seen, rewards, (terminated, truncated), info


def test_gymnasium_finds_nothing_wrong(short: DriveEnvironment) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        # Actions keep their units; a wrapper of gymnasium brings them to -1 to 1.
        warnings.filterwarnings("ignore", message=".*symmetric and normalized space.*")
        check_env(short, skip_render_check=True)


def test_stable_baselines_finds_nothing_wrong(short: DriveEnvironment) -> None:
    checker = pytest.importorskip("stable_baselines3.common.env_checker", reason="stable-baselines3 is not installed")
    checker.check_env(short, skip_render_check=True)


@pytest.fixture(scope="module")
def episodes(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[dict[str, Any]]]:
    """Records of three episodes by one law, of which the first two have one seed, and what each came to."""
    folder = tmp_path_factory.mktemp("episodes") / "records"
    environment = gymnasium.make(PARKED_CAR, scenario="delay_probe", values=NEAR, records=folder)
    infos = [driven(environment, seed, law.acceleration)[3] for seed in (7, 7, 8)]
    environment.close()
    return folder, infos


def processes() -> set[int]:
    """Return the processes that descend from this one."""
    return {process.pid for process in psutil.Process().children(recursive=True)}


def hashes(folder: Path) -> dict[str, str]:
    return dict(vve.load(folder).summary["record_parts_sha256"])


def test_the_same_seed_and_actions_leave_the_same_bytes(episodes: tuple[Path, list[dict[str, Any]]]) -> None:
    folder, infos = episodes
    first, again, other = (Path(info["record"]) for info in infos)
    assert [place.parent for place in (first, again, other)] == [folder] * 3
    written = sorted(file.relative_to(first) for file in first.rglob("*") if file.is_file())
    apart = [str(name) for name in written if (first / name).read_bytes() != (again / name).read_bytes()]
    # The one says when its drive began, to the second, and the other says the one's hash.
    assert set(apart) <= {"provenance.json", "summary.json"}
    assert hashes(first) == hashes(again)
    assert hashes(first) != hashes(other)


def test_an_agents_drive_is_the_drive_of_a_controller_by_the_same_law(
    episodes: tuple[Path, list[dict[str, Any]]], tmp_path: Path
) -> None:
    scenario = vve.Scenario("delay_probe").replace(NEAR)
    own = vve.drive(scenario, seed=7, controller=f"{Path(law.__file__)}:make", out=tmp_path / "own", progress=False)
    info = episodes[1][0]
    mine, controllers = hashes(Path(info["record"])), hashes(own.folder)
    names = "scenario.json"  # names the controller, which of an agent's drive nobody can ask again
    assert mine.pop(names) != controllers.pop(names)
    assert mine == controllers
    assert info["figures"]["stop_gap_m"] == own.summary["stop_gap_m"]
    assert (info["outcome"], info["passed"]) == ("stopped", True)


def test_time_out_is_a_truncation_and_a_stop_a_termination(
    short: DriveEnvironment, episodes: tuple[Path, list[dict[str, Any]]]
) -> None:
    seen, rewards, ended, info = driven(short, 3, lambda observed: FULL)
    assert (ended, info["outcome"]) == ((False, True), "timeout")
    assert len(rewards) == 30  # 3 s of drive at ten actions a second
    # The rewards of progress add up to the way at the desired speed.
    place = law.PLACE["remaining_m"]
    assert sum(rewards[:-1]) == pytest.approx((seen[0][place] - seen[-1][place]) / 8.0, abs=1e-4)
    assert seen[-1][law.PLACE["speed_mps"]] > 0.5


@pytest.mark.thorough
def test_vectors_of_processes_drive_as_one_does(short: DriveEnvironment) -> None:
    made = {"scenario": "delay_probe", "values": SHORT}
    vector = gymnasium.make_vec(PARKED_CAR, num_envs=2, vectorization_mode="async", **made)
    try:
        first, _ = vector.reset(seed=[3, 4])
        after, rewards, *_ = vector.step(np.array([FULL, FULL]))
    finally:
        vector.close()
    for number, seed in enumerate((3, 4)):
        observed, _ = short.reset(seed=seed)
        assert (first[number] == observed).all()
        observed, reward, *_ = short.step(FULL)
        assert (after[number] == observed).all()
        assert rewards[number] == reward


def test_the_agents_steering_reaches_the_car(tmp_path: Path) -> None:
    environment = DriveEnvironment("delay_probe", values=SHORT, agent_steers=True, records=tmp_path / "records")
    action = np.array([1.0, 0.05], np.float32)
    *_, info = driven(environment, 1, lambda observed: action)
    environment.close()
    ticks = vve.load(info["record"]).ticks
    asked = ticks["steering_setpoint_rad"].dropna()
    assert set(asked) == {float(action[1])}


def test_an_episode_may_begin_at_speed(short: DriveEnvironment) -> None:
    rolling = {"ego.initial_speed_mps": 8.0, "ego.initial_s_m": 60.0, "obstacles.parked_car.at_m": 150.0}
    observed, _ = short.reset(seed=1, options={"values": rolling})
    assert observed[law.PLACE["speed_mps"]] == pytest.approx(8.0, abs=0.3)
    after = short.step(np.array([-2.0], np.float32))[0]
    for _ in range(4):
        after = short.step(np.array([-2.0], np.float32))[0]
    assert after[law.PLACE["speed_mps"]] < 7.8


def test_what_an_episode_alters_holds_for_it_alone(short: DriveEnvironment) -> None:
    place = law.PLACE["desired_speed_mps"]
    assert short.reset(seed=1, options={"values": {"ego.speed_mps": 5.0}})[0][place] == 5.0
    assert short.reset(seed=1)[0][place] == 8.0
    with pytest.raises(ConfigError, match="options: expected values alone, got value"):
        short.reset(options={"value": {}})


def test_an_episode_that_is_given_up_is_a_record_that_was_interrupted(tmp_path: Path) -> None:
    before = processes()
    environment = DriveEnvironment("delay_probe", values=SHORT, records=tmp_path / "records")
    environment.reset(seed=1)
    environment.step(FULL)
    environment.reset(seed=1)
    assert vve.load(tmp_path / "records" / "episode_00001").summary["outcome"] == "interrupted"
    assert processes() > before
    environment.close()
    assert processes() == before


def test_a_step_that_is_interrupted_ends_its_episode(short: DriveEnvironment) -> None:
    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    short.reset(seed=1)
    before = signal.signal(signal.SIGALRM, interrupt)
    try:
        with pytest.raises(KeyboardInterrupt):
            drive_until_interrupted(short)
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)
    with pytest.raises(gymnasium.error.ResetNeeded):
        short.step(FULL)
    first, _ = short.reset(seed=1)
    again, _ = short.reset(seed=1)
    assert (first == again).all()


def drive_until_interrupted(environment: DriveEnvironment) -> None:
    """Step for ever; a timer interrupts while a step waits for the drive's process, which is stopped."""
    session = environment._session
    assert session is not None
    for process in psutil.Process(session._worker.pid).children(recursive=True):
        process.suspend()
    signal.setitimer(signal.ITIMER_REAL, 0.2)
    try:
        environment.step(FULL)
    finally:
        for process in psutil.Process(session._worker.pid).children(recursive=True):
            process.resume()


@pytest.mark.thorough(witnesses=1)
@pytest.mark.parametrize("with_the_server", [False, True])
def test_a_process_that_is_killed_is_an_error_and_the_next_episode_a_drive(with_the_server: bool) -> None:
    environment, before = DriveEnvironment("delay_probe", values=SHORT), processes()
    environment.reset(seed=1)
    mine = sorted(processes() - before)
    for process in mine if with_the_server else mine[-1:]:
        os.kill(process, signal.SIGKILL)
    with pytest.raises(SimulationError, match="killed"):
        environment.step(FULL)
    with pytest.raises(gymnasium.error.ResetNeeded):
        environment.step(FULL)
    environment.reset(seed=1)
    assert environment.step(FULL)[2:4] == (False, False)
    environment.close()


@pytest.mark.parametrize(
    ("wrong", "line"),
    [
        ({"scenario": "parked_cat"}, "parked_car"),
        ({"values": {"ego.sped_mps": 1.0}}, "speed_mps"),
        ({"ticks_per_action": 0}, "ticks_per_action: expected at least 1, got 0"),
        ({"render_mode": "human"}, "render_mode: expected None, got 'human'"),
    ],
)
def test_what_is_wrong_is_said_in_a_line(wrong: dict[str, Any], line: str) -> None:
    with pytest.raises(ConfigError, match=line) as raised:
        DriveEnvironment(**wrong)
    assert "\n" not in str(raised.value)


def test_a_records_folder_with_other_files_is_refused(tmp_path: Path) -> None:
    (tmp_path / "mine.txt").touch()
    with pytest.raises(ConfigError, match=str(tmp_path)):
        DriveEnvironment("delay_probe", records=tmp_path)


@pytest.mark.parametrize("action", [[np.nan], [np.inf], [1.0, 1.0], 1.0])
def test_an_action_that_is_none_is_refused_and_the_drive_goes_on(short: DriveEnvironment, action: Any) -> None:
    short.reset(seed=1)
    with pytest.raises(ConfigError, match=r"action: expected 1 finite number\(s\)"):
        short.step(action)
    assert short.step(FULL)[0] in short.observation_space


def test_every_number_is_named_with_its_unit() -> None:
    units = ("_m", "_mps", "_mps2", "_rad", "_radps", "_per_m", "_s")
    assert all(feature.name.endswith(units) and feature.low < feature.high for feature in FEATURES)
    assert len({feature.name for feature in FEATURES}) == len(FEATURES)
