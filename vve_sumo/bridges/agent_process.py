"""Drives for an agent in a run's own process: in the place of the scenario's controller, the agent is asked.

The drive is an ordinary one in lockstep: it waits inside its tick for the agent's action, so the action answers the
observation of the same tick. Knows nothing of gymnasium.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any, Final, Protocol

import numpy as np
from numpy.typing import NDArray

from vve_sumo.bridges.agent_link import AgentAction, AgentLink, LinkClosedError
from vve_sumo.bridges.observed_numbers import ObservationEncoder
from vve_sumo.controller import Controller
from vve_sumo.drive.brain import ExternalController
from vve_sumo.drive.resolved_scenario import ResolvedScenario
from vve_sumo.drive.run import Drive
from vve_sumo.sweep.job import Job, MetricValue
from vve_sumo.values import ControlCommand, Observation

#: this module's function that drives a job, as a job names it
DRIVER: Final = f"{__name__}:drive_with_agent"


def order(address: Path, ticks_per_action: int, agent_steers: bool) -> dict[str, Any]:
    """Return what the job of an agent's drive says beyond its scenario; the environment listens at the address."""
    return {"address": str(address), "ticks_per_action": ticks_per_action, "agent_steers": agent_steers}


def drive_with_agent(
    job: Job, resolved: ResolvedScenario, drive: Callable[[ExternalController], Drive]
) -> tuple[Drive, dict[str, MetricValue]]:
    """Drive a job by the agent's actions; it is interrupted where the environment gives the drive up."""
    own = resolved.controller(job.working)
    with closing(AgentLink.connect(Path(job.driven["address"]))) as link:
        agent = AgentController(
            own,
            link,
            ObservationEncoder(resolved.vehicle),
            ticks_per_action=job.driven["ticks_per_action"],
            agent_steers=job.driven["agent_steers"],
            comfort_deceleration=resolved.model.limits.comfort.deceleration,
        )
        return drive(ExternalController(None, agent)), {}


class Link(Protocol):
    """What carries observations to an agent, and its actions back."""

    def send_observation(self, observation: NDArray[np.float32]) -> None:
        """Send an observation; raises LinkClosedError."""
        ...

    def receive_action(self) -> AgentAction:
        """Wait for the action that answers; raises LinkClosedError."""
        ...


class AgentController:
    """Answers an observation with the agent's newest action, for which it waits every so many ticks.

    Before drive time 0 of a rolling start, the scenario's own controller drives.
    """

    faults: tuple[str, ...] = ()
    overdue = ""

    def __init__(
        self,
        own: Controller,
        link: Link,
        encoder: ObservationEncoder,
        *,
        ticks_per_action: int,
        agent_steers: bool,
        comfort_deceleration: float,
    ) -> None:
        """`own` is the scenario's controller, which steers unless the agent does.

        An action that brakes harder than `comfort_deceleration` [m/s2] asks for the emergency envelope.
        """
        self._own, self._link, self._encoder = own, link, encoder
        self._ticks_per_action, self._agent_steers = ticks_per_action, agent_steers
        self._comfort_deceleration = comfort_deceleration
        self._action = AgentAction(0.0, 0.0)
        self._ticks_left = 0

    def step(self, observation: Observation) -> ControlCommand:
        """Return the agent's command; raises KeyboardInterrupt, which ends the drive, where the agent is gone."""
        if observation.time < 0.0:
            return self._own.step(observation)
        if self._ticks_left == 0:
            self._ticks_left, self._action = self._ticks_per_action, self._ask(observation)
        self._ticks_left -= 1
        acceleration = self._action.acceleration
        steering = self._action.steering if self._agent_steers else self._own.step(observation).steering
        emergency = acceleration < -self._comfort_deceleration
        return ControlCommand(steering, acceleration, emergency=emergency, note="agent")

    def require_answer(self) -> None:
        """Every action is waited for: nothing is overdue."""

    def _ask(self, observation: Observation) -> AgentAction:
        try:
            self._link.send_observation(self._encoder.encode(observation))
            action = self._link.receive_action()
        except LinkClosedError:
            raise KeyboardInterrupt from None
        # What is not finite is no action: the guard around every controller makes it a reason code.
        return action if all(map(math.isfinite, action)) else AgentAction(math.nan, math.nan)
