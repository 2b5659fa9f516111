"""SUMO started with a network and its traffic, and the lanes read from it: what every drive on a road begins with.

For a town that takes 0.3 s, and depends on nothing of a drive but its seed. So a process may load a road once and be
forked for each drive on it: in each fork SUMO goes on as if it had been started there.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

from vve_sumo.errors import SimulationError
from vve_sumo.world.lanes import Lanes, read_lanes
from vve_sumo.world.simulation import SUMO_ERRORS, Simulation


class RoadSource(NamedTuple):
    """All that decides what SUMO is like when it has started."""

    network: Path
    demand: tuple[Path, ...]
    seed: int
    period: float  #: of a step [s]


class LoadedRoad:
    """A road at SUMO's time 0, with nothing on it but what its files say."""

    def __init__(self, source: RoadSource) -> None:
        """Start SUMO and read the lanes; raises ConfigError and SimulationError as `Simulation` does."""
        self.source = source
        self.simulation = Simulation(source.network, source.demand, source.seed, source.period)
        try:
            self.lanes = Lanes(read_lanes(), 0.0)
        except BaseException as error:
            self.simulation.close()
            if isinstance(error, SUMO_ERRORS):
                raise SimulationError(f"{source.network}: SUMO does not say its lanes: {error}") from error
            raise

    @property
    def forkable(self) -> bool:
        """Whether drives in forks are as if each had started SUMO: not where they would share files that it writes."""
        return not self.simulation.may_write

    def inherit(self, source: RoadSource) -> None:
        """Begin a drive on it in a fork of the process that loaded it; raises SimulationError for another road."""
        if source != self.source:
            raise SimulationError(f"{source.network}: another road is loaded in this process")
        self.simulation.inherit()
