"""Shrinks an episode that breaks an invariant to a simpler one that still breaks it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Final

from vve_sumo.hunt.draw import from_onset
from vve_sumo.hunt.episode import KEYS, Action, Episode, RoadConditions
from vve_sumo.hunt.runner import EpisodeResult
from vve_sumo.plant.injected_faults import Shape

#: rounds of simplifying; each keeps the simplest that still fails
MAX_ROUNDS: Final = 12
#: durations below which an action is not shortened [s]
SHORTEST: Final = 0.1

#: runs episodes and gives what came of each, in the same order
RunAll = Callable[[Sequence[Episode]], Sequence[EpisodeResult]]


def shrunk(result: EpisodeResult, invariant: str, run_all: RunAll) -> EpisodeResult:
    """Return the simplest result found that breaks the same invariant."""
    for _ in range(MAX_ROUNDS):
        simpler = list(candidates(result.episode))
        broken = (one for one in run_all(simpler) if invariant in one.broken)
        better = next(broken, None)
        if better is None:
            return result
        result = better
    return result


def candidates(episode: Episode) -> Iterator[Episode]:
    """Yield simpler neighbours of an episode, those that are simpler by much first."""
    actions = episode.actions
    for at in range(len(actions)):
        if len(actions) > 1:
            yield replace(episode, actions=from_onset(actions[:at] + actions[at + 1 :]))
    if episode.road != RoadConditions() or episode.seed != 1:
        yield replace(episode, road=RoadConditions(), seed=1)
    for at, action in enumerate(actions):
        for simpler in _simpler(action):
            yield replace(episode, actions=from_onset((*actions[:at], simpler, *actions[at + 1 :])))
    if (whole := float(round(episode.offset))) != episode.offset:
        yield replace(episode, offset=whole)


def _simpler(action: Action) -> Iterator[Action]:
    if action.shape is not Shape.STEP:
        yield replace(action, shape=Shape.STEP, period=float("nan"))
    if action.kind not in KEYS and action.duration / 2.0 >= SHORTEST:
        yield replace(action, duration=round(action.duration / 2.0, 2))
    if (after := round(action.after, 1)) != action.after:
        yield replace(action, after=after)
    if action.after >= SHORTEST:
        yield replace(action, after=round(action.after / 2.0, 1))
    if (value := round(action.value, 2)) != action.value and action.value == action.value:
        yield replace(action, value=value)
