"""Runs a hunt: pairs or a search, episode by episode into its folder, and shrinks what is found.

The only module of this package that reads the wall clock: to end in time.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from vve_sumo import workspace
from vve_sumo.drive.run import resolve_by_name
from vve_sumo.drive.several_egos import require_one_ego
from vve_sumo.errors import ConfigError
from vve_sumo.hunt.draw import pairs
from vve_sumo.hunt.episode import Episode, EpisodePhase
from vve_sumo.hunt.findings import Findings, HuntFinding
from vve_sumo.hunt.journal import FOUND, HuntJournal
from vve_sumo.hunt.judging import Tolerances
from vve_sumo.hunt.runner import EpisodeResult, run_many
from vve_sumo.hunt.search import BATCH, Search
from vve_sumo.hunt.shrink import shrunk
from vve_sumo.hunt.simulation import HuntSetup
from vve_sumo.live.assembly import scenario_with_rig
from vve_sumo.plant.injectable import injectable_kinds
from vve_sumo.plant.injected_faults import KINDS
from vve_sumo.record.hashes import hash_file
from vve_sumo.rig.load import load as load_rig

#: pairs that are driven together; they share the nominal drive
CHUNK: Final = 400
#: phases in which pairs are tried where none are named
PAIR_PHASES: Final = (EpisodePhase.DRIVING, EpisodePhase.BEND, EpisodePhase.BRAKING, EpisodePhase.AT_REST)


@dataclass(frozen=True, slots=True)
class HuntQuery:
    """What is asked of a hunt."""

    rig: str
    scenario: str
    out: Path
    seed: int = 1
    workers: int = 2
    pairs: bool = False
    phases: tuple[EpisodePhase, ...] = PAIR_PHASES
    episodes: int | None = None  #: at most so many, those of the runs before included
    hours: float | None = None  #: of this run, at most
    resume: bool = False


@dataclass(slots=True)
class HuntProgress:
    """How far a hunt has come."""

    total: int | None
    done: int = 0
    done_in_this_run: int = 0  #: in this run
    findings: int = 0
    seconds: float = 0.0  #: of this run
    last_found: int = 0  #: number of the episode that the newest finding came of

    @property
    def rate(self) -> float:
        """Return the episodes of this run an hour, the time for shrinking included."""
        return 3600.0 * self.done_in_this_run / max(self.seconds, 1e-3)

    def say(self) -> str:
        """Return how far it has come, on one line."""
        of = "" if self.total is None else f" of {self.total}"
        return f"{self.done}{of} episodes, {self.rate:.0f} an hour, {self.findings} found"


Watch = Callable[[HuntProgress], None]


def course_of(scenario: str, rig: str, working: Path) -> tuple[HuntSetup, Path]:
    """Return the course of a scenario and a rig, and the rig's file; raises ConfigError for what is unusable."""
    file = workspace.find("rig", rig, working)
    loaded = load_rig(file, working)
    if loaded.brain.kind != "own":
        raise ConfigError(f"{file}: brain.kind is {loaded.brain.kind!r}, expected 'own': a hunt drives the gateway")
    if loaded.faults:
        raise ConfigError(f"{file}: faults: a hunt injects its own; leave the rig's out")
    values: dict[str, Any] = {"road.demand": []}
    resolved = resolve_by_name(scenario, working, values=values)
    require_one_ego(resolved, "a hunt simulates one car, without SUMO")
    resolved = scenario_with_rig(resolved, loaded, working)
    return HuntSetup(resolved, loaded, working), file


class Hunt:
    """One run of a hunt."""

    def __init__(self, query: HuntQuery, working: Path, watch: Watch) -> None:
        """Read scenario and rig, and open the folder; raises ConfigError."""
        self.course, file = course_of(query.scenario, query.rig, working)
        self.rig_text = file.read_text(encoding="utf-8")
        self.query, self._watch = query, watch
        left_out = KINDS.keys() - injectable_kinds(self.course.resolved.model.interface)
        self.left_out = tuple(sorted(left_out))  #: kinds that cannot be injected through the rig's interface
        self.tolerances = Tolerances()
        asked: dict[str, Any] = {
            "scenario": query.scenario,
            "rig": query.rig,
            "rig_sha256": hash_file(file),
            "seed": query.seed,
            "mode": "pairs" if query.pairs else "search",
            "phases": [phase.value for phase in query.phases] if query.pairs else [],
        }
        self.journal = HuntJournal(query.out, asked, resume=query.resume)
        self.findings = Findings(query.out / FOUND)
        self._begun = time.monotonic()
        self.progress = HuntProgress(query.episodes)

    def run(self) -> None:
        """Hunt until the pairs are done, the episodes are driven, or the time is up."""
        try:
            if self.query.pairs:
                self._run_pairs()
            else:
                self._run_search()
        finally:
            self.journal.close()

    def _run_pairs(self) -> None:
        every = [pair for pair in pairs(self.query.phases, self.query.seed) if self._can_be_driven(pair[1])]
        every = every[: self.query.episodes]
        self.progress.total = len(every)
        for first in range(0, len(every), CHUNK):
            if self._over():
                return
            self._drive(every[first : first + CHUNK])

    def _run_search(self) -> None:
        search, number = Search(self.query.seed), 0
        while not self._over():
            batch = [episode for episode in search.batch() if self._can_be_driven(episode)]
            named = [(f"{number}/{at}", episode) for at, episode in enumerate(batch)]
            left = BATCH if self.query.episodes is None else self.query.episodes - self.progress.done
            results = self._drive(named[:left])
            search.learn(results)
            number += 1

    def _can_be_driven(self, episode: Episode) -> bool:
        return not any(action.kind in self.left_out for action in episode.actions)

    def _over(self) -> bool:
        query, done = self.query, self.progress.done
        if query.episodes is not None and done >= query.episodes:
            return True
        return query.hours is not None and time.monotonic() - self._begun > 3600.0 * query.hours

    def _drive(self, named: Sequence[tuple[str, Episode]]) -> list[EpisodeResult]:
        """Run the episodes that no run before has, take in all, and return what came of them in their order."""
        known = self.journal.results
        missing = [(name, episode) for name, episode in named if name not in known]
        for fresh, (name, result) in enumerate(self._run_named(missing), start=1):
            self.journal.add(name, result)
            self.progress.done_in_this_run += 1
            self._show(self.progress.done + fresh)
        results = [known[name] for name, _episode in named if name in known]
        for result in results:
            self.progress.done += 1
            self._take(result)
        return results

    def _run_named(self, missing: Sequence[tuple[str, Episode]]) -> Iterator[tuple[str, EpisodeResult]]:
        names: dict[str, list[str]] = {}
        for name, episode in missing:
            names.setdefault(_key(episode), []).append(name)
        episodes = [episode for _name, episode in missing]
        for result in run_many(self.course, episodes, self.tolerances, self.query.workers):
            yield names[_key(result.episode)].pop(), result

    def _take(self, result: EpisodeResult) -> None:
        for invariant in self.findings.new(result):
            simplest = shrunk(result, invariant, self._run_all)
            self.findings.keep(HuntFinding(invariant, simplest), self.rig_text)
            self.progress.findings, self.progress.last_found = len(self.findings.all), self.progress.done
            self._show(self.progress.done)

    def _run_all(self, episodes: Sequence[Episode]) -> list[EpisodeResult]:
        came = {_key(r.episode): r for r in run_many(self.course, episodes, self.tolerances, self.query.workers)}
        return [came[key] for key in map(_key, episodes) if key in came]

    def _show(self, done: int) -> None:
        progress = self.progress
        progress.seconds = time.monotonic() - self._begun
        self._watch(
            HuntProgress(
                progress.total,
                done,
                progress.done_in_this_run,
                progress.findings,
                progress.seconds,
                progress.last_found,
            )
        )


def _key(episode: Episode) -> str:
    return str(episode.to_dict())
