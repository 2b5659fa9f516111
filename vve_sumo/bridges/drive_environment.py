"""A drive as an environment of gymnasium: one ego, whose acceleration, and steering if asked for, an agent commands.

The only module of the package that imports gymnasium, with `environments`, which registers it. How a drive is run is
`agent_session`'s and `agent_process`' matter.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import gymnasium
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from vve_sumo.bridges.agent_link import AgentAction
from vve_sumo.bridges.agent_process import DRIVER, order
from vve_sumo.bridges.agent_reward import reward_of_end, reward_of_progress
from vve_sumo.bridges.agent_session import AgentSession
from vve_sumo.bridges.observed_numbers import FEATURES, HIGH, LOW, REMAINING
from vve_sumo.drive.run import resolve_by_name, table_by_name
from vve_sumo.drive.termination import Outcome
from vve_sumo.errors import ConfigError, SimulationError
from vve_sumo.record.writer import require_empty_folder
from vve_sumo.scenario.load import parse
from vve_sumo.scenario.schema import Criteria
from vve_sumo.sweep.job import Job

#: scenario seeds that are drawn where `reset` is given none lie below it
SEEDS: Final = 2**31
#: of a sweep's run, time [s] and memory [MB]; a drive that waits for an agent has neither
NO_LIMIT: Final = 1e9
_DESIRED_SPEED: Final = [feature.name for feature in FEATURES].index("desired_speed_mps")

Vector = NDArray[np.float32]


class DriveEnvironment(gymnasium.Env[Vector, Vector]):
    """A scenario that an agent drives in lockstep, in processes of its own; each episode is one drive.

    Observations are the numbers of `FEATURES`. An action is the acceleration [m/s2], then, if the agent steers, the
    road-wheel angle [rad], left positive; it holds for `ticks_per_action` ticks of 20 ms.
    """

    metadata: dict[str, Any] = {"render_modes": []}  # noqa: RUF012 - as gymnasium declares it

    def __init__(
        self,
        scenario: str | Path = "parked_car",
        *,
        agent_steers: bool = False,
        ticks_per_action: int = 5,
        values: Mapping[str, Any] | None = None,
        controller: str | None = None,
        vehicle: str | None = None,
        records: str | Path | None = None,
        render_mode: str | None = None,
    ) -> None:
        """Read a scenario, by name or file; raises ConfigError for what is missing or wrong.

        `values` are those of dotted keys of the scenario, or of parameters that it declares. Unless the agent steers,
        `controller`, by default the scenario's, does. Each episode leaves a record in a folder below `records`, which
        has to be absent or empty; by default there are none.
        """
        if ticks_per_action < 1:
            raise ConfigError(f"ticks_per_action: expected at least 1, got {ticks_per_action}")
        if render_mode is not None:
            raise ConfigError(f"render_mode: expected None, got {render_mode!r}: look at a record with vve-sumo view")
        self.render_mode = None
        self._working, self._name = Path.cwd(), str(scenario)
        self._values, self._controller, self._vehicle = dict(values or {}), controller, vehicle
        self._agent_steers, self._ticks_per_action = agent_steers, ticks_per_action
        resolved = resolve_by_name(
            self._name, self._working, controller=controller, vehicle=vehicle, values=self._values
        )
        resolved.own_metrics()
        self._records = None if records is None else Path(records).absolute()
        if self._records is not None:
            require_empty_folder(self._records)
        steering = resolved.vehicle.steering_limit
        low, high = [-resolved.vehicle.deceleration_limit], [resolved.model.limits.comfort.acceleration]
        if agent_steers:
            low, high = [*low, -steering], [*high, steering]
        self.action_space = spaces.Box(np.array(low, np.float32), np.array(high, np.float32), dtype=np.float32)
        self.observation_space = spaces.Box(LOW, HIGH, dtype=np.float32)
        self._session: AgentSession | None = None
        self._criteria: Criteria
        self._observation: Vector | None = None  # None: no drive is under way
        self._record: Path | None = None
        self._episodes = 0

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Vector, dict[str, Any]]:
        """Begin a drive; the one under way is interrupted.

        `seed` is the scenario's; without one it is drawn by the environment's own random numbers. `options` may hold
        `values` as at the construction, for this drive alone. Raises ConfigError for what is wrong with either.
        """
        super().reset(seed=seed)
        options = options or {}
        if unknown := sorted(options.keys() - {"values"}):
            raise ConfigError(f"options: expected values alone, got {', '.join(unknown)}")
        drawn = int(self.np_random.integers(SEEDS)) if seed is None else seed
        values = self._values | dict(options.get("values", {}))
        file, table = table_by_name(
            self._name,
            self._working,
            seed=drawn,
            controller=self._controller,
            vehicle=self._vehicle,
            values=values,
        )
        self._criteria = parse(table, file).criteria
        self._session = self._session or AgentSession()
        self._observation = None
        self._episodes += 1
        self._record = None if self._records is None else self._records / f"episode_{self._episodes:05d}"
        if self._records is not None:
            self._records.mkdir(parents=True, exist_ok=True)
        name = file.name.removesuffix(".toml")
        job = Job(
            key=name,
            name=name,
            table=table,
            file=file.absolute(),
            working=self._working,
            keep=self._record,
            time_limit_s=NO_LIMIT,
            memory_limit_mb=NO_LIMIT,
            driver=DRIVER,
            driven=order(self._session.address, self._ticks_per_action, self._agent_steers),
        )
        self._observation = self._session.begin(job)
        return self._observation, {"seed": drawn}

    def step(self, action: Vector) -> tuple[Vector, float, bool, bool, dict[str, Any]]:
        """Act, drive on for `ticks_per_action` ticks or to the drive's end, and return what came of it.

        The drive's end is a termination, with the scenario's time out a truncation; `info` then holds its `outcome`,
        whether it `passed`, its `figures` and, if there is one, its `record`. An action beyond the space's bounds is
        cut to them. Raises ConfigError for one of another shape or that is not finite, SimulationError where the drive
        broke.
        """
        if self._observation is None or self._session is None:
            raise gymnasium.error.ResetNeeded("the drive is over, or none has begun: call reset")
        before, wanted = self._observation, self._checked(action)
        self._observation = None  # a step that is interrupted leaves a drive that nobody can go on with
        steering = wanted[1] if self._agent_steers else 0.0
        after = self._session.act(AgentAction(wanted[0], steering))
        if after is None:
            return self._ended(before)
        self._observation = after
        driven = float(before[REMAINING]) - float(after[REMAINING])
        return after, reward_of_progress(driven, float(after[_DESIRED_SPEED])), False, False, {}

    def close(self) -> None:
        """End the drive under way and the environment's processes."""
        if self._session is not None:
            self._session.close()
        self._session, self._observation = None, None

    def _checked(self, action: Vector) -> list[float]:
        """Return an action's numbers within the bounds of the space; raises ConfigError."""
        box = self.action_space
        assert isinstance(box, spaces.Box)
        asked = np.asarray(action, np.float32)
        if asked.shape != box.shape or not np.isfinite(asked).all():
            raise ConfigError(f"action: expected {box.shape[0]} finite number(s), got {action!r}")
        return np.clip(asked, box.low, box.high).astype(float).tolist()  # type: ignore[no-any-return]

    def _ended(self, last: Vector) -> tuple[Vector, float, bool, bool, dict[str, Any]]:
        assert self._session is not None
        result = self._session.result()
        if result.error:
            raise SimulationError(f"{self._name}: the drive came to no end: {result.error}")
        figures = result.figures
        truncated = figures["outcome"] == Outcome.TIMEOUT
        info = {"outcome": figures["outcome"], "passed": figures["passed"], "figures": figures}
        info |= {"record": str(self._record)} if self._record is not None else {}
        return last, reward_of_end(self._criteria, figures), not truncated, truncated, info
