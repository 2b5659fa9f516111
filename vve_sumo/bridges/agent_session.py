"""One environment's drives, one after the other, each in a process of its own; a server forks them as a sweep's runs.

Knows jobs, actions and observations; neither gymnasium nor what the numbers mean.
"""

from __future__ import annotations

import select
import shutil
import tempfile
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vve_sumo.bridges.agent_link import AgentAction, AgentLink, LinkClosedError, listen
from vve_sumo.errors import ConfigError, SimulationError
from vve_sumo.sweep.job import CONFIG, Job, RunResult
from vve_sumo.sweep.worker import Worker


class AgentSession:
    """Starts drives, and carries actions and observations; always call `close`."""

    def __init__(self) -> None:
        self._folder = Path(tempfile.mkdtemp(prefix="vve_sumo_agent_"))  # for this user only
        self.address = self._folder / "link"  #: at which a drive of this session connects
        self._listening = listen(self.address)
        self._worker = Worker()
        self._link: AgentLink | None = None

    def begin(self, job: Job) -> NDArray[np.float32]:
        """Start a drive, ending the one before, and return its first observation.

        Raises ConfigError for a job that cannot be driven, SimulationError where the drive ends before it begins.
        """
        self.abandon()
        self._worker.submit(job)
        while True:
            if self._connects():
                self._link = AgentLink(self._listening.accept()[0])
                try:
                    return self._link.receive_observation()
                except LinkClosedError:
                    raise _error(self.result()) from None
            if (result := self._worker.result()) is not None:
                raise _error(result)

    def act(self, action: AgentAction) -> NDArray[np.float32] | None:
        """Let the agent act and return the next observation; None where the drive is over, whose `result` there is."""
        assert self._link is not None
        try:
            self._link.send_action(action)
            return self._link.receive_observation()
        except LinkClosedError:
            return None

    def result(self) -> RunResult:
        """Wait for the result of the drive, which is over or given up; raises SimulationError for a lost process."""
        self._close_link()
        while True:
            if self._connects():
                # The worker began the drive again because its server was killed: no agent knows of that drive.
                self._listening.accept()[0].close()
                self._worker.kill()
                raise SimulationError("the process that drives for the environment was killed")
            if (result := self._worker.result()) is not None:
                return result

    def _connects(self) -> bool:
        """Wait for a drive or for the worker; return whether a drive connects."""
        connects = self._listening.fileno()
        return connects in select.select([connects, self._worker.fileno()], [], [])[0]

    def abandon(self) -> None:
        """End the drive that is under way, if there is one; its record says that it was interrupted."""
        if self._worker.busy:
            self.result()

    def close(self) -> None:
        """End the drive and the processes, and delete the link."""
        self._close_link()
        self._worker.kill()
        self._listening.close()
        shutil.rmtree(self._folder, ignore_errors=True)

    def _close_link(self) -> None:
        if self._link is not None:
            self._link.close()
            self._link = None


def _error(result: RunResult) -> ConfigError | SimulationError:
    """Return the error that says why a drive did not begin."""
    if result.error.startswith(CONFIG):
        return ConfigError(result.error.removeprefix(CONFIG))
    error = SimulationError(f"the drive ended before it began: {result.error or result.figures.get('outcome')}")
    if result.said:
        error.add_note(result.said)
    return error
