"""Steps a second of the environment for gymnasium, beside those of others that are installed, and what PPO learns.

python -m benchmarks.environments [--seconds N] [--learn SECONDS] [--smoke]
Others: highway-env, sumo-rl with libsumo, and SMARTS with its roads of SUMO (all simulate other things, at other steps;
the table says which).
--learn trains PPO of stable-baselines3 to stop before a parked car, for that time, and drives with it afterwards.
"""

from __future__ import annotations

import argparse
import importlib.util
import multiprocessing
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import psutil

#: the paper's parked car on a straight empty road, 60 m away
NEAR = {
    "road.network": "test_track",
    "road.demand": [],
    "ego.path": "test_track",
    "ego.speed_mps": 8.0,
    "obstacles.parked_car.at_m": 60.0,
    "after_stop_s": 0.5,
    "duration_s": 40.0,
}
ENVIRONMENT = "vve_sumo.bridges.environments:vve_sumo/ParkedCar-v0"
#: of actions in training [m/s2]: those of comfortable driving
HARDEST, STRONGEST = -3.0, 2.0
SEEDS = range(1000, 1005)  #: of the drives that judge what was learnt


def ours(**keywords: Any) -> gymnasium.Env[Any, Any]:
    """Return the environment of the near parked car."""
    return gymnasium.make(ENVIRONMENT, values=NEAR, **keywords)


def town() -> gymnasium.Env[Any, Any]:
    """Return the paper's drive in Linden, with its traffic."""
    return gymnasium.make(ENVIRONMENT)


def highway() -> gymnasium.Env[Any, Any]:
    """Return highway-env's default."""
    importlib.import_module("highway_env")
    return gymnasium.make("highway-v0")


def intersection() -> gymnasium.Env[Any, Any]:
    """Return sumo-rl's single intersection, with libsumo."""
    os.environ["LIBSUMO_AS_TRACI"] = "1"
    import sumo_rl

    nets = Path(sumo_rl.__file__).parent / "nets" / "single-intersection"
    made: gymnasium.Env[Any, Any] = sumo_rl.SumoEnvironment(
        net_file=str(nets / "single-intersection.net.xml"),
        route_file=str(nets / "single-intersection.rou.xml"),
        single_agent=True,
        num_seconds=3600,
    )
    return made


class OneCar(gymnasium.Wrapper[Any, Any, Any, Any]):
    """The one agent of an environment of several."""

    def __init__(self, environment: gymnasium.Env[Any, Any], name: str) -> None:
        super().__init__(environment)
        self._name, self.action_space = name, environment.action_space[name]  # type: ignore[index]

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, Any]:
        """Step with the agent's action."""
        observed, reward, terminated, truncated, info = self.env.step({self._name: action})
        return observed, reward, terminated["__all__"], truncated["__all__"], info  # type: ignore[index]


def road() -> gymnasium.Env[Any, Any]:
    """Return SMARTS' car by throttle, brake and steering on a straight empty road of two lanes."""
    import sumo
    from smarts.core.agent_interface import AgentInterface
    from smarts.core.controllers import ActionSpaceType

    importlib.import_module("smarts.env")
    scenario = Path(tempfile.mkdtemp(prefix="smarts_"))
    (scenario / "build").mkdir()
    (scenario / "scenario.py").touch()
    words = "--grid --grid.x-number 2 --grid.y-number 1 --grid.length 800 --default.lanenumber 2 -o"
    netgenerate = [f"{sumo.SUMO_HOME}/bin/netgenerate", *words.split(), f"{scenario}/map.net.xml"]
    subprocess.run(netgenerate, check=True, capture_output=True)
    agent = AgentInterface(action=ActionSpaceType.Continuous, max_episode_steps=300)
    made = gymnasium.make(
        "hiway-v1", scenarios=[str(scenario)], agent_interfaces={"car": agent}, headless=True, disable_env_checker=True
    )
    return OneCar(made, "car")


#: what is timed: name, how it is made, seconds of simulation a step, what a step simulates
ROWS: list[tuple[str, Callable[[], gymnasium.Env[Any, Any]], float, str]] = [
    ("vve_sumo, near parked car", ours, 0.1, "5 ticks: car, receiver, radar, gateway, SUMO, empty road"),
    ("vve_sumo, parked_car", town, 0.1, "the same, 20 vehicles in a town"),
    ("highway-env, highway-v0", highway, 1.0, "15 steps of 50 kinematic vehicles"),
    ("SMARTS, hiway-v1", road, 0.1, "1 step of SUMO, the car by PyBullet, empty road"),
    ("sumo-rl, single intersection", intersection, 5.0, "5 steps of SUMO, no car of one's own"),
]
NEEDS = {
    "highway-env, highway-v0": "highway_env",
    "SMARTS, hiway-v1": "smarts",
    "sumo-rl, single intersection": "sumo_rl",
}


def cpu() -> float:
    """Return the processor time of this process and of all that it started [s]."""
    own = psutil.Process()
    return sum(sum(process.cpu_times()[:4]) for process in (own, *own.children(recursive=True)))


def timed(make: Callable[[], gymnasium.Env[Any, Any]], seconds: float) -> tuple[float, float]:
    """Return steps a second of processor time, without resets, and the median of a reset after the first [s]."""
    environment = make()
    steps, spent, resets, seed = 0, 0.0, [], 1
    environment.reset(seed=seed)
    try:
        while spent < seconds or len(resets) < 2:
            environment.action_space.seed(seed)
            over, begun, last = False, cpu(), time.monotonic()
            while not over and time.monotonic() - last < seconds:
                action = environment.action_space.sample()
                if isinstance(action, np.ndarray):
                    action = np.abs(action)  # a car that stands costs less
                _observation, _reward, terminated, truncated, _info = environment.step(action)
                steps, over = steps + 1, terminated or truncated
            spent, seed, begun = spent + cpu() - begun, seed + 1, cpu()
            environment.reset(seed=seed)
            resets.append(cpu() - begun)
    finally:
        environment.close()
    return steps / spent, statistics.median(resets)


def table(seconds: float) -> None:
    """Print a row an environment; all times are of the processor, whatever else it does."""
    print("| environment | steps/s | simulated s/s | reset [s] | a step |")
    print("|---|---:|---:|---:|---|")
    for name, make, step, what in ROWS:
        if name in NEEDS and importlib.util.find_spec(NEEDS[name]) is None:
            continue
        # In a process of its own: SUMO cannot be both a library of ours and what another package steers.
        with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as process:
            rate, reset = process.submit(timed, make, seconds).result()
        print(f"| {name} | {rate:.0f} | {rate * step:.1f} | {reset:.2f} | {what} |", flush=True)


class Lesson(gymnasium.ActionWrapper[Any, Any, Any]):
    """Actions from -1 to 1 as accelerations of comfortable driving."""

    def __init__(self, environment: gymnasium.Env[Any, Any]) -> None:
        super().__init__(environment)
        self.action_space = gymnasium.spaces.Box(-1.0, 1.0, (1,), np.float32)

    def action(self, action: Any) -> Any:
        """Return the acceleration of an action [m/s2]."""
        acceleration = 0.5 * (STRONGEST - HARDEST) * action + 0.5 * (STRONGEST + HARDEST)
        return acceleration.astype(np.float32)


def trained() -> gymnasium.Env[Any, Any]:
    """Return the environment that PPO is trained in; an action holds for half a second."""
    return Lesson(ours(ticks_per_action=25))


def learn(seconds: float) -> None:
    """Train PPO for a time, and print how the drives of its policy without exploration end."""
    from stable_baselines3 import PPO
    from stable_baselines3.common.callbacks import BaseCallback
    from stable_baselines3.common.vec_env import SubprocVecEnv, VecMonitor, VecNormalize

    class Clock(BaseCallback):  # type: ignore[misc]
        """Ends the training when the time is over, and says every minute how far it is."""

        begun, said = time.monotonic(), 0

        def _on_step(self) -> bool:
            spent = time.monotonic() - self.begun
            if spent > 60.0 * (self.said + 1):
                self.said += 1
                print(
                    f"\r{spent:.0f} of {seconds:.0f} s: {self.num_timesteps} steps", end="", file=sys.stderr, flush=True
                )
            return spent < seconds

    vector = VecNormalize(VecMonitor(SubprocVecEnv([trained] * 2)), clip_obs=5.0)
    model = PPO(
        "MlpPolicy", vector, learning_rate=5e-4, n_steps=128, batch_size=64, gamma=0.99, seed=1, device="cpu",
        policy_kwargs={"log_std_init": -0.7},
    )  # fmt: skip
    model.learn(10**9, callback=Clock())
    print(file=sys.stderr)
    judge(model, vector, model.num_timesteps)
    vector.close()


def judge(model: Any, vector: Any, steps: int) -> None:
    """Print the ends of a few drives."""
    environment, gaps, outcomes = trained(), [], []
    for seed in SEEDS:
        observed, over = environment.reset(seed=seed)[0], False
        while not over:
            action, _state = model.predict(vector.normalize_obs(observed), deterministic=True)
            observed, _reward, terminated, truncated, info = environment.step(action)
            over = terminated or truncated
        outcomes.append(info["outcome"])
        gaps.append(info["figures"]["stop_gap_m"] or np.nan)
    environment.close()
    passed = sum(4.5 <= gap <= 5.5 for gap in gaps)
    ends = ", ".join(f"{outcomes.count(one)} {one}" for one in sorted(set(outcomes)))
    print(
        f"after {steps} steps: {ends}; {passed} of {len(gaps)} at 4.5 to 5.5 m: {' '.join(f'{g:.1f}' for g in gaps)}",
        flush=True,
    )


def main() -> None:
    """Print the table, or what was learnt."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=20.0, help="of processor time, for each environment [s]")
    parser.add_argument("--learn", type=float, metavar="SECONDS", help="train PPO instead")
    parser.add_argument("--smoke", action="store_true", help="a tiny amount of work, whose figures say nothing")
    arguments = parser.parse_args()
    if arguments.learn is not None:
        learn(arguments.learn)
    else:
        table(1.0 if arguments.smoke else arguments.seconds)


if __name__ == "__main__":
    main()
