"""Runs episodes: a nominal drive, of which a child is forked at each episode's onset.

A child goes on with the very drive that its parent has got to, so an episode costs only what follows its onset, and is
the same as if it had been driven alone from the beginning.
"""

from __future__ import annotations

import gc
import json
import math
import os
import select
import signal
import traceback
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Final

from vve_sumo.drive.termination import Outcome
from vve_sumo.hunt.episode import Episode, EpisodePhase, RoadConditions
from vve_sumo.hunt.invariants import Judges
from vve_sumo.hunt.judging import Tolerances, Violation
from vve_sumo.hunt.simulation import EpisodeDrive, HuntSetup
from vve_sumo.hunt.truth import TruthSample
from vve_sumo.live.wording import DRIVING
from vve_sumo.timing import PERIOD
from vve_sumo.values import ArmingState
from vve_sumo.vehicle.arming import WAITING

#: an episode of a car that is still driven goes on for so long after its last action [s]
AFTERMATH: Final = 3.0
#: a car that is not driven any more has so long to come to rest [s]: a stop from the limit takes less
STOP_TIME: Final = 9.0
#: the longest episode, after its onset [s]
LONGEST: Final = 25.0
#: an episode ends so long after the car has come to rest and nothing more is to come [s]
QUIET: Final = 1.5
#: an episode goes on for so long after the first violation, which others may follow [s]
AFTER_VIOLATION: Final = 1.0
#: a nominal drive that has not come to a phase by then never will [s]
NOMINAL_LIMIT: Final = 240.0
#: curvature of the path that counts as a bend [1/m]
BEND: Final = 0.02
#: setpoint's deceleration that counts as braking, and distance before the obstacle [m/s2]
BRAKES: Final = -1.2


@dataclass(frozen=True, slots=True)
class EpisodeResult:
    """What came of an episode."""

    episode: Episode
    violations: tuple[Violation, ...]
    margins: dict[str, float]  #: least, by invariant
    outcome: str  #: that the drive would have had, empty where it had none yet
    reasons: tuple[str, ...]  #: of the gateway at the end
    seconds: float  #: simulated after the onset
    onset: float = 0.0  #: drive time of the onset [s]
    moved: float | None = None  #: drive time at which the car had first moved by then [s]
    failure: str = ""  #: traceback of an exception that escaped, which is a violation too

    @property
    def broken(self) -> tuple[str, ...]:
        """Return the names of the invariants that were broken."""
        return tuple(violation.invariant for violation in self.violations) + (("exception",) if self.failure else ())

    @property
    def margin(self) -> float:
        """Return the least margin of all."""
        return 0.0 if self.failure else min(self.margins.values(), default=1.0)

    def to_dict(self) -> dict[str, Any]:
        """Return plain JSON."""
        return {
            "episode": self.episode.to_dict(),
            "violations": [list(violation) for violation in self.violations],
            "margins": {name: round(margin, 4) for name, margin in self.margins.items()},
            "outcome": self.outcome,
            "reasons": list(self.reasons),
            "seconds": self.seconds,
            "onset_s": self.onset,
            "moved_s": self.moved,
            "failure": self.failure,
        }

    @classmethod
    def from_dict(cls, data: dict[str, Any]) -> EpisodeResult:
        """Return what `to_dict` gave."""
        return cls(
            Episode.from_dict(data["episode"]),
            tuple(Violation(*violation) for violation in data["violations"]),
            data["margins"],
            data["outcome"],
            tuple(data["reasons"]),
            data["seconds"],
            data["onset_s"],
            data["moved_s"],
            data["failure"],
        )


class Phases:
    """Tells at each tick of a nominal drive which phases begin with it."""

    def __init__(self, simulation: EpisodeDrive) -> None:
        self._simulation = simulation
        self._begun: set[EpisodePhase] = set()
        self._moved = False

    def step(self, sample: TruthSample | None) -> list[EpisodePhase]:
        """Return the phases that begin with the next tick, by the sample of the last."""
        holds = self._holding(sample)
        new = [phase for phase in EpisodePhase if phase in holds and phase not in self._begun]
        self._begun.update(new)
        return new

    def _holding(self, sample: TruthSample | None) -> set[EpisodePhase]:
        if sample is None:
            return {EpisodePhase.ARMING}
        state, speed, drive = sample.state, sample.pose.speed, self._simulation
        self._moved |= speed > 1.0
        if state is ArmingState.STOPPED:
            return {EpisodePhase.STOPPED}
        if state is ArmingState.DISARMED and self._moved:
            return {EpisodePhase.RELEASED}
        if state is not ArmingState.ENGAGED:
            return set()
        if not sample.went:
            return {EpisodePhase.HELD} if WAITING in sample.reasons else {EpisodePhase.ENGAGING}
        if self._moved and speed < 0.01:
            return {EpisodePhase.AT_REST}
        holds = {EpisodePhase.DRIVING} if speed > 4.0 else set()
        path = drive.resolved.path
        if speed > 2.0 and drive.s == drive.s and abs(path.at(drive.s).curvature) > BEND:
            holds.add(EpisodePhase.BEND)
        obstacle = min((one.at_m for one in drive.resolved.scenario.obstacles), default=path.length)
        if drive.requested_acceleration < BRAKES and drive.s > obstacle - 60.0 and speed > 2.0:
            holds.add(EpisodePhase.BRAKING)
        return holds


Shown = Callable[[TruthSample, EpisodeDrive], None]


def finish(
    simulation: EpisodeDrive, episode: Episode, tolerances: Tolerances, show: Shown | None = None
) -> EpisodeResult:
    """Let an episode's actions set in now, go on to its end, and judge it."""
    begun, moved = simulation.now, simulation.moved
    simulation.begin(episode.actions)
    judges = Judges(simulation.rig, simulation.parameters, simulation.resolved.model.limits, tolerances)
    if simulation.operator.went:
        judges.went()
    last, quiet, sample = begun + min(episode.end, LONGEST - STOP_TIME), 0.0, None
    over = last + STOP_TIME
    last_set_in = begun + max((action.after for action in episode.actions), default=0.0)
    while simulation.now < over - PERIOD / 2:
        sample = simulation.step()
        judges.step(sample)
        if show is not None:
            show(sample, simulation)
        if judges.violations:
            over = min(over, judges.violations[0].time + AFTER_VIOLATION)
        if sample.phase == DRIVING and sample.time > last + AFTERMATH:
            break
        still = abs(sample.pose.speed) < 0.01 and sample.time > last_set_in
        idle = sample.state not in (ArmingState.ENGAGED, ArmingState.STOPPING) or simulation.outcome is not None
        quiet = quiet + PERIOD if still and idle else 0.0
        if quiet > QUIET:
            break
    outcome: Outcome | None = simulation.outcome
    judges.end(simulation.now, outcome, simulation.ended_because)
    return EpisodeResult(
        episode,
        tuple(v._replace(time=round(v.time - begun, 3)) for v in judges.violations),
        judges.margins,
        "" if outcome is None else outcome.value,
        () if sample is None else tuple(sample.reasons),
        round(simulation.now - begun, 3),
        round(begun, 3),
        None if math.isnan(moved) else round(moved, 3),
    )


def run_alone(course: HuntSetup, episode: Episode, tolerances: Tolerances, show: Shown | None = None) -> EpisodeResult:
    """Run one episode from the beginning of its drive, in this process; raises LookupError for a phase never met."""
    for simulation, due in _onsets(course, episode.road, episode.seed, [episode]):
        for one in due:
            return finish(simulation, one, tolerances, show)
    raise LookupError(f"the nominal drive never comes to the phase {episode.phase.value!r}")


def run_many(
    course: HuntSetup, episodes: Iterable[Episode], tolerances: Tolerances, workers: int = 1
) -> Iterator[EpisodeResult]:
    """Run episodes, `workers` at a time, and yield what came of each, in no particular order.

    An episode whose phase the nominal drive never comes to yields nothing.
    """
    groups: dict[tuple[RoadConditions, int], list[Episode]] = defaultdict(list)
    for episode in episodes:
        groups[episode.road, episode.seed].append(episode)
    for (road, seed), group in groups.items():
        yield from _run_group(course, road, seed, group, tolerances, workers)


def _run_group(
    course: HuntSetup, road: RoadConditions, seed: int, group: list[Episode], tolerances: Tolerances, workers: int
) -> Iterator[EpisodeResult]:
    children: dict[int, tuple[int, Episode, bytearray]] = {}
    # A collection in the parent would touch, and so copy, every page that its children share with it.
    gc.collect()
    gc.freeze()
    try:
        for simulation, due in _onsets(course, road, seed, group):
            for episode in due:
                while len(children) >= workers:
                    yield from _collect(children)
                reader, child = _fork(simulation, episode, tolerances)
                children[reader] = child, episode, bytearray()
        while children:
            yield from _collect(children)
    finally:
        gc.unfreeze()
        for reader, (child, _episode, _data) in children.items():
            os.close(reader)
            os.kill(child, signal.SIGKILL)
            os.waitpid(child, 0)


def _onsets(
    course: HuntSetup, road: RoadConditions, seed: int, group: Sequence[Episode]
) -> Iterator[tuple[EpisodeDrive, list[Episode]]]:
    """Drive nominally, and yield the drive at every tick at which episodes of the group set in."""
    simulation = EpisodeDrive(course, road, seed)
    phases, waiting = Phases(simulation), defaultdict(list)
    due: dict[int, list[Episode]] = defaultdict(list)
    for episode in group:
        waiting[episode.phase].append(episode)
    sample = None
    while (waiting or due) and simulation.now < NOMINAL_LIMIT:
        for phase in phases.step(sample):
            for episode in waiting.pop(phase, ()):
                due[simulation.number + max(round(episode.offset / PERIOD), 0)].append(episode)
        if begun := due.pop(simulation.number, None):
            yield simulation, begun
        if waiting or due:
            sample = simulation.step()


def _fork(simulation: EpisodeDrive, episode: Episode, tolerances: Tolerances) -> tuple[int, int]:
    """Fork a child that finishes an episode; return the end of the pipe that its result comes by, and its number."""
    reader, writer = os.pipe()
    child = os.fork()
    if child:
        os.close(writer)
        return reader, child
    try:
        os.close(reader)
        gc.disable()
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        with os.fdopen(writer, "wb") as pipe:
            pipe.write(json.dumps(_guarded(simulation, episode, tolerances).to_dict()).encode())
    finally:
        os._exit(0)


def _guarded(simulation: EpisodeDrive, episode: Episode, tolerances: Tolerances) -> EpisodeResult:
    try:
        return finish(simulation, episode, tolerances)
    except Exception:
        return EpisodeResult(episode, (), {}, "", (), 0.0, failure=traceback.format_exc())


def _collect(children: dict[int, tuple[int, Episode, bytearray]]) -> Iterator[EpisodeResult]:
    """Wait for children and yield the results of those that have ended."""
    ready, _, _ = select.select(list(children), [], [])
    for reader in ready:
        child, episode, data = children[reader]
        if piece := os.read(reader, 1 << 16):
            data += piece
            continue
        del children[reader]
        os.close(reader)
        os.waitpid(child, 0)
        if data:
            yield EpisodeResult.from_dict(json.loads(data))
        else:
            yield EpisodeResult(episode, (), {}, "", (), 0.0, failure="the episode's process died")
